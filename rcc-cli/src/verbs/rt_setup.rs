//! `rt-setup`: applies the real-time settings that need root: frequency governor, interrupt affinity, sleep states;
//! reports what was set. Runs on the main thread; with `--hold` it waits, because sleep states stay disabled only while
//! a file is open.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use rcc_api::codes;
use rcc_process::{HealthReport, Helpers, Notifier, Stop};

use crate::context::Context;
use crate::failure::Failure;
use crate::output::print_line;
use crate::units::cores::Cores;

/// Arguments of `rt-setup`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Cores of the cycles, such as 3 or 2-3; interrupts are moved away from them. Also read from RCC_RT_CORES…
    #[arg(long, value_name = "CORES")]
    cores: Option<Cores>,
    /// Keep the processors out of sleep states until SIGTERM or Ctrl-C
    #[arg(long)]
    hold: bool,
    /// Root folder of the system's files
    #[arg(long, value_name = "DIR", default_value = "/", hide = true)]
    root: PathBuf,
}

/// Runs the verb.
///
/// # Errors
/// Fails if signals cannot be handled or the supervisor cannot be notified. Settings that the machine lacks or refuses
/// are only reported.
pub fn run(_: &Context, arguments: Arguments) -> Result<(), Failure> {
    let failed =
        |error: &dyn std::error::Error| Failure::new(codes::PROCESS_FAILED, error.to_string(), "");
    let stop = Stop::prepare(false).map_err(|error| failed(&error))?;
    let cores = wanted(arguments.cores);
    let mut lines = vec![
        governor(&arguments.root),
        interrupts(&arguments.root, &cores),
    ];
    let (held, line) = match arguments.hold {
        true => latency(&arguments.root),
        false => (None, "sleep states: unchanged without --hold".to_owned()),
    };
    lines.push(line);
    lines.iter().for_each(|line| print_line(line));
    if arguments.hold {
        let status = lines.join("; ");
        let look = move || HealthReport {
            progress: 0,
            status: status.clone(),
        };
        let helpers = Helpers::default();
        let supervisor = Notifier::start(&helpers, look).map_err(|error| failed(&error))?;
        helpers.start();
        stop.wait();
        supervisor.stopping();
    }
    drop(held);
    Ok(())
}

/// Returns the cores given here and those of every cell (`RCC_RT_CORES_<CELL>`, written by install-units).
fn wanted(given: Option<Cores>) -> BTreeSet<usize> {
    let named = std::env::vars().filter(|(name, _)| name.starts_with("RCC_RT_CORES"));
    let named = named.filter_map(|(_, value)| value.parse::<Cores>().ok());
    let all = named.chain(given);
    all.flat_map(|cores| cores.numbers().clone()).collect()
}

/// Returns the files `file` in all folders named `prefix` plus a number.
fn numbered(folder: &Path, prefix: &str, file: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let is_numbered = |name: &str| {
        let number = name.strip_prefix(prefix);
        number
            .is_some_and(|rest| !rest.is_empty() && rest.bytes().all(|byte| byte.is_ascii_digit()))
    };
    let named = entries.filter(|entry| entry.file_name().to_str().is_some_and(is_numbered));
    let mut files: Vec<PathBuf> = named.map(|entry| entry.path().join(file)).collect();
    files.retain(|path| path.exists());
    files.sort();
    files
}

/// Writes the same text into all files; returns how many accepted it, and the first refusal.
fn write_all(files: &[PathBuf], text: &str) -> (usize, Option<(PathBuf, io::Error)>) {
    let mut refusal = None;
    let mut taken = 0;
    for path in files {
        let written = OpenOptions::new().write(true).open(path);
        match written.and_then(|mut file| file.write_all(text.as_bytes())) {
            Ok(()) => taken += 1,
            Err(error) => refusal = refusal.or(Some((path.clone(), error))),
        }
    }
    (taken, refusal)
}

fn outcome(
    what: &str,
    done: &str,
    files: usize,
    (taken, refusal): (usize, Option<(PathBuf, io::Error)>),
) -> String {
    let but = refusal.map_or(String::new(), |(path, error)| {
        format!(" ({}: {error})", path.display())
    });
    match (files, taken) {
        (0, _) => format!("{what}: not available on this machine"),
        (_, 0) => format!("{what}: not set{but}"),
        _ => format!("{what}: {done} for {taken} of {files}{but}"),
    }
}

fn governor(root: &Path) -> String {
    let files = numbered(
        &root.join("sys/devices/system/cpu"),
        "cpu",
        "cpufreq/scaling_governor",
    );
    outcome(
        "frequency governor",
        "performance",
        files.len(),
        write_all(&files, "performance"),
    )
}

fn interrupts(root: &Path, cores: &BTreeSet<usize>) -> String {
    let what = "interrupts";
    if cores.is_empty() {
        return format!(
            "{what}: not moved, no core is reserved (`executor: {{core: …}}`, or --cores)"
        );
    }
    let count = numbered(&root.join("sys/devices/system/cpu"), "cpu", "").len();
    let Some(rest) = Cores::all_but(count, cores) else {
        return format!("{what}: not moved, there is no other core");
    };
    let files = numbered(&root.join("proc/irq"), "", "smp_affinity_list");
    // Per-core interrupts cannot be moved: they refuse.
    let done = format!("moved to cores {rest}");
    outcome(
        what,
        &done,
        files.len(),
        write_all(&files, &rest.to_string()),
    )
}

/// The kernel keeps the processors out of sleep states while this file is open with 0 µs written to it.
fn latency(root: &Path) -> (Option<File>, String) {
    let path = root.join("dev/cpu_dma_latency");
    let opened = OpenOptions::new().write(true).open(&path);
    match opened.and_then(|mut file| file.write_all(&0_i32.to_ne_bytes()).map(|()| file)) {
        Ok(file) => (
            Some(file),
            "sleep states: disabled while this runs".to_owned(),
        ),
        Err(error) => (
            None,
            format!("sleep states: unchanged ({}: {error})", path.display()),
        ),
    }
}

#[cfg(test)]
mod tests {
    use rcc_testing::TempDir;

    use super::*;

    /// A system root in a temporary folder, removed at the end.
    struct RootFixture(TempDir);

    impl RootFixture {
        fn new() -> RootFixture {
            let root = rcc_testing::folder();
            for file in [
                "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor",
                "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor",
                "proc/irq/7/smp_affinity_list",
                "dev/cpu_dma_latency",
            ] {
                let path = root.path().join(file);
                fs::create_dir_all(path.parent().unwrap()).unwrap();
                fs::write(path, "").unwrap();
            }
            RootFixture(root)
        }

        fn text(&self, file: &str) -> String {
            fs::read_to_string(self.0.path().join(file)).unwrap()
        }
    }

    #[test]
    fn everything_is_set_and_reported() {
        let system = RootFixture::new();
        assert_eq!(
            governor(system.0.path()),
            "frequency governor: performance for 2 of 2"
        );
        let line = interrupts(system.0.path(), &BTreeSet::from([1]));
        assert_eq!(line, "interrupts: moved to cores 0 for 1 of 1");
        assert_eq!(system.text("proc/irq/7/smp_affinity_list"), "0");
        let (held, line) = latency(system.0.path());
        assert!(held.is_some(), "{line}");
        assert_eq!(system.text("dev/cpu_dma_latency"), "\0\0\0\0");
    }

    #[test]
    fn settings_that_the_machine_lacks_are_reported() {
        let nowhere = Path::new("/nowhere");
        assert_eq!(
            governor(nowhere),
            "frequency governor: not available on this machine"
        );
        let line = interrupts(nowhere, &BTreeSet::from([0]));
        assert_eq!(line, "interrupts: not moved, there is no other core");
        assert!(
            latency(nowhere)
                .1
                .starts_with("sleep states: unchanged (/nowhere/dev/cpu_dma_latency")
        );
    }
}
