//! Measures whole cycles of an executor: latch, evaluate, guard, write, record, with boards in shared memory.

use std::error::Error;
use std::time::Duration;

use rcc_bench::executor::BenchExecutor;
use rcc_bench::graph::Graph;
use rcc_bench::instance::cell;
use rcc_bench::kernel_nets;
use rcc_bench::measure::{Effort, MeasuredSubject, alternate};
use rcc_bench::net::net;
use rcc_core::kinematics::Arm;
use rcc_core::pose::Pose;
use rcc_language::compile_for;
use rcc_language::devices::{CellDevice, DeviceTable};

use crate::table::{digits, spread, table, verdict};

/// Maximum duration of a cycle with one net of 50 nodes, ns.
const GOAL_NS: f64 = 1000.0;
/// Length of the line, m. It takes more than an hour, longer than the measurement.
const LENGTH: f64 = 0.1;

/// Returns the section of the page; see the module.
pub fn section(effort: Effort) -> Result<String, Box<dyn Error>> {
    eprintln!("performance: whole cycles");
    let mut names = Vec::new();
    let mut executors = Vec::new();
    for (mix, nets) in [
        ("full", 0),
        ("scalar", 1),
        ("full", 1),
        ("full", 10),
        ("full", 50),
    ] {
        names.push(match nets {
            0 => "idle".to_owned(),
            1 => format!("1 net, {mix}_50"),
            _ => format!("{nets} nets, {mix}_50 each"),
        });
        executors.push(with_nets(mix, nets)?);
    }
    names.push("an arm on a line: path, inverse kinematics, guard, set-point, monitor".into());
    executors.push(with_line()?);
    let subjects = executors.iter_mut().map(|executor| {
        MeasuredSubject::timing_itself(|cycles| Duration::from_nanos(executor.cycles(cycles)))
    });
    let figures = alternate(&mut subjects.collect::<Vec<_>>(), effort);
    if executors
        .last()
        .is_some_and(|executor| executor.running() != 1)
    {
        return Err("the line ended while it was measured".into());
    }
    let rows = names.into_iter().zip(figures).map(|(name, figure)| {
        let goal = if name.starts_with("1 net") {
            verdict(figure.median, GOAL_NS)
        } else {
            String::new()
        };
        vec![name, spread(figure, 1.0), digits(figure.median / 1e4), goal]
    });
    Ok(format!(
        "## A whole cycle of the executor\n\n\
         ns from the wake-up until everything is written, as the executor itself measures it: boards read, nets evaluated, guard, \
         boards written (command, status, tables), flight recorder with the hash of every slot. One station with eight analog and \
         four digital inputs that change every cycle; in the last row one arm. Caches are warm, because the loop has no pause.\n\n{}",
        table(
            &["cycle", "ns", "% of 1 ms", "goal"],
            &rows.collect::<Vec<_>>()
        )
    ))
}

fn with_nets(mix: &str, nets: usize) -> Result<BenchExecutor, Box<dyn Error>> {
    let mut executor = BenchExecutor::new(cell(), [0.0; 8])?;
    let text = net(&Graph::load(mix, 50)?).text;
    for _ in 0..nets {
        executor.start(compile_for(&text, "graph.json", &cell())?.plan)?;
    }
    Ok(executor)
}

/// Returns a net that moves the arm sideways from where it is held, and keeps its orientation: the goal is within the
/// range of every joint wherever the arm begins.
fn line(arm: &Arm) -> String {
    let Pose {
        position: [x, y, z],
        orientation: [qx, qy, qz, qw],
    } = arm.forward(&kernel_nets::HOLD);
    let y = y + LENGTH;
    format!(
        r#"
net: line
primitives:
  stop: {{type: Cancel}}
  move: {{type: LinearMotion, parameters: {{device: arm, to: {{xyz: [{x}, {y}, {z}], quat: [{qx}, {qy}, {qz}, {qw}]}},
         velocity: 0.00002 m/s, acceleration: 0.5 m/s^2, jerk: 5 m/s^3}}, inputs: {{stop: stop.requested}}}}
  ik: {{type: InverseKinematics, parameters: {{device: arm}}, inputs: {{pose: move.pose}}}}
  robot: {{type: JointPositionCommand, parameters: {{device: arm}}, inputs: {{position: ik.joints}}}}
  end: {{type: Termination, inputs: {{done: move.done}}}}
  watch: {{type: Monitor, inputs: {{value: move.pose}}}}
"#
    )
}

fn with_line() -> Result<BenchExecutor, Box<dyn Error>> {
    let device = CellDevice {
        name: "arm".into(),
        model: rcc_core::frame::DeviceModel {
            channels: [0; 4],
            ..kernel_nets::models()[0]
        },
        channels: [const { Vec::new() }; 4],
    };
    let table = DeviceTable {
        fingerprint: 0,
        period_ns: 1_000_000,
        devices: vec![device],
    };
    let arm = kernel_nets::models()[0].arm.ok_or("no arm")?;
    let mut executor = BenchExecutor::new(table.clone(), kernel_nets::HOLD)?;
    executor.start(compile_for(&line(&arm), "line.yaml", &table)?.plan)?;
    Ok(executor)
}
