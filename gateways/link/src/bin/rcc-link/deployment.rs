//! `rcc-link deploy` and `withdraw`: nets and configuration files to cells, and back. Run by the main thread.

use std::time::{Duration, Instant};

use clap::Args;
use rcc_config::link::is_cell_key;
use rcc_link::deploy::{self, DeployError, DeployText, Deployment};
use rcc_link::fleet;
use zenoh::Session;

use crate::LinkError;
use crate::reach::Reach;

/// Longest wait for cells that are not there yet.
const FOUND_MAX: Duration = Duration::from_secs(3);
/// Interval at which they are looked for.
const LOOK: Duration = Duration::from_millis(100);

/// Arguments of `deploy`.
#[derive(Args)]
pub struct Deploy {
    #[command(flatten)]
    reach: Reach,
    /// Cells: SITE/CELL, or a pattern with * and ? for those that are there
    #[arg(long, value_name = "CELLS", required = true)]
    to: Vec<String>,
    /// Number of cells that there must be
    #[arg(long, value_name = "COUNT")]
    expect: Option<usize>,
    /// Check on every cell, and change nothing
    #[arg(long)]
    check: bool,
    /// Nets, and configurations, each of which goes to the cell of its name
    #[arg(required = true)]
    files: Vec<String>,
}

/// Checks everywhere, then loads cell by cell.
pub fn give(arguments: &Deploy) -> Result<(), LinkError> {
    let texts = arguments.files.iter().map(|file| DeployText::read(file));
    let texts = texts.collect::<Result<Vec<DeployText>, DeployError>>()?;
    let (session, peer) = arguments.reach.as_peer()?;
    let cells = find(&session, arguments)?;
    let deployment = Deployment {
        session: &session,
        peer: &peer,
        cells: &cells,
        texts: &texts,
    };
    for line in deployment.check()? {
        rcc_process::say(&line);
    }
    if !arguments.check {
        deployment.roll(|done| rcc_process::say(&done.to_string()))?;
    }
    Ok(())
}

/// Looks for the cells; what a cell declares arrives a moment after the connection to it.
fn find(session: &Session, arguments: &Deploy) -> Result<Vec<String>, LinkError> {
    let until = Instant::now() + FOUND_MAX;
    loop {
        let found = fleet::cells(session, "*")?;
        match deploy::select(&found, &arguments.to, arguments.expect) {
            Err(DeployError::NoCell { .. } | DeployError::Count { .. })
                if Instant::now() < until =>
            {
                std::thread::sleep(LOOK);
            }
            selected => return Ok(selected?),
        }
    }
}

/// Unloads nets; goes on after one that cannot be unloaded.
pub fn withdraw(reach: &Reach, nets: &[(String, String)]) -> Result<(), LinkError> {
    let (session, peer) = reach.as_peer()?;
    let mut left = 0;
    for (cell, net) in nets {
        match deploy::withdraw(&session, &peer, cell, net) {
            Ok(()) => rcc_process::say(&format!("{cell}  {net} is unloaded")),
            Err(error) => {
                left += 1;
                rcc_process::remark(&format!("rcc-link: {net}: {error}"));
            }
        }
    }
    match left {
        0 => Ok(()),
        left => Err(LinkError::NotWithdrawn(left)),
    }
}

/// Reads `SITE/CELL/NET#ID`.
pub fn loaded_net(text: &str) -> Result<(String, String), String> {
    let named = text.rsplit_once('/').filter(|(cell, _)| is_cell_key(cell));
    match named.filter(|(_, net)| net.contains('#')) {
        Some((cell, net)) => Ok((cell.to_owned(), net.to_owned())),
        None => Err("write site, cell, net and number: 'lab/press/close-door#7'".to_owned()),
    }
}
