//! The command line of `io-sim`.
//! Read once, by the main thread.

use super::image::Wire;
use crate::sim::control_socket;
use clap::Parser;
use std::net::SocketAddr;
use std::path::PathBuf;

/// An I/O station that speaks Modbus TCP: 64 coils, discrete inputs, holding registers and input registers.
#[derive(Clone, Debug, Parser)]
#[command(name = "io-sim", version = rcc_ipc::version::version())]
pub struct Options {
    /// Where the Modbus server listens; port 0 lets the system choose
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub bind: SocketAddr,
    /// Where the control port is: a Unix socket (one JSON object a line) for programs of the same user and of root, in a
    /// folder that only they can write to; files that requests name lie below that folder. Without it there is none
    #[arg(long, value_name = "SOCKET", value_parser = control_socket::path)]
    pub control: Option<PathBuf>,
    /// Wires an output back to an input: coil:N=discrete:N or holding:N=input:N, from 0
    #[arg(long, value_name = "OUTPUT=INPUT")]
    pub wire: Vec<Wire>,
    /// SCHED_FIFO priority of its server, where the system grants it: a real station is punctual
    #[arg(long, value_name = "1..99", value_parser = clap::value_parser!(u8).range(1..=99))]
    pub priority: Option<u8>,
    /// Ends when the thread that started it ends
    #[arg(long)]
    pub parent_death: bool,
}
