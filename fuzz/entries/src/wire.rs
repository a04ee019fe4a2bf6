//! Target `wire`: arbitrary bytes as each message between loader and executor. Malformed messages must be refused; a
//! decoded message must stay the same when it is encoded and decoded again; a truncated or extended message must be
//! refused. Run by the thread of the target.

use rcc_protocol::control::{Answer, Call};
use rcc_protocol::wire::{Message, decode, encode};

/// Decodes the bytes as each message type.
pub fn run(data: &[u8]) {
    message::<Call>(data);
    message::<Answer>(data);
}

fn message<T: Message>(data: &[u8]) {
    let Ok(value) = decode::<T>(data) else {
        return;
    };
    let Ok(once) = encode(&value) else {
        panic!("a decoded message can be encoded");
    };
    let twice = decode::<T>(&once)
        .ok()
        .and_then(|value| encode(&value).ok());
    assert_eq!(twice.as_ref(), Some(&once), "encoding is stable");
    let longer = [&once[..], &[0]].concat();
    assert!(decode::<T>(&longer).is_err(), "trailing bytes are refused");
    let shorter = once.len().saturating_sub(1);
    assert!(
        decode::<T>(&once[..shorter]).is_err(),
        "a truncated message is refused"
    );
}
