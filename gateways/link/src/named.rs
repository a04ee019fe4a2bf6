//! Every message and request names its key itself, as Zenoh's attachment. Zenoh sends keys as numbers; when a connection is made
//! again while the other side still closes the old one, it may look a number up in the old table, and hand what arrives to the
//! reader of another key (eclipse-zenoh/zenoh#1886). Such a message is dropped, so that no value and no request takes the place of
//! another. Pure.

use zenoh::bytes::ZBytes;
use zenoh::query::Query;
use zenoh::sample::Sample;

/// Returns true if a message arrives under its own key.
#[must_use]
pub fn is_named(sample: &Sample) -> bool {
    is_key(sample.key_expr().as_str(), sample.attachment())
}

/// Returns true if a request arrives under its own key.
#[must_use]
pub fn is_asked(query: &Query) -> bool {
    is_key(query.key_expr().as_str(), query.attachment())
}

fn is_key(key: &str, attachment: Option<&ZBytes>) -> bool {
    let named = attachment.map(ZBytes::to_bytes);
    let is = named.as_deref() == Some(key.as_bytes());
    if !is {
        let named = named.as_deref().map(String::from_utf8_lossy);
        tracing::debug!(key, named = named.as_deref(), "dropped");
    }
    is
}
