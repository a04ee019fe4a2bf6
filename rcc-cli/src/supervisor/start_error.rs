//! Why a process could not be started, and whether another attempt can help. Used by the supervisor's thread.

use std::io;
use std::path::{Path, PathBuf};

use nix::errno::Errno;

use super::policy::Remedy;

/// The reason why a process could not be started.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {source}")]
pub struct StartError {
    path: PathBuf,
    source: io::Error,
    /// The system refused the program, not one of its files.
    is_of_program: bool,
}

impl StartError {
    /// A log or socket of the process cannot be created.
    #[must_use]
    pub fn file(path: &Path, source: io::Error) -> StartError {
        StartError {
            path: path.to_owned(),
            source,
            is_of_program: false,
        }
    }

    /// The program cannot be executed.
    #[must_use]
    pub fn program(path: &Path, source: io::Error) -> StartError {
        StartError {
            path: path.to_owned(),
            source,
            is_of_program: true,
        }
    }

    /// Returns true if another attempt cannot help: the program is missing or must not be executed. Everything else may
    /// pass, such as a shortage of processes, memory, open files or disk space.
    fn is_final(&self) -> bool {
        use io::ErrorKind::{NotFound, PermissionDenied};
        self.is_of_program && matches!(self.source.kind(), NotFound | PermissionDenied)
    }

    /// Returns the remedy.
    #[must_use]
    pub fn remedy(&self) -> Remedy {
        if self.is_final() {
            return Remedy::Final("grant the permission, or reinstall all programs");
        }
        Remedy::AfterRestarts(
            match Errno::from_raw(self.source.raw_os_error().unwrap_or(0)) {
                Errno::EAGAIN => {
                    "end other processes, or allow more (`ulimit -u`, TasksMax=), then restart the cell"
                }
                Errno::ENOMEM => "end other programs to free memory, then restart the cell",
                Errno::EMFILE | Errno::ENFILE => {
                    "allow more open files (`ulimit -n`), then restart the cell"
                }
                Errno::ENOSPC | Errno::EDQUOT => {
                    "free space on the disk of this file, then restart the cell"
                }
                Errno::ETXTBSY => {
                    "wait until the installation of the programs has ended, then restart the cell"
                }
                _ => {
                    "make this path usable again, then restart the cell, which creates its folders"
                }
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_missing_or_forbidden_program_is_final() {
        let system = |errno: Errno| io::Error::from_raw_os_error(errno as i32);
        let path = Path::new("/opt/rcc/rcc-exec");
        for errno in [Errno::ENOENT, Errno::EACCES, Errno::EPERM] {
            assert!(StartError::program(path, system(errno)).remedy().is_final());
            assert!(!StartError::file(path, system(errno)).remedy().is_final());
        }
        for (errno, remedy) in [
            (Errno::EAGAIN, "ulimit -u"),
            (Errno::ENOMEM, "memory"),
            (Errno::EMFILE, "ulimit -n"),
            (Errno::ENOSPC, "space"),
            (Errno::ETXTBSY, "installation"),
        ] {
            let error = StartError::program(path, system(errno));
            assert!(!error.remedy().is_final() && error.remedy().words().contains(remedy));
            assert!(error.to_string().starts_with("/opt/rcc/rcc-exec: "));
        }
    }
}
