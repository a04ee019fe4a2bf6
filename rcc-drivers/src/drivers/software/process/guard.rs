//! Ends the program together with the driver, however the driver ends: a program that ignores the end of its input would
//! live on after SIGKILL of the driver, beside the one that the next driver starts.
//!
//! The parent death signal cannot do this: it must be requested between fork and exec (`unsafe`), and does not reach what
//! the program has started. So a shell waits for the end of its input, which only the driver holds open.

use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};

use nix::unistd::Pid;

/// Ends the process group that is its argument at the end of its input.
const SCRIPT: &str = r#"read -r line; kill -s KILL -- "-$1""#;

/// A process that ends a process group with SIGKILL if this process dies before the value is dropped.
#[derive(Debug)]
pub struct Guard(Child);

impl Guard {
    /// Starts it, in a process group of its own: what ends the driver or the program with their group must not end it.
    ///
    /// # Errors
    /// Returns the error of the system, with the program.
    pub fn start(group: Pid) -> std::io::Result<Guard> {
        let child = Command::new("/bin/sh")
            .args(["-c", SCRIPT, "guard", &group.to_string()])
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn();
        child.map(Guard).map_err(|error| {
            std::io::Error::new(
                error.kind(),
                format!("/bin/sh, which ends it with the driver: {error}"),
            )
        })
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        // Both fail only if it has ended; it must not see the end of its input.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
