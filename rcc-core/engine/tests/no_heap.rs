//! No heap operation in any cycle of the engine: nets start, run, end, fault and are refused.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;

use common::{
    EngineFixture, HOLD, TestPlan, drift_net, endless_net, input_net, line_net, named, output_net,
    publishing_net, start_of, subscribing_net,
};
use rcc_config::CellConfig;
use rcc_core::message::{CommandState, DeviceState, EndReason};
use rcc_core::plan::{Rate, ValuePoint};
use rcc_core::topic::Topic;
use rcc_core::types::{NULL_INT, Store};
use rcc_engine::queue::{EngineRequest, ValueReading};
use rcc_engine::record::{FlightRecorder, FlightRecorderConfig};
use rcc_protocol::control::{Answer, InputValue, PlanData};
use rcc_protocol::rules::{Rule, RuleTerm};

/// An allocator that counts the heap operations of each thread.
struct Counting;

thread_local! {
    static OPERATIONS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    // At the end of a thread the counter is gone.
    let _ = OPERATIONS.try_with(|operations| operations.set(operations.get() + 1));
}

#[allow(unsafe_code)]
// SAFETY: everything is passed on to the system's allocator; counting does not allocate.
unsafe impl GlobalAlloc for Counting {
    // SAFETY: the caller's guarantees are passed on.
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: as above.
        unsafe { System.alloc(layout) }
    }
    // SAFETY: the caller's guarantees are passed on.
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        count();
        // SAFETY: as above.
        unsafe { System.dealloc(memory, layout) }
    }
    // SAFETY: the caller's guarantees are passed on.
    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: as above.
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Runs `work` and returns the number of heap operations it made in this thread.
fn operations(work: impl FnOnce()) -> u64 {
    let before = OPERATIONS.with(Cell::get);
    work();
    OPERATIONS.with(Cell::get) - before
}

/// Sends a request and runs cycles without a heap operation; replies are taken outside of the count.
fn execute(fixture: &mut EngineFixture, order: impl FnOnce(u64) -> EngineRequest, cycles: usize) {
    fixture.ends.requests.push(order(0)).unwrap();
    let count = operations(|| fixture.steps(cycles));
    assert_eq!(count, 0, "heap operations in {cycles} cycles");
    while fixture.ends.replies.pop().is_ok() {}
    fixture.records();
    while fixture.ends.events.pop().is_ok() {}
}

#[test]
fn the_allocator_counts_heap_operations() {
    assert!(operations(|| drop(std::hint::black_box(vec![1, 2, 3]))) >= 2);
}

#[test]
fn values_between_nets_make_no_heap_operation() {
    let topic = Topic::new("tool/force", "Real", "N");
    let mut fixture = EngineFixture::new();
    let gives = fixture.load(publishing_net(topic, Rate::EVERY_CYCLE));
    let again = fixture.load(publishing_net(topic, Rate::EVERY_CYCLE));
    let takes = fixture.load(subscribing_net(topic, Rate::EVERY_CYCLE, 3));
    let ticket = 0;
    for id in [takes, gives, again] {
        execute(&mut fixture, start_of(id), 20);
    }
    execute(
        &mut fixture,
        |_| EngineRequest::Abort { ticket, id: gives },
        20,
    );
    execute(&mut fixture, start_of(again), 20);
    let shown = fixture.read(takes, &[]).expect("it runs");
    assert!(shown.evaluations > 80, "{shown:?}");
}

#[test]
fn a_whole_life_cycle_makes_no_heap_operation() {
    let mut fixture = EngineFixture::new();
    for _ in 0..2 {
        let id = fixture.load(line_net());
        execute(&mut fixture, start_of(id), 300);
        execute(
            &mut fixture,
            |ticket| EngineRequest::Cancel { ticket, id },
            1000,
        );
        assert_eq!(fixture.reason(id), EndReason::Canceled);
        execute(
            &mut fixture,
            |ticket| EngineRequest::Unload { ticket, id },
            10,
        );
        fixture.driver.measurement.hold = HOLD;
    }
}

#[test]
fn the_flight_recorder_makes_no_heap_operation() {
    let config = FlightRecorderConfig {
        span_ns: 2_000_000_000,
        memory: 2 << 20,
        period_ns: 1_000_000,
    };
    let (recorder, mut helper) = FlightRecorder::new(config, 1);
    let mut fixture = EngineFixture::new().recorded_by(recorder);
    let mut incidents = 0;
    for round in 0..6 {
        let id = fixture.load(line_net());
        execute(&mut fixture, start_of(id), 300);
        execute(&mut fixture, |ticket| EngineRequest::Record { ticket }, 300);
        fixture.driver.alive = round % 2 == 0;
        execute(
            &mut fixture,
            |ticket| EngineRequest::Cancel { ticket, id },
            6000,
        );
        fixture.driver.alive = true;
        fixture.driver.measurement.state = DeviceState::Ready as u32;
        fixture.driver.measurement.hold = HOLD;
        execute(
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
fn loading_while_another_net_runs_makes_no_heap_operation() {
    let mut fixture = EngineFixture::new();
    let first = fixture.load(output_net(0));
    execute(&mut fixture, start_of(first), 10);
    let Answer::Reserved { id } = fixture.ask(|ticket| EngineRequest::Reserve { ticket }) else {
        panic!()
    };
    let net = fixture.build(line_net()).unwrap();
    execute(
        &mut fixture,
        |ticket| EngineRequest::Install { ticket, id, net },
        10,
    );
}

#[test]
fn refusals_and_faults_make_no_heap_operation() {
    let mut fixture = EngineFixture::new();
    let (line, holder, rival) = (
        fixture.load(line_net()),
        fixture.load(endless_net(1)),
        fixture.load(endless_net(1)),
    );
    fixture.driver.measurement.hold[0] += 0.1;
    execute(&mut fixture, start_of(line), 3);
    fixture.driver.measurement.hold = HOLD;
    execute(&mut fixture, start_of(holder), 3);
    execute(&mut fixture, start_of(rival), 3);
    execute(
        &mut fixture,
        |ticket| EngineRequest::Cancel { ticket, id: holder },
        3,
    );
    execute(&mut fixture, start_of(12345), 3);
    execute(&mut fixture, start_of(line), 100);
    fixture.driver.alive = false;
    execute(
        &mut fixture,
        |ticket| EngineRequest::Cancel { ticket, id: 999 },
        100,
    );
    execute(
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
fn setting_and_reading_values_makes_no_heap_operation() {
    let config = FlightRecorderConfig {
        span_ns: 2_000_000_000,
        memory: 2 << 20,
        period_ns: 1_000_000,
    };
    let (recorder, _helper) = FlightRecorder::new(config, 1);
    let mut fixture = EngineFixture::new().recorded_by(recorder);
    let id = fixture.load(input_net(0.5, 5));
    for round in 0..20 {
        let value = |input, words| InputValue { input, words };
        let values = match round % 3 {
            0 => vec![value(0, vec![1.0f64.to_bits()]), value(1, vec![0; 3])],
            1 => vec![value(0, vec![2.0f64.to_bits()])],
            _ => vec![value(7, vec![])],
        };
        execute(
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
        execute(&mut fixture, read, 2);
        if round == 3 {
            execute(&mut fixture, start_of(id), 3);
        }
    }
}

#[test]
fn an_unreachable_pose_and_null_inputs_make_no_heap_operation() {
    let mut plan = TestPlan::new();
    let (no, nothing) = (plan.bool(0), plan.bool(2));
    let pose = plan.reals(&[9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 1.0]);
    let joints = plan.reals(&[f64::NAN; 7]);
    let state = plan.reals(&[f64::NAN; 10]);
    plan.data.ints.extend([NULL_INT, NULL_INT, 0]);
    plan.add("InverseKinematics", &[pose, joints, 0, 1, 0, 2, state, 7]);
    plan.add("JointPositionCommand", &[joints, 0, 7]);
    plan.add("DigitalOutput", &[nothing, 0, 0]);
    plan.add("Termination", &[no]);
    let mut fixture = EngineFixture::new();
    let id = fixture.load(plan.data);
    execute(&mut fixture, start_of(id), 100);
    fixture.driver.measurement.state = DeviceState::Online as u32;
    execute(
        &mut fixture,
        |ticket| EngineRequest::Abort { ticket, id },
        3,
    );
}

/// A net that holds the arm, with a monitor in every cycle.
fn stay() -> PlanData {
    let mut plan = TestPlan {
        data: drift_net(HOLD[0], 0.0),
    };
    plan.monitor(Store::Real, 0, 1, 1);
    plan.data
}

/// One round of everything: nets start, end, are canceled, aborted, handed over, refused, and fault; cycles are late.
fn live(fixture: &mut EngineFixture) {
    let ids = [line_net(), stay(), stay(), drift_net(0.0, 0.0)].map(|plan| fixture.load(plan));
    let outputs = [output_net(1), output_net(1), endless_net(2)].map(|plan| fixture.load(plan));
    let [line, stay, again, elsewhere] = ids;
    let [lamp, other, endless] = outputs;
    execute(fixture, start_of(lamp), 10);
    execute(fixture, start_of(line), 150);
    execute(
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
            lease: 0,
        }
    };
    execute(fixture, switch(&[lamp], &[other, stay, endless]), 50);
    assert_eq!(fixture.reason(lamp), EndReason::Aborted);
    execute(fixture, switch(&[stay], &[elsewhere]), 20);
    execute(fixture, switch(&[lamp], &[again]), 20);
    assert_eq!(fixture.state(stay), CommandState::Running);
    execute(fixture, switch(&[stay], &[again]), 50);
    assert_eq!(fixture.state(again), CommandState::Running);
    execute(fixture, start_of(12345), 5);
    execute(fixture, |ticket| EngineRequest::Record { ticket }, 5);
    // The other nets end with a fault: the device is lost.
    fixture.driver.alive = false;
    execute(
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
        execute(fixture, |ticket| EngineRequest::Unload { ticket, id }, 3);
    }
}

#[test]
fn a_hundred_thousand_cycles_with_the_flight_recorder_make_no_heap_operation() {
    let mut fixture = EngineFixture::new();
    let config = FlightRecorderConfig {
        span_ns: 1_000_000_000,
        memory: 4 << 20,
        period_ns: fixture.period_ns,
    };
    let (recorder, mut helper) = FlightRecorder::new(config, 1);
    fixture.engine = fixture.engine.recorded_by(recorder);
    let mut incidents = 0;
    // One cycle in a hundred loads a net; it is not counted.
    while fixture.engine.status().cycle < 102_000 {
        live(&mut fixture);
        // The helper thread's work: a ring that was handed over is returned.
        while let Ok(recording) = helper.recordings.pop() {
            incidents += 1;
            helper.spare.push(recording.ring).unwrap();
        }
    }
    assert!(incidents > 1, "{incidents} incidents");
}

/// Start position of the demo's arm (`configs/cells/demo.yaml`).
const DEMO_START: [f64; 8] = {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, FRAC_PI_6};
    [0.0, -FRAC_PI_6, 0.0, FRAC_PI_2, 0.0, -FRAC_PI_3, 0.0, 0.0]
};

/// Loads every net of `configs/nets` into a cell of its own and passes it to `live`.
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
fn no_example_net_makes_a_heap_operation_from_start_to_cancel_or_abort() {
    with_example_nets(|name, fixture, id| {
        execute(fixture, start_of(id), 300);
        assert_ne!(fixture.state(id), CommandState::Ready, "{name} runs");
        // Changing conditions while a net runs: forces, inputs that change, and unknown ones.
        for force in [20.0, -20.0, f64::NAN, 0.0] {
            fixture.driver.measurement.wrench = [force; 6];
            for other in &mut fixture.others {
                other.digital = !other.digital;
                other.digital_known = !other.digital_known;
                other.analog = [force; 16];
            }
            execute(fixture, start_of(id), 50);
        }
        execute(fixture, |ticket| EngineRequest::Cancel { ticket, id }, 3000);
        execute(fixture, |ticket| EngineRequest::Abort { ticket, id }, 30);
        assert_eq!(fixture.state(id), CommandState::Terminated, "{name}");
        execute(fixture, |ticket| EngineRequest::Unload { ticket, id }, 3);
    });
}

#[test]
fn no_example_net_makes_a_heap_operation_to_its_end_or_through_a_fault() {
    with_example_nets(|_, fixture, id| {
        execute(fixture, start_of(id), 5000);
        execute(fixture, |ticket| EngineRequest::Abort { ticket, id }, 30);
    });
    with_example_nets(|name, fixture, id| {
        execute(fixture, start_of(id), 100);
        fixture.driver.alive = false;
        execute(fixture, start_of(id), 100);
        fixture.driver.alive = true;
        execute(fixture, |ticket| EngineRequest::Abort { ticket, id }, 100);
        assert_eq!(fixture.state(id), CommandState::Terminated, "{name}");
    });
    with_example_nets(|name, fixture, id| {
        // Refused because the arm is elsewhere; then too many late cycles.
        fixture.driver.measurement.hold[0] += 0.1;
        execute(fixture, start_of(id), 3);
        fixture.driver.measurement.hold = DEMO_START;
        execute(fixture, start_of(id), 100);
        let late = operations(|| (0..10).for_each(|_| fixture.engine.account(1, 5_000_000, 5)));
        assert_eq!(late, 0, "{name}");
        execute(fixture, |ticket| EngineRequest::Abort { ticket, id }, 100);
        assert_eq!(fixture.state(id), CommandState::Terminated, "{name}");
    });
}

#[test]
fn rules_and_leases_make_no_heap_operation() {
    let config = FlightRecorderConfig {
        span_ns: 1_000_000_000,
        memory: 4 << 20,
        period_ns: 1_000_000,
    };
    let (recorder, _helper) = FlightRecorder::new(config, 1);
    let mut fixture = EngineFixture::new().recorded_by(recorder);
    let [arm, heir, lamp, other] = [
        drift_net(HOLD[0], 0.0),
        drift_net(HOLD[0], 0.0),
        output_net(1),
        output_net(1),
    ]
    .map(|plan| fixture.load(plan));
    let ticket = 0;
    execute(
        &mut fixture,
        |_| EngineRequest::GrantLease {
            ticket,
            expires_ns: 200_000_000,
        },
        2,
    );
    execute(&mut fixture, start_of(arm), 10);
    let rule = |term: RuleTerm, stop: u64, start: u64| {
        let mut rule = Rule {
            stop: named(&[stop]),
            start: named(&[start]),
            lease: 1,
            ..Rule::EMPTY
        };
        rule.when[0] = Some(term);
        rule
    };
    let state = |command: u64, state: CommandState| RuleTerm::State {
        command,
        state: state as u32,
    };
    // One fires at once, one follows it, one is refused, and one is disarmed when the lease is lost.
    let rules = vec![
        rule(RuleTerm::True, arm, heir),
        rule(state(heir, CommandState::Running), 0, lamp),
        rule(state(lamp, CommandState::Running), 0, other),
        rule(state(heir, CommandState::Canceling), heir, other),
    ];
    execute(
        &mut fixture,
        |_| EngineRequest::InstallRules { ticket, rules },
        50,
    );
    assert_eq!(fixture.state(heir), CommandState::Running);
    assert_eq!(fixture.state(lamp), CommandState::Running);
    assert_eq!(fixture.state(other), CommandState::Ready);
    execute(
        &mut fixture,
        |_| EngineRequest::ListRules {
            ticket,
            after: 0,
            list: Vec::new(),
        },
        300,
    );
    // The lease is lost: what the rules started has ended.
    assert!(!fixture.state(heir).is_active());
    execute(
        &mut fixture,
        |_| EngineRequest::RemoveRule { ticket, id: 1 },
        2,
    );
}
