//! Finds the state folder of a cell, with event log, incident files and logs, whether or not the cell is up. Used by
//! the main thread of verbs that read it.

use rcc_ipc::state_folder::{StateFolder, state_base};
use rcc_ipc::{Cell, CellError};

use crate::cells;
use crate::context::{Context, cell_failure};
use crate::failure::Failure;
use crate::output::print_note;

/// A cell and its state folder.
#[derive(Clone, Debug)]
pub struct KeptState {
    /// The cell, unless it has ended.
    pub cell: Option<Cell>,
    /// Its state folder.
    pub state: StateFolder,
}

impl KeptState {
    /// Finds the state folder of the context's cell.
    ///
    /// # Errors
    /// Fails if no such cell runs and its state folder does not exist, or if the cell belongs to another user.
    pub fn find(context: &Context) -> Result<KeptState, Failure> {
        let name = context.cell_name();
        let kept = || StateFolder::find(name);
        match Cell::find(name) {
            Ok(Some(cell)) => Ok(KeptState {
                // A cell of an older build has no state folder yet.
                state: cell.state(),
                cell: Some(cell),
            }),
            Ok(None) => kept()
                .map(|state| KeptState { cell: None, state })
                .ok_or_else(|| nothing_kept(name)),
            // The running cell of that name is somebody else's; the state folder may be ours.
            Err(error @ CellError::NotOurs { .. }) => kept()
                .map(|state| KeptState { cell: None, state })
                .ok_or_else(|| cell_failure(&error)),
            Err(error) => Err(cell_failure(&error)),
        }
    }

    /// Returns true if a process of the cell is alive, or may be.
    #[must_use]
    pub fn is_up(&self) -> bool {
        let announced = self.cell.as_ref().map(Cell::announced_all);
        announced.is_some_and(|announced| {
            // A list that cannot be read proves nothing.
            announced.map_or(true, |all| all.iter().any(|one| !one.liveness().is_dead()))
        })
    }

    /// Says on stderr where `what` is read if the cell is not up.
    pub fn note(&self, context: &Context, what: &str) {
        if !self.is_up() {
            print_note(&format!(
                "cell `{}` is not up; {what} kept in {}",
                context.cell_name(),
                self.state.path().display()
            ));
        }
    }
}

/// Returns the failure for a cell that does not run and of which nothing is kept.
fn nothing_kept(name: &str) -> Failure {
    let mut failure = cells::not_found(name);
    let base = state_base();
    let kept = match StateFolder::names() {
        none if none.is_empty() => String::new(),
        names => format!("; kept: {}", names.join(", ")),
    };
    failure.body.message += &format!(", and nothing is kept of it in {}{kept}", base.display());
    failure
}
