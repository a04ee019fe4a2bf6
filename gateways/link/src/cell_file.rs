//! Replaces the file of a cell's configuration by one that came over the link. What reaches beyond the cell (its name, who
//! may use it, which programs it runs, where it writes) stays as it is: that is changed on the cell itself. Reads and writes
//! files.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use rcc_config::diagnostic::Faults;
use rcc_config::{CellConfig, DeviceConfig, DriverConfig, DriverNeed};
use serde_json::Value;

/// The driver of `rcc-driver` that runs a program of somebody else: the only one.
const SOFTWARE: &str = "software";
/// Its setting that has this program and its arguments.
const COMMAND: &str = "command";

/// Why a file is not taken.
#[derive(Debug, thiserror::Error)]
pub enum CellFileError {
    /// The present file, or the new text, is invalid.
    #[error("{0}")]
    Invalid(Faults),
    /// The text is the configuration of another cell.
    #[error(
        "the configuration is that of cell `{given}`, and this is `{own}`: send each cell its own"
    )]
    Name {
        /// Name in the text.
        given: String,
        /// Name in the present file.
        own: String,
    },
    /// The text changes what only a person on the cell may.
    #[error(
        "`{key}` differs from the cell's present file: it is changed on the cell itself, not over the link"
    )]
    Fixed {
        /// Key of the cell's file.
        key: &'static str,
    },
    /// The text runs a program that the present file does not run.
    #[error(
        "`{program}` is not run by the cell's present file: new programs are given to a cell on the cell itself, not over the \
         link"
    )]
    Program {
        /// The program with its arguments.
        program: String,
    },
    /// The text permits a program more than the present file does.
    #[error(
        "`needs` of `{program}` are more than in the cell's present file: they are changed on the cell itself, not over the link"
    )]
    Needs {
        /// The program with its arguments.
        program: String,
    },
    /// A file cannot be written.
    #[error("{file} cannot be written: {cause}: `rcc-link serve` needs the right to write there")]
    Write {
        /// The file.
        file: String,
        /// Why.
        cause: io::Error,
    },
}

/// Checks a new text for the cell whose present file is `file`.
///
/// # Errors
/// Fails for a text that changes more than the cell's own work.
pub fn check(file: &Path, text: &str) -> Result<(), CellFileError> {
    let present = CellConfig::load_offline(file).map_err(CellFileError::Invalid)?;
    let base = file.parent().unwrap_or(Path::new(""));
    let name = file.display().to_string();
    let new = CellConfig::parse_offline(text, &name, base).map_err(CellFileError::Invalid)?;
    if new.name != present.name {
        return Err(CellFileError::Name {
            given: new.name,
            own: present.name,
        });
    }
    let fixed = [
        ("link", new.link == present.link),
        ("access", new.access == present.access),
        ("recorder", new.recorder == present.recorder),
        ("ports", new.ports == present.ports),
    ];
    if let Some((key, _)) = fixed.into_iter().find(|(_, same)| !same) {
        return Err(CellFileError::Fixed { key });
    }
    let known = programs(&present);
    for program in programs(&new) {
        program.check(&known)?;
    }
    Ok(())
}

/// The process that starts a program; it determines where the file of the program is searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StartedBy {
    /// The supervisor: in the folder of RCC's programs, or with a `/` by its path.
    Supervisor,
    /// The driver `software`: by `PATH`, or with a `/` by its path.
    Software,
}

/// A program that a file runs.
#[derive(Debug)]
struct NamedProgram<'a> {
    started_by: StartedBy,
    /// The program and its arguments.
    line: Vec<String>,
    /// Permissions of its unit in addition to those of every driver.
    needs: &'a [DriverNeed],
}

impl NamedProgram<'_> {
    /// Checks that the present file runs the same program with all that this one needs.
    fn check(&self, known: &[NamedProgram<'_>]) -> Result<(), CellFileError> {
        let same =
            |one: &&NamedProgram<'_>| (one.started_by, &one.line) == (self.started_by, &self.line);
        let mut known = known.iter().filter(same).peekable();
        let program = || self.line.join(" ");
        if known.peek().is_none() {
            return Err(CellFileError::Program { program: program() });
        }
        match known.any(|one| self.needs.iter().all(|need| one.needs.contains(need))) {
            true => Ok(()),
            false => Err(CellFileError::Needs { program: program() }),
        }
    }
}

/// Returns the programs that a file names, apart from `rcc-driver`, which every cell may run.
fn programs(config: &CellConfig) -> Vec<NamedProgram<'_>> {
    let simulators = config.simulators.iter().map(|own| NamedProgram {
        started_by: StartedBy::Supervisor,
        line: line(&own.program, &own.arguments),
        needs: &[],
    });
    let devices = config.devices.iter();
    devices.filter_map(of_device).chain(simulators).collect()
}

fn of_device(device: &DeviceConfig) -> Option<NamedProgram<'_>> {
    let (started_by, line) = match &device.driver {
        DriverConfig::Program(own) => (StartedBy::Supervisor, line(&own.program, &own.arguments)),
        DriverConfig::Name(name) if name == SOFTWARE => {
            (StartedBy::Software, command(device.settings.get(COMMAND)?))
        }
        // Also a program, and with more permissions than `rcc-driver`.
        DriverConfig::Name(_) => {
            let own = device.driver.own_program()?;
            (StartedBy::Supervisor, line(own.program, &[]))
        }
    };
    Some(NamedProgram {
        started_by,
        line,
        needs: device.driver.needs(),
    })
}

fn line(program: &str, arguments: &[String]) -> Vec<String> {
    let all = std::iter::once(program).chain(arguments.iter().map(String::as_str));
    all.map(str::to_owned).collect()
}

/// Returns the words of a command. One that the driver would refuse is compared as JSON, and so is refused if it is new.
fn command(value: &Value) -> Vec<String> {
    let word = |value: &Value| match value {
        Value::String(word) => word.clone(),
        other => other.to_string(),
    };
    match value {
        Value::Array(words) => words.iter().map(word).collect(),
        other => vec![other.to_string()],
    }
}

/// Writes the text beside the file, keeps the present one as `FILE.previous`, and renames: at no time is there half a file.
/// Returns the path of the previous one.
///
/// # Errors
/// Fails if the folder cannot be written; then the file is as it was.
pub fn replace(file: &Path, text: &str) -> Result<PathBuf, CellFileError> {
    let failed = |path: &Path| {
        let file = path.display().to_string();
        move |cause| CellFileError::Write { file, cause }
    };
    // A link to the file stays one.
    let file = &file.canonicalize().map_err(failed(file))?;
    let beside = |ending: &str| {
        let mut name = OsString::from(file);
        name.push(ending);
        PathBuf::from(name)
    };
    let (next, previous) = (beside(".next"), beside(".previous"));
    let write = || {
        let mut new = File::create(&next)?;
        new.set_permissions(fs::metadata(file)?.permissions())?;
        new.write_all(text.as_bytes())?;
        new.sync_all()
    };
    write().map_err(failed(&next))?;
    fs::copy(file, &previous).map_err(failed(&previous))?;
    fs::rename(&next, file).map_err(failed(file))?;
    // The name is in the folder: without this a power cut could bring the old file back.
    let folder = file.parent().unwrap_or(Path::new("/"));
    let synced = File::open(folder).and_then(|folder| folder.sync_all());
    synced.map_err(failed(folder))?;
    Ok(previous)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRESENT: &str = "cell: press\nperiod: 1 ms\nlink: {site: lab}\ndevices:\n  io: {driver: modbus}\n  own: {driver: \
                           {program: ./box, arguments: [--fast]}}\n";

    /// Returns a folder with the present file.
    fn present() -> (rcc_testing::TempDir, PathBuf) {
        let folder = rcc_testing::folder();
        let file = folder.path().join("press.yaml");
        fs::write(&file, PRESENT).expect("a file");
        (folder, file)
    }

    #[test]
    fn what_reaches_beyond_the_cell_is_not_changed_over_the_link() {
        let (_folder, file) = present();
        check(&file, PRESENT).expect("the same");
        check(&file, &PRESENT.replace("1 ms", "2 ms")).expect("another period");
        check(
            &file,
            &PRESENT.replace("driver: modbus", "driver: ideal-arm"),
        )
        .expect("another driver of rcc-driver");
        let rows = [
            (
                "press",
                "lift",
                "is that of cell `lift`, and this is `press`",
            ),
            ("{site: lab}", "{site: lab, publish: []}", "`link` differs"),
            ("link: {site: lab}\n", "", "`link` differs"),
            (
                "devices:",
                "access: {group: users}\ndevices:",
                "`access` differs",
            ),
            ("./box", "/bin/sh", "`/bin/sh --fast` is not run by"),
            ("--fast", "-c", "`./box -c` is not run by"),
            (
                "modbus",
                "ethercat",
                "`rcc-ethercat` is not run by the cell's present file",
            ),
            (
                "[--fast]",
                "[--fast], needs: [raw network]",
                "`needs` of `./box --fast` are more",
            ),
            ("1 ms", "1 mm", "1 mm"),
        ];
        for (from, to, words) in rows {
            let refused = check(&file, &PRESENT.replacen(from, to, 1)).expect_err(words);
            assert!(refused.to_string().contains(words), "{words}: {refused}");
        }
    }

    #[test]
    fn the_command_of_a_software_device_is_a_program_too() {
        let (_folder, file) = present();
        let software = |command: &str| {
            let device = format!("driver: software, settings: {{command: {command}}}");
            PRESENT.replace("driver: modbus", &device)
        };
        let refused = |text: &str| match check(&file, text).expect_err("refused") {
            CellFileError::Program { program } => program,
            other => panic!("{other}"),
        };
        let shell = software("[/bin/sh, -c, reboot]");
        assert_eq!(refused(&shell), "/bin/sh -c reboot");
        // Nor what the supervisor starts, whose file is looked for in another folder.
        assert_eq!(refused(&software("[./box, --fast]")), "./box --fast");
        fs::write(&file, &shell).expect("a file");
        check(&file, &shell).expect("the same command");
        let moved = shell.replace("  io: ", "  camera: ");
        check(&file, &moved).expect("the same command in another device");
        assert_eq!(refused(&shell.replace("-c,", "-x,")), "/bin/sh -x reboot");
        assert_eq!(refused(&software("reboot")), "\"reboot\"");
        check(
            &file,
            &software("[]").replace("settings: {command: []}", "settings: {period: 10 ms}"),
        )
        .expect("no command");
    }

    #[test]
    fn a_program_may_need_less_but_not_more() {
        let (_folder, file) = present();
        let needs =
            |words: &str| PRESENT.replace("[--fast]", &format!("[--fast], needs: [{words}]"));
        fs::write(&file, needs("raw network, /dev/ttyUSB0")).expect("a file");
        check(&file, &needs("raw network")).expect("fewer");
        check(&file, PRESENT).expect("none");
        let more = check(&file, &needs("raw network, /dev/ttyUSB1")).expect_err("another");
        assert!(matches!(more, CellFileError::Needs { .. }), "{more}");
    }

    #[test]
    fn the_present_file_is_kept_beside_the_new_one() {
        let (folder, file) = present();
        let link = folder.path().join("link.yaml");
        std::os::unix::fs::symlink(&file, &link).expect("a link");
        let previous = replace(&link, "cell: new\n").expect("written");
        let text = |path: &Path| fs::read_to_string(path).expect("a file");
        assert_eq!(
            (text(&file), text(&link)),
            ("cell: new\n".to_owned(), "cell: new\n".to_owned())
        );
        assert_eq!(text(&previous), PRESENT);
        assert!(link.is_symlink());
        let names = fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(names, 3, "nothing else is left");
        let refused = replace(&folder.path().join("none.yaml"), "").expect_err("no file");
        assert!(
            refused.to_string().contains("none.yaml cannot be written"),
            "{refused}"
        );
    }
}
