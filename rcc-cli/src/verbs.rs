//! The verbs. Each has a file, a `mod` line, a row in its group of `verbs!` (the order of the help), and an entry in
//! `reach.rs` for `--url`.
//! Verbs run on the main thread and end with a documented exit code.

use crate::context::Context;
use crate::duration::duration;
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
pub mod down;
pub mod events;
pub mod explain;
pub mod fault;
pub mod fleet;
pub mod fmt;
pub mod graph;
pub mod import;
pub mod incidents;
pub mod install_units;
pub mod load;
pub mod ls;
pub mod man;
pub mod plot;
pub mod primitives;
pub mod record;
pub mod replay;
pub mod robot;
pub mod rt_setup;
pub mod rules;
pub mod run;
pub mod schema;
pub mod serve;
pub mod set;
pub mod sim;
pub mod simulate;
pub mod start;
pub mod state;
pub mod status;
pub mod tail;
pub mod task;
pub mod top;
pub mod topics;
pub mod unload;
pub mod up;
pub mod wait;
pub mod watch;
pub mod wrench;

macro_rules! verbs {
    ($($title:literal { $($(#[doc = $doc:literal])* $name:ident = $module:ident;)* })*) => {
        /// Subcommands of `rcc-cli`.
        #[derive(clap::Subcommand, Debug)]
        pub enum Verb {
            $($($(#[doc = $doc])* $name($module::Arguments),)*)*
        }

        impl Verb {
            /// Runs the verb.
            ///
            /// # Errors
            /// Fails with the exit code of everything that is not a success.
            pub fn run(self, context: &Context) -> Result<(), Failure> {
                match self {
                    $($(Verb::$name(arguments) => $module::run(context, arguments),)*)*
                }
            }
        }

        /// Titles of the groups of verbs in the help, each with the number of its verbs; in the order of [`Verb`].
        pub const GROUPS: &[(&str, usize)] = &[$(($title, [$(stringify!($name)),*].len())),*];
    };
}

verbs! {
    "Write and check nets" {
        /// Check nets, libraries, cells and robots offline
        Check = check;
        /// Format nets, keeping comments
        Fmt = fmt;
        /// Explain a net: time budget, order of evaluation, and which values can be null
        Explain = explain;
        /// Draw a net as SVG, DOT or Mermaid
        Graph = graph;
        /// Run a net in virtual time against simple device models, without a cell
        Simulate = simulate;
        /// Plot the arm motions of a net: path, joints, and derivatives relative to their limits
        Plot = plot;
        /// Convert nets between DirectIONet (the predecessor's format), YAML and JSON
        Convert = convert;
        /// List the primitives, or explain one
        Primitives = primitives;
        /// Print the JSON Schema of nets, cells or robots, for editors
        Schema = schema;
        /// Show the execution cost of each primitive on this machine
        Costs = costs;
    }
    "Run nets" {
        /// Load, start and follow a net; Ctrl-C cancels it
        Run = run;
        /// Load a net (LOAD)
        Load = load;
        /// Start loaded nets at the next cycle (START)
        Start = start;
        /// Run a task: nets, the rules between them, and what starts first
        Task = task;
        /// Install, list or remove rules: conditions that stop and start nets in the same cycle
        Rules = rules;
        /// Set or list the inputs of a net
        Set = set;
        /// Ask a net to end in its own way (CANCEL)
        Cancel = cancel;
        /// End a net at once; the drivers bring its devices to rest (ABORT)
        Abort = abort;
        /// Wait until nets have ended, and report how
        Wait = wait;
        /// Unload nets that are not active (UNLOAD)
        Unload = unload;
    }
    "Observe" {
        /// List the loaded nets
        Ls = ls;
        /// Show the state of one net, or of all nets (STATE)
        State = state;
        /// Show values of a net's ports periodically
        Watch = watch;
        /// Print monitored values as they arrive
        Tail = tail;
        /// Serve a dashboard for browsers on this machine, and print its address
        Serve = serve;
        /// Record nets, devices and events to an MCAP file, for Foxglove, PlotJuggler, Rerun and Python
        Record = record;
        /// Read a recording again, as a table or curves; make a net from a trajectory of ROS
        Import = import;
        /// List the topics that connect nets
        Topics = topics;
        /// Show live timing: nets, histograms, primitives and late cycles
        Top = top;
        /// Show the executor's health and the cell's processes
        Status = status;
        /// Ask, follow and deploy to the cells of several hosts (rcc-link)
        Fleet = fleet;
        /// Show the event log: process deaths, lost devices, ended nets and their causes
        Events = events;
        /// List the incident files of the flight recorder, or record one now
        Incidents = incidents;
        /// Replay the nets of an incident file and compare every cycle
        Replay = replay;
    }
    "Devices and robots" {
        /// List the devices and their connections
        Devices = devices;
        /// Inject a fault into a simulated cell
        Fault = fault;
        /// Show the channels of a simulated device, and set its inputs
        Sim = sim;
        /// Create robot files from URDF
        Robot = robot;
        /// Identify the load of a wrist sensor from its readings
        Wrench = wrench;
    }
    "Cells and machines" {
        /// Run the paper's three figures on a simulated cell and verify the measurements
        Demo = demo;
        /// Start and supervise a cell
        Up = up;
        /// End a cell: its nets are canceled, its arms come to rest
        Down = down;
        /// Check this machine's real-time capability, or diagnose a device connection
        Doctor = doctor;
        /// Apply the real-time settings that need root; the units do this at start
        RtSetup = rt_setup;
        /// Install or remove the systemd units of a cell
        InstallUnits = install_units;
    }
    "Shell" {
        /// Print completions for a shell
        Completions = completions;
        /// Write the manual pages
        Man = man;
    }
}

/// Selects a net by id or name.
#[derive(clap::Args, Debug)]
pub struct NetName {
    /// Net: id, name (the newest with that name), or name#id
    pub name: String,
}
