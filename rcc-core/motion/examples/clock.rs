//! What a step of a path clock costs, ns: `cargo run --release -p rcc-motion --example clock`. One thread.

use std::hint::black_box;
use std::time::Instant;

use rcc_core::path::Drive;
use rcc_motion::{PathBounds, PathClock, PathPiece};

const BATCH: usize = 1000;
const DRIVE: Drive = Drive::RUN;

/// The best and the median of many batches of steps, ns a step; each batch begins with a clock from `start`.
fn measure(start: &PathClock, bounds: &PathBounds, drive: impl Fn(usize) -> Drive) -> [f64; 2] {
    let mut all: Vec<f64> = (0..2000)
        .map(|_| {
            let mut clock = *start;
            let begin = Instant::now();
            for step in 0..BATCH {
                black_box(clock.step(black_box(bounds), drive(step)));
            }
            begin.elapsed().as_nanos() as f64 / BATCH as f64
        })
        .collect();
    all.sort_by(f64::total_cmp);
    [all[0], all[all.len() / 2]]
}

fn main() {
    let bounds = |pieces: &[(f64, f64)]| {
        let piece = |&(end_s, velocity)| PathPiece { end_s, velocity };
        let pieces: Vec<PathPiece> = pieces.iter().map(piece).collect();
        PathBounds::new(&pieces, 2.0, 20.0, 1e-3).expect("these are limits")
    };
    let one = bounds(&[(10.0, 0.5)]);
    let stairs: Vec<(f64, f64)> = (1..=40)
        .map(|k| (f64::from(k) * 0.25, if k % 2 == 0 { 0.5 } else { 0.2 }))
        .collect();
    let stairs = bounds(&stairs);
    let after = |bounds: &PathBounds, steps| {
        let mut clock = PathClock::new();
        for _ in 0..steps {
            clock.step(bounds, DRIVE);
        }
        clock
    };
    let full = |_| DRIVE;
    let ramp = |step: usize| Drive {
        speed: 1.0 - 0.4 * (step % 2) as f64,
        ..DRIVE
    };
    println!("step                                   best  median, ns");
    for (name, clock, bounds, drive) in [
        (
            "cruising",
            after(&one, 2000),
            &one,
            &full as &dyn Fn(usize) -> Drive,
        ),
        ("40 pieces, no change", after(&stairs, 2000), &stairs, &full),
        ("a new speed each step", after(&one, 2000), &one, &ramp),
        (
            "a new speed each step, 40 pieces",
            after(&stairs, 2000),
            &stairs,
            &ramp,
        ),
    ] {
        let [best, median] = measure(&clock, bounds, drive);
        println!("{name:36} {best:6.0}  {median:6.0}");
    }
}
