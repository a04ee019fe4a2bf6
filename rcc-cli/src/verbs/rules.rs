//! `rules`: installs rules from a file, lists them, removes them. Main thread.

use rcc_api::bodies::{CommandView, RuleNumber, RuleView, RulesBody, RulesInstalled};

use crate::client::LoaderClient;
use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::follow::POLL_INTERVAL;
use crate::interrupt::Interrupts;
use crate::lease::{self, HeldLease, ShownRules};
use crate::table;
use crate::task::TaskFile;

/// Arguments of `rules`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    #[command(subcommand)]
    what: RulesCommand,
}

#[derive(clap::Subcommand, Debug)]
enum RulesCommand {
    /// Install the rules of a file (YAML or JSON), all or none
    Install {
        /// File with `rules:`; - reads standard input
        file: String,
        /// Hold a lease and show what fires, until no rule can fire; Ctrl-C ends the lease
        #[arg(long)]
        stay: bool,
    },
    /// List the rules and their states
    Ls,
    /// Remove rules
    Remove {
        /// Numbers of the rules
        #[arg(required = true)]
        numbers: Vec<u64>,
    },
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached or refuses.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let client = context.client()?;
    match arguments.what {
        RulesCommand::Ls => {
            let rules: Vec<RuleView> = client.get("/rules")?;
            context.print(&rules, |rules| list(rules));
            Ok(())
        }
        RulesCommand::Remove { numbers } => {
            let removed = numbers
                .iter()
                .map(|number| client.delete::<RuleNumber>(&format!("/rules/{number}")));
            let removed = removed.collect::<Result<Vec<_>, Failure>>()?;
            context.print(&removed, |removed| numbered(removed, "removed"));
            Ok(())
        }
        RulesCommand::Install { file, stay } => install(context, &client, &file, stay),
    }
}

fn install(
    context: &Context,
    client: &LoaderClient,
    file: &str,
    stay: bool,
) -> Result<(), Failure> {
    let task = TaskFile::read(file)?;
    let interrupts = Interrupts::listen()?;
    let held = match stay {
        true => Some(HeldLease::grant(client)?),
        false => None,
    };
    let lease = held.as_ref().map(|held| held.number);
    let rules = task.rules;
    let body = lease::text(&RulesBody { rules, lease })?;
    let installed = client.post::<RulesInstalled>("/rules", body);
    let (installed, held) = match (installed, held) {
        (Ok(installed), Some(held)) => (installed, held),
        (Ok(installed), None) => {
            context.print(&installed, |installed| {
                numbered(&installed.rules, "installed")
            });
            return Ok(());
        }
        (Err(failure), held) => {
            if let Some(held) = held {
                held.end(client);
            }
            return Err(failure);
        }
    };
    let numbers: Vec<u64> = installed.rules.iter().map(|rule| rule.rule).collect();
    if context.format == OutputFormat::Human {
        context.print(&installed, |installed| {
            numbered(&installed.rules, "installed")
        });
    }
    watch(context, client, &interrupts, held, (&numbers, &[]))
}

/// Renews the lease and shows what the rules do, until none of them can fire and what they started has ended.
///
/// # Errors
/// Fails if the lease is lost, the loader refuses, or Ctrl-C ends it.
pub fn watch(
    context: &Context,
    client: &LoaderClient,
    interrupts: &Interrupts,
    mut held: HeldLease,
    (numbers, loaded): (&[u64], &[u64]),
) -> Result<(), Failure> {
    let mut shown = ShownRules::default();
    loop {
        if interrupts.asked() {
            held.end(client);
            return Err(Failure::interrupted());
        }
        held.renew(client)?;
        // While the loader is being restarted, the lease counts.
        if let Ok(rules) = client.get::<Vec<RuleView>>("/rules") {
            let rules: Vec<&RuleView> = rules
                .iter()
                .filter(|rule| numbers.contains(&rule.rule))
                .collect();
            for line in shown.changes(&rules) {
                if context.format == OutputFormat::Human {
                    context.print(&line, Clone::clone);
                }
            }
            // Asked for after the rules: what a rule has started is in the table by then.
            let commands = client.get::<Vec<CommandView>>("/commands");
            if let Ok(commands) = commands
                && !lease::is_busy(&rules, &commands, loaded)
            {
                held.end(client);
                if context.format == OutputFormat::Json {
                    context.print(&rules, |_| String::new());
                }
                return Ok(());
            }
        }
        std::thread::sleep(POLL_INTERVAL);
    }
}

fn numbered(rules: &[RuleNumber], what: &str) -> String {
    let lines = rules
        .iter()
        .map(|rule| format!("rule {} `{}`  {what}", rule.rule, rule.name));
    lines.collect::<Vec<_>>().join("\n")
}

fn list(rules: &[RuleView]) -> String {
    if rules.is_empty() {
        return "no rules are installed".to_owned();
    }
    let mut rows = table::table(&["RULE", "NAME", "WHEN", "THEN", "STATE", "CYCLE", "REASON"]);
    for rule in rules {
        rows.add_row([
            rule.rule.to_string(),
            rule.name.clone(),
            rule.when.clone(),
            then(rule),
            rule.state.clone(),
            table::grouped(rule.cycle),
            rule.words.clone().unwrap_or_default(),
        ]);
    }
    table::text(&rows)
}

/// How often a rule that records has recorded.
pub(super) fn recorded(rule: &RuleView) -> Option<String> {
    let (record, recorded) = (rule.record?, rule.recorded.unwrap_or_default());
    let skipped = match recorded.skipped {
        0 => String::new(),
        skipped => format!(", {skipped} skipped"),
    };
    Some(format!(
        "{} of {}{skipped}",
        recorded.recordings, record.times
    ))
}

/// The consequences of a rule, one line for each kind.
fn then(rule: &RuleView) -> String {
    let lists = [
        ("stop", &rule.stop),
        ("cancel", &rule.cancel),
        ("start", &rule.start),
    ];
    let lines = lists.into_iter().filter(|(_, names)| !names.is_empty());
    let lines = lines.map(|(what, names)| format!("{what} {}", names.join(", ")));
    let lines = lines.chain(recorded(rule).map(|recorded| format!("record, {recorded}")));
    lines.collect::<Vec<_>>().join("\n")
}
