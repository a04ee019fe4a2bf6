//! Measures the nets that the predecessor's library generated: their size here, and the duration of a cycle.

use std::error::Error;

use rcc_bench::measure::{Effort, MeasuredSubject, TimeStats, alternate};
use rcc_config::CellConfig;
use rcc_core::message::Joints;
use rcc_directionet::compiler;
use rcc_engine::net::Net;
use rcc_language::devices::DeviceTable;

use crate::table::{digits, spread, table};
use crate::{PERIOD_S, RunningNet, devices, root};

const FOLDER: &str = "tests/data/directionet/flat";
/// Header lines that map their names to a cell of ours.
const HEADER: &str = "# devices: io0=io, iiwa=lwr\n# channels: io.InBool.8=door_closed, io.InReal.1=temperature, io.OutBool.2=clamp\n";
/// Start position of the straight motions, rad.
const HOLD: Joints = [0.3, 0.4, 0.0, -1.4, 0.0, 1.1, 0.0, 0.0];

/// Returns the section of the page; see the module.
pub fn section(effort: Effort) -> Result<String, Box<dyn Error>> {
    eprintln!("nets: the predecessor's");
    let cell = CellConfig::load_offline(&root().join("configs/cells/demo.yaml"))?;
    let mut names = Vec::new();
    for entry in std::fs::read_dir(root().join(FOLDER))? {
        names.push(entry?.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    let (known, models) = (DeviceTable::from(&cell), cell.models());
    let hold: Vec<_> = models.iter().map(|it| it.arm.map(|_| HOLD)).collect();
    let (mut nets, mut sizes) = (Vec::new(), Vec::new());
    for name in &names {
        let text = std::fs::read_to_string(root().join(FOLDER).join(name))?;
        let types = text.matches('(').count();
        let Ok(compiled) = compiler(&known).compile(&format!("{HEADER}{text}"), name) else {
            sizes.push((types, None));
            continue;
        };
        let primitives = compiled.names.primitives.len();
        let net = Net::build(compiled.plan, &models, cell.fingerprint(), &hold, PERIOD_S)
            .map_err(|refusal| format!("{name}: {refusal:?}"))?;
        sizes.push((types, Some(primitives)));
        nets.push(RunningNet {
            net,
            models: models.clone(),
            devices: devices(&models, HOLD),
        });
    }
    let runs = nets.iter_mut().map(|running| {
        MeasuredSubject::new(|cycles| {
            for _ in 0..cycles {
                running.step();
            }
        })
    });
    let mut figures = alternate(&mut runs.collect::<Vec<_>>(), effort).into_iter();
    let rows = names.iter().zip(sizes).map(|(name, (types, primitives))| {
        row(
            name,
            types,
            primitives.zip(figures.next_if_some(primitives)),
        )
    });
    Ok(format!(
        "## The predecessor's nets\n\n\
         The 18 flat nets of `{FOLDER}`, through the reader of DirectIONet. *Theirs* is the number of primitives in \
         their text, *ours* the number evaluated here. A net without results is for an arm with six axes, which the \
         demo cell does not have.\n\n{}",
        table(
            &[
                "net",
                "theirs",
                "ours",
                "ns a cycle",
                "ns a primitive of ours"
            ],
            &rows.collect::<Vec<_>>()
        )
    ))
}

/// Takes the next result if the net was loaded.
trait NextIfSome: Iterator<Item = TimeStats> {
    fn next_if_some(&mut self, loaded: Option<usize>) -> Option<TimeStats> {
        loaded.and_then(|_| self.next())
    }
}

impl<I: Iterator<Item = TimeStats>> NextIfSome for I {}

fn row(name: &str, theirs: usize, measured: Option<(usize, TimeStats)>) -> Vec<String> {
    let name = name.trim_end_matches(".net").to_owned();
    match measured {
        Some((ours, figure)) => vec![
            name,
            theirs.to_string(),
            ours.to_string(),
            spread(figure, 1.0),
            digits(figure.median / ours as f64),
        ],
        None => vec![name, theirs.to_string(), "–".into(), "–".into(), "–".into()],
    }
}
