//! The command line of `io-sim`.
//! Read once, by the main thread.

use super::process_image::PointLoopback;
use crate::sim::control_socket;
use clap::Parser;
use std::net::SocketAddr;
use std::path::PathBuf;

/// An I/O station that speaks Modbus TCP: 64 coils, discrete inputs, holding registers and input registers.
#[derive(Clone, Debug, Parser)]
#[command(name = "io-sim", version = rcc_protocol::version::version())]
pub struct Options {
    /// Where the Modbus server listens; port 0 lets the system choose
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub bind: SocketAddr,
    /// Unix socket of the control port (one JSON object per line), for programs of the same user and of root, in a
    /// folder that only they can write to; files that requests name must be below that folder. Default: no control port
    #[arg(long, value_name = "SOCKET", value_parser = control_socket::path)]
    pub control: Option<PathBuf>,
    /// Loops an output back to an input: coil:N=discrete:N or holding:N=input:N, N from 0
    #[arg(long, value_name = "OUTPUT=INPUT")]
    pub wire: Vec<PointLoopback>,
    /// SCHED_FIFO priority of the server thread, if the system permits it: a real station is punctual
    #[arg(long, value_name = "1..99", value_parser = clap::value_parser!(u8).range(1..=99))]
    pub priority: Option<u8>,
    /// Ends when the thread that started it ends
    #[arg(long)]
    pub parent_death: bool,
}
