//! Search of folders for the files that `check` reads, and recognition of their kinds. Nothing is passed over without
//! being named or counted.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use rcc_config::FileKind;
use serde::Serialize;

/// Kind of a checked file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CheckedKind {
    /// A net in YAML or JSON.
    Net,
    /// A net in DirectIONet.
    DirectIoNet,
    /// A library of fragments.
    Library,
    /// The configuration of a cell.
    Cell,
    /// The configuration of a robot.
    Robot,
    /// A task, or rules alone.
    Task,
}

impl CheckedKind {
    /// Recognises a file by its text; `None` for any other file.
    pub fn of((name, text): &(String, String)) -> Option<CheckedKind> {
        if rcc_directionet::looks_like(text) {
            return Some(CheckedKind::DirectIoNet);
        }
        match FileKind::of_text(text) {
            Some(FileKind::Net) => Some(CheckedKind::Net),
            Some(FileKind::Library) => Some(CheckedKind::Library),
            Some(FileKind::Cell) => Some(CheckedKind::Cell),
            Some(FileKind::Robot) => Some(CheckedKind::Robot),
            Some(FileKind::Task) => Some(CheckedKind::Task),
            // DirectIONet that is too broken to be recognised.
            None if name.ends_with(".net") || name.ends_with(".dio") => {
                Some(CheckedKind::DirectIoNet)
            }
            None => None,
        }
    }
}

/// Extensions of files that can be checked.
const ENDINGS: [&str; 5] = ["yaml", "yml", "json", "net", "dio"];
/// Greatest depth of the search, so that a link to a parent folder ends.
const DEPTH_MAX: usize = 16;

/// Files below a folder.
#[derive(Debug, Default)]
pub struct FoundFiles {
    /// Files that can be checked, sorted by name.
    pub files: Vec<String>,
    /// Number of other files by their endings; files without one are under an empty text.
    pub other_endings: BTreeMap<String, u64>,
    /// Folders that are nested too deeply, and entries that are neither a file nor a folder, with the reason.
    pub passed_over: Vec<(String, &'static str)>,
}

/// Lists the files below a folder.
///
/// # Errors
/// Returns the error from the system if a folder cannot be read.
pub fn find(folder: &Path) -> io::Result<FoundFiles> {
    let mut found = FoundFiles::default();
    search(folder, 0, &mut found)?;
    Ok(found)
}

fn search(folder: &Path, depth: usize, found: &mut FoundFiles) -> io::Result<()> {
    let entries: Result<Vec<_>, _> = std::fs::read_dir(folder)?.collect();
    let mut paths: Vec<PathBuf> = entries?.into_iter().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        let name = path.to_string_lossy().into_owned();
        if path.is_dir() {
            if depth < DEPTH_MAX {
                search(&path, depth + 1, found)?;
            } else {
                found.passed_over.push((name, "nested too deeply"));
            }
            continue;
        }
        if !path.is_file() {
            found.passed_over.push((name, "not a regular file"));
            continue;
        }
        let ending = path.extension().and_then(|ending| ending.to_str());
        let ending = ending.unwrap_or_default();
        if ENDINGS.contains(&ending.to_ascii_lowercase().as_str()) {
            found.files.push(name);
        } else {
            *found.other_endings.entry(ending.to_owned()).or_default() += 1;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(name: &str, text: &str) -> Option<CheckedKind> {
        CheckedKind::of(&(name.to_owned(), text.to_owned()))
    }

    #[test]
    fn every_kind_is_recognised_and_other_files_are_not() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
        let shipped = |name: &str| {
            let text = std::fs::read_to_string(folder.join(name)).unwrap_or_default();
            kind(name, &text)
        };
        assert_eq!(shipped("nets/line.yaml"), Some(CheckedKind::Net));
        assert_eq!(shipped("cells/demo.yaml"), Some(CheckedKind::Cell));
        assert_eq!(shipped("robots/iiwa7.yaml"), Some(CheckedKind::Robot));
        assert_eq!(kind("a", "library: a\n"), Some(CheckedKind::Library));
        assert_eq!(shipped("tasks/probe.yaml"), Some(CheckedKind::Task));
        assert_eq!(kind("a", "rules: []\n"), Some(CheckedKind::Task));
        let foreign = "{a=Core::BooleanValue(Value='true'),outTerminate=a.outValue}";
        assert_eq!(kind("a", foreign), Some(CheckedKind::DirectIoNet));
        let with_mark = format!("\u{feff}{foreign}");
        assert_eq!(kind("a", &with_mark), Some(CheckedKind::DirectIoNet));
        assert_eq!(kind("a.net", "{a="), Some(CheckedKind::DirectIoNet));
        assert_eq!(kind("package.json", "{\"name\": \"a\"}"), None);
    }

    #[test]
    fn a_folder_is_searched_in_order_and_every_file_is_listed_or_counted() {
        let folder = rcc_testing::folder();
        let root = folder.path();
        std::fs::create_dir_all(root.join("deep/er")).expect("a folder");
        for name in ["b.yaml", "a.JSON", "deep/er/c.net", "notes.md", "Makefile"] {
            std::fs::write(root.join(name), "").expect("a file");
        }
        std::os::unix::fs::symlink("/dev/null", root.join("device.yaml")).expect("a link");
        let found = find(root).expect("the folder");
        let shown = |name: &str| root.join(name).to_string_lossy().into_owned();
        assert_eq!(
            found.files,
            ["a.JSON", "b.yaml", "deep/er/c.net"].map(shown)
        );
        assert_eq!(
            found.other_endings,
            BTreeMap::from([(String::new(), 1), ("md".to_owned(), 1)])
        );
        assert_eq!(
            found.passed_over,
            [(shown("device.yaml"), "not a regular file")]
        );
    }
}
