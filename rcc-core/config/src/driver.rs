//! Which program drives a device: one of RCC's own drivers by its name, or a program of somebody else.
//! Read once at start-up.

use std::fmt;
use std::path::{Path, PathBuf};

/// Which program drives a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DriverConfig {
    /// A driver of `rcc-driver`, of which only the drivers package knows which exist, or one of [`OWN_PROGRAMS`].
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
    /// Permissions of its systemd unit beyond those of every driver.
    pub needs: Vec<DriverNeed>,
}

/// A driver of RCC that has a program of its own, outside of the default build.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OwnProgram {
    /// Name of the driver.
    pub driver: &'static str,
    /// Its program, in the folder of RCC's programs.
    pub program: &'static str,
    /// The package that builds it.
    pub package: &'static str,
    /// Permissions of its systemd unit beyond those of every driver.
    pub needs: &'static [DriverNeed],
}

/// All drivers of RCC that have programs of their own.
pub const OWN_PROGRAMS: &[OwnProgram] = &[OwnProgram {
    driver: "ethercat",
    program: "rcc-ethercat",
    package: "rcc-ethercat",
    needs: &[DriverNeed::RawNetwork],
}];

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

impl DriverConfig {
    /// Returns the program of a driver of RCC that is not in `rcc-driver`.
    #[must_use]
    pub fn own_program(&self) -> Option<&'static OwnProgram> {
        OWN_PROGRAMS.iter().find(|own| self.is(own.driver))
    }

    /// Returns what the unit permits besides what every driver may do.
    #[must_use]
    pub fn needs(&self) -> &[DriverNeed] {
        match (self, self.own_program()) {
            (DriverConfig::Program(program), _) => &program.needs,
            (_, Some(own)) => own.needs,
            (_, None) => &[],
        }
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
    fn a_driver_with_a_program_of_its_own_brings_its_needs() {
        let named = |name: &str| DriverConfig::Name(name.to_owned());
        let ethercat = named("ethercat");
        assert_eq!(
            ethercat.own_program().map(|own| own.program),
            Some("rcc-ethercat")
        );
        assert_eq!(ethercat.needs(), [DriverNeed::RawNetwork]);
        assert_eq!(named("modbus").own_program(), None);
        assert_eq!(named("modbus").needs(), []);
    }

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
