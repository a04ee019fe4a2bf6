//! Runs the executor's engine in virtual time, with a simulated driver that may do anything, and checks every set-point
//! that the engine commands. Run by the thread of the target.

use bytemuck::Zeroable;
use rcc_core::message::{
    CommandEntry, CommandState, DeviceState, FaultCode, JOINTS_MAX, Joints, MAGIC, Measurement,
    SetPoint,
};
use rcc_engine::engine::{Engine, EngineConfig};
use rcc_engine::net::Net;
use rcc_engine::queue::{EngineReply, EngineRequest, HelperRingEnds, rings};
use rcc_protocol::control::{Answer, PlanData, Refusal};

use crate::set_point_checker::SetPointChecker;
use crate::shipped::{HOLD, shipped};

const PERIOD_NS: u64 = 1_000_000;

/// The engine of the demo cell.
pub struct EngineHarness {
    engine: Engine,
    ends: HelperRingEnds,
    /// Measurement of each device; the arm is the first.
    pub measured: Vec<Measurement>,
    /// True if the devices have a board.
    pub attached: bool,
    /// True if the drivers exchange data; otherwise their measurements age.
    pub alive: bool,
    /// True if they measure what a correct driver would; otherwise only what the target sets.
    pub honest: bool,
    now_ns: u64,
    next_ticket: u64,
    checker: SetPointChecker,
    owner: u64,
    /// Number of set-points that commanded anything.
    pub commanded: u64,
}

impl Default for EngineHarness {
    fn default() -> Self {
        EngineHarness::new()
    }
}

impl EngineHarness {
    /// Creates an engine whose devices are all ready, and runs one cycle.
    #[must_use]
    pub fn new() -> EngineHarness {
        let models = shipped().models.clone();
        let (rt, ends) = rings();
        let measured = models.iter().map(|model| Measurement {
            magic: MAGIC,
            state: DeviceState::Ready as u32,
            quality_permille: 1000,
            joints: model.joints,
            hold: if model.joints > 0 {
                HOLD
            } else {
                [0.0; JOINTS_MAX]
            },
            position: if model.joints > 0 {
                HOLD
            } else {
                [0.0; JOINTS_MAX]
            },
            ..Measurement::zeroed()
        });
        let measured = measured.collect();
        let checker = SetPointChecker::new(models[0].limits, 0.0);
        let config = EngineConfig {
            incarnation: 7,
            first_id: 1,
            period_ns: PERIOD_NS,
            stale_after_ns: 50 * PERIOD_NS,
            late_in_a_row_max: 3,
            models,
        };
        let mut harness = EngineHarness {
            engine: Engine::new(config, rt),
            ends,
            measured,
            attached: true,
            alive: true,
            honest: true,
            now_ns: 1_000 * PERIOD_NS,
            next_ticket: 1,
            checker,
            owner: 0,
            commanded: 0,
        };
        harness.step();
        harness
    }

    /// Runs one cycle: the devices exchange data, then the engine runs, and its commands are checked.
    pub fn step(&mut self) {
        self.now_ns += PERIOD_NS;
        self.exchange();
        for (index, measured) in self.measured.iter().enumerate() {
            let board = self.attached.then_some((1, *measured));
            self.engine.latch(index, board, self.now_ns);
        }
        self.engine.cycle(self.now_ns);
        self.engine.account(0, 1000, 0);
        self.check_arm();
        for row in &self.engine.tables().commands {
            assert!(
                row.fault.code != FaultCode::Panic as u32,
                "a primitive panicked"
            );
        }
        while self.ends.records.pop().is_ok() {}
        while self.ends.events.pop().is_ok() {}
    }

    fn newest(&self, device: usize) -> SetPoint {
        let image = self.engine.image(device);
        let newest = image.and_then(|image| image.at(image.head.sequence));
        newest.copied().unwrap_or(SetPoint::NONE)
    }

    /// Exchanges data as a driver's host does, without its delay.
    fn exchange(&mut self) {
        if !self.alive {
            return;
        }
        for index in 0..self.measured.len() {
            let newest = self.newest(index);
            let measured = &mut self.measured[index];
            measured.sequence += 1;
            measured.stamp_ns = self.now_ns;
            if !self.honest || measured.state < DeviceState::Ready as u32 {
                continue;
            }
            let moves = newest.has_position == 1;
            measured.state = if moves {
                DeviceState::Commanded
            } else {
                DeviceState::Ready
            } as u32;
            measured.settled_ns = if moves { 0 } else { newest.logical_ns };
            if moves {
                (measured.hold, measured.position) = (newest.position, newest.position);
            }
        }
    }

    /// Checks that the arm's set-points are within its limits, whatever was measured.
    fn check_arm(&mut self) {
        for index in 0..self.measured.len() {
            let newest = self.newest(index);
            let analog = newest.analog.iter().any(|value| !value.is_nan());
            let outputs = newest.digital_commanded != 0 || analog;
            self.commanded += u64::from(newest.has_position == 1 || outputs);
            if index > 0 {
                assert_eq!(newest.has_position, 0, "plain I/O has no position");
                continue;
            }
            if newest.has_position == 0 {
                self.checker.forget();
                self.owner = 0;
            } else if self.owner == newest.owner && newest.owner != 0 {
                self.checker.in_range(&newest.position);
                self.checker.follow(&newest.position, 1e-3);
            } else {
                assert_ne!(newest.owner, 0, "a set-point has an owner");
                let model = &shipped().models[0];
                let hold = self.measured[0].hold;
                self.checker
                    .begin(&hold, model.first_tolerance_rad, &newest.position);
                self.owner = newest.owner;
            }
        }
    }

    /// Builds a net as the executor's net-builder thread does.
    ///
    /// # Errors
    /// Returns the executor's refusal.
    pub fn build(&self, plan: PlanData) -> Result<Box<Net>, Refusal> {
        let known = |measured: &Measurement| {
            let finite = measured.hold.iter().all(|value| value.is_finite());
            (finite && measured.joints > 0).then_some(measured.hold)
        };
        let holds: Vec<Option<Joints>> = self.measured.iter().map(known).collect();
        let shipped = shipped();
        Net::build(
            plan,
            &shipped.models,
            shipped.table.fingerprint,
            &holds,
            1e-3,
        )
    }

    /// Submits an order and runs a cycle; returns the answer, if there is one by then.
    pub fn ask(&mut self, order: impl FnOnce(u64) -> EngineRequest) -> Option<Answer> {
        let wanted = self.next_ticket;
        self.next_ticket += 1;
        let room = self.ends.requests.push(order(wanted));
        assert!(room.is_ok(), "the engine takes its orders");
        self.step();
        let mut found = None;
        while let Ok(outcome) = self.ends.replies.pop() {
            match outcome {
                EngineReply::Answer { ticket, answer } if ticket == wanted => found = Some(answer),
                EngineReply::Read {
                    reading, refused, ..
                } => found = Some(refused.map_or(Answer::Values(reading.values), Answer::Refused)),
                EngineReply::Rules { .. } => found = Some(Answer::Rules(Vec::new())),
                _ => {}
            }
        }
        found
    }

    /// Loads a net as a ready command, and returns its id.
    pub fn install(&mut self, net: Box<Net>) -> Option<u64> {
        let Some(Answer::Reserved { id }) = self.ask(|ticket| EngineRequest::Reserve { ticket })
        else {
            return None;
        };
        self.ask(|ticket| EngineRequest::Install { ticket, id, net });
        Some(id)
    }

    /// Returns the row of a command.
    #[must_use]
    pub fn row(&self, id: u64) -> Option<&CommandEntry> {
        self.engine.command(id)
    }

    /// Returns true if the command has ended or never existed.
    #[must_use]
    pub fn is_over(&self, id: u64) -> bool {
        let state = self.row(id).map(|row| CommandState::from_number(row.state));
        !state.is_some_and(CommandState::is_active)
    }
}
