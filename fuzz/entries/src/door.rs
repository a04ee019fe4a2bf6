//! Target `door`: any bytes as requests to the executor, as announcements and as files of commands. What is no call is
//! refused; what is one is carried out and commands nothing outside of the limits. Run by the thread of the target.

use arbitrary::Unstructured;
use rcc_exec::queue::Order;
use rcc_ipc::control::{Answer, Call};
use rcc_ipc::{Announcement, wire};
use rcc_loader::server::store::CommandFile;

use crate::engine::Bench;

/// Requests of one input.
const CALLS_MAX: usize = 32;

/// Each request is its length in two bytes, and its bytes.
pub fn run(data: &[u8]) {
    if let Ok(announcement) = serde_json::from_slice::<Announcement>(data) {
        let _ = announcement.is_alive();
        let again =
            serde_json::to_vec(&announcement).and_then(|text| serde_json::from_slice(&text));
        assert!(again.is_ok_and(|again: Announcement| again == announcement));
    }
    // Readers take what they find or leave it.
    let _ = serde_json::from_slice::<CommandFile>(data);
    let _ = wire::decode_serde::<Answer>(data);
    let mut bench = Bench::new();
    let mut rest = data;
    for _ in 0..CALLS_MAX {
        let Some((length, tail)) = rest.split_first_chunk::<2>() else {
            break;
        };
        let length = usize::from(u16::from_le_bytes(*length)).min(tail.len());
        let (call, tail) = tail.split_at(length);
        rest = tail;
        if let Ok(call) = wire::decode_serde::<Call>(call) {
            let bytes = wire::encode_serde(&call);
            assert!(bytes.is_ok(), "what was decoded can be encoded");
            obey(&mut bench, call);
        }
        bench.step();
    }
    let mut what = Unstructured::new(rest);
    while !what.is_empty() && crate::plan::happen(&mut bench, 1, &mut what).is_ok() {
        bench.step();
    }
}

/// As the executor's intake thread does it.
fn obey(bench: &mut Bench, call: Call) {
    let answer = match call {
        Call::Reserve => bench.ask(|ticket| Order::Reserve { ticket }),
        Call::Reject { id } => bench.ask(|ticket| Order::Reject { ticket, id }),
        Call::Start { id } => bench.ask(|ticket| Order::Start { ticket, id }),
        Call::Cancel { id } => bench.ask(|ticket| Order::Cancel { ticket, id }),
        Call::Abort { id } => bench.ask(|ticket| Order::Abort { ticket, id }),
        Call::Unload { id } => bench.ask(|ticket| Order::Unload { ticket, id }),
        Call::Install { id, plan } => match bench.build(plan) {
            Ok(net) => bench.ask(|ticket| Order::Install { ticket, id, net }),
            Err(refusal) => {
                bench.ask(|ticket| Order::Reject { ticket, id });
                Some(Answer::Refused(refusal))
            }
        },
    };
    let answer = answer.unwrap_or_else(|| panic!("every call has an answer within its cycle"));
    assert!(wire::encode_serde(&answer).is_ok());
}
