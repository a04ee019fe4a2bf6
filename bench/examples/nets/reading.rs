//! Measures the cost for the real-time thread if a client reads values of a running net in every cycle (a cell serves
//! at most one reading per cycle, and `rcc-cli watch` reads at most 100 times a second).

use std::error::Error;

use rcc_bench::graph::Graph;
use rcc_bench::instance::cell;
use rcc_bench::measure::{Effort, MeasuredSubject, alternate};
use rcc_bench::net::net;
use rcc_core::plan::ValuePoint;
use rcc_engine::net::Net;
use rcc_engine::queue::ValueReading;
use rcc_language::compile_for;

use crate::table::{digits, spread, table};
use crate::{PERIOD_S, RunningNet, devices};

/// Numbers of ports that are read; the last is the maximum of one reading.
const PORTS: [usize; 5] = [0, 1, 10, 100, 1024];

/// Returns the section of the page; see the module.
pub fn section(effort: Effort) -> Result<String, Box<dyn Error>> {
    eprintln!("nets: reading values");
    let text = net(&Graph::load("full", 2000)?).text;
    let compiled = compile_for(&text, "graph.json", &cell())?;
    let outputs = compiled.names.primitives.iter().flat_map(|it| &it.outputs);
    let single = outputs.filter(|port| port.width == 1);
    let points: Vec<ValuePoint> = single
        .map(|port| ValuePoint {
            store: port.store,
            slot: port.slot,
            width: port.width,
        })
        .collect();
    let models = cell().models();
    let mut subjects = Vec::new();
    for ports in PORTS {
        let net = Net::build(
            compiled.plan.clone(),
            &models,
            cell().fingerprint,
            &[None],
            PERIOD_S,
        );
        let running = RunningNet {
            net: net.map_err(|refusal| format!("{refusal:?}"))?,
            models: models.clone(),
            devices: devices(&models, [0.0; 8]),
        };
        let chosen = points.get(..ports).ok_or("too few ports")?;
        subjects.push((running, ValueReading::of(chosen.to_vec())));
    }
    let runs = subjects.iter_mut().map(|(running, reading)| {
        MeasuredSubject::new(|cycles| {
            for _ in 0..cycles {
                running.step();
                // Every point is in the plan; if nothing were read, the result would show it.
                let _ = running.net.read(reading);
            }
        })
    });
    let figures = alternate(&mut runs.collect::<Vec<_>>(), effort);
    let without = figures.first().map_or(0.0, |figure| figure.median);
    let rows = PORTS.iter().zip(&figures).map(|(ports, figure)| {
        vec![
            format!("{ports} ports"),
            spread(*figure, 1.0),
            digits(figure.median - without),
        ]
    });
    Ok(format!(
        "## Reading values\n\n\
         A net of 2000 primitives, and a reading of some of its ports in **every** cycle: the copy that the real-time thread makes.\n\n{}",
        table(
            &["read in every cycle", "ns a cycle", "for the reading, ns"],
            &rows.collect::<Vec<_>>()
        )
    ))
}
