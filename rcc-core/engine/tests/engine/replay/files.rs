//! Incident files: replayed as the recording was; damaged ones are refused, and hostile ones do no harm.

use rcc_engine::incident::{self, Incident, IncidentHead, IncidentParts};

use super::*;

/// The words of the incident file of a tape.
fn file(stage: &Recorded, tape: &RecordedTape) -> Vec<u64> {
    file_for(
        stage,
        tape,
        rcc_core::primitives::fingerprint(),
        incident::FORMAT,
    )
}

/// The words of the incident file of a tape, with a fingerprint of the catalogue and a version of the format.
fn file_for(stage: &Recorded, tape: &RecordedTape, catalogue: u64, format: u32) -> Vec<u64> {
    let nets: Vec<_> = stage
        .nets
        .iter()
        .map(|(id, origin)| (*id, origin))
        .collect();
    let head = IncidentHead {
        format,
        layout: incident::layout(),
        catalogue: rcc_protocol::events::hex_digits(catalogue),
        configuration: rcc_protocol::events::hex_digits(CONFIGURATION),
        ..IncidentHead::default()
    };
    let parts = IncidentParts {
        files: &[(1, b"{\"net\": \"odd length\"}")],
        models: &stage.fixture.models,
        nets: &nets,
        ring: &tape.recording.ring,
    };
    let mut bytes = Vec::new();
    incident::write(&mut bytes, head, &parts).expect("a Vec takes everything");
    let words = bytes
        .chunks(8)
        .map(|word| word.try_into().expect("whole words"));
    words.map(u64::from_le_bytes).collect()
}

fn replay_file(words: &[u64]) -> Result<Vec<NetReplayResult>, String> {
    let incident = Incident::parse(words).map_err(|error| error.to_string())?;
    let source = ReplaySource {
        models: &incident.models,
        configuration: incident.configuration,
        nets: &incident.nets,
        words: &incident.records,
    };
    replay(&source, None, |_| ()).map_err(|error| error.to_string())
}

#[test]
fn an_incident_file_is_replayed_as_the_recording_was() {
    for seed in 1..40 {
        let mut random = Rng::with_seed(seed);
        let mut stage = Recorded::new(4 << 20);
        let mut ids = Vec::new();
        while ids.len() < 4 {
            let plan = random::net(&mut random, &stage.fixture.models, CONFIGURATION);
            ids.extend(stage.load(plan));
        }
        ids.extend(stage.load(line_net()));
        ids.iter().for_each(|id| stage.start(*id));
        live(&mut random, &mut stage, &ids);
        let tape = stage.freeze();
        let words = file(&stage, &tape);
        assert_eq!(
            replay_file(&words),
            Ok(stage.replay(&tape.words)),
            "seed {seed}"
        );
        let found = incident::overview(&tape.recording.ring);
        let evaluated = stage
            .replay(&tape.words)
            .into_iter()
            .map(|result| result.id);
        assert!(found.nets.iter().copied().eq(evaluated), "{found:?}");
        assert_eq!(found.last_cycle, tape.recording.trigger.cycle + 200);
    }
}

#[test]
fn files_of_other_formats_are_refused_in_words() {
    let mut stage = Recorded::new(4 << 20);
    let id = stage.load(line_net()).expect("a net");
    stage.start(id);
    stage.fixture.steps(50);
    let tape = stage.freeze();
    let catalogue = rcc_core::primitives::fingerprint();
    for format in 0..12 {
        let words = file_for(&stage, &tape, catalogue, format);
        match format {
            incident::FORMAT => assert_eq!(replay_file(&words), Ok(stage.replay(&tape.words))),
            _ => {
                let told = replay_file(&words).expect_err("another format");
                assert!(told.contains(&format!("format {format}")), "{told}");
                assert!(told.contains("replay it with that build"), "{told}");
            }
        }
    }
}

#[test]
fn a_damaged_file_is_refused_and_a_hostile_one_does_no_harm() {
    let (stage, tape) = analog_tape();
    let words = file(&stage, &tape);
    let mut random = Rng::with_seed(7);
    for _ in 0..200 {
        let mut bad = words.clone();
        let at = random.below(bad.len());
        bad[at] ^= 1 << random.below(64);
        assert!(Incident::parse(&bad).is_err(), "word {at}");
        assert!(Incident::parse(&words[..random.below(words.len())]).is_err());
    }
    // With a valid checksum over any content; mostly in the part before the records.
    let early = 200;
    for round in 0..2000 {
        let mut bad = words.clone();
        for _ in 0..1 + random.below(3) {
            let range = if round % 4 == 0 { bad.len() } else { early };
            let at = 2 + random.below(range - 3);
            bad[at] = match random.below(4) {
                0 => random.bits(),
                1 => bad[at] ^ 1 << random.below(64),
                2 => u64::MAX,
                _ => random.below(1000) as u64,
            };
        }
        let mut sum = WordChecksum::default();
        let (last, body) = bad.split_last_mut().expect("a file");
        body.iter().for_each(|word| sum.take(*word));
        *last = sum.end();
        // An error, a difference or no effect are all right: the test is that it returns.
        let _ = replay_file(&bad);
    }
}

#[test]
fn a_file_of_a_build_with_other_time_laws_is_refused_with_both_fingerprints() {
    let (stage, tape) = analog_tape();
    let ours = rcc_core::primitives::fingerprint();
    let error = replay_file(&file_for(&stage, &tape, ours ^ 1, incident::FORMAT))
        .expect_err("another build's");
    for words in [
        "other time laws",
        "replay it with the build that wrote it",
        &rcc_protocol::events::hex_digits(ours),
        &rcc_protocol::events::hex_digits(ours ^ 1),
    ] {
        assert!(error.contains(words), "{words}: {error}");
    }
}

#[test]
fn a_damaged_recording_is_an_error_or_a_difference_and_never_a_panic() {
    let (stage, tape) = analog_tape();
    let mut random = Rng::with_seed(1);
    for _ in 0..300 {
        let length = 1 + random.below(3000);
        let from = random.below(tape.words.len() - length);
        let mut words = tape.words[from..from + length].to_vec();
        for _ in 0..4 {
            let at = random.below(words.len());
            words[at] = match random.below(3) {
                0 => random.bits(),
                1 => words[at] ^ 1 << random.below(64),
                _ => u64::MAX,
            };
        }
        let source = ReplaySource {
            models: &stage.fixture.models,
            configuration: CONFIGURATION,
            nets: &stage.nets,
            words: &words,
        };
        // Any result is right: the test is that it returns.
        let _ = replay(&source, None, |_| ());
    }
}
