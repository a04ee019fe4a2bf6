//! Two arms in two cells beside one conveyor: cell A moves the belt and follows it, cell B follows its topic over a cable that
//! loses, delays, duplicates and reorders packets.

use std::process::Child;

use rcc_driver_kit::proxy::FaultRates;
use rcc_tests::cell::TestCell;
use rcc_tests::cell_fixture::{await_some, await_told};
use rcc_tests::program;

use super::CANCELED;
use super::cable::Cable;
use super::hosts::{ADDRESSES, Hosts};
use super::pair::{REST, cell, end_gateway, start_gateway};

const PORT: u16 = 7447;
/// Velocity of the belt in the units of the joint that follows, rad/s.
const SPEED: f64 = 0.1;
/// Greatest way of the belt between a value that A compares and now, rad. On the way there and on the way back a value is at
/// most 300 ms old (`expires`) and its measurement at most 250 ms (`stale_after`), and 100 ms are for the shortest transit,
/// which ages do not count, and for cycles.
const LAG_MAX: f64 = SPEED * 1.2;
/// Cycles to compare while packets are lost, delayed, duplicated and reordered.
const CYCLES: i64 = 3_000;
/// Distance of the arms at which they are in step: the belt's way in a quarter of a second, rad.
const IN_STEP: f64 = SPEED * 0.25;
/// Faults of the cable; a step is 1 ms.
const FAULTS: FaultRates = FaultRates {
    lost: 0.02,
    late: 0.3,
    late_steps_max: 20,
    duplicated: 0.05,
    reordered: 0.05,
    ..FaultRates::NONE
};
/// Cuts, s, measured by the way of A's arm: about when connections are given up on one side or both, so that some are made again
/// while the other side still closes the old one.
const CUTS_S: [f64; 4] = [1.6, 1.75, 1.9, 2.1];
const CUT: FaultRates = FaultRates {
    lost: 1.0,
    ..FaultRates::NONE
};

const BELT: &str = "net: conveyor
primitives:
  speed: {type: Input, parameters: {unit: rad/s, initial: 0.0}}
  position: {type: Integrator, inputs: {in: speed.value}}
  give: {type: Publish, parameters: {topic: belt/position}, inputs: {in: position.out}}
  cancel: {type: Cancel}
  end: {type: Termination, inputs: {done: cancel.requested}}
";
/// Primitives that only the net of cell A has.
const NEAR: &str = "  belt: {type: Subscribe, parameters: {topic: belt/position, unit: rad}}
  give: {type: Publish, parameters: {topic: near/joint}, inputs: {in: joint.out}}
";
/// Primitives that only the net of cell B has: it publishes the belt position that it receives, and counts the cycles in which that
/// is below an earlier one.
const FAR: &str = "  belt: {type: AnalogInput, parameters: {device: other, channel: belt}}
  echo: {type: Publish, parameters: {topic: far/belt}, inputs: {in: belt.out}}
  give: {type: Publish, parameters: {topic: far/joint}, inputs: {in: joint.out}}
  greatest: {type: PeakHold, inputs: {in: belt.out}}
  back: {type: Less, inputs: {a: belt.out, b: greatest.greatest}}
  backwards: {type: Counter, inputs: {in: back.out}}
  watch: {type: Monitor, inputs: {value: backwards.out}}
";
/// Judges in every cycle of A what comes back from B.
const COMPARE: &str = "net: compare
primitives:
  now: {type: Subscribe, parameters: {topic: belt/position}}
  near: {type: Subscribe, parameters: {topic: near/joint}}
  belt: {type: AnalogInput, parameters: {device: other, channel: belt}}
  joint: {type: AnalogInput, parameters: {device: other, channel: joint}}
  lag: {type: Subtract, inputs: {a: now.value, b: belt.out}}
  old: {type: Greater, inputs: {a: lag.out, b: LAG_MAX rad}}
  early: {type: Less, inputs: {a: lag.out, b: 0 rad}}
  wrong: {type: Or, inputs: {a: old.out, b: early.out}}
  null: {type: IsNull, inputs: {in: wrong.out}}
  known: {type: Not, inputs: {in: null.out}}
  compared: {type: Counter, inputs: {in: known.out}}
  violation: {type: OrElse, inputs: {in: wrong.out, other: false}}
  violations: {type: Counter, inputs: {in: violation.out}}
  apart: {type: Subtract, inputs: {a: near.value, b: joint.out}}
  watch_compared: {type: Monitor, inputs: {value: compared.out}}
  watch_violations: {type: Monitor, inputs: {value: violations.out}}
  watch_apart: {type: Monitor, inputs: {value: apart.out}}
  cancel: {type: Cancel}
  end: {type: Termination, inputs: {done: cancel.requested}}
";

/// A net whose arm follows the output `belt`; `further` are more primitives.
fn follow(belt: &str, further: &str) -> String {
    format!(
        "net: follow
primitives:
  cancel: {{type: Cancel}}
  move: {{type: JointGoal, parameters: {{device: arm}}, inputs: {{goal: [{belt}, {REST}], stop: cancel.requested}}}}
  robot: {{type: JointPositionCommand, parameters: {{device: arm}}, inputs: {{position: move.position}}}}
  joint: {{type: At, inputs: {{in: move.position, index: 0}}}}
{further}  end: {{type: Termination, inputs: {{done: \"= cancel.requested and move.done\"}}}}
"
    )
}

/// Settings of a cell: its gateway, and the topics of the other cell as a device.
fn settings(own: usize, channels: &str) -> String {
    let sites = ["lab-a", "lab-b"];
    let (here, there) = (sites[own], sites[1 - own]);
    let [listen, connect] = [own, 1 - own].map(|host| format!("tcp/{}:{PORT}", ADDRESSES[host]));
    let shown = program("rcc-link-device");
    let shown = shown.display();
    format!(
        "  other:\n    driver: {{program: {shown}}}\n    settings: {{peer: {there}/test, connect: [\"{connect}\"], expires: 300 ms}}\n    \
         channels: {{{channels}}}\nlink: {{site: {here}, listen: [\"{listen}\"]}}\n"
    )
}

struct Line {
    a: TestCell,
    b: TestCell,
    gateways: [Child; 2],
    cable: Cable,
    _hosts: Hosts,
}

impl Line {
    fn start(seed: u64) -> Result<Line, String> {
        super::installed()?;
        let (hosts, cable) = Hosts::with_faults(seed)?;
        let channel = |name: &str, topic: &str| {
            format!("{name}: {{kind: analog input, address: {topic}, unit: rad}}")
        };
        let back = [channel("belt", "far/belt"), channel("joint", "far/joint")].join(", ");
        let a = cell(&hosts.names[0], &settings(0, &back));
        let b = cell(
            &hosts.names[1],
            &settings(1, &channel("belt", "belt/position")),
        );
        let gateways = [&a, &b].map(start_gateway);
        for cell in [&a, &b] {
            cell.await_device("arm", "ready");
        }
        Ok(Line {
            a,
            b,
            gateways,
            cable,
            _hosts: hosts,
        })
    }

    /// Runs the belt, which stands still, the arms, and the comparison.
    fn run(&self) {
        self.a.run(BELT);
        self.a.run(&follow("belt.value", NEAR));
        self.b.await_device("other", "ready");
        self.b.run(&follow("belt.out", FAR));
        self.a.await_device("other", "ready");
        self.a
            .run(&COMPARE.replace("LAG_MAX", &LAG_MAX.to_string()));
    }

    fn compared(&self) -> i64 {
        let count = self.a.value("compare", "compared.out").as_i64();
        count.expect("never null")
    }

    fn await_in_step(&self) {
        await_told("the arms to be in step", || {
            match self.a.value("compare", "apart.out").as_f64() {
                Some(apart) if apart.abs() <= IN_STEP => Ok(()),
                apart => Err(format!("they are {apart:?} apart")),
            }
        });
    }

    /// Set-point of the joint of A's arm that follows the belt, rad.
    fn joint_of_a(&self) -> f64 {
        let joint = self.a.value("follow", "joint.out");
        joint.as_f64().expect("A sees its own belt")
    }

    fn await_rest(&self, cell: &TestCell) {
        await_told("an arm to rest", || {
            let velocity = cell.value("follow", "move.velocity");
            match velocity[0].as_f64() == Some(0.0) {
                true => Ok(()),
                false => Err(format!("its velocity is {velocity}")),
            }
        });
    }

    /// Whatever happened, no value was older than its limits, from the future, or older than one before it.
    fn assert_judged_well(&self) {
        assert_eq!(self.a.value("compare", "violations.out"), 0);
        let backwards = await_some("a value of the belt in B", || {
            self.b.value("follow", "backwards.out").as_i64()
        });
        assert_eq!(backwards, 0);
    }

    /// Nothing passes for a time: the arm of B rests, and that of A goes on.
    fn cut(&self, seconds: f64) {
        self.cable.set_rates(CUT);
        let goal = self.joint_of_a() + SPEED * seconds;
        self.await_rest(&self.b);
        await_some("null in A", || {
            let apart = self.a.value("compare", "apart.out");
            apart.is_null().then_some(())
        });
        await_some("the arm of A to go on", || {
            (self.joint_of_a() >= goal).then_some(())
        });
        self.await_rest(&self.b);
        self.cable.set_rates(FaultRates::NONE);
        self.await_in_step();
        self.assert_judged_well();
    }

    fn stop(self) {
        self.gateways.into_iter().for_each(end_gateway);
        self.a.stop();
        self.b.stop();
    }
}

#[test]
fn two_arms_in_two_cells_keep_in_step_with_a_conveyor() {
    let seed = super::seed();
    let line = match Line::start(seed) {
        Ok(line) => line,
        Err(reason) => {
            return eprintln!(
                "skipped: two arms in two cells keep in step with a conveyor ({reason})"
            );
        }
    };
    line.run();
    line.a
        .cli_exits(0, &["set", "conveyor", &format!("speed={SPEED}")]);
    line.await_in_step();
    // Packets are lost, late, doubled and overtaken.
    line.cable.set_rates(FAULTS);
    let goal = line.compared() + CYCLES;
    await_some("compared cycles", || {
        (line.compared() >= goal).then_some(())
    });
    line.cable.set_rates(FaultRates::NONE);
    for counts in line.cable.counts() {
        let made = [
            counts.lost,
            counts.late,
            counts.duplicated,
            counts.reordered,
        ];
        assert!(
            made.iter().all(|count| *count > 0),
            "{counts:?}, seed {seed}"
        );
    }
    line.assert_judged_well();
    line.await_in_step();
    CUTS_S.into_iter().for_each(|seconds| line.cut(seconds));
    eprintln!(
        "{} compared cycles, seed {seed}: {:?}",
        line.compared(),
        line.cable.counts()
    );
    // The belt's end is the arms' end.
    line.a
        .cli_exits(CANCELED, &["cancel", "conveyor", "--wait"]);
    line.await_rest(&line.a);
    line.stop();
}
