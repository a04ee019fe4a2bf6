//! Cache file for measured costs, so that a restarted executor need not measure again: one file per build, catalogue
//! and processor model. Never run by the real-time thread.
//!
//! The folder is `$RCC_CACHE_DIR`, else `$CACHE_DIRECTORY` (systemd), else `/var/cache/rcc` for root, else
//! `$XDG_CACHE_HOME/rcc`, else `~/.cache/rcc`.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use rcc_core::{fnv, primitives};
use rcc_os::file::{self, Readers};

use super::Costs;

/// Greatest length of a file that is read, bytes; real ones have a few kilobytes.
const BYTES_MAX: u64 = 1 << 20;
/// Number of files that are kept; the oldest are deleted.
const FILES_MAX: usize = 8;
const PREFIX: &str = "costs-";

/// Where costs come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CostsSource {
    /// Read from this file.
    Read(PathBuf),
    /// Measured and written to this file.
    Measured(PathBuf),
    /// Measured, but not written, for this reason.
    NotKept(String),
}

/// Returns the costs of this machine: from the cache file if it is valid and `refresh` is false, else measured and
/// written.
#[must_use]
pub fn costs(refresh: bool) -> (Costs, CostsSource) {
    let Some(folder) = folder() else {
        let why = "no cache folder: set RCC_CACHE_DIR".to_owned();
        return (Costs::measure(), CostsSource::NotKept(why));
    };
    costs_in(&folder, refresh)
}

/// As [`costs`], with another folder.
#[must_use]
pub fn costs_in(folder: &Path, refresh: bool) -> (Costs, CostsSource) {
    let key = key();
    let path = folder.join(format!("{PREFIX}{:016x}", hash(&key)));
    let kept = file::read_text(&path, BYTES_MAX).ok();
    if let Some(costs) = kept.filter(|_| !refresh).and_then(|text| read(&text, &key)) {
        return (costs, CostsSource::Read(path));
    }
    let costs = Costs::measure();
    match write(folder, &path, &key, &costs) {
        Ok(()) => (costs, CostsSource::Measured(path)),
        Err(error) => (
            costs,
            CostsSource::NotKept(format!("{}: {error}", path.display())),
        ),
    }
}

/// Everything that the costs depend on, in one line.
fn key() -> String {
    let build = env!("RCC_BUILD");
    format!(
        "rcc-costs 1 {build} {:016x} {}",
        primitives::fingerprint(),
        processor()
    )
}

/// Processor model as reported by the kernel.
fn processor() -> String {
    let all = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = all.lines().find(|line| line.starts_with("model name"));
    let model = model.and_then(|line| line.split_once(':')).map(|row| row.1);
    model.unwrap_or_default().trim().to_owned()
}

/// A file consists of its key, the costs, and a line with the hash of both.
fn read(text: &str, key: &str) -> Option<Costs> {
    let (body, end) = text.trim_end().rsplit_once('\n')?;
    let body = format!("{body}\n");
    let whole = end == format!("end {:016x}", hash(&body));
    let costs = body.strip_prefix(key)?.strip_prefix('\n')?;
    if whole { Costs::parse(costs) } else { None }
}

fn write(folder: &Path, path: &Path, key: &str, costs: &Costs) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let body = format!("{key}\n{}", costs.text());
    let text = format!("{body}end {:016x}\n", hash(&body));
    file::replace_shared(path, text.as_bytes(), Readers::Owner)?;
    forget_oldest(folder, path)
}

/// Deletes the oldest files, which belong to other builds, but not `newest`, which was just written. Files dated in the
/// future were written before the wall clock was set back: they count as the oldest.
fn forget_oldest(folder: &Path, newest: &Path) -> io::Result<()> {
    let now = SystemTime::now();
    let mut files: Vec<(bool, SystemTime, PathBuf)> = fs::read_dir(folder)?
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(PREFIX))
        .filter(|entry| entry.path() != newest)
        .filter_map(|entry| Some((entry.metadata().ok()?.modified().ok()?, entry.path())))
        .map(|(date, path)| (date <= now, date, path))
        .collect();
    files.sort();
    let surplus = files.len().saturating_sub(FILES_MAX - 1);
    files
        .iter()
        .take(surplus)
        .try_for_each(|(.., path)| fs::remove_file(path))
}

fn folder() -> Option<PathBuf> {
    let variable = |name| {
        let value = std::env::var_os(name).filter(|value| !value.is_empty());
        value.map(PathBuf::from).filter(|path| path.is_absolute())
    };
    let root = || {
        let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
        let uid = status.lines().find_map(|line| line.strip_prefix("Uid:"));
        let root = uid.and_then(|ids| ids.split_whitespace().nth(1)) == Some("0");
        root.then(|| PathBuf::from("/var/cache/rcc"))
    };
    variable("RCC_CACHE_DIR")
        .or_else(|| variable("CACHE_DIRECTORY"))
        .or_else(root)
        .or_else(|| Some(variable("XDG_CACHE_HOME")?.join("rcc")))
        .or_else(|| Some(variable("HOME")?.join(".cache/rcc")))
}

fn hash(text: &str) -> u64 {
    fnv::add(fnv::EMPTY, text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(origin: &CostsSource) -> PathBuf {
        match origin {
            CostsSource::Read(path) | CostsSource::Measured(path) => path.clone(),
            CostsSource::NotKept(why) => panic!("{why}"),
        }
    }

    #[test]
    fn costs_are_measured_once_and_again_when_the_file_is_damaged() {
        let temporary = rcc_testing::folder();
        let folder = &temporary.path().join("new");
        let (measured, origin) = costs_in(folder, false);
        assert!(matches!(origin, CostsSource::Measured(_)), "{origin:?}");
        let path = file(&origin);
        let (read, origin) = costs_in(folder, false);
        assert_eq!((read, origin), (measured, CostsSource::Read(path.clone())));
        let good = fs::read_to_string(&path).unwrap();
        let (half, digit) = (&good[..good.len() / 2], good.replacen("net ", "net 9", 1));
        for bad in [
            half,
            "",
            &digit,
            &good.replacen("rcc-costs 1", "rcc-costs 2", 1),
        ] {
            fs::write(&path, bad).unwrap();
            let (_, origin) = costs_in(folder, false);
            assert!(matches!(origin, CostsSource::Measured(_)), "{origin:?}");
        }
        let (_, origin) = costs_in(folder, true);
        assert!(matches!(origin, CostsSource::Measured(_)), "refreshed");
        assert_eq!(
            fs::read_dir(folder).unwrap().count(),
            1,
            "one file, no leftovers"
        );
    }

    #[test]
    fn a_folder_that_cannot_be_written_costs_only_time() {
        let (_, origin) = costs_in(Path::new("/proc/rcc"), false);
        assert!(matches!(origin, CostsSource::NotKept(_)), "{origin:?}");
    }

    #[test]
    fn only_the_newest_files_are_kept() {
        let folder = rcc_testing::folder();
        for number in 0..FILES_MAX + 3 {
            fs::write(folder.path().join(format!("{PREFIX}{number:016x}")), "old").unwrap();
        }
        let (_, origin) = costs_in(folder.path(), false);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), FILES_MAX);
        assert!(file(&origin).exists());
    }

    #[test]
    fn the_file_just_written_stays_after_the_clock_was_set_back() {
        let folder = rcc_testing::folder();
        let future = SystemTime::now() + std::time::Duration::from_secs(9000);
        let old = folder.path().join(format!("{PREFIX}old"));
        fs::write(&old, "old").unwrap();
        for number in 0..FILES_MAX {
            let path = folder.path().join(format!("{PREFIX}{number:016x}"));
            let other = fs::File::create(&path).unwrap();
            other.set_modified(future).unwrap();
        }
        let (_, origin) = costs_in(folder.path(), false);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), FILES_MAX);
        assert!(file(&origin).exists() && old.exists());
        let (_, again) = costs_in(folder.path(), false);
        assert!(matches!(again, CostsSource::Read(_)), "{again:?}");
    }
}
