//! Opens the Zenoh session of a process: explicit endpoints, no multicast, and a lease that is short enough to connect again
//! soon after a cut. Zenoh's own threads run it.

use zenoh::{Config, Session, Wait};

/// Time without a sign of life after which a connection is closed, ms. A shorter one would close connections of a machine
/// that is merely busy.
const LEASE_MS: u32 = 2000;
/// Signs of life in that time.
const KEEP_ALIVES: u32 = 8;
/// Time between attempts to connect, first and longest, ms.
const RETRY_MS: [u32; 2] = [100, 1000];

/// Why there is no session.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The configuration is refused.
    #[error("the link cannot be configured: {0}")]
    Config(String),
    /// The session cannot be opened.
    #[error("the link cannot be opened: {0}")]
    Open(String),
    /// A subscription or token cannot be declared.
    #[error("the link cannot be used: {0}")]
    Declare(String),
}

/// Opens a session that listens at and connects to these endpoints, and connects again for ever.
///
/// # Errors
/// Fails if an endpoint is invalid or cannot be listened at. A peer that does not answer is not an error.
pub fn open(listen: &[String], connect: &[String]) -> Result<Session, SessionError> {
    let mut config = Config::default();
    let [first, longest] = RETRY_MS;
    let rows = [
        ("mode", "\"peer\"".to_owned()),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        ("listen/endpoints", texts(listen)),
        ("connect/endpoints", texts(connect)),
        ("connect/timeout_ms", "-1".to_owned()),
        ("connect/exit_on_failure", "false".to_owned()),
        (
            "connect/retry",
            format!(
                "{{period_init_ms: {first}, period_max_ms: {longest}, period_increase_factor: 2}}"
            ),
        ),
        ("open/return_conditions/connect_scouted", "false".to_owned()),
        ("transport/link/tx/lease", LEASE_MS.to_string()),
        ("transport/link/tx/keep_alive", KEEP_ALIVES.to_string()),
    ];
    for (key, value) in rows {
        let set = config.insert_json5(key, &value);
        set.map_err(|error| SessionError::Config(format!("{key}: {error}")))?;
    }
    zenoh::open(config)
        .wait()
        .map_err(|error| SessionError::Open(error.to_string()))
}

/// Returns a list of texts as JSON.
fn texts(list: &[String]) -> String {
    serde_json::Value::from(list.to_vec()).to_string()
}
