//! `rcc-robotics-api`: the gateway for the Java Robotics API. The main thread reads the command line, starts the others
//! and waits for the end.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use clap::Parser;
use rcc_ipc::Cell;
use rcc_process::Stop;
use rcc_robotics_api::attached::{self, DeviceAlias};
use rcc_robotics_api::devices::CellOptions;
use rcc_robotics_api::gateway::{Gateway, GatewayOptions};
use rcc_robotics_api::loader::CellClient;
use rcc_robotics_api::own_cell::{OwnCell, rcc_cli_beside};
use rcc_robotics_api::{cell_stream, engine, server};

/// Lets applications of the Java Robotics API v2 drive a cell, without a change of them.
///
/// Without --cell the gateway makes a cell of its own, with the simulated devices that the applications create.
#[derive(Parser)]
#[command(name = "rcc-robotics-api", version = rcc_protocol::version::version())]
struct Arguments {
    /// Address and port for the applications; there is no authentication, so that it should be a loopback address
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8080")]
    bind: SocketAddr,
    /// Attach to this running cell, whose devices and limits are used
    #[arg(long, env = "RCC_CELL")]
    cell: Option<String>,
    /// A device of the attached cell under a name and type of the library; otherwise it has its own name
    #[arg(long, value_name = "NAME=DEVICE[:TYPE]", requires = "cell")]
    device: Vec<DeviceAlias>,
    /// Name of the gateway's own cell
    #[arg(long, default_value = "robotics-api", conflicts_with = "cell")]
    own_cell: String,
    /// Folder for the files of the gateway's own cell [default: robotics-api in the cell's state folder]
    #[arg(long, conflicts_with = "cell")]
    folder: Option<PathBuf>,
    /// Period of the gateway's own cell, ms
    #[arg(long, default_value = "2", conflicts_with = "cell", value_parser = clap::value_parser!(u32).range(1..=50))]
    period: u32,
    /// Time that set-points wait in the drivers of the gateway's own cell, ms: bridges what a machine that is not
    /// real-time delays
    #[arg(long, default_value = "80", conflicts_with = "cell", value_parser = clap::value_parser!(u32).range(4..=400))]
    delay: u32,
    /// Time after which the nets of an application without connections are stopped, s
    #[arg(long, default_value = "10", value_parser = clap::value_parser!(u32).range(1..=3600))]
    session_timeout: u32,
    /// The program rcc-cli [default: beside this one, else of the path]
    #[arg(long, conflicts_with = "cell")]
    rcc_cli: Option<PathBuf>,
}

fn main() -> ExitCode {
    rcc_process::begin();
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            rcc_process::remark(&format!("rcc-robotics-api: {message}"));
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), String> {
    let stop = Stop::prepare(false).map_err(|error| error.to_string())?;
    let listener = TcpListener::bind(arguments.bind).map_err(|error| {
        format!(
            "cannot listen at {}: {error}; choose another port with --bind",
            arguments.bind
        )
    })?;
    let address = listener.local_addr().map_err(|error| error.to_string())?;
    if !address.ip().is_loopback() {
        tracing::warn!(%address, "the protocol has no authentication: whoever reaches this address moves the robots");
    }
    let gateway = Arc::new(gateway(arguments)?);
    let spawn = |name: &str, run: fn(&Gateway)| {
        let gateway = Arc::clone(&gateway);
        let thread = std::thread::Builder::new().name(name.to_owned());
        thread
            .spawn(move || run(&gateway))
            .map_err(|error| format!("no thread can be started: {error}"))
    };
    let supervisor = spawn("own-cell", |gateway| {
        if let Some(own) = &gateway.own {
            own.run(gateway);
        }
    })?;
    spawn("engine", |gateway| engine::run(gateway))?;
    spawn("cell-stream", |gateway| cell_stream::run(gateway))?;
    let served = Arc::clone(&gateway);
    let serve = move || server::serve(&listener, &served);
    std::thread::Builder::new()
        .name("accept".to_owned())
        .spawn(serve)
        .map_err(|error| error.to_string())?;
    rcc_process::say(&format!("listening on {address}"));
    let signal = stop.wait();
    tracing::info!(%signal, "ends");
    engine::end_all(&gateway);
    if let Some(own) = &gateway.own {
        own.end();
    }
    // A panic there was printed; the cell then ends with this process.
    let _ = supervisor.join();
    Ok(())
}

fn gateway(arguments: &Arguments) -> Result<Gateway, String> {
    let options = GatewayOptions {
        session_timeout: Duration::from_secs(arguments.session_timeout.into()),
    };
    let Some(name) = &arguments.cell else {
        let name = &arguments.own_cell;
        let cell = Cell::new(name).map_err(|error| error.to_string())?;
        let folder = arguments
            .folder
            .clone()
            .unwrap_or_else(|| cell.state_anchor().join("robotics-api"));
        let this = std::env::current_exe().ok();
        let rcc_cli = arguments
            .rcc_cli
            .clone()
            .unwrap_or_else(|| rcc_cli_beside(this.as_deref()));
        let own = CellOptions {
            name: name.clone(),
            period_ms: arguments.period,
            delay_ms: arguments.delay,
        };
        let own = OwnCell::new(own, folder, rcc_cli).map_err(|error| error.to_string())?;
        return Ok(Gateway::new(options, cell.socket(), Some(own)));
    };
    let cell = Cell::find(name).map_err(|error| error.to_string())?;
    let cell = cell
        .ok_or_else(|| format!("cell '{name}' not found: start it first, or leave out --cell"))?;
    let gateway = Gateway::new(options, cell.socket(), None);
    let devices = CellClient::new(&cell.socket()).devices();
    let devices =
        devices.map_err(|error| format!("the devices of cell '{name}' cannot be read: {error}"))?;
    gateway
        .state()
        .devices
        .extend(attached::reported(&devices, &arguments.device)?);
    Ok(gateway)
}
