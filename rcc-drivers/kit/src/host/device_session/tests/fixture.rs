//! Executor, board, device and session in one virtual time with steps of 1 ms, each of which may stall.
//! Test code only.

use rcc_core::guard::JointLimits;
use rcc_core::impedance::ControlMode;
use rcc_core::message::ANALOG_MAX;

use super::super::*;
use crate::conformance;

pub(super) const MS: u64 = 1_000_000;
pub(super) const DELAY: u64 = 10;
pub(super) const A_MAX: f64 = 20.0;
pub(super) const J_MAX: f64 = 2000.0;

pub(super) fn limits() -> ArmLimits {
    ArmLimits {
        joints: JointLimits {
            lower: [-2.0; JOINTS_MAX],
            upper: [2.0; JOINTS_MAX],
            velocity_max: [2.0; JOINTS_MAX],
            acceleration_max: [A_MAX; JOINTS_MAX],
            jerk_max: [J_MAX; JOINTS_MAX],
            joints: 7,
        },
        jerk_max: [J_MAX; JOINTS_MAX],
        impedance: None,
    }
}

/// A session with these settings, of a device that has not been reached yet.
pub(super) fn session(settings: SessionSettings) -> DeviceSession {
    let device = conformance::device("none", serde_json::json!({}), &[]);
    DeviceSession {
        settings,
        ..DeviceSession::new(&device, 0)
    }
}

/// Executor, board, device and session in one virtual time.
pub(super) struct SessionFixture {
    pub(super) session: DeviceSession,
    pub(super) image: CommandImage,
    /// An executor is present.
    pub(super) connected: bool,
    pub(super) now_ns: u64,
    /// Positions sent to the device, one row per exchange with its time, ms.
    pub(super) sent: Vec<(u64, Joints)>,
    pub(super) device: Exchange,
}

impl SessionFixture {
    /// A commandable arm at 0, and an executor without nets.
    pub(super) fn new() -> Self {
        Self::with(false)
    }

    /// As `new`, but the executor's clock follows the device.
    pub(super) fn with_leading_clock() -> Self {
        Self::with(true)
    }

    fn with(leads_clock: bool) -> Self {
        let mut fixture = Self {
            session: session(SessionSettings {
                limits: limits(),
                first_tolerance_rad: 2e-3,
                delay_ns: DELAY * MS,
                command_timeout_ns: 50 * MS,
                leads_clock,
            }),
            image: CommandImage::new(7, MS),
            connected: true,
            now_ns: 1_000 * MS,
            sent: Vec::new(),
            device: Exchange {
                ticks: 1,
                period_ns: MS,
                commandable: true,
                startable: true,
                strategy: ControlMode::Position,
                mirror: [0.0; JOINTS_MAX],
                quality_permille: 1000,
                reason: 0,
                late: 0,
                refused: 0,
            },
        };
        fixture.device.commandable = false;
        fixture.exchange();
        fixture.device.commandable = true;
        fixture.idle(20);
        assert_eq!(fixture.session.state(), DeviceState::Ready);
        fixture.sent.clear();
        fixture
    }

    /// Evaluates one cycle of the executor.
    pub(super) fn write(&mut self, entry: SetPoint) {
        let next = self.image.head.sequence + 1;
        self.image.push(next, self.now_ns, entry);
    }

    pub(super) fn observe(&mut self) {
        let image = self.connected.then_some(&self.image);
        self.session.observe(self.now_ns, image);
    }

    /// Runs one cycle of the device.
    pub(super) fn exchange(&mut self) {
        self.observe();
        self.session
            .exchange(self.now_ns, &Inputs::NONE, &self.device);
        self.sent.push((self.now_ns / MS, self.session.position));
    }

    /// Advances both by one millisecond.
    pub(super) fn both(&mut self, entry: SetPoint) {
        self.now_ns += MS;
        self.write(entry);
        self.exchange();
    }

    /// Runs one cycle of the executor and one of the device, without time in between.
    pub(super) fn both_now(&mut self, entry: SetPoint) {
        self.write(entry);
        self.exchange();
    }

    pub(super) fn idle(&mut self, cycles: u64) {
        (0..cycles).for_each(|_| self.both(SetPoint::NONE));
    }

    /// Runs the device without the executor.
    pub(super) fn device_alone(&mut self, cycles: u64) {
        for _ in 0..cycles {
            self.now_ns += MS;
            self.exchange();
        }
    }

    /// Plays a whole motion of `owner`.
    pub(super) fn run(&mut self, owner: u64, motion: &[f64]) {
        motion.iter().for_each(|q| self.both(at(owner, *q)));
    }

    /// Runs the executor without the device: a motion of `owner`.
    pub(super) fn executor_alone(&mut self, owner: u64, motion: &[f64]) {
        for q in motion {
            self.now_ns += MS;
            self.write(at(owner, *q));
        }
    }

    /// Returns the largest velocity, acceleration and jerk of joint 1 in what was sent, by finite differences.
    pub(super) fn peaks(&self) -> [f64; 3] {
        let mut rows: Vec<f64> = self.sent.iter().map(|(_, q)| q[0]).collect();
        let mut peak = || {
            rows = rows
                .windows(2)
                .map(|pair| (pair[1] - pair[0]) * 1e3)
                .collect();
            rows.iter().fold(0.0_f64, |max, value| max.max(value.abs()))
        };
        [peak(), peak(), peak()]
    }

    pub(super) fn check_peaks(&self) {
        let [velocity, acceleration, jerk] = self.peaks();
        assert!(
            velocity <= 2.0 && acceleration <= A_MAX * 1.000_001,
            "{velocity} {acceleration}"
        );
        assert!(jerk <= J_MAX * 2.0, "{jerk}");
    }

    pub(super) fn last(&self) -> f64 {
        self.session.position[0]
    }

    pub(super) fn positions(&self) -> Vec<f64> {
        self.sent.iter().map(|(_, q)| q[0]).collect()
    }
}

/// A set-point with joint 1 at `q` and joint 2 at half of it; output 0 is on beyond 0.1 rad.
pub(super) fn at(owner: u64, q: f64) -> SetPoint {
    let mut position = [0.0; JOINTS_MAX];
    (position[0], position[1]) = (q, 0.5 * q);
    let mut analog = [f64::NAN; ANALOG_MAX];
    analog[0] = q;
    SetPoint {
        owner,
        has_position: 1,
        position,
        digital: u64::from(q > 0.1),
        digital_commanded: 1,
        analog,
        ..SetPoint::NONE
    }
}

/// A quintic from rest to rest, from `from` by `way` rad in `cycles` ms, including its first and last point.
pub(super) fn motion(from: f64, way: f64, cycles: u64) -> Vec<f64> {
    let part = |x: f64| x * x * x * (10.0 - x * (15.0 - 6.0 * x));
    (0..=cycles)
        .map(|cycle| from + way * part(cycle as f64 / cycles as f64))
        .collect()
}

/// 0.2 rad in 0.4 s: 0.94 rad/s, 7.2 rad/s², 750 rad/s³.
pub(super) fn usual() -> Vec<f64> {
    motion(0.0, 0.2, 400)
}
