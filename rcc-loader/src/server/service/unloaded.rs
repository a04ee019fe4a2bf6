//! The last commands that had ended when they were unloaded: a client that waits for a net which another one runs and
//! unloads still learns how it ended. Used by the server's blocking threads.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use rcc_api::bodies::CommandView;

/// Number of commands that are remembered.
pub(super) const UNLOADED_MAX: usize = 256;

/// The last commands, the newest at the end; their ids are never given again.
#[derive(Debug, Default)]
pub(super) struct UnloadedCommands(Mutex<VecDeque<CommandView>>);

impl UnloadedCommands {
    /// Remembers a command that has ended, without its diagnostics, which may be long; once, however often its unloading is
    /// asked for.
    pub(super) fn add(&self, command: CommandView) {
        // A panic leaves it intact: a command is either in it or not.
        let mut commands = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if commands.iter().any(|known| known.id == command.id) {
            return;
        }
        if commands.len() >= UNLOADED_MAX {
            commands.pop_front();
        }
        commands.push_back(CommandView {
            diagnostics: Vec::new(),
            ..command
        });
    }

    /// Returns the command with this id.
    pub(super) fn find(&self, id: u64) -> Option<CommandView> {
        let commands = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        commands.iter().rfind(|command| command.id == id).cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_commands_are_remembered() {
        let commands = UnloadedCommands::default();
        let last = UNLOADED_MAX as u64 + 1;
        for id in (1..=last).chain([last]) {
            commands.add(CommandView {
                id,
                ..CommandView::default()
            });
        }
        assert_eq!(commands.find(1), None);
        for id in [2, last] {
            assert_eq!(commands.find(id).map(|command| command.id), Some(id));
        }
    }
}
