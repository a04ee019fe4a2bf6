//! Files of the system below a root folder, so that tests can read facts from a fixture. Run by the main thread; a
//! missing or unreadable file yields no fact.

use std::fs;
use std::path::{Path, PathBuf};

/// A root file system; usually `/`.
#[derive(Clone, Debug)]
pub struct SystemRoot {
    root: PathBuf,
}

impl SystemRoot {
    /// Uses this folder as `/`.
    #[must_use]
    pub fn at(root: &Path) -> SystemRoot {
        SystemRoot {
            root: root.to_owned(),
        }
    }

    /// Returns the full path of `path`, which has no leading slash.
    #[must_use]
    pub fn path(&self, path: &str) -> PathBuf {
        self.root.join(path.trim_start_matches('/'))
    }

    /// Reads a file as text, without surrounding white space.
    #[must_use]
    pub fn text(&self, path: &str) -> Option<String> {
        let bytes = fs::read(self.path(path)).ok()?;
        Some(String::from_utf8_lossy(&bytes).trim().to_owned())
    }

    /// Reads a file that contains a single number.
    #[must_use]
    pub fn number(&self, path: &str) -> Option<i64> {
        self.text(path)?.parse().ok()
    }

    /// Returns true if the path exists.
    #[must_use]
    pub fn has(&self, path: &str) -> bool {
        self.path(path).exists()
    }

    /// Returns the names in a folder, sorted.
    #[must_use]
    pub fn names(&self, path: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path(path))
            .into_iter()
            .flatten()
            .flatten();
        let mut names: Vec<String> = entries
            .filter_map(|entry| entry.file_name().into_string().ok())
            .collect();
        names.sort();
        names
    }

    /// Returns the first value of `key` in a file with lines `key: value` or `key = value`.
    #[must_use]
    pub fn value(&self, path: &str, key: &str) -> Option<String> {
        let text = self.text(path)?;
        value_in(&text, key).map(str::to_owned)
    }
}

/// Returns the first value of `key` among lines `key: value` or `key = value`.
#[must_use]
pub fn value_in<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.lines().find_map(|line| {
        let (name, value) = line.split_once([':', '='])?;
        (name.trim() == key).then(|| value.trim())
    })
}

/// Parses a list of cores such as `0-2,5`.
#[must_use]
pub fn list(text: &str) -> Vec<usize> {
    let mut all = Vec::new();
    for part in text.trim().split(',') {
        match part.split_once('-') {
            Some((first, last)) => {
                if let (Ok(first), Ok(last)) = (first.parse::<usize>(), last.parse::<usize>()) {
                    all.extend(first..=last.min(first.saturating_add(4096)));
                }
            }
            None => all.extend(part.parse::<usize>()),
        }
    }
    all
}

#[cfg(test)]
pub(crate) mod tests {
    use rcc_testing::TempDir;

    use super::*;

    /// A root folder with these files; removed at the end.
    pub(crate) struct FixtureRoot(TempDir);

    impl FixtureRoot {
        pub(crate) fn new(files: &[(&str, &str)]) -> FixtureRoot {
            let root = rcc_testing::folder();
            for (path, text) in files {
                let path = root.path().join(path);
                fs::create_dir_all(path.parent().expect("a file is in a folder"))
                    .expect("a folder");
                fs::write(path, text).expect("a file");
            }
            FixtureRoot(root)
        }

        pub(crate) fn system(&self) -> SystemRoot {
            SystemRoot::at(self.0.path())
        }
    }

    #[test]
    fn lists_of_cores_are_read() {
        assert_eq!(list("0-2,5\n"), [0, 1, 2, 5]);
        assert_eq!(list(""), [] as [usize; 0]);
        assert_eq!(list("(null)"), [] as [usize; 0]);
    }

    #[test]
    fn values_are_found_by_their_key() {
        let recorded = FixtureRoot::new(&[("proc/x", "Uid:\t1000\t1000\nCapEff:\t00ff\n")]);
        let system = recorded.system();
        assert_eq!(system.value("proc/x", "CapEff").as_deref(), Some("00ff"));
        assert_eq!(system.value("proc/x", "Gid"), None);
        assert_eq!(system.text("proc/nothing"), None);
    }
}
