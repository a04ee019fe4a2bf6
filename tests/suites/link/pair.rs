//! Cell A publishes a number, which cell B's arm follows; each in its own network namespace.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Stdio};

use nix::sys::signal::Signal;
use rcc_tests::cell::TestCell;
use rcc_tests::cell_fixture::{CellFixture, await_some, await_told};
use rcc_tests::census::Census;
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::programs::{program, repository};
use serde_json::Value;

use super::hosts::Hosts;

/// The joint that follows.
const JOINT: usize = 0;
/// Where the gateway of A listens.
pub(super) const ENDPOINT: &str = "tcp/10.77.0.1:7447";
/// Where the arm of B rests, rad.
pub(super) const REST: &str =
    "-1.5707963267948966, 1.5707963267948966, -1.5707963267948966, -1.5707963267948966, 0.0";

const BELT: &str = "net: belt
primitives:
  position: {type: Input, parameters: {unit: rad, initial: 0.0}}
  give: {type: Publish, parameters: {topic: belt/position}, inputs: {in: position.value}}
  cancel: {type: Cancel}
  end: {type: Termination, inputs: {done: cancel.requested}}
";
/// A net that another cell may start.
pub(super) const OTHER: &str = "net: other
primitives:
  cancel: {type: Cancel}
  end: {type: Termination, inputs: {done: cancel.requested}}
";
const STRICT: &str = "net: strict
primitives:
  belt: {type: AnalogInput, parameters: {device: press, channel: belt}}
  gone: {type: IsNull, inputs: {in: belt.out}}
  cancel: {type: Cancel}
  end: {type: Termination, inputs: {done: {lost: gone.out, canceled: cancel.requested}}}
";

fn follow() -> String {
    format!(
        "net: follow
primitives:
  belt: {{type: AnalogInput, parameters: {{device: press, channel: belt}}}}
  gone: {{type: IsNull, inputs: {{in: belt.out}}}}
  watch: {{type: Monitor, inputs: {{value: gone.out}}}}
  cancel: {{type: Cancel}}
  move: {{type: JointGoal, parameters: {{device: arm}}, inputs: {{goal: [belt.out, {REST}], stop: cancel.requested}}}}
  robot: {{type: JointPositionCommand, parameters: {{device: arm}}, inputs: {{position: move.position}}}}
  end: {{type: Termination, inputs: {{done: \"= cancel.requested and move.done\"}}}}
"
    )
}

pub(super) struct CellPair {
    pub a: TestCell,
    pub b: TestCell,
    gateway: Option<Child>,
    pub hosts: Hosts,
}

/// A cell with an arm in a namespace; `further` follows its arm in the configuration.
pub(super) fn cell(namespace: &str, further: &str) -> TestCell {
    let config = repository().join("configs/cells/by-joints.yaml");
    let text = format!(
        "cell: test\nperiod: 1 ms\nstale_after: 250 ms\ndevices:\n  arm:\n    driver: ideal-arm\n    robot: ../robots/ur5e.yaml\n    \
         first_tolerance: deg(0.1)\n    delay: 80 ms\n    settings:\n      start: [0, -90 deg, 90 deg, -90 deg, -90 deg, 0]\n{further}"
    );
    let place = CellFixture::new(&config, |_| text.clone());
    TestCell::begin(place.in_namespace(namespace))
}

/// Starts the gateway of a cell.
pub(super) fn start_gateway(cell: &TestCell) -> Child {
    let mut command = cell.program("rcc-link");
    command.arg("serve").arg("--config").arg(cell.config());
    let child = ends_with_test(&mut command).spawn();
    child.expect("rcc-link starts")
}

/// Asks a gateway to end, and asserts that it does so well.
pub(super) fn end_gateway(mut gateway: Child) {
    signal(gateway.id(), Signal::SIGTERM);
    let status = gateway.wait().expect("it is a child");
    assert!(status.success(), "{status:?}");
}

impl CellPair {
    /// Starts both cells and the gateway of A; the error says why it cannot be.
    pub fn start() -> Result<CellPair, String> {
        super::installed()?;
        let shown = program("rcc-link-device");
        let shown = shown.display();
        let hosts = Hosts::new()?;
        let [a, b] = &hosts.names;
        let link = format!(
            "link: {{site: lab-a, listen: [\"{ENDPOINT}\"], start: {{lab-b/test: [other]}}}}\n"
        );
        let device = format!(
            "  press:\n    driver: {{program: {shown}}}\n    settings: {{peer: lab-a/test, connect: [\"{ENDPOINT}\"], expires: 300 ms}}\n    \
             channels:\n      belt: {{kind: analog input, address: belt/position, unit: rad}}\n"
        );
        let mut pair = CellPair {
            a: cell(a, &link),
            b: cell(b, &device),
            gateway: None,
            hosts,
        };
        pair.start_gateway();
        for cell in [&pair.a, &pair.b] {
            cell.await_device("arm", "ready");
        }
        Ok(pair)
    }

    pub fn start_gateway(&mut self) {
        self.gateway = Some(start_gateway(&self.a));
    }

    pub fn kill_gateway(&mut self) {
        if let Some(mut gateway) = self.gateway.take() {
            gateway.kill().expect("it is a child");
            gateway.wait().expect("it is a child");
        }
    }

    /// Runs `belt` in A and, once its value arrives, `follow` in B.
    pub fn run_both(&self) {
        self.a.run(BELT);
        self.b.await_device("press", "ready");
        self.b.run(&follow());
        await_some("a first value", || {
            (self.value("gone.out").ok()? == Value::Bool(false)).then_some(())
        });
    }

    /// Sets what A publishes.
    pub fn publish(&self, position: f64) {
        self.a
            .cli_exits(0, &["set", "belt", &format!("position={position}")]);
    }

    /// Loads and starts `strict` in B.
    pub fn start_strict(&self) -> u64 {
        self.b.run(STRICT)
    }

    /// Returns the value of a port of `follow`.
    pub fn value(&self, port: &str) -> Result<Value, String> {
        let path = format!("/commands/follow/values?ports={port}");
        let reply = self.b.try_rest("GET", &path, "").ok_or("no answer")?;
        let value = reply.body["values"][0]["value"].clone();
        match value.is_null() {
            true => Err(format!("{port}: {:?}", reply.body)),
            false => Ok(value),
        }
    }

    pub fn joint(&self) -> Result<f64, String> {
        let joints = self.value("move.position")?;
        joints[JOINT].as_f64().ok_or_else(|| joints.to_string())
    }

    pub fn await_joint(&self, target: f64) {
        await_told("the arm to follow", || match self.joint()? {
            joint if (joint - target).abs() < 1e-6 => Ok(()),
            joint => Err(format!("the joint is at {joint}, not at {target}")),
        });
    }

    pub fn follow_state(&self) -> String {
        let reply = self.b.rest("GET", "/commands/follow?brief=true", "");
        reply.body["state"].as_str().unwrap_or_default().to_owned()
    }

    /// The value is null, and the arm comes to rest and stays there.
    pub fn assert_rests(&self) {
        await_told("the value to be null", || match self.value("gone.out")? {
            Value::Bool(true) => Ok(()),
            other => Err(format!("gone.out is {other}")),
        });
        await_told("the arm to rest", || {
            let velocity = self.value("move.velocity")?;
            match velocity[JOINT].as_f64() {
                Some(0.0) => Ok(()),
                _ => Err(velocity.to_string()),
            }
        });
        let rests = self.joint().expect("a position");
        self.b.watch().await_cycles(300);
        assert_eq!(self.value("gone.out"), Ok(Value::Bool(true)));
        assert_eq!(self.joint(), Ok(rests));
    }

    /// Runs `rcc-link` in B; returns what it says.
    pub fn link_in_b(&self, arguments: &[&str]) -> String {
        let mut command = self.b.program("rcc-link");
        let output = command.args(arguments).output();
        let output = output.expect("rcc-link runs");
        let text = [output.stdout, output.stderr].concat();
        String::from_utf8_lossy(&text).into_owned()
    }

    /// Runs `rcc-link` in B, which follows something, until it prints a line that contains `words`; returns that line.
    pub fn followed_in_b(&self, arguments: &[&str], words: &str) -> String {
        let mut command = self.b.program("rcc-link");
        let mut child = ends_with_test(command.args(arguments).stdout(Stdio::piped()))
            .spawn()
            .expect("rcc-link runs");
        let lines = BufReader::new(child.stdout.take().expect("a pipe")).lines();
        let found = lines
            .map_while(Result::ok)
            .find(|line| line.contains(words));
        let _ = child.kill();
        let _ = child.wait();
        found.unwrap_or_else(|| panic!("no line with `{words}`"))
    }

    /// Asks A, as another cell.
    pub fn ask(&self, operation: &str, peer: &str, net: &str) -> String {
        self.link_in_b(&[
            operation,
            "--connect",
            ENDPOINT,
            "--as",
            peer,
            "lab-a/test",
            net,
        ])
    }

    /// Open files and threads of the gateway of A and of the device of B.
    pub fn census(&self) -> [[u64; 2]; 2] {
        let gateway = self.gateway.as_ref().expect("it runs").id();
        let device = self.b.announced(rcc_protocol::Role::Driver, "press").pid;
        [(&self.a, gateway), (&self.b, device)].map(|(cell, pid)| {
            let census = Census::of(cell, pid);
            [census.descriptors, census.threads]
        })
    }

    pub fn assert_no_growth(&self, before: &[[u64; 2]; 2]) {
        // A connection that is being replaced has two sockets for a moment.
        await_told("no growth of open files and threads", || {
            let now = self.census();
            let pairs = now.iter().flatten().zip(before.iter().flatten());
            match pairs.into_iter().all(|(now, before)| now <= before) {
                true => Ok(()),
                false => Err(format!("{before:?} before, {now:?} now")),
            }
        });
    }

    /// Ends everything, and asserts that nothing is left.
    pub fn stop(mut self) {
        if let Some(gateway) = self.gateway.take() {
            end_gateway(gateway);
        }
        let CellPair { a, b, hosts, .. } = self;
        a.stop();
        b.stop();
        drop(hosts);
    }
}
