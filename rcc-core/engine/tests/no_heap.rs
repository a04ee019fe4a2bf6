//! No heap operation in any cycle of the engine: nets that start, run, end, fault and are refused.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;

use common::{
    EngineFixture, HOLD, TestPlan, drift_net, endless_net, input_net, line_net, named, output_net,
    publishing_net, subscribing_net,
};
use rcc_config::CellConfig;
use rcc_core::message::{CommandState, DeviceState, EndReason};
use rcc_core::plan::{Rate, ValuePoint};
use rcc_core::topic::Topic;
use rcc_core::types::{NULL_INT, Store};
use rcc_engine::queue::{EngineRequest, ValueReading};
use rcc_engine::record::{Recorder, RecorderConfig};
use rcc_ipc::control::{Answer, InputValue, PlanData};

/// Counts the heap operations of a thread.
struct Counting;

thread_local! {
    static OPERATIONS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    // At the end of a thread there is nothing left to count.
    let _ = OPERATIONS.try_with(|operations| operations.set(operations.get() + 1));
}

#[allow(unsafe_code)]
// SAFETY: everything is passed on to the system's allocator; counting allocates nothing.
unsafe impl GlobalAlloc for Counting {
    // SAFETY: the caller's promises are passed on.
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: as above.
        unsafe { System.alloc(layout) }
    }
    // SAFETY: the caller's promises are passed on.
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        count();
        // SAFETY: as above.
        unsafe { System.dealloc(memory, layout) }
    }
    // SAFETY: the caller's promises are passed on.
    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: as above.
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Runs `work` and returns how many heap operations it made in this thread.
fn operations(work: impl FnOnce()) -> u64 {
    let before = OPERATIONS.with(Cell::get);
    work();
    OPERATIONS.with(Cell::get) - before
}

/// Gives an order and runs cycles without a heap operation; answers are taken back outside of the count.
fn obey(fixture: &mut EngineFixture, order: impl FnOnce(u64) -> EngineRequest, cycles: usize) {
    fixture.ends.requests.push(order(0)).unwrap();
    let count = operations(|| fixture.steps(cycles));
    assert_eq!(count, 0, "heap operations in {cycles} cycles");
    while fixture.ends.replies.pop().is_ok() {}
    fixture.records();
    while fixture.ends.events.pop().is_ok() {}
}

#[test]
fn the_count_counts() {
    assert!(operations(|| drop(std::hint::black_box(vec![1, 2, 3]))) >= 2);
}

#[test]
fn values_from_net_to_net_make_none() {
    let topic = Topic::new("tool/force", "Real", "N");
    let mut fixture = EngineFixture::new();
    let gives = fixture.load(publishing_net(topic, Rate::EVERY_CYCLE));
    let again = fixture.load(publishing_net(topic, Rate::EVERY_CYCLE));
    let takes = fixture.load(subscribing_net(topic, Rate::EVERY_CYCLE, 3));
    let ticket = 0;
    for id in [takes, gives, again] {
        obey(&mut fixture, |_| EngineRequest::Start { ticket, id }, 20);
    }
    obey(
        &mut fixture,
        |_| EngineRequest::Abort { ticket, id: gives },
        20,
    );
    obey(
        &mut fixture,
        |_| EngineRequest::Start { ticket, id: again },
        20,
    );
    let shown = fixture.read(takes, &[]).expect("it runs");
    assert!(shown.evaluations > 80, "{shown:?}");
}

#[test]
fn a_whole_life_makes_no_heap_operation() {
    let mut fixture = EngineFixture::new();
    for _ in 0..2 {
        let id = fixture.load(line_net());
        obey(
            &mut fixture,
            |ticket| EngineRequest::Start { ticket, id },
            300,
        );
        obey(
            &mut fixture,
            |ticket| EngineRequest::Cancel { ticket, id },
            1000,
        );
        assert_eq!(fixture.reason(id), EndReason::Canceled);
        obey(
            &mut fixture,
            |ticket| EngineRequest::Unload { ticket, id },
            10,
        );
        fixture.driver.measurement.hold = HOLD;
    }
}

#[test]
fn the_flight_recorder_makes_none() {
    let config = RecorderConfig {
        span_ns: 2_000_000_000,
        memory: 2 << 20,
        period_ns: 1_000_000,
    };
    let (recorder, mut helper) = Recorder::new(config, 1);
    let mut fixture = EngineFixture::new().recorded_by(recorder);
    let mut incidents = 0;
    for round in 0..6 {
        let id = fixture.load(line_net());
        obey(
            &mut fixture,
            |ticket| EngineRequest::Start { ticket, id },
            300,
        );
        obey(&mut fixture, |ticket| EngineRequest::Record { ticket }, 300);
        fixture.driver.alive = round % 2 == 0;
        obey(
            &mut fixture,
            |ticket| EngineRequest::Cancel { ticket, id },
            6000,
        );
        fixture.driver.alive = true;
        fixture.driver.measurement.state = DeviceState::Ready as u32;
        fixture.driver.measurement.hold = HOLD;
        obey(
            &mut fixture,
            |ticket| EngineRequest::Unload { ticket, id },
            10,
        );
        while let Ok(recording) = helper.recordings.pop() {
            incidents += 1;
            let mut ring = recording.ring;
            ring.clear();
            helper.spare.push(ring).unwrap();
        }
    }
    assert!(incidents >= 6, "{incidents}");
}

#[test]
fn loading_while_another_net_runs_makes_none_either() {
    let mut fixture = EngineFixture::new();
    let first = fixture.load(output_net(0));
    obey(
        &mut fixture,
        |ticket| EngineRequest::Start { ticket, id: first },
        10,
    );
    let Answer::Reserved { id } = fixture.ask(|ticket| EngineRequest::Reserve { ticket }) else {
        panic!()
    };
    let net = fixture.build(line_net()).unwrap();
    obey(
        &mut fixture,
        |ticket| EngineRequest::Install { ticket, id, net },
        10,
    );
}

#[test]
fn refusals_and_faults_make_none() {
    let mut fixture = EngineFixture::new();
    let (line, holder, rival) = (
        fixture.load(line_net()),
        fixture.load(endless_net(1)),
        fixture.load(endless_net(1)),
    );
    fixture.driver.measurement.hold[0] += 0.1;
    obey(
        &mut fixture,
        |ticket| EngineRequest::Start { ticket, id: line },
        3,
    );
    fixture.driver.measurement.hold = HOLD;
    obey(
        &mut fixture,
        |ticket| EngineRequest::Start { ticket, id: holder },
        3,
    );
    obey(
        &mut fixture,
        |ticket| EngineRequest::Start { ticket, id: rival },
        3,
    );
    obey(
        &mut fixture,
        |ticket| EngineRequest::Cancel { ticket, id: holder },
        3,
    );
    obey(
        &mut fixture,
        |ticket| EngineRequest::Start { ticket, id: 12345 },
        3,
    );
    obey(
        &mut fixture,
        |ticket| EngineRequest::Start { ticket, id: line },
        100,
    );
    fixture.driver.alive = false;
    obey(
        &mut fixture,
        |ticket| EngineRequest::Cancel { ticket, id: 999 },
        100,
    );
    obey(
        &mut fixture,
        |ticket| EngineRequest::Acknowledge { ticket },
        100,
    );
    assert_eq!(fixture.reason(line), EndReason::Fault);
    let late = operations(|| (0..10).for_each(|_| fixture.engine.account(1, 5_000_000, 5)));
    assert_eq!(late, 0);
    assert_eq!(fixture.reason(holder), EndReason::Fault);
}

#[test]
fn setting_and_reading_values_makes_none() {
    let config = RecorderConfig {
        span_ns: 2_000_000_000,
        memory: 2 << 20,
        period_ns: 1_000_000,
    };
    let (recorder, _helper) = Recorder::new(config, 1);
    let mut fixture = EngineFixture::new().recorded_by(recorder);
    let id = fixture.load(input_net(0.5, 5));
    for round in 0..20 {
        let value = |input, words| InputValue { input, words };
        let values = match round % 3 {
            0 => vec![value(0, vec![1.0f64.to_bits()]), value(1, vec![0; 3])],
            1 => vec![value(0, vec![2.0f64.to_bits()])],
            _ => vec![value(7, vec![])],
        };
        obey(
            &mut fixture,
            |ticket| EngineRequest::Set { ticket, id, values },
            10,
        );
        let point = |slot| ValuePoint {
            store: Store::Real,
            slot,
            width: 2,
        };
        let reading = ValueReading::of(vec![point(0), point(round % 5)]);
        let read = |ticket| EngineRequest::Read {
            ticket,
            id,
            reading,
        };
        obey(&mut fixture, read, 2);
        if round == 3 {
            obey(
                &mut fixture,
                |ticket| EngineRequest::Start { ticket, id },
                3,
            );
        }
    }
}

#[test]
fn an_unreachable_pose_and_null_inputs_make_none() {
    let mut plan = TestPlan::new();
    let (no, nothing) = (plan.bool(0), plan.bool(2));
    let pose = plan.reals(&[9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 1.0]);
    let joints = plan.reals(&[f64::NAN; 7]);
    let state = plan.reals(&[f64::NAN; 10]);
    plan.data.ints.extend([NULL_INT; 2]);
    plan.add("InverseKinematics", &[pose, joints, 0, 1, 0, state, 7]);
    plan.add("JointPositionCommand", &[joints, 0, 7]);
    plan.add("DigitalOutput", &[nothing, 0, 0]);
    plan.add("Termination", &[no]);
    let mut fixture = EngineFixture::new();
    let id = fixture.load(plan.data);
    obey(
        &mut fixture,
        |ticket| EngineRequest::Start { ticket, id },
        100,
    );
    fixture.driver.measurement.state = DeviceState::Online as u32;
    obey(
        &mut fixture,
        |ticket| EngineRequest::Abort { ticket, id },
        3,
    );
}

/// A net that commands the arm to stay, watched in every cycle.
fn stay() -> PlanData {
    let mut plan = TestPlan {
        data: drift_net(HOLD[0], 0.0),
    };
    plan.monitor(Store::Real, 0, 1, 1);
    plan.data
}

/// One round of everything: nets start, end, are cancelled, aborted, handed over, refused, and fault; cycles are late.
fn live(fixture: &mut EngineFixture) {
    let ids = [line_net(), stay(), stay(), drift_net(0.0, 0.0)].map(|plan| fixture.load(plan));
    let outputs = [output_net(1), output_net(1), endless_net(2)].map(|plan| fixture.load(plan));
    let [line, stay, again, elsewhere] = ids;
    let [lamp, other, endless] = outputs;
    obey(
        fixture,
        |ticket| EngineRequest::Start { ticket, id: lamp },
        10,
    );
    obey(
        fixture,
        |ticket| EngineRequest::Start { ticket, id: line },
        150,
    );
    obey(
        fixture,
        |ticket| EngineRequest::Cancel { ticket, id: line },
        600,
    );
    assert_eq!(fixture.reason(line), EndReason::Canceled);
    fixture.driver.measurement.hold = HOLD;
    let switch = |stop: &[u64], start: &[u64]| {
        let (stop, start) = (named(stop), named(start));
        move |ticket| EngineRequest::Handover {
            ticket,
            stop,
            start,
        }
    };
    obey(fixture, switch(&[lamp], &[other, stay, endless]), 50);
    assert_eq!(fixture.reason(lamp), EndReason::Aborted);
    obey(fixture, switch(&[stay], &[elsewhere]), 20);
    obey(fixture, switch(&[lamp], &[again]), 20);
    assert_eq!(fixture.state(stay), CommandState::Running);
    obey(fixture, switch(&[stay], &[again]), 50);
    assert_eq!(fixture.state(again), CommandState::Running);
    obey(
        fixture,
        |ticket| EngineRequest::Start { ticket, id: 12345 },
        5,
    );
    obey(fixture, |ticket| EngineRequest::Record { ticket }, 5);
    // Each of the others ends by a fault: the device is lost.
    fixture.driver.alive = false;
    obey(
        fixture,
        |ticket| EngineRequest::Cancel { ticket, id: 999 },
        100,
    );
    assert_eq!(fixture.reason(again), EndReason::Fault);
    fixture.driver.alive = true;
    fixture.driver.measurement.state = DeviceState::Ready as u32;
    let late = operations(|| (0..10).for_each(|_| fixture.engine.account(5_000_000, 1, 5)));
    assert_eq!(late, 0);
    for id in ids.into_iter().chain(outputs) {
        obey(fixture, |ticket| EngineRequest::Unload { ticket, id }, 3);
    }
}

#[test]
fn a_hundred_thousand_cycles_of_everything_with_the_flight_recorder_make_none() {
    let mut fixture = EngineFixture::new();
    let config = RecorderConfig {
        span_ns: 1_000_000_000,
        memory: 4 << 20,
        period_ns: fixture.period_ns,
    };
    let (recorder, mut helper) = Recorder::new(config, 1);
    fixture.engine = fixture.engine.recorded_by(recorder);
    let mut incidents = 0;
    // One cycle in a hundred is one in which something is loaded, which is not counted.
    while fixture.engine.status().cycle < 102_000 {
        live(&mut fixture);
        // The helper's work: a ring that was handed over goes back.
        while let Ok(recording) = helper.recordings.pop() {
            incidents += 1;
            helper.spare.push(recording.ring).unwrap();
        }
    }
    assert!(incidents > 1, "{incidents} incidents");
}

/// The start of the demo's arm (`configs/cells/demo.yaml`).
const DEMO_START: [f64; 8] = {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, FRAC_PI_6};
    [0.0, -FRAC_PI_6, 0.0, FRAC_PI_2, 0.0, -FRAC_PI_3, 0.0, 0.0]
};

/// Loads every net of `configs/nets` into a cell of its own, and gives it to `live`.
fn with_example_nets(live: impl Fn(&str, &mut EngineFixture, u64)) {
    let configs = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs"));
    let config = CellConfig::load_offline(&configs.join("cells/demo.yaml")).unwrap();
    let files = std::fs::read_dir(configs.join("nets")).unwrap();
    let mut count = 0;
    for path in files.map(|file| file.unwrap().path()) {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&path).unwrap();
        let compiled = rcc_language::compile(&text, &name, &config);
        let plan = compiled.unwrap_or_else(|faults| panic!("{faults}")).plan;
        let mut fixture = EngineFixture::of_cell(config.models(), config.fingerprint(), DEMO_START);
        let id = fixture.load(plan);
        live(&name, &mut fixture, id);
        count += 1;
    }
    assert!(count >= 3, "{count} example nets");
}

#[test]
fn no_example_net_makes_any_from_start_to_cancel_or_abort() {
    with_example_nets(|name, fixture, id| {
        obey(fixture, |ticket| EngineRequest::Start { ticket, id }, 300);
        assert_ne!(fixture.state(id), CommandState::Ready, "{name} runs");
        // Whatever happens while a net runs: forces, inputs that change and that are not known.
        for force in [20.0, -20.0, f64::NAN, 0.0] {
            fixture.driver.measurement.wrench = [force; 6];
            for other in &mut fixture.others {
                other.digital = !other.digital;
                other.digital_known = !other.digital_known;
                other.analog = [force; 16];
            }
            obey(fixture, |ticket| EngineRequest::Start { ticket, id }, 50);
        }
        obey(fixture, |ticket| EngineRequest::Cancel { ticket, id }, 3000);
        obey(fixture, |ticket| EngineRequest::Abort { ticket, id }, 30);
        assert_eq!(fixture.state(id), CommandState::Terminated, "{name}");
        obey(fixture, |ticket| EngineRequest::Unload { ticket, id }, 3);
    });
}

#[test]
fn no_example_net_makes_any_to_its_end_or_through_a_fault() {
    with_example_nets(|_, fixture, id| {
        obey(fixture, |ticket| EngineRequest::Start { ticket, id }, 5000);
        obey(fixture, |ticket| EngineRequest::Abort { ticket, id }, 30);
    });
    with_example_nets(|name, fixture, id| {
        obey(fixture, |ticket| EngineRequest::Start { ticket, id }, 100);
        fixture.driver.alive = false;
        obey(fixture, |ticket| EngineRequest::Start { ticket, id }, 100);
        fixture.driver.alive = true;
        obey(fixture, |ticket| EngineRequest::Abort { ticket, id }, 100);
        assert_eq!(fixture.state(id), CommandState::Terminated, "{name}");
    });
    with_example_nets(|name, fixture, id| {
        // Refused: the arm is elsewhere, then too many late cycles.
        fixture.driver.measurement.hold[0] += 0.1;
        obey(fixture, |ticket| EngineRequest::Start { ticket, id }, 3);
        fixture.driver.measurement.hold = DEMO_START;
        obey(fixture, |ticket| EngineRequest::Start { ticket, id }, 100);
        let late = operations(|| (0..10).for_each(|_| fixture.engine.account(1, 5_000_000, 5)));
        assert_eq!(late, 0, "{name}");
        obey(fixture, |ticket| EngineRequest::Abort { ticket, id }, 100);
        assert_eq!(fixture.state(id), CommandState::Terminated, "{name}");
    });
}
