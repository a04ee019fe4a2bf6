//! Measures the cost of a fragment of 500 primitives while it is active and while it is not, compared with a net
//! without it.

use std::error::Error;
use std::fmt::Write;

use rcc_bench::instance::cell;
use rcc_bench::measure::{Effort, MeasuredSubject, alternate};
use rcc_engine::net::Net;
use rcc_language::compile_for;

use crate::table::{digits, spread, table};
use crate::{PERIOD_S, RunningNet, devices};

const SIZE: usize = 500;

/// Returns the section of the page; see the module.
pub fn section(effort: Effort) -> Result<String, Box<dyn Error>> {
    eprintln!("nets: fragments");
    let cases = [
        ("without the fragment", None, false),
        ("the fragment, always active", Some(""), true),
        (
            "active by a button, pressed",
            Some(", active: button.out"),
            true,
        ),
        (
            "active by a button, not pressed",
            Some(", active: button.out"),
            false,
        ),
    ];
    let mut nets = Vec::new();
    for (_, active, pressed) in cases {
        let compiled = compile_for(&text(active), "net.yaml", &cell())?;
        let models = cell().models();
        let net = Net::build(
            compiled.plan,
            &models,
            cell().fingerprint,
            &[None],
            PERIOD_S,
        )
        .map_err(|refusal| format!("{refusal:?}"))?;
        let mut devices = devices(&models, [0.0; 8]);
        for device in &mut devices {
            device.measurement.digital = u64::from(pressed);
            device.measurement.analog[0] = 0.25;
        }
        nets.push(RunningNet {
            net,
            models,
            devices,
        });
    }
    let subjects = nets.iter_mut().map(|running| {
        MeasuredSubject::new(|cycles| {
            for _ in 0..cycles {
                running.step();
            }
        })
    });
    let figures = alternate(&mut subjects.collect::<Vec<_>>(), effort);
    let without = figures.first().map_or(0.0, |figure| figure.median);
    let rows = cases.iter().zip(&figures).map(|((name, ..), figure)| {
        vec![
            (*name).to_owned(),
            spread(*figure, 1.0),
            digits(figure.median - without),
            digits((figure.median - without) / SIZE as f64),
        ]
    });
    Ok(format!(
        "## A fragment of {SIZE} primitives\n\n{}",
        table(
            &[
                "net",
                "ns a cycle",
                "more than without, ns",
                "a primitive of it, ns"
            ],
            &rows.collect::<Vec<_>>()
        )
    ))
}

/// Returns the text of a net with sums and products in a fragment; `None`: without the fragment.
fn text(active: Option<&str>) -> String {
    let mut text = "net: fragment\n".to_owned();
    if active.is_some() {
        let last = SIZE - 1;
        let _ = writeln!(
            text,
            "fragments:\n  long:\n    inputs: {{x: {{}}}}\n    outputs: {{y: n{last}.out}}\n    primitives:\n      n0: {{type: Abs, inputs: {{in: x}}}}"
        );
        for number in 1..SIZE {
            let ty = if number % 2 == 0 { "Multiply" } else { "Add" };
            // Writing to a String cannot fail.
            let _ = writeln!(
                text,
                "      n{number}: {{type: {ty}, inputs: {{a: n{}.out, b: 0.5}}}}",
                number - 1
            );
        }
    }
    text += "primitives:\n  button: {type: DigitalInput, parameters: {device: station, channel: v0}}\n  \
             u: {type: AnalogInput, parameters: {device: station, channel: u0}}\n";
    if let Some(active) = active {
        let _ = writeln!(
            text,
            "  long: {{fragment: long, inputs: {{x: u.out}}{active}}}"
        );
    }
    text += "  end: {type: Termination, inputs: {done: false}}\n";
    text += if active.is_some() {
        "discard: [long.y, button.out]\n"
    } else {
        "discard: [u.out, button.out]\n"
    };
    if active.is_some_and(|active| !active.is_empty()) {
        text = text.replace(", button.out]", "]");
    }
    text
}
