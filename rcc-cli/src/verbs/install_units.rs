//! `install-units FILE`: writes the systemd units of a cell from its configuration, or removes them. Runs on the main
//! thread; starts nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use rcc_api::codes;
use rcc_config::ports::PortArgument;
use rcc_config::{CellConfig, auto_ports};
use rcc_core::counted::Counted;

use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::output::{print_line, print_record};
use crate::supervisor::paths;
use crate::units::cores::Cores;
use crate::units::disk::{self, FileChange};
use crate::units::{self, CellUnits};

/// Arguments of `install-units`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Cell configuration, in a place that services can read, for example below /etc/rcc
    file: PathBuf,
    /// Write below this folder instead of /
    #[arg(long, value_name = "DIR", default_value = "/")]
    root: PathBuf,
    /// Change nothing; print what would be written, replaced and removed
    #[arg(long)]
    dry_run: bool,
    /// Cores for everything but the cycle, such as 0-2,5 [default: all but those of executors and isolated ones]
    #[arg(long, value_name = "CORES")]
    cpus: Option<Cores>,
    /// Folder of the installed programs [default: this program's folder]
    #[arg(long, value_name = "DIR")]
    programs: Option<PathBuf>,
    /// Number of a port that the configuration assigns automatically
    #[arg(long = "port", value_name = "NAME=NUMBER")]
    ports: Vec<PortArgument>,
    /// Install units for the simulators as well
    #[arg(long)]
    simulators: bool,
    /// Remove the units of this cell; with the last cell, everything
    #[arg(long)]
    uninstall: bool,
}

/// Folders hidden from the services (`ProtectHome`, `PrivateTmp`).
const HIDDEN: [&str; 5] = ["/home", "/root", "/run/user", "/tmp", "/var/tmp"];
/// Folder with the kernel's lists of cores.
const CPUS: &str = "/sys/devices/system/cpu";
/// Programs that the units start.
const PROGRAMS: [&str; 5] = [
    "rcc-exec",
    "rcc-loader",
    "rcc-driver",
    "rcc-janitor",
    "rcc-cli",
];

/// Runs the verb.
///
/// # Errors
/// Fails if the configuration is invalid or not for production, if a file was not written by RCC, or if the system
/// refuses.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let name = arguments.file.display().to_string();
    let path = arguments.file.canonicalize();
    let path = path.map_err(|error| Failure::unreadable(&name, &error))?;
    let invalid = |faults| Failure::from_faults("invalid configuration", &faults);
    if arguments.uninstall {
        // Removing needs no ports.
        let config = CellConfig::load_offline(&path).map_err(invalid)?;
        let cell = context.cell.as_deref().unwrap_or(&config.name);
        let removed = disk::remove(&arguments.root, cell, arguments.dry_run)?;
        print_changes(context, &removed, arguments.dry_run);
        if !arguments.dry_run {
            after_uninstall(context, cell);
        }
        return Ok(());
    }
    let ports = chosen_ports(&path, &arguments)?;
    let config = CellConfig::load(&path, &ports).map_err(invalid)?;
    let cell = context.cell.clone().unwrap_or(config.name.clone());
    let elsewhere = arguments.root != Path::new("/");
    let programs = programs(arguments.programs.as_deref(), elsewhere)?;
    require_own_programs(&config, &programs, elsewhere)?;
    require_visible(&path, "the configuration", elsewhere)?;
    require_no_simulators(&config, &arguments)?;
    let cores = cores(&config, &arguments.root, &cell, arguments.cpus)?;
    let cell_units = CellUnits {
        cell: &cell,
        config: &config,
        path: &path,
        ports: &ports,
        cores: cores.as_ref(),
        programs: &programs,
        simulators: arguments.simulators,
    };
    let mut files = units::shipped(&programs);
    files.extend(cell_units.drop_ins());
    let mut done = disk::write(&arguments.root, &files, arguments.dry_run)?;
    done.extend(disk::remove_stale(
        &arguments.root,
        &cell,
        &files,
        arguments.dry_run,
    )?);
    print_changes(context, &done, arguments.dry_run);
    if !arguments.dry_run {
        after_install(context, &cell);
    }
    Ok(())
}

/// Returns the numbers of the automatic ports; all of them must be given.
fn chosen_ports(path: &Path, arguments: &Arguments) -> Result<BTreeMap<String, u16>, Failure> {
    let given: BTreeMap<String, u16> = arguments
        .ports
        .iter()
        .map(|port| (port.name.clone(), port.number))
        .collect();
    let automatic = auto_ports(path)
        .map_err(|faults| Failure::from_faults("invalid configuration", &faults))?;
    let open: Vec<String> = automatic.into_iter().map(|(name, _)| name).collect();
    let missing: Vec<&str> = open
        .iter()
        .filter(|name| !given.contains_key(*name))
        .map(String::as_str)
        .collect();
    if missing.is_empty() {
        return Ok(given);
    }
    let sample: Vec<String> = missing
        .iter()
        .zip(49938..)
        .map(|(name, port)| format!("--port {name}={port}"))
        .collect();
    Err(Failure::new(
        codes::BAD_REQUEST,
        format!(
            "services need fixed ports, but the configuration assigns these automatically: {}",
            missing.join(", ")
        ),
        format!("set numbers in its `ports`, or pass {}", sample.join(" ")),
    ))
}

/// Fails if the configuration has simulators that were not requested.
fn require_no_simulators(config: &CellConfig, arguments: &Arguments) -> Result<(), Failure> {
    if arguments.simulators || config.simulators.is_empty() {
        return Ok(());
    }
    let names: Vec<&str> = config
        .simulators
        .iter()
        .map(|one| one.name.as_str())
        .collect();
    Err(Failure::new(
        codes::BAD_REQUEST,
        format!(
            "the configuration has simulators ({}) and is not meant for production",
            names.join(", ")
        ),
        "remove `simulators` and give the devices their real addresses, or add --simulators to run them as services",
    ))
}

fn programs(given: Option<&Path>, elsewhere: bool) -> Result<PathBuf, Failure> {
    let here = std::env::current_exe().unwrap_or_default();
    let folder = given
        .or(here.parent())
        .unwrap_or(Path::new(units::PROGRAMS))
        .to_owned();
    if elsewhere {
        return Ok(folder);
    }
    let missing = PROGRAMS.iter().find(|name| !folder.join(name).is_file());
    if let Some(name) = missing {
        return Err(Failure::new(
            codes::BAD_REQUEST,
            format!("{name} not found in {}", folder.display()),
            "install all programs in one folder and pass it with --programs DIR",
        ));
    }
    require_visible(&folder, "the folder of the programs", elsewhere)?;
    Ok(folder)
}

/// Fails if a device has a driver of RCC whose program is not installed.
fn require_own_programs(
    config: &CellConfig,
    folder: &Path,
    elsewhere: bool,
) -> Result<(), Failure> {
    let devices = config.devices.iter();
    let mut own = devices.filter_map(|device| device.driver.own_program());
    match own.find(|own| !elsewhere && !folder.join(own.program).is_file()) {
        None => Ok(()),
        Some(own) => Err(Failure::new(
            codes::BAD_REQUEST,
            format!("{} not found in {}", own.program, folder.display()),
            paths::build(own),
        )),
    }
}

fn require_visible(path: &Path, what: &str, elsewhere: bool) -> Result<(), Failure> {
    let hidden = HIDDEN.iter().find(|folder| path.starts_with(folder));
    match hidden {
        Some(folder) if !elsewhere => Err(Failure::new(
            codes::BAD_REQUEST,
            format!(
                "{what} is {}, but services cannot access {folder}",
                path.display()
            ),
            "sudo packaging/install; sudo mkdir -p /etc/rcc; sudo cp -r configs/* /etc/rcc/",
        )),
        _ => Ok(()),
    }
}

/// Returns the cores for everything but the cycle, unless cores are given: all that are online, but those of executors and
/// isolated ones. The cores that this process may use itself do not matter: systemd starts the services.
fn cores(
    config: &CellConfig,
    root: &Path,
    cell: &str,
    given: Option<Cores>,
) -> Result<Option<Cores>, Failure> {
    let Some(core) = config.executor.core else {
        return Ok(given);
    };
    if given.as_ref().is_some_and(|cores| cores.contains(core)) {
        return Err(Failure::new(
            codes::BAD_REQUEST,
            format!("core {core} is reserved for the executor (`executor: {{core: {core}}}`)"),
            "remove it from --cpus",
        ));
    }
    if given.is_some() {
        return Ok(given);
    }
    let list = |name: &str| fs::read_to_string(Path::new(CPUS).join(name)).unwrap_or_default();
    let mut taken = reserved_by_others(root, cell);
    taken.insert(core);
    Ok(housekeeping(&list("online"), &list("isolated"), &taken))
}

/// Returns the cores of the list `online` without those of the list `isolated`, which the scheduler leaves alone, and those
/// `taken`; `None` if none remain.
fn housekeeping(online: &str, isolated: &str, taken: &BTreeSet<usize>) -> Option<Cores> {
    let numbers = |list: &str| {
        list.trim()
            .parse()
            .map_or(BTreeSet::new(), |cores: Cores| cores.numbers().clone())
    };
    let isolated = numbers(isolated);
    let rest = numbers(online)
        .into_iter()
        .filter(|core| !isolated.contains(core) && !taken.contains(core));
    let rest: Vec<String> = rest.map(|core| core.to_string()).collect();
    rest.join(",").parse().ok()
}

/// Returns the cores of the executors of other cells, from the drop-ins of `rt-setup` that were written for them.
fn reserved_by_others(root: &Path, cell: &str) -> BTreeSet<usize> {
    let folder = root.join(units::UNITS).join("rcc-rt-setup.service.d");
    let own = format!("50-cell-{cell}.conf");
    let others = fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| {
            let name = entry.file_name();
            name != *own && name.to_string_lossy().starts_with("50-cell-")
        });
    let texts = others.filter_map(|entry| fs::read_to_string(entry.path()).ok());
    texts.flat_map(|text| reserved_in(&text)).collect()
}

fn reserved_in(drop_in: &str) -> BTreeSet<usize> {
    let lines = drop_in
        .lines()
        .filter_map(|line| line.strip_prefix("Environment=RCC_RT_CORES"));
    let lists = lines.filter_map(|line| line.split_once('=')?.1.parse::<Cores>().ok());
    lists.flat_map(|cores| cores.numbers().clone()).collect()
}

/// Prints the change of each file, or with `dry` the change that was not made, and the number of files.
fn print_changes(context: &Context, done: &[(FileChange, PathBuf)], dry: bool) {
    if context.format == OutputFormat::Json {
        let rows: Vec<_> = done
            .iter()
            .map(|(done, path)| serde_json::json!({"path": path, "done": done, "dry_run": dry}))
            .collect();
        print_record(&serde_json::Value::from(rows).to_string());
        return;
    }
    for (done, path) in done {
        let word = match (done, dry) {
            (FileChange::Written, false) => "written",
            (FileChange::Written, true) => "would write",
            (FileChange::Replaced, false) => "replaced",
            (FileChange::Replaced, true) => "would replace",
            (FileChange::Removed, false) => "removed",
            (FileChange::Removed, true) => "would remove",
            (FileChange::Unchanged, _) => "unchanged",
            (FileChange::Packaged, _) => "packaged",
        };
        let width = if dry { 13 } else { 10 };
        print_line(&format!("{word:<width$} {}", path.display()));
    }
    let kept = |done: &FileChange| matches!(done, FileChange::Unchanged | FileChange::Packaged);
    let changes = done.iter().filter(|(done, _)| !kept(done)).count();
    print_line(&match (dry, changes) {
        (_, 0) => "nothing to change".to_owned(),
        (true, changes) => format!(
            "{} would change; nothing was changed (--dry-run)",
            Counted::of(changes, "file")
        ),
        (false, changes) => format!("{} changed", Counted::of(changes, "file")),
    });
}

fn after_install(context: &Context, cell: &str) {
    if context.format == OutputFormat::Json {
        return;
    }
    print_line(&format!(
        "next:
  sudo systemd-sysusers && sudo systemd-tmpfiles --create && sudo systemctl daemon-reload
  sudo systemctl enable --now rcc@{cell}.target rcc.target
  systemctl status 'rcc-*@{cell}*'"
    ));
}

fn after_uninstall(context: &Context, cell: &str) {
    if context.format == OutputFormat::Human {
        print_line(&format!(
            "next: sudo systemctl stop rcc@{cell}.target; sudo systemctl daemon-reload"
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn housekeeping_takes_the_online_cores_that_nobody_reserved() {
        let cores = |online, isolated, taken: &[usize]| {
            let taken = taken.iter().copied().collect();
            housekeeping(online, isolated, &taken).map(|cores| cores.to_string())
        };
        assert_eq!(cores("0-3\n", "\n", &[3]).as_deref(), Some("0-2"));
        // Core 1 is switched off, and more are online than a process of a container may use.
        assert_eq!(
            cores("0,2-15", "8-11", &[2, 3]).as_deref(),
            Some("0,4-7,12-15")
        );
        assert_eq!(cores("0-1", "", &[7]).as_deref(), Some("0-1"));
        assert_eq!(cores("0-1", "1", &[0]), None);
        assert_eq!(cores("", "", &[0]), None);
    }

    #[test]
    fn cores_of_other_cells_are_reserved() {
        let root = rcc_testing::folder();
        let folder = root
            .path()
            .join("etc/systemd/system/rcc-rt-setup.service.d");
        fs::create_dir_all(&folder).unwrap();
        for (name, cores) in [("lab", "3"), ("line-2", "4"), ("idle", ""), ("own", "5")] {
            let text = format!("# written\n[Service]\nEnvironment=RCC_RT_CORES_X={cores}\n");
            fs::write(folder.join(format!("50-cell-{name}.conf")), text).unwrap();
        }
        fs::write(
            folder.join("90-site.conf"),
            "Environment=RCC_RT_CORES_X=9\n",
        )
        .unwrap();
        assert_eq!(
            reserved_by_others(root.path(), "own"),
            BTreeSet::from([3, 4])
        );
    }
}
