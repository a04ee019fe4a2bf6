//! An engine in virtual time with one arm and its simulated driver, and plans written by hand.
#![allow(dead_code)] // Each test binary uses its own part.

use bytemuck::Zeroable;
use rcc_core::frame::DeviceModel;
use rcc_core::message::{
    CommandEntry, CommandState, DeviceState, EndReason, Joints, MAGIC, Measurement, MonitorRecord,
    SetPoint,
};
use rcc_core::plan::{InputPoint, KernelRun, MonitorPoint, PublishPoint, Rate, ValuePoint};
use rcc_core::primitives;
use rcc_core::topic::Topic;
use rcc_core::types::{NULL_INT, Store};
use rcc_engine::engine::{Engine, EngineConfig};
use rcc_engine::net::Net;
use rcc_engine::queue::{EngineReply, EngineRequest, HelperRingEnds, ValueReading, rings};
use rcc_engine::record::FlightRecorder;
use rcc_protocol::control::{Answer, InputValue, NetValues, PlanData, Refusal, SWITCH_MAX};
pub use rcc_testing::arms::HOLD;
use rcc_testing::arms::plain_lwr;

pub const PERIOD_NS: u64 = 1_000_000;

/// An LWR 4+ with four channels of each kind.
pub fn model() -> DeviceModel {
    DeviceModel {
        channels: [4; 4],
        ..plain_lwr(2000.0)
    }
}

/// A driver that plays set-points after a delay of some cycles, like the driver host.
pub struct SimulatedDriver {
    pub measurement: Measurement,
    pub delay: u64,
    pub alive: bool,
    pub incarnation: u64,
    waited: u64,
}

impl SimulatedDriver {
    fn exchange(&mut self, engine: &Engine, now_ns: u64) {
        if !self.alive {
            return;
        }
        let image = engine.image(0).expect("device 0");
        let newest = image.at(image.head.sequence).expect("the newest set-point");
        let m = &mut self.measurement;
        m.sequence += 1;
        m.stamp_ns = now_ns;
        if m.state == DeviceState::Online as u32 {
            return;
        }
        if newest.has_position == 1 {
            self.waited = 0;
            m.state = DeviceState::Commanded as u32;
            m.settled_ns = 0;
            m.played_ns = newest.logical_ns;
            m.hold = newest.position;
            m.position = newest.position;
        } else if m.state == DeviceState::Commanded as u32 {
            self.waited += 1;
            if self.waited > self.delay {
                m.state = DeviceState::Ready as u32;
                m.settled_ns = newest.logical_ns;
            }
        } else {
            m.settled_ns = newest.logical_ns;
        }
    }
}

/// The engine, the helper threads' ends of its rings, and virtual time.
pub struct EngineFixture {
    pub engine: Engine,
    pub ends: HelperRingEnds,
    pub driver: SimulatedDriver,
    pub now_ns: u64,
    pub period_ns: u64,
    pub models: Vec<DeviceModel>,
    /// Measurements of the devices after the arm, which are plain I/O.
    pub others: Vec<Measurement>,
    configuration: u64,
    next_ticket: u64,
}

impl EngineFixture {
    pub fn new() -> EngineFixture {
        EngineFixture::with(model())
    }

    pub fn with(model: DeviceModel) -> EngineFixture {
        EngineFixture::of_cell(vec![model], 5, HOLD)
    }

    /// As `new`, with another base period.
    pub fn at_period(period_ns: u64) -> EngineFixture {
        EngineFixture::of_cell_at(vec![model()], 5, HOLD, period_ns)
    }

    /// An engine for the devices of a cell, the arm first; the arm is held at `hold`.
    pub fn of_cell(models: Vec<DeviceModel>, configuration: u64, hold: Joints) -> EngineFixture {
        EngineFixture::of_cell_at(models, configuration, hold, PERIOD_NS)
    }

    fn of_cell_at(
        models: Vec<DeviceModel>,
        configuration: u64,
        hold: Joints,
        period_ns: u64,
    ) -> EngineFixture {
        let (rt, ends) = rings();
        let config = EngineConfig {
            incarnation: 7,
            first_id: 1,
            period_ns,
            stale_after_ns: (3 * period_ns).max(50_000_000),
            late_in_a_row_max: 3,
            models: models.clone(),
        };
        let mut measurement = Measurement::zeroed();
        measurement.magic = MAGIC;
        measurement.state = DeviceState::Ready as u32;
        let others = vec![measurement; models.len() - 1];
        measurement.joints = 7;
        measurement.hold = hold;
        measurement.position = hold;
        let driver = SimulatedDriver {
            measurement,
            delay: 10,
            alive: true,
            incarnation: 1,
            waited: 0,
        };
        let mut fixture = EngineFixture {
            engine: Engine::new(config, rt),
            ends,
            driver,
            now_ns: 1_000_000_000,
            period_ns,
            models,
            others,
            configuration,
            next_ticket: 1,
        };
        fixture.step();
        fixture
    }

    /// Adds a flight recorder to the engine.
    pub fn recorded_by(self, recorder: FlightRecorder) -> EngineFixture {
        let engine = self.engine.recorded_by(recorder);
        EngineFixture { engine, ..self }
    }

    /// One cycle: the driver exchanges data, then the executor runs.
    pub fn step(&mut self) {
        self.now_ns += self.period_ns;
        if self.engine.status().cycle > 0 {
            self.driver.exchange(&self.engine, self.now_ns);
        }
        self.driver.measurement.stamp_ns = if self.driver.alive {
            self.now_ns
        } else {
            self.driver.measurement.stamp_ns
        };
        let newest = (self.driver.incarnation, self.driver.measurement);
        self.engine.latch(0, Some(newest), self.now_ns);
        for (index, other) in self.others.iter_mut().enumerate() {
            if self.driver.alive {
                other.stamp_ns = self.now_ns;
            }
            self.engine.latch(index + 1, Some((2, *other)), self.now_ns);
        }
        self.engine.cycle(self.now_ns);
        self.engine.account(0, 1000, 0);
    }

    pub fn steps(&mut self, count: usize) {
        (0..count).for_each(|_| self.step());
    }

    /// Sends a request without waiting for the reply; returns its ticket.
    pub fn order(&mut self, order: impl FnOnce(u64) -> EngineRequest) -> u64 {
        let ticket = self.next_ticket;
        self.next_ticket += 1;
        self.ends.requests.push(order(ticket)).expect("room");
        ticket
    }

    /// Sends a request, runs one cycle and returns the answer.
    pub fn ask(&mut self, order: impl FnOnce(u64) -> EngineRequest) -> Answer {
        let ticket = self.order(order);
        self.step();
        self.answer(ticket).expect("an answer in the same cycle")
    }

    pub fn answer(&mut self, wanted: u64) -> Option<Answer> {
        while let Ok(reply) = self.ends.replies.pop() {
            if let EngineReply::Answer { ticket, answer } = reply
                && ticket == wanted
            {
                return Some(answer);
            }
        }
        None
    }

    pub fn build(&self, plan: PlanData) -> Result<Box<Net>, Refusal> {
        let mut holds = vec![Some(self.driver.measurement.hold)];
        holds.resize(self.models.len(), None);
        let dt_s = self.period_ns as f64 / 1e9;
        Net::build(plan, &self.models, self.configuration, &holds, dt_s)
    }

    /// Reserves a row and installs the plan in it.
    pub fn load(&mut self, plan: PlanData) -> u64 {
        let net = self.build(plan).expect("a good plan");
        let Answer::Reserved { id } = self.ask(|ticket| EngineRequest::Reserve { ticket }) else {
            panic!("no row")
        };
        let answer = self.ask(|ticket| EngineRequest::Install { ticket, id, net });
        assert!(matches!(answer, Answer::Done { .. }), "{answer:?}");
        id
    }

    pub fn start(&mut self, id: u64) -> Answer {
        self.ask(start_of(id))
    }

    /// Requests a hand-over and runs one cycle.
    pub fn switch(&mut self, stop: &[u64], start: &[u64]) -> Answer {
        let (stop, start) = (named(stop), named(start));
        self.ask(|ticket| EngineRequest::Handover {
            ticket,
            stop,
            start,
            lease: 0,
        })
    }

    /// Sets inputs and runs one cycle.
    pub fn set(&mut self, id: u64, values: &[(u32, &[f64])]) -> Answer {
        let value = |(input, values): &(u32, &[f64])| InputValue {
            input: *input,
            words: values.iter().map(|value| value.to_bits()).collect(),
        };
        let values = values.iter().map(value).collect();
        self.ask(|ticket| EngineRequest::Set { ticket, id, values })
    }

    /// Reads values as the previous cycle left them, and runs one cycle.
    pub fn read(&mut self, id: u64, points: &[ValuePoint]) -> Result<NetValues, Refusal> {
        let reading = ValueReading::of(points.to_vec());
        self.order(|ticket| EngineRequest::Read {
            ticket,
            id,
            reading,
        });
        self.step();
        while let Ok(reply) = self.ends.replies.pop() {
            if let EngineReply::Read {
                reading, refused, ..
            } = reply
            {
                return refused.map_or(Ok(reading.values), Err);
            }
        }
        panic!("nothing was read")
    }

    /// The newest set-point of device 0.
    pub fn told(&self) -> SetPoint {
        let image = self.engine.image(0).expect("device 0");
        *image.at(image.head.sequence).expect("the newest set-point")
    }

    pub fn entry(&self, id: u64) -> CommandEntry {
        *self
            .engine
            .tables()
            .commands
            .iter()
            .find(|entry| entry.id == id)
            .expect("a row")
    }

    pub fn state(&self, id: u64) -> CommandState {
        CommandState::from_number(self.entry(id).state)
    }

    pub fn reason(&self, id: u64) -> EndReason {
        EndReason::from_number(self.entry(id).reason)
    }

    /// Steps until the command is terminated, at most `cycles`.
    pub fn until_terminated(&mut self, id: u64, cycles: usize) -> EndReason {
        for _ in 0..cycles {
            if self.state(id) == CommandState::Terminated {
                return self.reason(id);
            }
            self.step();
        }
        panic!("still {:?} after {cycles} cycles", self.state(id));
    }

    pub fn records(&mut self) -> Vec<MonitorRecord> {
        std::iter::from_fn(|| self.ends.records.pop().ok()).collect()
    }
}

/// START without a lease.
pub fn start_of(id: u64) -> impl FnOnce(u64) -> EngineRequest {
    move |ticket| EngineRequest::Start {
        ticket,
        id,
        lease: 0,
    }
}

/// Ids in a list of fixed length.
pub fn named(ids: &[u64]) -> [u64; SWITCH_MAX] {
    let mut list = [0; SWITCH_MAX];
    list[..ids.len()].copy_from_slice(ids);
    list
}

/// Collects primitives into a plan; slots are assigned by hand.
#[derive(Default)]
pub struct TestPlan {
    pub data: PlanData,
}

impl TestPlan {
    pub fn new() -> TestPlan {
        let data = PlanData {
            catalogue: primitives::fingerprint(),
            configuration: 5,
            ..PlanData::default()
        };
        TestPlan { data }
    }

    pub fn reals(&mut self, values: &[f64]) -> u32 {
        self.data.reals.extend(values);
        (self.data.reals.len() - values.len()) as u32
    }

    pub fn bool(&mut self, value: u8) -> u32 {
        self.data.bools.push(value);
        (self.data.bools.len() - 1) as u32
    }

    /// Adds primitives of one type.
    pub fn add(&mut self, name: &str, operands: &[u32]) {
        let (entry, row) = primitives::find(name).expect("a primitive");
        let first = self.data.operands.len() as u32;
        self.data.operands.extend(operands);
        // The first kernel whose operand groups fit; one for wide values has one operand more, the width.
        let fits = |kernel| {
            operands
                .len()
                .is_multiple_of(row.spec.operands(kernel).count())
        };
        let kernel = row.kernels.iter().position(fits).expect("whole groups");
        let kernel = primitives::kernel_number(entry, kernel);
        self.data.runs.push(KernelRun {
            kernel,
            first,
            operands: operands.len() as u32,
        });
    }

    /// Adds an input of reals with these initial values.
    pub fn input(&mut self, values: &[f64], expires: u32) -> InputPoint {
        let slot = self.reals(values);
        let age = self.reals(&[f64::NAN]);
        self.data.ints.push(NULL_INT);
        let input = InputPoint {
            store: Store::Real,
            slot,
            width: values.len() as u32,
            since: self.data.ints.len() as u32 - 1,
            age,
            expires,
            at_least: None,
            at_most: None,
            topic: None,
        };
        self.data.inputs.push(input);
        input
    }

    pub fn monitor(&mut self, store: Store, slot: u32, width: u32, every: u32) {
        self.data.monitors.push(MonitorPoint {
            store,
            slot,
            width,
            every,
        });
    }
}

/// A net that writes a digital output until CANCEL.
pub fn output_net(channel: u32) -> PlanData {
    let mut plan = TestPlan::new();
    let (requested, on) = (plan.bool(2), plan.bool(1));
    plan.add("Cancel", &[requested]);
    plan.add("DigitalOutput", &[on, 0, channel]);
    plan.add("Termination", &[requested]);
    plan.monitor(Store::Bool, requested, 1, 1);
    plan.data
}

/// A net that shows its logical time in each evaluation and writes it to analog output 0, until CANCEL.
pub fn time_net(rate: Rate) -> PlanData {
    let mut plan = TestPlan::new();
    let requested = plan.bool(2);
    let time = plan.reals(&[f64::NAN]);
    plan.add("Cancel", &[requested]);
    plan.add("Time", &[time]);
    plan.add("AnalogOutput", &[time, 0, 0]);
    plan.add("Termination", &[requested]);
    plan.monitor(Store::Real, time, 1, 1);
    plan.data.rate = rate;
    plan.data
}

/// A net with two inputs, of one element and of three, shown in each evaluation with the age of the first; the first is
/// written to analog output 0. Runs until CANCEL.
pub fn input_net(initial: f64, expires: u32) -> PlanData {
    let mut plan = TestPlan::new();
    let requested = plan.bool(2);
    let one = plan.input(&[initial], expires);
    let three = plan.input(&[f64::NAN; 3], 0);
    plan.add("Cancel", &[requested]);
    plan.add("AnalogOutput", &[one.slot, 0, 0]);
    plan.add("Termination", &[requested]);
    plan.monitor(Store::Real, one.slot, 1, 1);
    plan.monitor(Store::Real, three.slot, 3, 1);
    plan.monitor(Store::Real, one.age, 1, 1);
    plan.data
}

/// A net that publishes its logical time in each evaluation, until CANCEL.
pub fn publishing_net(topic: Topic, rate: Rate) -> PlanData {
    let mut plan = TestPlan::new();
    let requested = plan.bool(2);
    let time = plan.reals(&[f64::NAN]);
    let out = plan.reals(&[f64::NAN]);
    plan.add("Cancel", &[requested]);
    plan.add("Time", &[time]);
    plan.add("Publish", &[time, out]);
    plan.add("Termination", &[requested]);
    plan.data.publishes.push(PublishPoint {
        topic,
        store: Store::Real,
        slot: out,
        width: 1,
    });
    plan.data.rate = rate;
    plan.data
}

/// A net that shows the value of a topic, and its age, in each evaluation, until CANCEL.
pub fn subscribing_net(topic: Topic, rate: Rate, expires: u32) -> PlanData {
    let mut plan = TestPlan::new();
    let requested = plan.bool(2);
    let value = plan.input(&[f64::NAN], expires);
    plan.data.inputs[0].topic = Some(topic);
    plan.add("Cancel", &[requested]);
    plan.add("Termination", &[requested]);
    plan.monitor(Store::Real, value.slot, 1, 1);
    plan.monitor(Store::Real, value.age, 1, 1);
    plan.data.rate = rate;
    plan.data
}

/// As `output_net`, without `Cancel`: it never ends by itself.
pub fn endless_net(channel: u32) -> PlanData {
    let mut plan = TestPlan::new();
    let (no, on) = (plan.bool(0), plan.bool(1));
    plan.add("DigitalOutput", &[on, 0, channel]);
    plan.add("Termination", &[no]);
    plan.data
}

/// A line of 10 cm along y from the hold set-point, stopped by CANCEL.
pub fn line_net() -> PlanData {
    motion_net(None)
}

/// A line from a given start pose, or from the hold set-point.
pub fn motion_net(from: Option<[f64; 7]>) -> PlanData {
    let start = model().arm.expect("an arm").forward(&HOLD);
    let mut goal = start;
    goal.position[1] += 0.1;
    let mut plan = TestPlan::new();
    let (requested, done) = (plan.bool(2), plan.bool(2));
    let pose = plan.reals(&[f64::NAN; 7]);
    let [distance, speed, acceleration] = [(); 3].map(|()| plan.reals(&[f64::NAN]));
    let to = plan.reals(&goal.to_slots());
    let from = plan.reals(&from.unwrap_or([f64::NAN; 7]));
    let limits = plan.reals(&[0.2, 1.0, 10.0, 1.0, 4.0, 40.0]);
    let joints = plan.reals(&[f64::NAN; 7]);
    let ik = plan.reals(&[f64::NAN; 10]);
    plan.data.ints.extend([NULL_INT, NULL_INT, NULL_INT, 0]);
    let pause = plan.bool(0);
    let [progress, all] = [f64::NAN, 1.0].map(|value| plan.reals(&[value]));
    let given = plan.reals(&[f64::NAN; 7]);
    plan.add("Cancel", &[requested]);
    let inputs = [requested, pause, all];
    let outputs = [
        given,
        pose,
        done,
        progress,
        distance,
        speed,
        acceleration,
        2,
    ];
    let six: [u32; 6] = std::array::from_fn(|place| limits + place as u32);
    // Even speed profile and constant arm angle: no arm angle is given, and the first keyword of each list.
    let (profile, elbow) = ([all, pause, 3], [given, 3]);
    let parameters = [&[0, to, from][..], &six, &profile, &elbow].concat();
    plan.add(
        "LinearMotion",
        &[&inputs[..], &outputs, &parameters, &[0, 7]].concat(),
    );
    // Begins where the arm is held: the first keyword.
    plan.add("InverseKinematics", &[pose, joints, 0, 1, 0, 3, ik, 7]);
    plan.add("JointPositionCommand", &[joints, 0, 7]);
    plan.add("Termination", &[done]);
    plan.monitor(Store::Real, distance, 1, 1);
    plan.data.clocks = 1;
    plan.data
}

/// A net that commands joint 1 to `from` + `velocity`·t (rad, rad/s) and holds the others; never ends.
pub fn drift_net(from: f64, velocity: f64) -> PlanData {
    let mut plan = TestPlan::new();
    let no = plan.bool(0);
    let [from, velocity, time, way] =
        [from, velocity, f64::NAN, f64::NAN].map(|value| plan.reals(&[value]));
    let joints = plan.reals(&HOLD[..7]);
    plan.add("Time", &[time]);
    plan.add("Multiply", &[time, velocity, way]);
    plan.add("Add", &[from, way, joints]);
    plan.add("JointPositionCommand", &[joints, 0, 7]);
    plan.add("Termination", &[no]);
    plan.data
}
