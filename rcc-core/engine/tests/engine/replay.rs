//! Recording and replay in virtual time: 1,000 random nets, the content of a full ring, and that differences are found.

mod files;
mod random;

use std::collections::BTreeMap;

use crate::common::{EngineFixture, HOLD, line_net, model, output_net, start_of, time_net};
use rcc_core::frame::DeviceModel;
use rcc_core::message::{CommandState, DeviceState, EndReason, Measurement};
use rcc_core::plan::Rate;
use rcc_core::types::Store;
use rcc_engine::hash::WordChecksum;
use rcc_engine::net::{Net, NetOrigin};
use rcc_engine::queue::EngineRequest;
use rcc_engine::record::{
    FlightRecorder, FlightRecorderConfig, FlightRecorderHelper, FrozenRecording, TriggerReason,
};
use rcc_engine::replay::{MismatchKind, NetReplayResult, ReplaySource, replay};
use rcc_protocol::control::{Answer, PlanData};
use rcc_testing::{Random, Rng};

const CONFIGURATION: u64 = 5;
const ROOM: usize = 64 << 20;

/// A fixture whose engine is recorded, and the origins of its nets.
struct Recorded {
    fixture: EngineFixture,
    helper: FlightRecorderHelper,
    nets: BTreeMap<u64, NetOrigin>,
}

/// The data that a helper thread would write to a file.
struct RecordedTape {
    words: Vec<u64>,
    recording: FrozenRecording,
}

impl Recorded {
    fn new(memory: usize) -> Recorded {
        let io = DeviceModel {
            joints: 0,
            arm: None,
            ..model()
        };
        Recorded::of(vec![model(), io], memory)
    }

    fn of(models: Vec<DeviceModel>, memory: usize) -> Recorded {
        Recorded::for_span(models, memory, 10_000_000_000)
    }

    fn for_span(models: Vec<DeviceModel>, memory: usize, span_ns: u64) -> Recorded {
        let fixture = EngineFixture::of_cell(models, CONFIGURATION, HOLD);
        let config = FlightRecorderConfig {
            span_ns,
            memory,
            period_ns: fixture.period_ns,
        };
        let (recorder, helper) = FlightRecorder::new(config, fixture.models.len());
        Recorded {
            fixture: fixture.recorded_by(recorder),
            helper,
            nets: BTreeMap::new(),
        }
    }

    /// Makes a net ready; `None` if its start values do not exist.
    fn load(&mut self, plan: PlanData) -> Option<u64> {
        let net = self.fixture.build(plan).ok()?;
        let origin = net.origin();
        let Answer::Reserved { id } = self.fixture.ask(|ticket| EngineRequest::Reserve { ticket })
        else {
            panic!("no row")
        };
        self.fixture
            .ask(|ticket| EngineRequest::Install { ticket, id, net });
        self.nets.insert(id, origin);
        Some(id)
    }

    fn start(&mut self, id: u64) {
        self.fixture.order(start_of(id));
    }

    /// Freezes the recording and takes it.
    fn freeze(&mut self) -> RecordedTape {
        self.fixture
            .order(|ticket| EngineRequest::Record { ticket });
        self.fixture.steps(202);
        self.tape().expect("a recording")
    }

    fn tape(&mut self) -> Option<RecordedTape> {
        let recording = self.helper.recordings.pop().ok()?;
        let words = recording.ring.newest().concat();
        Some(RecordedTape { words, recording })
    }

    /// Returns the ring of a tape.
    fn give_back(&mut self, tape: RecordedTape) {
        let mut ring = tape.recording.ring;
        ring.clear();
        self.helper.spare.push(ring).expect("room for both rings");
    }

    fn replay(&self, words: &[u64]) -> Vec<NetReplayResult> {
        let source = ReplaySource {
            models: &self.fixture.models,
            configuration: CONFIGURATION,
            nets: &self.nets,
            words,
        };
        replay(&source, None, |_| ()).expect("a recording of this build")
    }
}

/// Asserts that all replays of a recording are identical; returns the number of compared cycles.
fn identical(results: &[NetReplayResult], seed: u64) -> u64 {
    for result in results {
        assert_eq!(result.mismatch, None, "seed {seed}: {result:?}");
        assert!(result.has_plan, "seed {seed}");
    }
    results.iter().map(|result| result.compared).sum()
}

#[test]
fn a_thousand_random_nets_are_replayed_to_the_bit() {
    let (mut nets, mut compared, mut recorded, mut with_motion, mut ended) = (0, 0, 0, 0, 0);
    let mut seed = 0;
    while nets < 1000 {
        seed += 1;
        let mut random = Rng::with_seed(seed);
        let mut stage = Recorded::new(4 << 20);
        let mut ids = Vec::new();
        while ids.len() < 8 {
            let plan = random::net(&mut random, &stage.fixture.models, CONFIGURATION);
            let checked = plan.plan().check(&stage.fixture.models, CONFIGURATION);
            assert!(checked.is_ok(), "seed {seed}: {checked:?}");
            with_motion += usize::from(plan.clocks > 0);
            ids.extend(stage.load(plan));
        }
        nets += ids.len();
        ids.iter().for_each(|id| stage.start(*id));
        for part in 0..2 {
            live(&mut random, &mut stage, &ids);
            let tape = stage.freeze();
            let results = stage.replay(&tape.words);
            compared += identical(&results, seed);
            recorded += results.iter().map(|result| result.recorded).sum::<u64>();
            // From START on in the first recording, from snapshots in the second.
            assert!(
                part == 1
                    || results
                        .iter()
                        .all(|result| result.compared == result.recorded)
            );
            stage.give_back(tape);
        }
        let over = |id: &&u64| stage.fixture.state(**id) == CommandState::Terminated;
        ended += ids.iter().filter(over).count();
    }
    println!(
        "{seed} seeds, {nets} nets, {with_motion} with motions, {ended} ended; {compared} of {recorded} cycles compared"
    );
    assert!(with_motion > 50 && ended > 100, "{with_motion} {ended}");
    assert!(
        compared > 200_000 && compared * 10 > recorded * 9,
        "{compared} of {recorded}"
    );
}

/// Some cycles with random inputs, device losses and requests.
fn live(random: &mut Rng, stage: &mut Recorded, ids: &[u64]) {
    for _ in 0..100 + random.below(100) {
        let fixture = &mut stage.fixture;
        random::measure(random, &mut fixture.driver.measurement);
        fixture
            .others
            .iter_mut()
            .for_each(|other| random::measure(random, other));
        fixture.driver.alive = !random.once_in(300);
        if random.once_in(20) {
            fixture.driver.measurement.state = DeviceState::Ready as u32;
        }
        if random.once_in(40) {
            let id = ids[random.below(ids.len())];
            match random.below(3) {
                0 => fixture.order(|ticket| EngineRequest::Cancel { ticket, id }),
                1 => fixture.order(start_of(id)),
                _ => fixture.order(|ticket| EngineRequest::Abort { ticket, id }),
            };
        }
        let (id, plan) = stage
            .nets
            .iter()
            .nth(random.below(stage.nets.len()))
            .expect("nets");
        if random.once_in(3)
            && let Some(value) = random::value(random, &plan.data.inputs)
        {
            fixture.order(|ticket| EngineRequest::Set {
                ticket,
                id: *id,
                values: vec![value],
            });
        }
        fixture.step();
        while fixture.ends.replies.pop().is_ok() {}
    }
}

#[test]
fn a_motion_is_replayed_from_start_through_cancel_to_its_end() {
    let mut stage = Recorded::new(ROOM);
    let id = stage.load(line_net()).expect("a line");
    stage.start(id);
    stage.fixture.steps(300);
    stage
        .fixture
        .order(|ticket| EngineRequest::Cancel { ticket, id });
    stage.fixture.steps(500);
    assert_eq!(stage.fixture.reason(id), EndReason::Canceled);
    let cycles = stage.fixture.entry(id).cycles;
    let tape = stage.freeze();
    let results = stage.replay(&tape.words);
    assert_eq!(identical(&results, 0), cycles);
}

#[test]
fn a_motion_is_replayed_from_a_snapshot_on_its_way() {
    let mut stage = Recorded::new(ROOM);
    let id = stage.load(line_net()).expect("a line");
    stage.start(id);
    stage.fixture.steps(50);
    let first = stage.freeze();
    stage.give_back(first);
    stage
        .fixture
        .order(|ticket| EngineRequest::Cancel { ticket, id });
    stage.fixture.steps(500);
    let tape = stage.freeze();
    let results = stage.replay(&tape.words);
    assert!(identical(&results, 0) > 50, "{results:?}");
    assert_eq!(
        results[0].compared + 1,
        results[0].recorded,
        "all after the snapshot"
    );
}

#[test]
fn a_full_ring_keeps_the_newest_cycles() {
    let mut stage = Recorded::new(2 << 20);
    let id = stage
        .load(time_net(Rate { every: 3, phase: 1 }))
        .expect("a net");
    stage.start(id);
    stage.fixture.steps(20_000);
    let tape = stage.freeze();
    let results = stage.replay(&tape.words);
    assert!(identical(&results, 0) > 100, "{results:?}");
    let last = stage.fixture.engine.status().cycle;
    assert!(results[0].span[1] + 5 > last, "{results:?}, now {last}");
    assert!(results[0].span[0] > 10_000, "{results:?}");
}

#[test]
fn a_fault_freezes_the_recording_and_a_burst_of_them_makes_one_more() {
    let mut stage = Recorded::new(ROOM);
    let line = stage.load(line_net()).expect("a line");
    stage.start(line);
    stage.fixture.steps(100);
    stage.fixture.driver.alive = false;
    stage.fixture.steps(400);
    let tape = stage.tape().expect("an incident");
    let TriggerReason::Fault { id, fault } = tape.recording.trigger.reason else {
        panic!("{:?}", tape.recording.trigger)
    };
    assert_eq!((id, fault.device), (line, 0));
    assert_eq!(fault.cycle, tape.recording.trigger.cycle);
    stage.give_back(tape);
    stage.fixture.driver.alive = true;
    for _ in 0..20 {
        let net = stage.load(output_net(0)).expect("a net");
        stage.start(net);
        stage.fixture.steps(5);
        stage.fixture.driver.alive = false;
        stage.fixture.steps(60);
        assert_eq!(stage.fixture.reason(net), EndReason::Fault);
        stage.fixture.driver.alive = true;
        stage.fixture.steps(5);
    }
    assert!(stage.tape().is_none(), "they wait for their time");
    stage.fixture.steps(5000);
    let tape = stage.tape().expect("one for all of them");
    assert_eq!(tape.recording.trigger.others, 19);
    assert!(identical(&stage.replay(&tape.words), 0) > 0);
    assert!(stage.tape().is_none());
}

#[test]
fn a_delayed_fault_is_in_its_recording_however_small_the_ring() {
    // The shortest spans; then a ring that is full after about a second.
    for (span_ns, memory) in [
        (2_000_000_000, ROOM),
        (1_000_000_000, ROOM),
        (10_000_000_000, 1 << 18),
    ] {
        let mut stage = Recorded::for_span(vec![model()], memory, span_ns);
        let fail = |stage: &mut Recorded| {
            stage.fixture.driver.alive = true;
            stage.fixture.steps(5);
            let net = stage.load(output_net(0)).expect("a net");
            stage.start(net);
            stage.fixture.steps(5);
            stage.fixture.driver.alive = false;
            stage.fixture.steps(60);
            assert_eq!(stage.fixture.reason(net), EndReason::Fault);
        };
        fail(&mut stage);
        stage.fixture.steps(300);
        let first = stage.tape().expect("an incident");
        stage.give_back(first);
        // Within the hold-off time after the first one.
        stage.fixture.steps(600);
        fail(&mut stage);
        stage.fixture.steps(6000);
        let tape = stage.tape().expect("another incident");
        let found = rcc_engine::incident::overview(&tape.recording.ring);
        let trigger = tape.recording.trigger;
        assert!(
            (found.first_cycle..=found.last_cycle).contains(&trigger.cycle),
            "{span_ns} ns, {memory} bytes: {found:?}, {trigger:?}"
        );
        assert!(matches!(trigger.reason, TriggerReason::Fault { .. }));
        stage.give_back(tape);
    }
}

#[test]
fn while_no_ring_is_free_a_trigger_waits_for_one() {
    let mut stage = Recorded::new(ROOM);
    let tape = stage.freeze();
    stage
        .fixture
        .order(|ticket| EngineRequest::Record { ticket });
    stage.fixture.steps(1000);
    assert!(stage.tape().is_none());
    stage.give_back(tape);
    stage.fixture.steps(2);
    assert!(stage.tape().is_some());
}

/// Indices of the records of a type, by the low byte of their head.
fn records(words: &[u64], tag: u8) -> Vec<usize> {
    let (mut at, mut found) = (0, Vec::new());
    while at < words.len() {
        if words[at] as u8 == tag {
            found.push(at);
        }
        at += 1 + (words[at] >> 32) as usize;
    }
    found
}

/// A net that passes an analog input through a delay and an addition.
fn analog_net() -> PlanData {
    let mut plan = crate::common::TestPlan::new();
    let (no, value) = (plan.bool(0), plan.reals(&[f64::NAN]));
    let (before, sum) = (plan.reals(&[0.0]), plan.reals(&[f64::NAN]));
    plan.add("AnalogInput", &[value, 1, 2]);
    plan.add("Add", &[value, before, sum]);
    plan.add("Termination", &[no]);
    plan.data.delays.push(rcc_core::plan::Delay {
        store: Store::Real,
        from: sum,
        to: before,
        width: 1,
    });
    plan.data
}

/// A recording of `analog_net` in which the input changes in every cycle.
fn analog_tape() -> (Recorded, RecordedTape) {
    let mut stage = Recorded::new(ROOM);
    let id = stage.load(analog_net()).expect("a net");
    stage.start(id);
    for cycle in 0..1500 {
        stage.fixture.others[0].analog[2] = f64::from(cycle);
        stage.fixture.step();
    }
    let tape = stage.freeze();
    (stage, tape)
}

#[test]
fn a_changed_input_is_found_at_its_cycle_and_a_snapshot_names_the_slot() {
    let (stage, mut tape) = analog_tape();
    assert_eq!(stage.replay(&tape.words)[0].mismatch, None);
    // Change one bit of the value of device 1, in the middle of the recording.
    let inputs = records(&tape.words, 2);
    let of_io: Vec<usize> = inputs
        .into_iter()
        .filter(|at| (tape.words[*at] >> 8) as u8 == 1)
        .collect();
    let at = of_io[of_io.len() / 2];
    let offset = std::mem::offset_of!(Measurement, analog) / 8 + 2;
    tape.words[at + 1 + offset] ^= 1 << 40;
    let cycles = records(&tape.words, 1);
    let cycle = cycles.iter().rfind(|start| **start < at).expect("a cycle");
    let cycle = tape.words[cycle + 1];
    let results = stage.replay(&tape.words);
    let mismatch = results[0].mismatch.expect("it is found");
    assert_eq!(
        (mismatch.cycle, mismatch.what),
        (cycle, MismatchKind::Slots)
    );
    let slot = mismatch.slot.expect("a later snapshot names it");
    assert_eq!((slot.store, slot.writer), (Store::Real, Some("Add")));
    assert!(slot.cycle > cycle);
}

#[test]
fn a_changed_hash_is_found_at_its_cycle() {
    let (stage, mut tape) = analog_tape();
    let nets = records(&tape.words, 5);
    tape.words[nets[777] + 4] ^= 1;
    let results = stage.replay(&tape.words);
    assert_eq!(results[0].different, 1);
    assert_eq!(results[0].mismatch.expect("it is found").net_cycle, 778);
}

#[test]
fn evaluations_before_a_net_was_prepared_again_are_not_compared() {
    let mut stage = Recorded::new(4 << 20);
    let id = stage.load(line_net()).expect("a good plan");
    // The arm rests elsewhere by now: refused after the first evaluation.
    let hold = &mut stage.fixture.driver.measurement.hold;
    hold[0] += 0.1;
    let holds = [Some(*hold), None];
    stage.start(id);
    stage.fixture.steps(2);
    let net = Net::prepare_again(
        &stage.nets[&id],
        &stage.fixture.models,
        CONFIGURATION,
        &holds,
    );
    let net = net.expect("from there, too");
    stage.nets.insert(id, net.origin());
    stage.fixture.order(|_| EngineRequest::Renew { id, net });
    stage.start(id);
    stage.fixture.steps(300);
    let tape = stage.freeze();
    let results = stage.replay(&tape.words);
    let result = &results[0];
    assert_eq!(result.mismatch, None, "{result:?}");
    assert!(result.compared > 300, "{result:?}");
    assert_eq!(result.recorded, result.compared + 1, "{result:?}");
}
