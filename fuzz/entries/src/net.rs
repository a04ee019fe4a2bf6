//! Target `net`: any text at the loader. Never a panic, every fault has a place in the text, and what the loader accepts
//! the executor accepts and runs. Run by the thread of the target.

use rcc_config::diagnostic::{Faults, Severity};
use rcc_engine::queue::EngineRequest;
use rcc_ipc::control::Refusal;

use crate::engine::EngineHarness;
use crate::shipped::shipped;

/// Cycles that an accepted net runs.
const CYCLES: usize = 30;

/// Compiles the bytes as a text and runs it for some cycles.
pub fn run(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    match rcc_language::compile_for(text, "net.yaml", &shipped().table) {
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
                    harness.ask(|ticket| EngineRequest::Start { ticket, id });
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
                assert!(
                    fault.help.is_some(),
                    "it does not say what to do: {fault:?}"
                );
            }
        }
    }
}

/// Faults can be drawn, say something, and lie in their texts.
pub(crate) fn check_faults(faults: &Faults, refused: bool) {
    assert_eq!(
        faults.has_errors(),
        refused,
        "refused by faults, accepted without"
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
