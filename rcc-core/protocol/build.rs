//! Tells the library of which commit it is built: `RCC_COMMIT` if it is set (a source archive has no repository),
//! otherwise what git says. Only in release profiles: a development build would be linked again after every commit.

use std::env;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-env-changed=RCC_COMMIT");
    let released = env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let commit = env::var("RCC_COMMIT").ok().or_else(|| {
        let log = git(&[
            "rev-parse",
            "--path-format=absolute",
            "--git-path",
            "logs/HEAD",
        ]);
        if let Some(log) = log.filter(|_| released) {
            println!("cargo::rerun-if-changed={log}");
            return git(&["rev-parse", "--short=12", "HEAD"]);
        }
        None
    });
    let commit = commit.unwrap_or_else(|| {
        let unknown = if released { "unknown" } else { "development" };
        unknown.to_owned()
    });
    println!("cargo::rustc-env=RCC_COMMIT={commit}");
}

/// The one line that git prints, if there is git and this is a repository.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let line = String::from_utf8(output.stdout).ok()?;
    let line = line.trim().to_owned();
    (output.status.success() && !line.is_empty()).then_some(line)
}
