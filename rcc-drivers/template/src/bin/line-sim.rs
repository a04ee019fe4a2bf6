//! `line-sim`: the simulated devices of the template's cell, without hardware: `line-sim BOX ARM [MILLISECONDS]` with the
//! address of the box, the address where the arm's driver listens, and the arm's period.

use std::net::SocketAddr;
use std::process::ExitCode;
use std::time::Duration;

use line_drivers::simulated_arm::SimulatedArm;
use line_drivers::simulated_box::SimulatedBox;

/// Where the joints of `robot.yaml` begin, rad.
const START: [f64; 2] = [0.0, 0.5];

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let ended = match words.as_slice() {
        [io, arm] => run(io, arm, "4"),
        [io, arm, period] => run(io, arm, period),
        _ => Err("usage: line-sim 127.0.0.1:7000 127.0.0.1:7001 4".into()),
    };
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run(io: &str, arm: &str, period_ms: &str) -> Result<(), Box<dyn std::error::Error>> {
    let arm: SocketAddr = arm.parse()?;
    let period = Duration::from_millis(period_ms.parse::<u64>()?.max(1));
    let _io = SimulatedBox::start(io.parse()?)?;
    println!("the box listens at {io}");
    Ok(SimulatedArm::new(&START).run(arm, period)?)
}
