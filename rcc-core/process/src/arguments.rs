//! Arguments that all programs of a cell take, as options or environment variables. Read once, by the main thread.

use std::collections::BTreeMap;
use std::path::PathBuf;

use rcc_config::CellConfig;
use rcc_config::ports::PortArgument;

use crate::exit::ExitError;

/// Numbers of the ports that a configuration leaves open.
#[derive(Clone, Debug, clap::Args)]
pub struct PortArguments {
    /// Number of a port that the configuration leaves open
    #[arg(
        long = "port",
        env = "RCC_PORTS",
        value_name = "NAME=NUMBER",
        value_delimiter = ','
    )]
    ports: Vec<PortArgument>,
}

impl PortArguments {
    /// Returns the numbers by name.
    #[must_use]
    pub fn chosen(&self) -> BTreeMap<String, u16> {
        let ports = self.ports.iter();
        ports.map(|port| (port.name.clone(), port.number)).collect()
    }
}

/// Cell and configuration, to be flattened into a program's own arguments.
#[derive(Clone, Debug, clap::Args)]
pub struct CellArguments {
    /// Name of the cell
    #[arg(long, env = "RCC_CELL")]
    pub cell: String,
    /// Configuration of the cell
    #[arg(long, env = "RCC_CONFIG", value_name = "FILE")]
    pub config: PathBuf,
    /// Ports that the configuration leaves open
    #[command(flatten)]
    pub ports: PortArguments,
    /// End when the parent process dies
    #[arg(long)]
    pub parent_death: bool,
}

impl CellArguments {
    /// Reads the configuration with the given ports.
    ///
    /// # Errors
    /// Returns every fault of the configuration; the exit code is that of a configuration error.
    pub fn load(&self) -> Result<CellConfig, ExitError> {
        CellConfig::load(&self.config, &self.chosen_ports())
            .map_err(|faults| ExitError::configuration(&faults))
    }

    /// Returns the ports given on the command line, by name.
    #[must_use]
    pub fn chosen_ports(&self) -> BTreeMap<String, u16> {
        self.ports.chosen()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Program {
        #[command(flatten)]
        cell: CellArguments,
    }

    #[test]
    fn ports_are_given_one_by_one_or_separated_by_commas() {
        let given = [
            "program",
            "--cell=a",
            "--config=b",
            "--port=x=1,y=2",
            "--port",
            "z=3",
        ];
        let ports = Program::parse_from(given).cell.ports.ports;
        let names: Vec<_> = ports
            .iter()
            .map(|port| (&*port.name, port.number))
            .collect();
        assert_eq!(names, [("x", 1), ("y", 2), ("z", 3)]);
    }

    #[test]
    fn a_missing_configuration_exits_with_78() {
        let given = ["program", "--cell=a", "--config=/nowhere/cell.yaml"];
        let ending = Program::parse_from(given).cell.load().unwrap_err();
        assert_eq!(ending.code, crate::exit::CONFIGURATION);
        assert!(
            ending.message.contains("/nowhere/cell.yaml"),
            "{}",
            ending.message
        );
    }
}
