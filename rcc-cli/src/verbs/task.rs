//! `task FILE`: loads the nets of a task, installs its rules, starts what starts first, and stays until nothing is left
//! to do. Ctrl-C ends its lease: the executor disarms its rules and cancels its nets. Main thread.

use std::collections::BTreeMap;

use rcc_api::bodies::{CommandRef, RulesBody, RulesInstalled, Switch, Switched};

use crate::client::LoaderClient;
use crate::context::{Context, OutputFormat};
use crate::failure::{Failure, draw};
use crate::follow::{self, OnRejection};
use crate::interrupt::Interrupts;
use crate::lease::{self, HeldLease};
use crate::output::print_diagnostics;
use crate::task::TaskFile;
use crate::verbs::rules;

/// Ids and titles of the loaded commands by their names in the task.
type Commands = BTreeMap<String, (u64, String)>;

/// Arguments of `task`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Task file (YAML or JSON): `nets`, `start`, `rules`
    file: String,
    /// Keep the nets loaded at the end
    #[arg(long)]
    keep: bool,
    /// Repeat the task: it begins again when nothing of it runs any more
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    times: u32,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached or refuses, if the lease is lost, or if Ctrl-C ends the task.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let task = TaskFile::read(&arguments.file)?;
    let client = context.client()?;
    let interrupts = Interrupts::listen()?;
    for _ in 0..arguments.times {
        once(context, &client, &interrupts, (&task, arguments.keep))?;
    }
    Ok(())
}

fn once(
    context: &Context,
    client: &LoaderClient,
    interrupts: &Interrupts,
    (task, keep): (&TaskFile, bool),
) -> Result<(), Failure> {
    let mut commands = Commands::new();
    let result = load_all(client, task, &mut commands)
        .and_then(|()| begin(context, client, interrupts, (task, &commands)));
    if !keep {
        for (id, _) in commands.values() {
            // One that is still being canceled cannot be unloaded; it stays in the list.
            let _ = follow::unload(client, &id.to_string());
        }
    }
    result
}

/// Loads the nets; remembers their commands by their names.
fn load_all(
    client: &LoaderClient,
    task: &TaskFile,
    commands: &mut Commands,
) -> Result<(), Failure> {
    for net in &task.nets {
        let source = follow::read_net(&net.file)?;
        let loaded = follow::load(client, &source.0, &source.1, OnRejection::Unload)?;
        print_diagnostics(&draw(
            &loaded.diagnostics,
            Some(&source),
            Context::drawing(),
        ));
        let name = match net.name.as_str() {
            "" => loaded.net.clone(),
            name => name.to_owned(),
        };
        let title = follow::title(&loaded);
        commands.insert(name, (loaded.id, title));
    }
    Ok(())
}

fn begin(
    context: &Context,
    client: &LoaderClient,
    interrupts: &Interrupts,
    (task, commands): (&TaskFile, &Commands),
) -> Result<(), Failure> {
    let task = task.with_commands(&|name| Some(commands.get(name)?.1.clone()));
    let held = HeldLease::grant(client)?;
    let numbers = match install_and_start(context, client, &task, held.number) {
        Ok(numbers) => numbers,
        Err(failure) => {
            held.end(client);
            return Err(failure);
        }
    };
    let loaded: Vec<u64> = commands.values().map(|(id, _)| *id).collect();
    rules::watch(context, client, interrupts, held, (&numbers, &loaded))
}

/// Installs the rules, then starts what starts first; returns the numbers of the rules.
fn install_and_start(
    context: &Context,
    client: &LoaderClient,
    task: &TaskFile,
    lease: u64,
) -> Result<Vec<u64>, Failure> {
    let lease = Some(lease);
    let mut numbers = Vec::new();
    if !task.rules.is_empty() {
        let rules = task.rules.clone();
        let body = lease::text(&RulesBody { rules, lease })?;
        let installed: RulesInstalled = client.post("/rules", body)?;
        numbers.extend(installed.rules.iter().map(|rule| rule.rule));
    }
    if !task.start.is_empty() {
        let start = task.start.iter().cloned().map(CommandRef::Name).collect();
        let switch = Switch {
            start,
            lease,
            ..Switch::default()
        };
        let switched: Switched = client.post("/switch", lease::text(&switch)?)?;
        for started in &switched.started {
            if context.format == OutputFormat::Human {
                let line = format!("{}#{}  running", started.net, started.id);
                context.print(&line, Clone::clone);
            }
        }
    }
    Ok(numbers)
}
