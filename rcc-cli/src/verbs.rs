//! The verbs: one file and two lines each, its module and its row of the table.
//! Every verb runs on the main thread and ends with a documented exit code.

use std::time::Duration;

use crate::context::Context;
use crate::failure::Failure;

pub mod abort;
pub mod cancel;
pub mod check;
pub mod completions;
pub mod convert;
pub mod costs;
pub mod demo;
pub mod devices;
pub mod doctor;
pub mod events;
pub mod explain;
pub mod fault;
pub mod fmt;
pub mod graph;
pub mod incidents;
pub mod install_units;
pub mod load;
pub mod ls;
pub mod man;
pub mod plot;
pub mod primitives;
pub mod replay;
pub mod robot;
pub mod rt_setup;
pub mod run;
pub mod schema;
pub mod set;
pub mod simulate;
mod source;
pub mod start;
pub mod state;
pub mod status;
pub mod tail;
pub mod top;
pub mod topics;
pub mod unload;
pub mod up;
pub mod watch;
pub mod wrench;

macro_rules! verbs {
    ($($(#[doc = $doc:literal])* $name:ident = $module:ident;)*) => {
        /// What to do.
        #[derive(clap::Subcommand, Debug)]
        pub enum Verb {
            $($(#[doc = $doc])* $name($module::Arguments),)*
        }

        impl Verb {
            /// Does it.
            ///
            /// # Errors
            /// Everything that is not a success, with its exit code.
            pub fn run(self, context: &Context) -> Result<(), Failure> {
                match self {
                    $(Verb::$name(arguments) => $module::run(context, arguments),)*
                }
            }
        }
    };
}

verbs! {
    /// Start a simulated cell, run the paper's three figures, verify what was measured.
    Demo = demo;
    /// Start and supervise a cell.
    Up = up;
    /// Check nets without loading them anywhere.
    Check = check;
    /// Lay out the text of nets, comments kept.
    Fmt = fmt;
    /// What a net needs, in which order it runs, and what can be null and why.
    Explain = explain;
    /// A net of the predecessor (DirectIONet) as YAML or JSON, and back.
    Convert = convert;
    /// Make a robot file from a URDF.
    Robot = robot;
    /// Draw a net: SVG, DOT or Mermaid.
    Graph = graph;
    /// What primitives cost on this machine.
    Costs = costs;
    /// LOAD: give a net to the core.
    Load = load;
    /// START: evaluate a loaded net from the next cycle on.
    Start = start;
    /// Run a net in virtual time against simple device models, without a cell.
    Simulate = simulate;
    /// Draw what the arms of a net would do: path, joints, speeds, accelerations and jerks against their limits.
    Plot = plot;
    /// Load, start and follow a net; Ctrl-C cancels it.
    Run = run;
    /// Set inputs of a net while it is ready or runs, or list them.
    Set = set;
    /// Values of any ports of a net, again and again.
    Watch = watch;
    /// CANCEL: ask a net to end in its own way.
    Cancel = cancel;
    /// ABORT: end a net at once; the drivers bring its devices to rest.
    Abort = abort;
    /// UNLOAD: forget a net that is not active.
    Unload = unload;
    /// STATE: everything about one net, or the states of all.
    State = state;
    /// List the loaded nets.
    Ls = ls;
    /// List the values that go from net to net.
    Topics = topics;
    /// List the devices.
    Devices = devices;
    /// List the primitives, or explain one.
    Primitives = primitives;
    /// Print the JSON Schema of nets, for editors.
    Schema = schema;
    /// The executor's health and the processes of the cell.
    Status = status;
    /// Where the time of the cycles goes, live: nets, histograms, primitives, late cycles.
    Top = top;
    /// What happened: who died, what was lost, what ended and why.
    Events = events;
    /// List what the flight recorder wrote, or have it write now.
    Incidents = incidents;
    /// Run the nets of an incident file again and compare every cycle.
    Replay = replay;
    /// Break something on purpose, in a simulated cell only.
    Fault = fault;
    /// What this machine grants and how punctual it is; why a device is not connected.
    Doctor = doctor;
    /// What hangs on a wrist sensor, from its readings.
    Wrench = wrench;
    /// Print monitored values as they come.
    Tail = tail;
    /// Print the completions of a shell.
    Completions = completions;
    /// Write the manual pages.
    Man = man;
    /// Write the systemd units of a cell from its configuration, or remove them.
    InstallUnits = install_units;
    /// Set what only root can set for real time; the units do it at start.
    RtSetup = rt_setup;
}

/// A net by id or name.
#[derive(clap::Args, Debug)]
pub struct Named {
    /// Id, name of the net (then the newest of that name), or name#id.
    pub name: String,
}

/// Reads `500ms`, `2s`, `1min`, or seconds without a unit.
///
/// # Errors
/// Anything else, in words.
pub fn duration(text: &str) -> Result<Duration, String> {
    let text = text.trim();
    let digits = text
        .find(|c: char| !c.is_ascii_digit() && c != '.')
        .unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let factor = match unit.trim() {
        "ms" => 1e-3,
        "s" | "" => 1.0,
        "min" => 60.0,
        _ => return Err(format!("`{text}` is no time: write 500ms, 2s or 1min")),
    };
    number
        .parse::<f64>()
        .ok()
        .map(|value| value * factor)
        .filter(|seconds| (1e-3..=86_400.0).contains(seconds))
        .map(Duration::from_secs_f64)
        .ok_or_else(|| format!("`{text}` is no time from 1ms to 1440min"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_a_unit_or_are_seconds() {
        assert_eq!(duration("500ms"), Ok(Duration::from_millis(500)));
        assert_eq!(duration("1.5"), Ok(Duration::from_millis(1500)));
        assert_eq!(duration("1 min"), Ok(Duration::from_secs(60)));
    }

    #[test]
    fn what_is_no_time_is_refused() {
        for text in ["", "s", "-1s", "0s", "5 h", "1e9s", "nan"] {
            assert!(duration(text).is_err(), "{text}");
        }
    }
}
