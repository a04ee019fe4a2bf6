//! Target `krc`: arbitrary answers and lines to the simulators and their control ports. They must not panic, and the
//! simulated state must remain finite. Run by the thread of the target.

use arbitrary::{Arbitrary, Result, Unstructured};
use rcc_drivers::fri_lwr::wire::{CommandDatagram, flags};
use rcc_drivers::sim::io::{control as io_control, process_image::ProcessImage};
use rcc_drivers::sim::lwr::control::{ControlError, KrcCommand};
use rcc_drivers::sim::lwr::krc::Krc;
use rcc_drivers::sim::lwr::settings::{KrlProgram, Settings};
use rcc_drivers::sim::requests::{ControlAnswer, RequestError, to_line};

use crate::plan::real;

const STEPS_MAX: usize = 300;

/// Uses the input as lines for a control port, and then as a sequence of steps.
pub fn run(data: &[u8]) {
    let mut krc = Krc::new(Settings {
        script: KrlProgram::Auto,
        ..Settings::default()
    });
    if let Ok(text) = std::str::from_utf8(data) {
        for line in text.lines() {
            send_line(&mut krc, line);
            send_io_line(line);
            krc.tick(1);
        }
    }
    let mut bytes = Unstructured::new(data);
    let mut answer = CommandDatagram {
        flags: flags::JOINT_POSITION,
        ..CommandDatagram::default()
    };
    for _ in 0..STEPS_MAX {
        if bytes.is_empty() || apply_step(&mut krc, &mut answer, &mut bytes).is_err() {
            break;
        }
    }
    let snapshot = krc.snapshot();
    let robot = &snapshot.robot;
    let mut values = robot.q.iter().chain(&robot.velocity);
    let finite = values.all(|value| value.is_finite());
    assert!(finite, "{snapshot:?}");
    let answer = Ok::<_, ControlError>(ControlAnswer::State(Box::new(snapshot)));
    assert!(!to_line(answer).contains('\n'));
}

fn send_line(krc: &mut Krc, line: &str) {
    let answer = serde_json::from_str::<KrcCommand>(line)
        .map_err(|error| RequestError::from(error).into())
        .and_then(|command| krc.execute(command));
    assert!(!to_line(answer).contains('\n'), "an answer is one line");
}

fn send_io_line(line: &str) {
    let mut image = ProcessImage::new(Vec::new());
    if let Ok(io_control::IoCommand::Set(input)) = serde_json::from_str(line) {
        // The only rule is that it returns.
        let _ = image.set(&input);
    }
}

fn apply_step(
    krc: &mut Krc,
    answer: &mut CommandDatagram,
    bytes: &mut Unstructured<'_>,
) -> Result<()> {
    match bytes.int_in_range(0..=15)? {
        0 => answer.joint_position[bytes.int_in_range(0..=6)?] = real(bytes)? as f32,
        1 => {
            answer.joint_position[bytes.int_in_range(0..=6)?] +=
                f32::from(i8::arbitrary(bytes)?) * 1e-5
        }
        2 => answer.flags = u32::arbitrary(bytes)?,
        3 => answer.krl.integers[bytes.int_in_range(0..=15)?] = i32::arbitrary(bytes)?,
        4 => answer.krl.booleans = u16::arbitrary(bytes)?,
        5 => answer.krl.reals[bytes.int_in_range(0..=15)?] = real(bytes)? as f32,
        6 => {
            let length = bytes.int_in_range(0..=400)?;
            // The result is ignored: datagrams that the controller refuses are inputs of this target too.
            let _ = krc.receive(bytes.bytes(length.min(bytes.len()))?, 1e-4);
        }
        7 => drop(krc.tick(bytes.int_in_range(1..=2000)?)),
        8 => {
            let length = bytes.int_in_range(0..=96)?;
            let line = String::from_utf8_lossy(bytes.bytes(length.min(bytes.len()))?).into_owned();
            send_line(krc, &line);
        }
        9 => answer.reflected_sequence = u16::arbitrary(bytes)?,
        10 => krc.receive_foreign(),
        11 => send_line(
            krc,
            bytes.choose(&[
                "\"estop\"",
                "\"ack\"",
                "{\"wall\":null}",
                "{\"drives\":{\"on\":true}}",
            ])?,
        ),
        12 => {
            let snapshot = krc.snapshot();
            answer.joint_position = snapshot.robot.q_cmd.map(|q| q as f32);
        }
        _ => {}
    }
    for _ in 0..bytes.int_in_range(0..=15)? {
        answer.reflected_sequence = krc.sequence();
        answer.send_sequence = answer.send_sequence.wrapping_add(1);
        // As above.
        let _ = krc.receive(&answer.encode(), 1e-4);
        krc.tick(1);
    }
    Ok(())
}
