//! The command line of `ethercat-sim`.
//! Read once, by the main thread.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Parser;
use rcc_drivers::sim::control_socket;

use super::line::LineWire;
use super::model::{MODELS, Model};
use crate::wire::Interface;

/// A line of EtherCAT terminals on a network interface, such as one end of a veth pair.
#[derive(Clone, Debug, Parser)]
#[command(name = "ethercat-sim", version = rcc_protocol::version::version())]
pub struct Options {
    /// Network interface on which the line answers; needs CAP_NET_RAW
    #[arg(long, value_name = "INTERFACE", required_unless_present = "udp")]
    pub nic: Option<String>,
    /// Address on which the line answers to EtherCAT over UDP instead; needs no rights
    #[arg(long, value_name = "ADDRESS", conflicts_with = "nic")]
    pub udp: Option<SocketAddr>,
    /// The terminals in their order
    #[arg(long, value_name = "NAME,NAME…", value_delimiter = ',', value_parser = model,
          default_value = "EL1008,EL2008,EL3064,EL4004")]
    pub terminals: Vec<&'static Model>,
    /// Wires an output to an input: TERMINAL.CHANNEL=TERMINAL.CHANNEL, from 1; may be repeated. An analog input gets the raw
    /// value of the output
    #[arg(long, value_name = "2.1=1.1")]
    pub wire: Vec<LineWire>,
    /// Unix socket of the control port (one JSON object per line), for programs of the same user and of root, in a
    /// folder that only they can write to. Default: no control port
    #[arg(long, value_name = "SOCKET", value_parser = control_socket::path)]
    pub control: Option<PathBuf>,
    /// SCHED_FIFO priority of the thread that answers, if the system permits it: a real line is punctual
    #[arg(long, value_name = "1..99", value_parser = clap::value_parser!(u8).range(1..=99))]
    pub priority: Option<u8>,
    /// Ends when the thread that started it ends
    #[arg(long)]
    pub parent_death: bool,
}

impl Options {
    /// Returns where the line is connected.
    #[must_use]
    pub fn interface(&self) -> Interface {
        match (&self.nic, self.udp) {
            (_, Some(address)) => Interface::Udp(address),
            // One of the two is required.
            (name, None) => Interface::Nic(name.clone().unwrap_or_default()),
        }
    }
}

fn model(name: &str) -> Result<&'static Model, String> {
    Model::named(name).ok_or_else(|| {
        let names: Vec<&str> = MODELS.iter().map(|model| model.name).collect();
        format!(
            "unknown terminal; available terminals: {}",
            names.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_terminals_are_a_list_of_known_names() {
        let parse = |list| Options::try_parse_from(["ethercat-sim", "--nic=x", list]);
        let options = parse("--terminals=EL2008,EL2008,EL1008").unwrap();
        let names: Vec<&str> = options.terminals.iter().map(|model| model.name).collect();
        assert_eq!(names, ["EL2008", "EL2008", "EL1008"]);
        let error = parse("--terminals=EL9999").unwrap_err().to_string();
        assert!(
            error.contains("available terminals: EL1008, EL2008"),
            "{error}"
        );
    }
}
