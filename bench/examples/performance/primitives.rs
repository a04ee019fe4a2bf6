//! Measures each kernel of the catalogue.

use std::error::Error;
use std::time::{Duration, Instant};

use rcc_bench::kernel_nets::{CatalogueKernel, count, devices, models, net, rows};
use rcc_bench::measure::{Effort, MeasuredSubject, alternate};
use rcc_core::primitive::Role;
use rcc_engine::net::Net;

use crate::table::{digits, table};

/// Number of cycles between two starts, so few that no motion comes to its end.
const CYCLES: usize = 100;

/// Returns the section of the page; see the module.
pub fn section(effort: Effort) -> Result<String, Box<dyn Error>> {
    eprintln!("performance: every kernel of the catalogue");
    let all: Vec<CatalogueKernel> = rows()
        .filter(|row| row.entry.spec.role != Role::Termination)
        .collect();
    let first = all.first().ok_or("an empty catalogue")?;
    let refused = |refusal| format!("a net of the catalogue is refused: {refusal:?}");
    let mut nets = vec![net(first, 0).map_err(refused)?];
    for row in &all {
        nets.push(net(row, count(&row.entry.spec)).map_err(refused)?);
    }
    let (models, devices) = (models(), devices());
    let mut subjects: Vec<MeasuredSubject<'_>> = Vec::new();
    for net in &mut nets {
        let (models, devices) = (&models, &devices);
        subjects.push(MeasuredSubject::timing_itself(move |cycles| {
            let mut total = Duration::ZERO;
            for first in (0..cycles).step_by(CYCLES) {
                total += stretch(net, cycles.min(first + CYCLES) - first, |net| {
                    net.evaluate(models, devices, 1e-3);
                });
            }
            total
        }));
    }
    // There are many subjects, and a shorter stretch is enough for a run of 256.
    let effort = Effort {
        stretch: effort.stretch / 4,
        ..effort
    };
    let figures = alternate(&mut subjects, effort);
    let empty = figures.first().map_or(0.0, |figure| figure.median);
    let rows = all.iter().zip(&figures[1..]).map(|(row, figure)| {
        let count = f64::from(count(&row.entry.spec));
        vec![
            row.name(),
            format!("{count}"),
            digits(((figure.median - empty) / count).max(0.0)),
        ]
    });
    Ok(format!(
        "## Each primitive\n\n\
         ns per primitive in a run of equal primitives, from nets generated from the catalogue; the time of an empty net, {} ns, \
         is subtracted. Inputs are not null and differ between primitives. Runs of arm commands and motions are \
         shorter, because each needs an arm or a path clock of its own.\n\n{}",
        digits(empty),
        table(
            &["primitive", "in the run", "ns each"],
            &rows.collect::<Vec<_>>()
        )
    ))
}

fn stretch(net: &mut Net, cycles: usize, mut evaluate: impl FnMut(&mut Net)) -> Duration {
    net.reset();
    let begun = Instant::now();
    (0..cycles).for_each(|_| evaluate(net));
    begun.elapsed()
}
