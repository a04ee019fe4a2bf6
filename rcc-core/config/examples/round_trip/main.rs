//! Forward and inverse kinematics of every robot in `configs/robots`: 100,000 random joint positions each, and the
//! singular ones, by their own branch and by all eight. Prints the largest difference between poses; exits with 1 if
//! one exceeds 10⁻¹².

mod trip;

use std::process::ExitCode;

const POSITIONS: usize = 100_000;

fn main() -> ExitCode {
    let mut good = true;
    for (file, robot) in trip::robots() {
        let worst = trip::round_trip(&robot, POSITIONS);
        println!("{file}: {worst:?}");
        good &= worst.same < 1e-12 && worst.branches < 1e-12;
    }
    ExitCode::from(u8::from(!good))
}
