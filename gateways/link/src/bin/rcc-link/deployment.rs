//! `rcc-link deploy` and `withdraw`: nets and configuration files to cells, and back. Run by the main thread.

use clap::Args;
use rcc_config::link::is_cell_key;
use rcc_link::deploy::{self, DeployError, DeployText, Deployment};
use rcc_link::fleet;

use crate::LinkError;
use crate::reach::Reach;

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
    let found = fleet::cells(&session, "*")?;
    let cells = deploy::select(&found, &arguments.to, arguments.expect)?;
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
