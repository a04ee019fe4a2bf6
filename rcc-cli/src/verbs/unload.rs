//! `unload NAME…`, `unload --all`: unloads nets that are not active.

use rcc_api::bodies::{CommandView, Done};
use rcc_api::codes;

use crate::client::LoaderClient;
use crate::context::Context;
use crate::failure::Failure;
use crate::follow;
use crate::output::print_note;

/// Arguments of `unload`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Nets: id, name (the newest with that name), or name#id
    #[arg(required_unless_present = "all", value_name = "NAME")]
    names: Vec<String>,
    /// Unload every net that is not active
    #[arg(long, conflicts_with = "names")]
    all: bool,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached or refuses.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let client = context.client()?;
    if arguments.all {
        let unloaded = unload_all(&client)?;
        context.print(&unloaded, |unloaded| match unloaded.as_slice() {
            [] => "no nets were unloaded".to_owned(),
            rows => rows.iter().map(line).collect::<Vec<_>>().join("\n"),
        });
        return Ok(());
    }
    for name in &arguments.names {
        let done = follow::unload(&client, name)?;
        context.print(&done, line);
    }
    Ok(())
}

/// Unloads every command that is not active; names those that stay.
fn unload_all(client: &LoaderClient) -> Result<Vec<Done>, Failure> {
    let commands: Vec<CommandView> = client.get("/commands")?;
    let (mut unloaded, mut active) = (Vec::new(), Vec::new());
    for command in &commands {
        let gone = match command.state.as_str() {
            "running" | "canceling" | "loading" => None,
            _ => match follow::unload(client, &command.id.to_string()) {
                // Started, or unloaded by somebody else, since the list was made.
                Err(failure) if failure.exit == codes::WRONG_STATE.exit => None,
                Err(failure) if failure.body.code == codes::UNKNOWN_COMMAND.code => continue,
                done => Some(done?),
            },
        };
        match gone {
            Some(done) => unloaded.push(done),
            None => active.push(follow::title(command)),
        }
    }
    if !active.is_empty() {
        print_note(&format!(
            "not unloaded, because active or still loading: {}; `rcc-cli cancel NAME` ends a net",
            active.join(", ")
        ));
    }
    Ok(unloaded)
}

fn line(done: &Done) -> String {
    format!("{}#{}  unloaded", done.net, done.id)
}
