//! Target `net`: arbitrary text as a net. The loader must not panic, every fault must have a position in the text, and
//! the executor must accept and run what the loader accepts. Run by the thread of the target.

use rcc_config::diagnostic::{Faults, Severity};
use rcc_engine::queue::EngineRequest;
use rcc_protocol::control::Refusal;

use crate::engine::EngineHarness;
use crate::shipped::shipped;

/// Number of cycles that an accepted net runs, before and after CANCEL.
const CYCLES: usize = 30;

/// Compiles the bytes as a text and runs an accepted net for some cycles.
pub fn run(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    match rcc_directionet::compiler(&shipped().table).compile(text, "net.yaml") {
        Ok(compiled) => {
            check_faults(&compiled.warnings, false);
            let mut harness = EngineHarness::new();
            match harness.build(compiled.plan) {
                Err(Refusal::Plan(error)) => {
                    panic!("the executor refuses what the loader made: {error:?}")
                }
                Err(_) => {}
                Ok(net) => {
                    let id = harness.install(net).unwrap_or(0);
                    harness.ask(|ticket| EngineRequest::Start {
                        ticket,
                        id,
                        lease: 0,
                    });
                    (0..CYCLES).for_each(|_| harness.step());
                    harness.ask(|ticket| EngineRequest::Cancel { ticket, id });
                    (0..CYCLES).for_each(|_| harness.step());
                }
            }
        }
        Err(faults) => {
            check_faults(&faults, true);
            let errors = faults
                .diagnostics
                .iter()
                .filter(|fault| fault.severity == Severity::Error);
            for fault in errors {
                assert!(fault.help.is_some(), "an error without a remedy: {fault:?}");
            }
        }
    }
}

/// Checks that faults can be rendered, have a message, and lie within their texts.
pub(crate) fn check_faults(faults: &Faults, refused: bool) {
    assert_eq!(
        faults.has_errors(),
        refused,
        "a text is refused exactly if it has errors"
    );
    for fault in &faults.diagnostics {
        let text = &faults.sources[fault.file as usize].text;
        assert!(!fault.message.is_empty() && fault.code.starts_with("RCC"));
        if let Some(place) = fault.place {
            let inside = place.start <= place.end && place.end <= text.len();
            assert!(inside, "{}: {place:?} of {} bytes", fault.code, text.len());
            assert!(
                text.is_char_boundary(place.start) && text.is_char_boundary(place.end),
                "{fault:?}"
            );
        }
    }
    assert!(!faults.render(false).is_empty() || faults.diagnostics.is_empty());
    for row in faults.rows() {
        assert_eq!(row.line == 0, row.column == 0, "{row:?}");
    }
}
