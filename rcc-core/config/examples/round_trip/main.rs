//! Forward and inverse kinematics of every robot in `configs/robots`: `round_trip [COUNT]` takes COUNT random joint
//! positions each (100,000 by default), and the singular ones, by their own branch and by all eight. Prints the largest
//! difference between poses; exits with 1 if one exceeds 10⁻¹².

mod trip;

use std::process::ExitCode;

const POSITIONS: usize = 100_000;

fn main() -> ExitCode {
    let count = std::env::args().nth(1).map(|count| count.parse());
    let Ok(positions) = count.unwrap_or(Ok(POSITIONS)) else {
        eprintln!("usage: round_trip [COUNT]");
        return ExitCode::from(2);
    };
    let mut good = true;
    for (file, robot) in trip::robots() {
        let worst = trip::round_trip(&robot, positions);
        println!("{file}: {worst:?}");
        good &= worst.same < 1e-12 && worst.branches < 1e-12;
    }
    ExitCode::from(u8::from(!good))
}
