//! Builds a line that stops on contact, runs it in the cell that the environment names, and shows how far it is. Its
//! one thread is not real-time: the reaction is in the net.

use rcc_client::Cell;
use rcc_net::{BuildError, NetBuilder, pose};

fn guarded_move() -> Result<String, BuildError> {
    let net = NetBuilder::new("guarded-move");
    let cancel = net.cancel("cancel");
    let ft = net.force_torque("ft", "lwr");
    let touch = net.greater("touch", net.abs("force", ft.fz).out, "12 N");
    let down = pose([0.538, 0.1, 0.234], [0.0, std::f64::consts::PI, 0.0]);
    let line = net
        .linear_motion("move", "lwr", down)
        .velocity("0.1 m/s")
        .stop(cancel.requested | touch.out);
    net.joint_position_command("robot", "lwr", line.joints);
    net.termination("end", line.done);
    net.discard_rest();
    net.to_yaml()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let cell = Cell::connect()?;
    let command = cell.start(&guarded_move()?)?;
    for sample in command.watch(&["move.distance"], 10.0)? {
        let sample = sample?;
        println!(
            "{:.2} s  {} m",
            sample.time_s, sample.values["move.distance"]
        );
    }
    let outcome = command.wait(None)?;
    command.unload()?;
    println!("{}", outcome.finished()?);
    Ok(())
}
