//! Target `requests`: arbitrary bytes as requests to the executor, as announcements and as command files. Malformed
//! requests must be refused; valid ones are carried out and must command nothing outside the limits. Run by the thread of
//! the target.

use arbitrary::{Arbitrary, Result, Unstructured};
use rcc_api::command_file::CommandFile;
use rcc_core::message::CommandState;
use rcc_core::plan::ValuePoint;
use rcc_core::types::Store;
use rcc_engine::queue::{EngineRequest, ValueReading};
use rcc_protocol::control::{Answer, Call, InputValue, READ_ELEMENTS_MAX, SWITCH_MAX};
use rcc_protocol::rules::{NewRule, Rule, RuleTerm};
use rcc_protocol::{Announcement, wire};

use crate::engine::EngineHarness;
use crate::shipped::shipped;

/// Maximum number of requests per input.
const CALLS_MAX: usize = 32;

/// Each request consists of arbitrary bytes, or of a valid request with some bytes changed.
pub fn run(data: &[u8]) {
    if let Ok(announcement) = serde_json::from_slice::<Announcement>(data) {
        let _ = announcement.liveness();
        let again =
            serde_json::to_vec(&announcement).and_then(|text| serde_json::from_slice(&text));
        assert!(again.is_ok_and(|again: Announcement| again == announcement));
    }
    // Parsing may succeed or fail, but must not panic.
    let _ = serde_json::from_slice::<CommandFile>(data);
    let _ = wire::decode::<Answer>(data);
    let mut harness = EngineHarness::new();
    let mut bytes = Unstructured::new(data);
    for _ in 0..CALLS_MAX {
        let Ok(call) = request(&mut bytes) else {
            break;
        };
        if let Ok(call) = wire::decode::<Call>(&call) {
            assert!(wire::encode(&call).is_ok(), "a decoded call can be encoded");
            obey(&mut harness, call);
        }
        if crate::plan::apply_event(&mut harness, 1, &mut bytes).is_err() {
            break;
        }
        harness.step();
    }
}

fn request(bytes: &mut Unstructured<'_>) -> Result<Vec<u8>> {
    let id = bytes.int_in_range(0..=4)?;
    let call = match bytes.int_in_range(0..=9)? {
        0..=1 => Call::Reserve,
        2..=4 => {
            let plan = bytes.choose(&shipped().plans)?.clone();
            Call::Install { id, plan }
        }
        5 => Call::Start { id, lease: 0 },
        6 => bytes
            .choose(&[
                Call::Cancel { id },
                Call::Abort { id },
                Call::Switch {
                    stop: vec![id],
                    start: vec![id + 1],
                    lease: 0,
                },
                Call::Unload { id },
                Call::Reject { id },
                Call::Acknowledge,
                Call::InstallRules {
                    rules: vec![rule_about(id); 2],
                },
                Call::RemoveRule { id },
                Call::Rules { after: 0 },
                Call::GrantLease {
                    expires_ns: 60_000_000,
                },
                Call::RenewLease { lease: id },
                Call::BindLease {
                    lease: id,
                    commands: vec![id],
                },
                Call::EndLease { lease: id },
                Call::Set {
                    id,
                    values: vec![InputValue {
                        input: 0,
                        words: vec![0],
                    }],
                },
                Call::Read {
                    id,
                    points: vec![ValuePoint {
                        store: Store::Real,
                        slot: 0,
                        width: 7,
                    }],
                },
            ])?
            .clone(),
        _ => {
            let length = bytes.int_in_range(0..=200)?;
            return Ok(bytes.bytes(length.min(bytes.len()))?.to_vec());
        }
    };
    let mut call = wire::encode(&call).unwrap_or_default();
    for _ in 0..bytes.int_in_range(0..=3)? {
        let at = bytes.int_in_range(0..=call.len().max(1) - 1)?;
        if let Some(place) = call.get_mut(at) {
            *place = u8::arbitrary(bytes)?;
        }
    }
    Ok(call)
}

/// A rule that starts a command when it is ready.
fn rule_about(id: u64) -> NewRule {
    let mut rule = Rule {
        goes_on: true,
        ..Rule::EMPTY
    };
    let state = CommandState::Ready as u32;
    let term = RuleTerm::State { command: id, state };
    if let (Some(when), Some(start)) = (rule.when.first_mut(), rule.start.first_mut()) {
        (*when, *start) = (Some(term), id);
    }
    NewRule {
        rule,
        name: "fuzzed".to_owned(),
        when: String::new(),
    }
}

/// Carries out a call as the executor's intake thread does.
fn obey(harness: &mut EngineHarness, call: Call) {
    let answer = match call {
        Call::Reserve => harness.ask(|ticket| EngineRequest::Reserve { ticket }),
        Call::Reject { id } => harness.ask(|ticket| EngineRequest::Reject { ticket, id }),
        Call::Start { id, lease } => {
            harness.ask(|ticket| EngineRequest::Start { ticket, id, lease })
        }
        Call::Switch { stop, start, lease } => {
            let named = |ids: &[u64]| {
                let mut list = [0; SWITCH_MAX];
                list.iter_mut()
                    .zip(ids)
                    .for_each(|(place, id)| *place = *id);
                list
            };
            let (stop, start) = (named(&stop), named(&start));
            harness.ask(|ticket| EngineRequest::Handover {
                ticket,
                stop,
                start,
                lease,
            })
        }
        Call::Set { id, values } => harness.ask(|ticket| EngineRequest::Set { ticket, id, values }),
        Call::Read { id, points } => {
            let widths = points.iter().map(|point| u64::from(point.width));
            if widths.sum::<u64>() > READ_ELEMENTS_MAX as u64 {
                return;
            }
            let reading = ValueReading::of(points);
            harness.ask(|ticket| EngineRequest::Read {
                ticket,
                id,
                reading,
            })
        }
        Call::Cancel { id } => harness.ask(|ticket| EngineRequest::Cancel { ticket, id }),
        Call::Abort { id } => harness.ask(|ticket| EngineRequest::Abort { ticket, id }),
        Call::Unload { id } => harness.ask(|ticket| EngineRequest::Unload { ticket, id }),
        Call::Record | Call::Recorded { .. } => {
            harness.ask(|ticket| EngineRequest::Record { ticket })
        }
        Call::Acknowledge => harness.ask(|ticket| EngineRequest::Acknowledge { ticket }),
        Call::InstallRules { rules } => {
            let rules = rules.into_iter().map(|rule| rule.rule).collect();
            harness.ask(|ticket| EngineRequest::InstallRules { ticket, rules })
        }
        Call::RemoveRule { id } => harness.ask(|ticket| EngineRequest::RemoveRule { ticket, id }),
        Call::Rules { after } => {
            let list = Vec::with_capacity(8);
            harness.ask(|ticket| EngineRequest::ListRules {
                ticket,
                after,
                list,
            })
        }
        Call::GrantLease { expires_ns } => {
            harness.ask(|ticket| EngineRequest::GrantLease { ticket, expires_ns })
        }
        Call::RenewLease { lease } => {
            harness.ask(|ticket| EngineRequest::RenewLease { ticket, lease })
        }
        Call::EndLease { lease } => harness.ask(|ticket| EngineRequest::EndLease { ticket, lease }),
        Call::BindLease { lease, commands } => {
            let mut list = [0; SWITCH_MAX];
            list.iter_mut()
                .zip(&commands)
                .for_each(|(place, id)| *place = *id);
            harness.ask(|ticket| EngineRequest::BindLease {
                ticket,
                lease,
                commands: list,
            })
        }
        Call::Install { id, plan } => match harness.build(plan) {
            Ok(net) => harness.ask(|ticket| EngineRequest::Install { ticket, id, net }),
            Err(refusal) => {
                harness.ask(|ticket| EngineRequest::Reject { ticket, id });
                Some(Answer::Refused(refusal))
            }
        },
    };
    let answer = answer.unwrap_or_else(|| panic!("every call has an answer within its cycle"));
    assert!(wire::encode(&answer).is_ok());
}
