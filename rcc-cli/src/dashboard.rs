//! The dashboard beside a cell: `rcc-monitor serve` as a child process, its address, and the desktop's browser. Run by the
//! main thread, with which the child ends.

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use rcc_api::codes;
use rcc_process::signals::PARENT;

use crate::failure::Failure;
use crate::supervisor::paths;

/// Options that are passed to `rcc-monitor serve`.
#[derive(Clone, Debug, Default, PartialEq, Eq, clap::Args)]
pub struct DashboardArguments {
    /// TCP port on 127.0.0.1; 0 takes any free one [default: 7426, or any free one if it is in use]
    #[arg(long)]
    pub port: Option<u16>,
    /// Refuse START on the pages; CANCEL and ABORT are always possible
    #[arg(long)]
    pub no_start: bool,
    /// File with the token that readers of /metrics must send; only its owner may read it
    #[arg(long, value_name = "FILE")]
    pub metrics_token: Option<PathBuf>,
    /// Let every program of this machine read /metrics without a token
    #[arg(long, conflicts_with = "metrics_token")]
    pub metrics_open: bool,
}

/// A running dashboard; it ends when this is dropped.
#[derive(Debug)]
pub struct Dashboard {
    child: Child,
    /// Address of its page, with the token.
    pub address: String,
}

impl DashboardArguments {
    /// Returns the command that serves the dashboard of a cell.
    ///
    /// # Errors
    /// Fails if the program is not installed.
    pub fn command(&self, cell: &str) -> Result<Command, Failure> {
        let mut command = Command::new(paths::program("rcc-monitor")?);
        command.args(["--cell", cell, "serve"]);
        if let Some(port) = self.port {
            command.arg("--port").arg(port.to_string());
        }
        if self.no_start {
            command.arg("--no-start");
        }
        if let Some(file) = &self.metrics_token {
            command.arg("--metrics-token").arg(file);
        }
        if self.metrics_open {
            command.arg("--metrics-open");
        }
        Ok(command)
    }
}

impl Dashboard {
    /// Starts the dashboard of a cell and waits for its address.
    ///
    /// # Errors
    /// Fails if the program is not installed, or ends at once; it has then printed why.
    pub fn start(cell: &str, arguments: &DashboardArguments) -> Result<Dashboard, Failure> {
        let failed = |why: String| {
            let message = format!("the dashboard cannot be started: {why}");
            Failure::new(
                codes::PROCESS_FAILED,
                message,
                "`rcc-cli serve` starts it alone",
            )
        };
        let mut command = arguments.command(cell)?;
        command.arg("--parent-death");
        command.env(PARENT, std::process::id().to_string());
        command.stdin(Stdio::null()).stdout(Stdio::piped());
        let child = command.spawn().map_err(|error| failed(error.to_string()))?;
        let mut dashboard = Dashboard {
            child,
            address: String::new(),
        };
        if let Some(output) = dashboard.child.stdout.take() {
            // An unreadable line counts as none.
            let _ = BufReader::new(output).read_line(&mut dashboard.address);
        }
        dashboard
            .address
            .truncate(dashboard.address.trim_end().len());
        match dashboard.address.is_empty() {
            true => Err(failed("it ended at once".to_owned())),
            false => Ok(dashboard),
        }
    }

    /// Opens the page with the program that `BROWSER` names, or else in the desktop's browser; returns false if there is
    /// neither.
    pub fn show(&self) -> bool {
        let variable = |name| std::env::var_os(name).filter(|value| !value.is_empty());
        let mut opener = match variable("BROWSER") {
            Some(program) => Command::new(program),
            None if variable("DISPLAY")
                .or(variable("WAYLAND_DISPLAY"))
                .is_some() =>
            {
                Command::new("xdg-open")
            }
            None => return false,
        };
        let opener = opener
            .arg(&self.address)
            .stdin(Stdio::null())
            .stdout(Stdio::null());
        opener.stderr(Stdio::null()).spawn().is_ok()
    }

    /// Returns true if it has ended by itself.
    pub fn has_ended(&mut self) -> bool {
        self.child.try_wait().is_ok_and(|status| status.is_some())
    }
}

impl Drop for Dashboard {
    fn drop(&mut self) {
        let pid = i32::try_from(self.child.id()).map(Pid::from_raw);
        // In order, so that it gives its place in the cell back; an error means that it has ended already.
        let asked = pid.is_ok_and(|pid| kill(pid, Signal::SIGTERM).is_ok());
        if asked {
            let _ = self.child.wait();
        }
    }
}
