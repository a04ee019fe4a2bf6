//! Axes with simulated drives, one exchange after the other, in virtual time.
//! Test code only.

use std::time::Duration;

use super::*;
use crate::driver::axis_settings::DrivePlace;
use crate::sim::drive::DriveSettings;
use crate::sim::drive::{Drive, DriveState};

const PERIOD: Duration = Duration::from_millis(1);
const COUNTS_PER_RAD: f64 = 1e6;
/// Bit of the output `axes enable`.
const ENABLE: u32 = 2;

fn axis(terminal: usize) -> AxisSettings {
    AxisSettings {
        joint: format!("joint_{terminal}"),
        terminal: format!("drive_{terminal}"),
        place: DrivePlace {
            terminal,
            control: 0,
            target: 2,
            status: 0,
            position: 2,
            error: Some(6),
        },
        counts_per_unit: COUNTS_PER_RAD,
        zero: 0.5,
        following_window: 0.01,
        following_timeout: 10 * PERIOD,
        deceleration: 10.0,
    }
}

/// Two axes with their drives.
struct Bench {
    axes: Axes,
    drives: [Drive; 2],
    image: [TerminalImage; 2],
    now: Duration,
}

impl Bench {
    fn new(enable: Option<u32>) -> Bench {
        let image = || TerminalImage {
            inputs: vec![0; 8],
            outputs: vec![0; 6],
        };
        let mut bench = Bench {
            axes: Axes::new(vec![axis(0), axis(1)], [1e-3; JOINTS_MAX], enable),
            drives: [Drive::new(100_000), Drive::new(-7)],
            image: [image(), image()],
            now: Duration::ZERO,
        };
        bench.exchange_in(false, &Outputs::NONE);
        bench
    }

    fn settings() -> DriveSettings {
        DriveSettings {
            mode: 8,
            following_window: 10_000,
            following_timeout: 10 * PERIOD,
            quick_stop_deceleration: 10_000_000,
            speed_max: 5_000_000,
            interpolation_s: 1e-3,
        }
    }

    fn exchange_in(&mut self, op: bool, outputs: &Outputs) {
        self.now += PERIOD;
        for (drive, image) in self.drives.iter_mut().zip(&mut self.image) {
            drive.advance(self.now, &Self::settings());
            let values = [
                &drive.statusword().to_le_bytes()[..],
                &drive.position().to_le_bytes(),
                &drive.error().to_le_bytes(),
            ];
            image.inputs = values.concat();
            if op {
                let target = i32::from_le_bytes(bytes(&image.outputs, 2));
                drive.command(word(&image.outputs, 0), target, &Self::settings());
            }
        }
        self.axes.read(&self.image, 1_000_000, op);
        self.axes.write(outputs, &mut self.image);
    }

    /// Exchanges with the outputs of a host that holds the joints.
    fn hold(&mut self, on: bool, exchanges: usize) {
        for _ in 0..exchanges {
            let outputs = Outputs {
                position: self.axes.hold(),
                digital: u64::from(on) << ENABLE,
                digital_set: 1 << ENABLE,
                ..Outputs::NONE
            };
            self.exchange_in(true, &outputs);
        }
    }

    /// Moves both joints by this way in each exchange, rad.
    fn run(&mut self, step_rad: f64, exchanges: usize) {
        for _ in 0..exchanges {
            let outputs = Outputs {
                position: self.axes.hold().map(|joint| joint + step_rad),
                digital: 1 << ENABLE,
                digital_set: 1 << ENABLE,
                ..Outputs::NONE
            };
            self.exchange_in(true, &outputs);
        }
    }

    fn states(&self) -> [DriveState; 2] {
        [self.drives[0].state(), self.drives[1].state()]
    }

    fn enabled_by(enable: Option<u32>) -> Bench {
        match enable {
            Some(_) => Bench::enabled(enable),
            None => {
                let mut bench = Bench::new(None);
                bench.hold(false, 10);
                assert_eq!(bench.axes.reason(), 0, "{:?}", bench.states());
                bench
            }
        }
    }

    fn enabled(enable: Option<u32>) -> Bench {
        let mut bench = Bench::new(enable);
        bench.hold(false, 5);
        bench.hold(true, 10);
        assert_eq!(bench.axes.reason(), 0, "{:?}", bench.states());
        bench
    }
}

const OFF: [DriveState; 2] = [DriveState::SwitchOnDisabled; 2];
const ON: [DriveState; 2] = [DriveState::OperationEnabled; 2];

#[test]
fn the_drives_are_enabled_by_the_edge_of_the_output_and_stay_where_they_are() {
    let mut bench = Bench::new(Some(ENABLE));
    // On since the start of the line is no edge.
    bench.axes.lose();
    bench.hold(true, 20);
    assert_eq!(
        (bench.states(), bench.axes.reason()),
        (OFF, reasons::DRIVES_OFF)
    );
    bench.hold(false, 1);
    bench.hold(true, 1);
    assert_eq!(bench.states(), OFF);
    bench.hold(true, 10);
    assert_eq!((bench.states(), bench.axes.reason()), (ON, 0));
    assert_eq!(bench.drives.each_ref().map(Drive::position), [100_000, -7]);
    assert_eq!(bench.axes.hold()[..2], [0.6, 0.5 - 7e-6]);
}

#[test]
fn without_such_an_output_the_start_of_the_line_enables_them() {
    let mut bench = Bench::new(None);
    bench.hold(false, 10);
    assert_eq!((bench.states(), bench.axes.reason()), (ON, 0));
    bench.axes.lose();
    bench.hold(false, 10);
    assert_eq!((bench.states(), bench.axes.reason()), (ON, 0));
}

#[test]
fn the_drives_follow_the_set_points() {
    let mut bench = Bench::enabled(Some(ENABLE));
    bench.run(1e-3, 200);
    bench.hold(true, 3);
    let positions = bench.drives.each_ref().map(Drive::position);
    assert_eq!(positions, [300_000, 199_993]);
}

#[test]
fn a_first_set_point_that_is_elsewhere_stops_the_drives() {
    let mut bench = Bench::enabled(Some(ENABLE));
    bench.axes.followed = false;
    bench.run(0.02, 1);
    assert_eq!(bench.axes.reason(), reasons::JUMP);
    bench.hold(true, 5);
    assert_eq!(bench.states(), OFF);
    assert_eq!(bench.drives[0].position(), 100_000);
    let mut bench = Bench::enabled(Some(ENABLE));
    bench.run(f64::NAN, 1);
    assert_eq!(bench.axes.reason(), reasons::JUMP);
}

/// The host was away for 40 ms at 1 rad/s and plays their set-points at once.
#[test]
fn the_way_of_many_periods_is_not_made_in_one() {
    for enable in [Some(ENABLE), None] {
        let mut bench = Bench::enabled_by(enable);
        bench.run(1e-3, 200);
        let targets = |bench: &Bench| {
            let targets = bench.image.each_ref();
            targets.map(|image| i32::from_le_bytes(bytes(&image.outputs, 2)))
        };
        let before = targets(&bench);
        // Two set-points between two frames, and one period left out: followed.
        bench.run(3e-3, 1);
        assert_eq!(targets(&bench), before.map(|target| target + 3_000));
        assert_eq!(bench.axes.reason(), 0);
        bench.run(0.04, 1);
        let reason = match enable {
            Some(_) => reasons::LATE,
            None => reasons::DRIVES_ENABLING,
        };
        assert_eq!(bench.axes.reason(), reason);
        // Not a target ahead: the drive is told its own position, and to make a quick stop.
        for (target, before) in targets(&bench).into_iter().zip(before) {
            assert!(target <= before + 3_000, "{target} {before}");
        }
        bench.hold(true, 1);
        assert_eq!(bench.states(), [DriveState::QuickStopActive; 2]);
        bench.hold(true, 600);
        // Only a new edge enables them again, as after a loss of the line.
        let states = if enable.is_some() { OFF } else { ON };
        assert_eq!(bench.states(), states);
    }
}

#[test]
fn a_pause_at_rest_stops_nothing() {
    let mut bench = Bench::enabled(Some(ENABLE));
    bench.run(1e-3, 200);
    bench.hold(true, 1);
    bench.now += 40 * PERIOD;
    bench.hold(true, 1);
    assert_eq!((bench.states(), bench.axes.reason()), (ON, 0));
}

#[test]
fn the_end_of_the_output_is_a_quick_stop() {
    let mut bench = Bench::enabled(Some(ENABLE));
    bench.run(1e-3, 200);
    bench.hold(false, 1);
    assert_eq!(bench.axes.reason(), reasons::DRIVES_OFF);
    bench.hold(false, 1);
    assert_eq!(bench.states(), [DriveState::QuickStopActive; 2]);
    // 1 rad/s with 10 rad/s²: 0.1 s and 0.05 rad.
    let from = bench.drives[0].position();
    bench.hold(false, 120);
    assert_eq!(bench.states(), OFF);
    let way = bench.drives[0].position() - from;
    assert!((45_000..52_000).contains(&way), "{way}");
}

#[test]
fn a_fault_stops_all_drives_and_is_reset_by_a_new_edge_only() {
    let mut bench = Bench::enabled(Some(ENABLE));
    bench.drives[1].fail(0x2310);
    bench.hold(true, 2000);
    assert_eq!(
        bench.states(),
        [DriveState::SwitchOnDisabled, DriveState::Fault]
    );
    assert_eq!(bench.axes.reason(), reasons::DRIVE_FAULT);
    bench.hold(false, 2000);
    assert_eq!(bench.drives[1].state(), DriveState::Fault);
    bench.hold(true, 20);
    assert_eq!((bench.states(), bench.axes.reason()), (ON, 0));
}

#[test]
fn without_an_output_no_fault_is_ever_reset() {
    let mut bench = Bench::new(None);
    bench.hold(false, 10);
    bench.drives[0].fail(0x2310);
    bench.hold(false, 2000);
    bench.axes.lose();
    bench.hold(false, 2000);
    assert_eq!(
        bench.states(),
        [DriveState::Fault, DriveState::SwitchOnDisabled]
    );
    assert_eq!(bench.axes.reason(), reasons::DRIVE_FAULT);
}

#[test]
fn safe_torque_off_ends_the_permission_and_its_end_enables_nothing() {
    let mut bench = Bench::enabled(Some(ENABLE));
    bench.drives[0].set_torque_off(true);
    bench.hold(true, 5);
    assert_eq!(
        (bench.states(), bench.axes.reason()),
        (OFF, reasons::DRIVE_LEFT)
    );
    bench.drives[0].set_torque_off(false);
    bench.hold(true, 2000);
    assert_eq!(bench.states(), OFF);
    bench.hold(false, 1);
    bench.hold(true, 20);
    assert_eq!(bench.states(), ON);
}

#[test]
fn a_drive_that_cannot_be_enabled_is_given_up() {
    let mut bench = Bench::new(Some(ENABLE));
    bench.drives[1].set_torque_off(true);
    bench.hold(false, 1);
    bench.hold(true, 4000);
    assert_eq!(bench.axes.reason(), reasons::DRIVES_ENABLING);
    bench.hold(true, 1100);
    assert_eq!(
        (bench.states(), bench.axes.reason()),
        (OFF, reasons::DRIVE_START)
    );
}

#[test]
fn a_released_driver_switches_the_drives_off() {
    let mut bench = Bench::enabled(None);
    bench.axes.release();
    bench.hold(false, 5);
    assert_eq!(
        (bench.states(), bench.axes.reason()),
        (OFF, reasons::RELEASED)
    );
}

#[test]
fn a_drive_that_somebody_else_has_enabled_is_switched_off_first() {
    let mut bench = Bench::new(None);
    for word in [0x06, 0x07, 0x0f] {
        bench.drives[0].command(word, 100_000, &Bench::settings());
    }
    bench.hold(false, 1);
    bench.hold(false, 1);
    assert_ne!(bench.drives[0].state(), DriveState::OperationEnabled);
    bench.hold(false, 10);
    assert_eq!((bench.states(), bench.axes.reason()), (ON, 0));
}
