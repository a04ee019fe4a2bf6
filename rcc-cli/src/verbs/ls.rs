//! `ls`: lists the loaded nets.

use rcc_api::bodies::CommandView;

use crate::context::Context;
use crate::failure::Failure;
use crate::follow;
use crate::table;

/// Arguments of `ls`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached.
pub fn run(context: &Context, _arguments: Arguments) -> Result<(), Failure> {
    let commands: Vec<CommandView> = context.client()?.get("/commands")?;
    context.print(&commands, |commands| list(commands));
    Ok(())
}

/// Formats the list as a table.
pub(super) fn list(commands: &[CommandView]) -> String {
    if commands.is_empty() {
        return "no nets are loaded".to_owned();
    }
    let mut rows = table::table(&[
        "NET",
        "STATE",
        "CYCLES",
        "EXEC last/max",
        "EXPECTED",
        "USES",
    ]);
    for command in commands {
        rows.add_row([
            follow::title(command),
            follow::state_text(command),
            table::grouped(command.cycles),
            format!(
                "{} / {}",
                table::time(command.exec_last_ns),
                table::time(command.exec_max_ns)
            ),
            table::time(command.expected_ns),
            command.uses.join(", "),
        ]);
    }
    table::text(&rows)
}
