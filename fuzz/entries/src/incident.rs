//! Target `incident`: arbitrary bytes as an incident file, or a real file with some words changed and a matching
//! checksum. Parsing and replay must end with a result or an error message. Run by libFuzzer's one thread, and by the
//! corpus test.

use std::sync::OnceLock;

use arbitrary::{Arbitrary, Result, Unstructured};
use bytemuck::Zeroable;
use rcc_core::frame::DeviceInput;
use rcc_core::message::Measurement;
use rcc_engine::hash::WordChecksum;
use rcc_engine::incident::{self, Incident, IncidentHead, IncidentParts};
use rcc_engine::net::Net;
use rcc_engine::record::{EvaluationRecord, FlightRecorder, FlightRecorderConfig, TriggerReason};
use rcc_engine::replay::{ReplaySource, replay};
use rcc_engine::rows::RowIndex;
use rcc_protocol::control::PlanData;
use rcc_protocol::events::hex_digits;

use crate::shipped::{HOLD, shipped};

/// Returns a real incident file with the plans of the shipped nets and a few records.
fn real() -> &'static [u64] {
    static REAL: OnceLock<Vec<u64>> = OnceLock::new();
    REAL.get_or_init(make)
}

fn make() -> Vec<u64> {
    let cell = shipped();
    let hold = |_| Some(HOLD);
    let holds: Vec<_> = cell.models.iter().map(hold).collect();
    let build = |plan: &PlanData| {
        let configuration = plan.configuration;
        Net::build(plan.clone(), &cell.models, configuration, &holds, 1e-3).ok()
    };
    let mut nets: Vec<_> = cell.plans.iter().filter_map(build).collect();
    let origins: Vec<_> = nets.iter().map(|net| net.origin()).collect();
    let config = FlightRecorderConfig {
        span_ns: 1_000_000_000,
        memory: 1 << 20,
        period_ns: 1_000_000,
    };
    let (mut recorder, mut helper) = FlightRecorder::new(config, cell.models.len());
    let absent = DeviceInput {
        present: false,
        measurement: Measurement::zeroed(),
    };
    let inputs = vec![absent; cell.models.len()];
    recorder.trigger(TriggerReason::Request);
    let mut cycle = 0;
    let recording = loop {
        if let Ok(recording) = helper.recordings.pop() {
            break recording;
        }
        cycle += 1;
        // They never change.
        recorder.begin(cycle, cycle * 1_000_000, (&inputs, 0));
        for (row, net) in RowIndex::all().zip(&mut nets) {
            let begins = net.cycles == 0;
            let evaluation = net.evaluate(&cell.models, &inputs, 1e-3);
            let evaluated = EvaluationRecord {
                row,
                id: row.number() as u64 + 1,
                net,
                evaluation,
                begins,
                cancel: false,
                dt_s: 1e-3,
            };
            recorder.net(evaluated, &inputs);
        }
        recorder.end(0, 0, 0);
    };
    let head = IncidentHead {
        format: incident::FORMAT,
        layout: incident::layout(),
        catalogue: hex_digits(rcc_core::primitives::fingerprint()),
        configuration: hex_digits(cell.plans[0].configuration),
        ..IncidentHead::default()
    };
    let nets: Vec<_> = (1..).zip(&origins).collect();
    let parts = IncidentParts {
        files: &[(1, b"{}")],
        models: &cell.models,
        nets: &nets,
        ring: &recording.ring,
    };
    let mut bytes = Vec::new();
    assert!(incident::write(&mut bytes, head, &parts).is_ok());
    words(&bytes)
}

fn words(bytes: &[u8]) -> Vec<u64> {
    let (words, _) = bytes.as_chunks();
    words.iter().map(|word| u64::from_le_bytes(*word)).collect()
}

/// Checks one input.
pub fn run(data: &[u8]) {
    if let Ok(file) = changed(&mut Unstructured::new(data)) {
        look(&file);
    }
    look(&words(data));
}

/// Returns the real file with some words changed and a correct checksum.
fn changed(bytes: &mut Unstructured<'_>) -> Result<Vec<u64>> {
    let mut file = real().to_vec();
    let last = file.len() - 1;
    for _ in 0..bytes.int_in_range(0..=6)? {
        let at = bytes.int_in_range(0..=last - 1)?;
        file[at] = match bytes.int_in_range(0..=2)? {
            0 => u64::arbitrary(bytes)?,
            1 => file[at] ^ 1 << bytes.int_in_range(0..=63)?,
            _ => bytes.int_in_range(0..=300)?,
        };
    }
    let mut sum = WordChecksum::default();
    file.iter().take(last).for_each(|word| sum.take(*word));
    file[last] = sum.end();
    Ok(file)
}

fn look(file: &[u64]) {
    let incident = match Incident::parse(file) {
        Ok(incident) => incident,
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    let source = ReplaySource {
        models: &incident.models,
        configuration: incident.configuration,
        nets: &incident.nets,
        words: &incident.records,
    };
    match replay(&source, None, |_| ()) {
        Err(error) => assert!(!error.to_string().is_empty()),
        Ok(results) => {
            assert!(
                results
                    .iter()
                    .all(|result| result.different <= result.compared)
            );
        }
    }
}
