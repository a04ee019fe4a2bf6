//! The executor trusts no caller: invalid bytes and plans that are sent directly to its control service are refused or
//! harmless. Each test has a cell of its own.

use std::time::Duration;

use rcc_config::CellConfig;
use rcc_core::message::CommandState;
use rcc_ipc::{Client, Session};
use rcc_protocol::control::{Answer, CONTROL, Call, PlanData, Refusal};
use rcc_protocol::{Role, wire};
use rcc_testing::Rng;
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::{TestCell, await_some, nets};

/// A client of the executor's control service, which otherwise only the loader calls.
pub struct Control {
    client: Client,
    pub config: CellConfig,
    _session: Session,
}

impl Control {
    pub fn of(cell: &CellFixture) -> Control {
        let session = Session::join(cell.cell(), Role::Loader, "stranger").expect("a cell");
        let executor = cell.announced(Role::Executor, "exec");
        let client = session
            .client(&executor.services[CONTROL])
            .expect("the control service");
        let config = CellConfig::load(cell.config(), &Default::default());
        Control {
            client,
            config: config.unwrap_or_else(|faults| panic!("{faults}")),
            _session: session,
        }
    }

    fn bytes(&self, bytes: &[u8]) -> Answer {
        let answer = self
            .client
            .call(bytes, Duration::from_secs(20))
            .expect("an answer");
        wire::decode(&answer).expect("an answer of this build")
    }

    pub fn call(&self, call: &Call) -> Answer {
        self.bytes(&wire::encode(call).expect("a call"))
    }

    pub fn reserve(&self) -> u64 {
        match self.call(&Call::Reserve) {
            Answer::Reserved { id } => id,
            other => panic!("{other:?}"),
        }
    }

    fn plan(&self, text: &str) -> PlanData {
        let compiled = rcc_language::compile(text, "net", &self.config);
        compiled.unwrap_or_else(|faults| panic!("{faults}")).plan
    }
}

#[test]
fn bytes_that_are_not_a_call_are_refused_and_change_nothing() {
    let cell = TestCell::demo();
    let lamp = cell.run(&nets::lamp("lamp"));
    let executor = cell.announced(Role::Executor, "exec");
    let control = Control::of(&cell);
    let before = cell
        .rest("GET", "/commands", "")
        .body
        .as_array()
        .expect("rows")
        .len();
    let seed = rcc_os::clock::monotonic_ns();
    eprintln!("seed {seed}");
    let mut random = Rng::with_seed(seed);
    for length in [0, 1, 2, 7, 64, 1000, 100_000] {
        // An unknown call number, followed by random bytes.
        let mut bytes = vec![0xfa; length];
        for byte in bytes.iter_mut().skip(1) {
            *byte = random.u8(..);
        }
        assert_eq!(
            control.bytes(&bytes),
            Answer::Refused(Refusal::NotUnderstood),
            "{length} bytes"
        );
    }
    let mut cut = wire::encode(&Call::Install {
        id: lamp,
        plan: control.plan(&nets::lamp("lamp")),
    })
    .expect("a call");
    cut.truncate(cut.len() / 2);
    assert_eq!(
        control.bytes(&cut),
        Answer::Refused(Refusal::NotUnderstood),
        "half of a call"
    );
    drop(control);
    let rows = cell.rest("GET", "/commands", "").body;
    assert_eq!(rows.as_array().expect("rows").len(), before, "{rows}");
    assert_eq!(
        cell.announced(Role::Executor, "exec"),
        executor,
        "the same executor"
    );
    assert_eq!(cell.state(lamp)["state"], "running");
    cell.done(lamp, "cancel");
    cell.stop();
}

#[test]
fn an_invalid_plan_is_refused_by_the_executor_itself() {
    let cell = TestCell::demo();
    let lamp = cell.run(&nets::lamp("lamp"));
    let control = Control::of(&cell);
    let plan = control.plan(&nets::line("line", 0.1, 0.1));
    let wrongs: [fn(&mut PlanData); 7] = [
        |plan| plan.catalogue ^= 1,
        |plan| plan.configuration ^= 1,
        |plan| plan.operands[0] = u32::MAX,
        |plan| plan.runs[0].kernel = u16::MAX,
        |plan| plan.runs[0].first = u32::MAX,
        |plan| plan.clocks = 0,
        |plan| plan.reals.clear(),
    ];
    for (number, wrong) in wrongs.iter().enumerate() {
        let mut plan = plan.clone();
        wrong(&mut plan);
        let id = control.reserve();
        let answer = control.call(&Call::Install { id, plan });
        assert!(
            matches!(answer, Answer::Refused(Refusal::Plan(_))),
            "{number}: {answer:?}"
        );
        await_some("the rejection", || {
            (cell.state(id)["state"] == "rejected").then_some(())
        });
        let start = cell.operate(id, "start");
        assert_eq!(start.code(), "RCC3003", "{start:?}");
        let unloaded = control.call(&Call::Unload { id });
        assert!(matches!(unloaded, Answer::Done { .. }), "{unloaded:?}");
    }
    assert_eq!(cell.state(lamp)["state"], "running");
    drop(control);
    cell.stop();
}

#[test]
fn a_plan_with_flipped_bits_is_refused_or_harmless() {
    let cell = TestCell::demo();
    let executor = cell.announced(Role::Executor, "exec");
    let lamp = cell.run(&nets::lamp("lamp"));
    let control = Control::of(&cell);
    let watch = cell.watch();
    let plan = control.plan(&nets::input("input", "io", "lamp_on"));
    let seed = rcc_os::clock::monotonic_ns();
    eprintln!("seed {seed}");
    let (mut random, mut refused) = (Rng::with_seed(seed), 0);
    for round in 0..300 {
        let id = control.reserve();
        let mut bytes = wire::encode(&Call::Install {
            id,
            plan: plan.clone(),
        })
        .expect("a call");
        let bit = random.usize(..bytes.len() * 8);
        bytes[bit / 8] ^= 1 << (bit % 8);
        let answer = control.bytes(&bytes);
        refused += u32::from(matches!(answer, Answer::Refused(_)));
        // An accepted plan has passed the check: it may run, and can be ended.
        if matches!(answer, Answer::Done { .. } | Answer::Rehearsed { .. })
            && let Answer::Done { .. } | Answer::Rehearsed { .. } =
                control.call(&Call::Start { id, lease: 0 })
        {
            control.call(&Call::Abort { id });
        }
        if matches!(answer, Answer::Refused(_)) {
            control.call(&Call::Reject { id });
        }
        assert!(
            matches!(control.call(&Call::Unload { id }), Answer::Done { .. }),
            "round {round}: bit {bit}: {answer:?}"
        );
    }
    assert!(refused > 50, "{refused} of 300 were refused");
    let tables = watch.tables();
    let row = tables
        .commands
        .iter()
        .find(|row| row.id == lamp)
        .expect("the lamp's row");
    assert_eq!(CommandState::from_number(row.state), CommandState::Running);
    assert!(executor.liveness().is_alive(), "the same executor");
    drop((watch, control));
    cell.done(lamp, "cancel");
    cell.stop();
}
