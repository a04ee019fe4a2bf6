//! Which program drives a device: one of RCC's own drivers by its name, or a program of somebody else.
//! Read once at start-up.

use std::fmt;
use std::path::{Path, PathBuf};

/// Which program drives a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DriverConfig {
    /// A driver of `rcc-driver`; only the drivers package knows which exist.
    Name(String),
    /// A program made with `rcc-driver-kit`.
    Program(DriverProgram),
}

/// A program that drives a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriverProgram {
    /// As the file has it: with a `/` relative to the cell's file, otherwise a program in the folder of RCC's programs.
    pub program: String,
    /// Arguments before those that every driver gets.
    pub arguments: Vec<String>,
    /// What its unit permits besides what every driver may do.
    pub needs: Vec<DriverNeed>,
}

/// A permission of a driver's unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DriverNeed {
    /// Raw packets of a network interface: `CAP_NET_RAW` and sockets of the family `AF_PACKET`.
    RawNetwork,
    /// A device file, to read and write: `/dev/…`.
    DeviceFile(String),
}

impl DriverNeed {
    /// The word for [`DriverNeed::RawNetwork`] in a file.
    pub const RAW_NETWORK: &'static str = "raw network";

    /// Reads one word of a file.
    #[must_use]
    pub fn read(text: &str) -> Option<DriverNeed> {
        let device = |text: &str| {
            let plain = |letter: char| letter.is_ascii_alphanumeric() || "/_.:-".contains(letter);
            let name = text.strip_prefix("/dev/")?;
            (!name.is_empty() && name.chars().all(plain) && !name.contains(".."))
                .then(|| DriverNeed::DeviceFile(text.to_owned()))
        };
        match text {
            Self::RAW_NETWORK => Some(DriverNeed::RawNetwork),
            _ => device(text),
        }
    }
}

impl DriverConfig {
    /// Returns true for the driver of `rcc-driver` with this name.
    #[must_use]
    pub fn is(&self, name: &str) -> bool {
        matches!(self, DriverConfig::Name(own) if own == name)
    }
}

impl DriverProgram {
    /// Returns the path of a program that is given with a `/`, for a cell's file in this folder; `None` if it is in the
    /// folder of RCC's programs.
    #[must_use]
    pub fn path(&self, folder: &Path) -> Option<PathBuf> {
        let joined = || folder.join(&self.program);
        self.program.contains('/').then(joined)
    }
}

/// The name, or the program as the file has it.
impl fmt::Display for DriverConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            DriverConfig::Name(name) => name,
            DriverConfig::Program(program) => &program.program,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_need_is_a_known_word_or_a_device_file() {
        let file = |path: &str| Some(DriverNeed::DeviceFile(path.to_owned()));
        assert_eq!(
            DriverNeed::read("raw network"),
            Some(DriverNeed::RawNetwork)
        );
        assert_eq!(DriverNeed::read("/dev/ttyUSB0"), file("/dev/ttyUSB0"));
        for wrong in [
            "",
            "network",
            "/dev/",
            "/etc/passwd",
            "/dev/../etc/x",
            "/dev/a b",
        ] {
            assert_eq!(DriverNeed::read(wrong), None, "{wrong}");
        }
    }
}
