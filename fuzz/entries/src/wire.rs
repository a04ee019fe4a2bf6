//! Target `wire`: any bytes as each message between loader and executor. What is none is refused; what is one is the same
//! after it was sent again; a message that is cut or continued is none. Run by the thread of the target.

use rcc_ipc::control::{Answer, Call};
use rcc_ipc::wire::{Message, decode, encode};

/// As each type.
pub fn run(data: &[u8]) {
    message::<Call>(data);
    message::<Answer>(data);
}

fn message<T: Message>(data: &[u8]) {
    let Ok(value) = decode::<T>(data) else {
        return;
    };
    let Ok(once) = encode(&value) else {
        panic!("what was decoded can be encoded");
    };
    let twice = decode::<T>(&once)
        .ok()
        .and_then(|value| encode(&value).ok());
    assert_eq!(twice.as_ref(), Some(&once), "it is the same again");
    let longer = [&once[..], &[0]].concat();
    assert!(decode::<T>(&longer).is_err(), "nothing follows it");
    let shorter = once.len().saturating_sub(1);
    assert!(
        decode::<T>(&once[..shorter]).is_err(),
        "its last byte counts"
    );
}
