//! Random paths under random overrides, checked on the executed phases themselves, not on samples. `RCC_MOTION_CASES`
//! sets the number of cases.

use rcc_testing::{Random, Rng};

use super::*;

fn path(random: &mut Rng) -> Vec<PathPiece> {
    let mut end_s = 0.0;
    let base = random.log_uniform(0.02, 2.0);
    let pieces = (0..=random.below(8)).map(|_| {
        end_s += random.log_uniform(1e-4, 1.0);
        let velocity = base * random.log_uniform(0.1, 1.0);
        PathPiece { end_s, velocity }
    });
    pieces.collect()
}

/// Checks every executed segment of a motion, and every returned state.
struct SegmentChecker<'a> {
    pieces: &'a [PathPiece],
    acceleration: f64,
    jerk: f64,
    last: AxisState,
    told: PathState,
}

const TOLERANCE: f64 = 1e-9;

impl SegmentChecker<'_> {
    fn length(&self) -> f64 {
        self.pieces.last().unwrap().end_s
    }

    fn part(&mut self, start: AxisState, jerk: f64, duration_s: f64) {
        let (length, top) = (self.length(), 2.0);
        let near = |a: f64, b: f64, scale: f64| (a - b).abs() <= TOLERANCE * scale;
        let joined = near(start.position, self.last.position, 1e-3 * length)
            && near(start.velocity, self.last.velocity, top)
            && near(
                start.acceleration,
                self.last.acceleration,
                self.acceleration,
            );
        assert!(joined, "{start:?} after {:?}", self.last);
        assert!(jerk.abs() <= self.jerk * (1.0 + TOLERANCE));
        let end = start.after(duration_s, jerk);
        for state in [start, end] {
            let within = state.acceleration.abs() <= self.acceleration * (1.0 + TOLERANCE);
            assert!(within, "{state:?}");
            assert!(state.position <= length * (1.0 + 1e-12), "{state:?}");
        }
        self.velocities(start, jerk, duration_s);
        self.last = end;
    }

    /// Checks the velocity in every piece that the segment touches: at its ends there, and at its extremum.
    fn velocities(&self, start: AxisState, jerk: f64, duration_s: f64) {
        let end = start.after(duration_s, jerk);
        let (mut begin_s, mut from) = (0.0, 0.0);
        for piece in self.pieces {
            let touched = piece.end_s >= start.position && begin_s <= end.position;
            begin_s = piece.end_s;
            if !touched {
                continue;
            }
            let to = crossing(start, jerk, duration_s, piece.end_s);
            let vertex = (-start.acceleration / jerk).max(from).min(to);
            let vertex = if vertex.is_finite() { vertex } else { from };
            for t_s in [from, vertex, to] {
                let state = start.after(t_s, jerk);
                let slow = state.velocity >= -TOLERANCE * piece.velocity;
                // A segment that only touches the end of a piece, by rounding, is not in it.
                let inside = to - from > 1e-9 * duration_s || state.acceleration <= 0.0;
                let kept = state.velocity <= piece.velocity * (1.0 + TOLERANCE) || !inside;
                assert!(
                    slow && kept,
                    "{state:?} in {piece:?}, {start:?} {jerk} {duration_s} {from} {to}"
                );
            }
            from = to;
        }
    }

    fn state(&mut self, state: PathState) {
        let PathState {
            s,
            velocity,
            acceleration,
            jerk,
            ..
        } = state;
        assert!(
            [s, velocity, acceleration, jerk]
                .iter()
                .all(|x| x.is_finite())
        );
        assert!(s >= self.told.s && s <= self.length(), "{state:?}");
        assert!(velocity >= 0.0);
        assert!(
            (s - self.last.position).abs() <= 1e-12 * self.length(),
            "{state:?} {:?}",
            self.last
        );
        self.told = state;
    }
}

/// Time at which a segment passes a position, by bisection.
fn crossing(start: AxisState, jerk: f64, duration_s: f64, position: f64) -> f64 {
    if start.after(duration_s, jerk).position <= position {
        return duration_s;
    }
    let (mut early, mut late) = (0.0, duration_s);
    for _ in 0..60 {
        let t_s = 0.5 * (early + late);
        *(if start.after(t_s, jerk).position > position {
            &mut late
        } else {
            &mut early
        }) = t_s;
    }
    early
}

/// Runs one random path; returns the number of cycles.
fn case(seed: u64) -> usize {
    let mut random = Rng::with_seed(seed);
    let pieces = path(&mut random);
    let (acceleration, jerk) = (random.log_uniform(0.1, 50.0), random.log_uniform(1.0, 1e4));
    let new = |dt_s| PathBounds::new(&pieces, acceleration, jerk, dt_s).unwrap();
    let full_s = duration_s(&new(1e-9));
    let bounds = new(full_s / random.log_uniform(20.0, 400.0));
    let mut judge = SegmentChecker {
        pieces: &pieces,
        acceleration,
        jerk,
        last: AxisState::default(),
        told: PathState::default(),
    };
    let mut clock = PathClock::new();
    let (stop_at, calm_at) = (random.below(2000), random.below(600));
    let often = random.log_uniform(1.0, 300.0);
    let mut speed_override = if random.unit() < 0.5 {
        RUN
    } else {
        random.speed_override()
    };
    // At rest at every boundary, at the beginning and after the last pause.
    let rests = (bounds.pieces() + 4) as f64;
    let change_s = 2.0 * (2.0 / jerk).sqrt() + 2.0 / acceleration + acceleration / jerk;
    let slowest = pieces
        .iter()
        .map(|piece| piece.velocity)
        .fold(f64::INFINITY, f64::min);
    let most_s = rests * change_s * 2.0 + judge.length() / slowest + full_s;
    let most = calm_at + (most_s / bounds.dt_s()).ceil() as usize;
    for cycle in 0..=most {
        if cycle >= calm_at {
            speed_override = RUN;
        } else if random.unit() * often < 1.0 {
            speed_override = random.speed_override();
        }
        let told = SpeedOverride {
            stop: cycle == stop_at,
            ..speed_override
        };
        let state = clock.advance(&bounds, told, |profile, from_s, to_s| {
            for (start, jerk, duration_s) in profile.parts(from_s, to_s) {
                judge.part(start, jerk, duration_s);
            }
        });
        judge.state(state);
        if state.done {
            assert_eq!(state.stopping, cycle >= stop_at);
            assert!(state.stopping || state.s == judge.length());
            assert_eq!((state.velocity, state.acceleration), (0.0, 0.0));
            for _ in 0..3 {
                assert_eq!(
                    clock.step(&bounds, random.speed_override()),
                    state,
                    "stays done"
                );
            }
            return cycle;
        }
    }
    panic!("not at the end after {most} cycles: {:?}", judge.told);
}

#[test]
fn every_path_under_every_override_keeps_its_limits_and_ends() {
    let cases = std::env::var("RCC_MOTION_CASES").map_or(20_000, |cases| cases.parse().unwrap());
    let mut cycles = 0;
    for seed in 0..cases {
        let result = std::panic::catch_unwind(|| case(seed));
        cycles += result.unwrap_or_else(|_| panic!("seed {seed}"));
    }
    println!("{cases} paths, {cycles} cycles");
}
