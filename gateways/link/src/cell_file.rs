//! Replaces the file of a cell's configuration by one that came over the link. What reaches beyond the cell (its name, who
//! may use it, which programs it runs, where it writes) stays as it is: that is changed on the cell itself. Reads and writes
//! files.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use rcc_config::diagnostic::Faults;
use rcc_config::{CellConfig, DriverConfig};

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
    match programs(&new).into_iter().find(|one| !known.contains(one)) {
        None => Ok(()),
        Some(program) => Err(CellFileError::Program {
            program: program.join(" "),
        }),
    }
}

/// Returns the programs that a file names, with their arguments.
fn programs(config: &CellConfig) -> BTreeSet<Vec<String>> {
    let line = |program: &String, arguments: &[String]| {
        let all = std::iter::once(program).chain(arguments);
        all.cloned().collect()
    };
    let drivers = config
        .devices
        .iter()
        .filter_map(|device| match &device.driver {
            DriverConfig::Name(_) => None,
            DriverConfig::Program(own) => Some(line(&own.program, &own.arguments)),
        });
    let simulators = config.simulators.iter();
    let simulators = simulators.map(|own| line(&own.program, &own.arguments));
    drivers.chain(simulators).collect()
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
            &PRESENT.replace("driver: modbus", "driver: software"),
        )
        .expect("another driver");
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
            ("1 ms", "1 mm", "1 mm"),
        ];
        for (from, to, words) in rows {
            let refused = check(&file, &PRESENT.replacen(from, to, 1)).expect_err(words);
            assert!(refused.to_string().contains(words), "{words}: {refused}");
        }
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
