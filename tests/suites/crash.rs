//! `kill -9` of the driver and of the executor in motion: what keeps running, what comes to rest, and that nothing
//! moves again by itself. Each test has a cell of its own.

use nix::sys::signal::Signal;
use rcc_core::message::MonitorRecord;
use rcc_protocol::Role;
use rcc_testing::Rng;
use rcc_tests::cell_fixture::ExecutorBoards;
use rcc_tests::census::runtime_files;
use rcc_tests::processes::{self, OpenResources};
use rcc_tests::records::RecordCollector;
use rcc_tests::reference::{ReferenceThread, Stall};
use rcc_tests::simulator::{ANSWERS_LOST, assert_within_limits};
use rcc_tests::{TestCell, UnsupervisedCell, await_some, nets};

/// The executor's period.
const PERIOD_NS: u64 = 1_000_000;
/// One second, in ticks of the simulated controller.
const SECOND: u64 = 1000;

#[test]
fn a_killed_driver_ends_its_net_and_the_executor_keeps_running() {
    // A higher priority than the executors of the tests that run in parallel, which are not a normal load of this
    // machine.
    let cell = TestCell::changed(|text| text.replace("{priority: 80}", "{priority: 85, core: 1}"));
    let lamp = cell.run(&nets::lamp("lamp"));
    let line = cell.run(&nets::line("line", 0.2, 0.1));
    let mut arm = cell.simulator("lwr-sim");
    arm.await_motion();
    arm.reset_statistics();
    let (records, watch) = (RecordCollector::follow(&cell), cell.watch());
    let reference = ReferenceThread::start(1, 95);
    let before = watch.status();

    let dead = cell.kill(Role::Driver, "lwr");
    let row = cell.await_end(line);
    assert_eq!(row["fault"]["fault"], "device lost", "{row}");
    assert_eq!(row["fault"]["device"], "lwr", "{row}");
    assert_within_limits(&arm.await_rest(), &ANSWERS_LOST);

    cell.await_successor(Role::Driver, "lwr", dead);
    cell.await_device("lwr", "ready");
    arm.assert_still(SECOND);
    assert_eq!(
        cell.device("lwr").expect("a row")["holder"],
        serde_json::Value::Null,
        "a net is never restarted"
    );
    let next = cell.run(&nets::line("next", 0.0, 0.2));
    cell.assert_ends(next, "finished");
    assert_within_limits(&arm.state(), &ANSWERS_LOST);

    assert_eq!(
        cell.state(lamp)["state"],
        "running",
        "the other net is not affected"
    );
    let after = watch.status();
    let stalls = reference.map(ReferenceThread::finish);
    let records = records.finish();
    assert_no_cycle_missing(&records, &watch);
    match stalls {
        Some(stalls) if after.grants & 1 == 1 => {
            assert_late_with_the_machine(after.late - before.late, &records, &stalls);
        }
        _ => {
            eprintln!("skipped: without SCHED_FIFO the cause of a late cycle cannot be determined")
        }
    }
    drop(watch);
    cell.done(lamp, "cancel");
    cell.stop();
}

/// Asserts that each cycle has its record: the lamp's net is the only one with a monitor, which records every cycle.
fn assert_no_cycle_missing(records: &[MonitorRecord], watch: &ExecutorBoards) {
    assert!(records.len() > 1000, "{} records", records.len());
    for pair in records.windows(2) {
        let cycles = pair[1].cycle - pair[0].cycle;
        let lost = pair[1].sequence - pair[0].sequence;
        assert_eq!(cycles, lost, "a cycle without a record: {pair:?}");
        assert!(
            pair[1].values[0] > pair[0].values[0],
            "logical time increases: {pair:?}"
        );
    }
    assert_eq!(watch.status().dropped_records, 0);
}

/// Asserts that the machine is the cause of each late cycle: a thread of higher priority on the same core was late at
/// that time, too.
fn assert_late_with_the_machine(late: u64, records: &[MonitorRecord], stalls: &[Stall]) {
    let cycles = records.len();
    eprintln!(
        "{late} late of {cycles} cycles; the reference thread was late {} times",
        stalls.len()
    );
    let waits = records
        .windows(2)
        .filter(|pair| pair[1].cycle == pair[0].cycle + 1);
    for pair in waits.filter(|pair| pair[1].stamp_ns - pair[0].stamp_ns > 3 * PERIOD_NS / 2) {
        let (from_ns, to_ns) = (pair[0].stamp_ns, pair[1].stamp_ns + PERIOD_NS);
        let excused = |stall: &Stall| stall.from_ns < to_ns && stall.to_ns > from_ns;
        assert!(
            stalls.iter().any(excused),
            "cycle {} is late, but the machine did not stall from {from_ns} to {to_ns}: {stalls:?}",
            pair[1].cycle
        );
    }
    // One stall of the machine makes one cycle late, or two when it lies between them.
    assert!(
        late <= 2 * stalls.len() as u64,
        "{late} late cycles, the machine's stalls: {stalls:?}"
    );
}

#[test]
fn without_the_executor_the_driver_brings_the_arm_to_rest_and_nothing_moves_by_itself_again() {
    let cell = TestCell::demo();
    let line = cell.run(&nets::line("line", 0.2, 0.15));
    let mut arm = cell.simulator("lwr-sim");
    arm.await_motion();
    let dead = cell.kill(Role::Executor, "exec");
    let rest = arm.await_rest();
    assert_within_limits(&rest, &[]);
    cell.await_successor(Role::Executor, "exec", dead);
    cell.await_devices();
    arm.assert_still(SECOND);
    let gone = cell.rest("GET", &format!("/commands/{line}"), "");
    assert_eq!(
        (gone.status, gone.code()),
        (404, "RCC3001"),
        "commands die with their executor: {gone:?}"
    );
    let next = cell.run(&nets::line("next", 0.0, 0.1));
    cell.assert_ends(next, "finished");
    assert_within_limits(&arm.state(), &[]);
    cell.stop();
}

#[test]
fn ids_of_a_dead_executor_are_never_given_again() {
    let cell = TestCell::demo();
    let lease = |cell: &TestCell| {
        let lease = cell.rest("POST", "/leases", r#"{"expires_ms": 60000}"#);
        lease.body["lease"].as_u64().expect("a lease")
    };
    let (old, old_lease) = (cell.load(&nets::lamp("old")), lease(&cell));
    let dead = cell.kill(Role::Executor, "exec");
    cell.await_successor(Role::Executor, "exec", dead);
    cell.await_devices();

    // A client that knows nothing of the restart must not start what another one has loaded since.
    let (new, new_lease) = (cell.load(&nets::line("new", 0.1, 0.1)), lease(&cell));
    assert!(new > old && new_lease > old_lease, "{new} {new_lease}");
    let requests = [
        format!("/commands/{old}/start"),
        format!("/commands/{old}/cancel"),
        format!("/leases/{old_lease}/renew"),
    ];
    for request in requests {
        let answer = cell.rest("POST", &request, "");
        assert!((400..500).contains(&answer.status), "{request}: {answer:?}");
    }
    assert_eq!(cell.state(new)["state"], "ready");
    cell.stop();
}

#[test]
fn outputs_take_their_safe_value_when_the_executor_dies() {
    let cell = TestCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    let mut station = cell.simulator("io-sim");
    cell.run(&nets::output("torch", "lwr", "torch"));
    cell.run(&nets::output("gun", "lwr", "gun"));
    cell.run(&nets::lamp("lamp"));
    let mut outputs = || {
        let krl = arm.state()["krl_from_pc"]["booleans"].clone();
        (
            krl[0] == true,
            krl[2] == true,
            station.state()["coils"][0] == true,
        )
    };
    await_some("all outputs", || {
        (outputs() == (true, true, true)).then_some(())
    });
    let dead = cell.kill(Role::Executor, "exec");
    // The torch must go out; the gripper must stay closed, or it would drop its part.
    await_some("the safe values", || {
        (outputs() == (false, true, false)).then_some(())
    });
    cell.await_successor(Role::Executor, "exec", dead);
    cell.await_devices();
    assert_eq!(
        outputs(),
        (false, true, false),
        "no output is switched again by itself"
    );
    cell.stop();
}

#[test]
fn outputs_of_a_killed_driver_take_their_safe_value_when_it_is_back() {
    let cell = TestCell::demo();
    let mut station = cell.simulator("io-sim");
    let lamp = cell.run(&nets::lamp("lamp"));
    await_some("the lamp", || {
        (station.state()["coils"][0] == true).then_some(())
    });
    let dead = cell.kill(Role::Driver, "io");
    let row = cell.await_end(lamp);
    assert_eq!(row["fault"]["fault"], "device lost", "{row}");
    cell.await_successor(Role::Driver, "io", dead);
    await_some("the lamp to be off", || {
        (station.state()["coils"][0] == false).then_some(())
    });
    cell.stop();
}

#[test]
fn twenty_driver_kills_at_random_moments_leak_nothing() {
    let seed = rcc_os::clock::monotonic_ns();
    eprintln!("seed {seed}");
    let mut random = Rng::with_seed(seed);
    let mut cell = UnsupervisedCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    let executor = cell.pid("executor");
    let watch = cell.watch();
    let lamp = cell.run(&nets::lamp("lamp"));
    let mut settled = None;
    for round in 0..20 {
        let y = if round % 2 == 0 { 0.1 } else { 0.0 };
        let line = cell.load(&nets::line("line", y, 0.2));
        cell.start_when_ready(line);
        std::thread::sleep(std::time::Duration::from_micros(random.u64(..400_000)));
        cell.end("lwr", Signal::SIGKILL);
        // At the very end of the line the kill may come too late to matter.
        let row = cell.await_end(line);
        assert!(
            row["fault"]["fault"] == "device lost" || row["reason"] == "finished",
            "{row}"
        );
        let unload = cell.rest("DELETE", &format!("/commands/{line}"), "");
        assert_eq!(unload.status, 200, "{unload:?}");
        cell.start_driver("lwr");
        // A driver may also be killed before it is ready.
        if round % 5 == 4 {
            std::thread::sleep(std::time::Duration::from_micros(random.u64(..100_000)));
            cell.end("lwr", Signal::SIGKILL);
            cell.start_driver("lwr");
        }
        cell.await_driver(&watch, "lwr");
        let now = ResourceCounts::of(&cell, executor);
        // The first rounds create what is created only once: threads, buffers, files of names.
        match settled {
            None if round >= 2 => settled = Some(now),
            Some(settled) => await_some(&format!("{settled:?} after kill {round}"), || {
                let now = ResourceCounts::of(&cell, executor);
                if !now.is_within(&settled) {
                    eprintln!("after kill {round}: {now:?}");
                    // Files that were left half-created are removed only once they are old enough.
                    cell.clean();
                }
                now.is_within(&settled).then_some(())
            }),
            None => {}
        }
    }
    assert_within_limits(&arm.state(), &ANSWERS_LOST);
    assert_eq!(cell.state(lamp)["state"], "running");
    cell.done(lamp, "cancel");
    drop(watch);
    cell.stop();
}

/// Numbers that a leak would increase.
#[derive(Clone, Copy, Debug)]
struct ResourceCounts {
    shared_memory: usize,
    files: u64,
    processes: usize,
    executor: OpenResources,
}

impl ResourceCounts {
    fn of(cell: &UnsupervisedCell, executor: u32) -> ResourceCounts {
        ResourceCounts {
            shared_memory: cell
                .cell()
                .leftovers()
                .expect("/dev/shm can be listed")
                .len(),
            files: runtime_files(cell.cell().runtime_dir()),
            processes: processes::with_runtime_dir(cell.folder()).len(),
            executor: processes::holdings(executor),
        }
    }

    fn is_within(&self, other: &ResourceCounts) -> bool {
        self.shared_memory <= other.shared_memory
            && self.files <= other.files
            && self.processes <= other.processes
            && self.executor.files <= other.executor.files
            && self.executor.mappings <= other.executor.mappings
    }
}
