//! Writes and removes unit files; never changes a file without RCC's mark. Used by the main thread of `install-units`.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use rcc_api::codes;
use rcc_os::file::{self, Readers};

use super::{DROP_IN, MARK, PACKAGED, SHIPPED, UNITS, UnitFile};
use crate::failure::Failure;

/// File that a package has at the very place to which `install-units` writes: PAM reads it from there only.
const SHARED: &str = "etc/security/limits.d/rcc.conf";

/// Longest unit file that is read, bytes.
const UNIT_MAX: u64 = 1 << 20;

/// Change of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FileChange {
    /// It did not exist.
    Written,
    /// It had another content.
    Replaced,
    /// It had this content already.
    Unchanged,
    /// A package provides it.
    Packaged,
    /// It was removed.
    Removed,
}

/// Determines the change of each file and, unless `dry`, applies it. Nothing is written if one of them is not RCC's.
///
/// # Errors
/// Fails if a file was not written by RCC, or if the system refuses.
pub fn write(
    root: &Path,
    files: &[UnitFile],
    dry: bool,
) -> Result<Vec<(FileChange, PathBuf)>, Failure> {
    let plan: Result<Vec<_>, Failure> = files
        .iter()
        .map(|file| Ok((judge(root, file)?, file)))
        .collect();
    let plan = plan?;
    for (done, file) in &plan {
        if !dry && matches!(done, FileChange::Written | FileChange::Replaced) {
            store(&root.join(&file.path), &file.text)?;
        }
    }
    let entry = |(done, file): &(FileChange, &UnitFile)| (*done, root.join(&file.path));
    Ok(plan.iter().map(entry).collect())
}

fn judge(root: &Path, file: &UnitFile) -> Result<FileChange, Failure> {
    let path = root.join(&file.path);
    let packaged = file.path.strip_prefix(UNITS).ok();
    if packaged.is_some_and(|unit| root.join(PACKAGED).join(unit).exists())
        || is_of_package(root, &file.path)
    {
        return Ok(FileChange::Packaged);
    }
    match read(&path)? {
        None => Ok(FileChange::Written),
        Some(text) if text == file.text => Ok(FileChange::Unchanged),
        Some(text) if text.starts_with(MARK) => Ok(FileChange::Replaced),
        Some(_) => Err(Failure::new(
            codes::CELL_LIVES,
            format!(
                "{} exists and was not written by RCC; nothing was changed",
                path.display()
            ),
            "move it away, or add your own drop-in beside it",
        )),
    }
}

/// Returns true if this very file is one of a package, which is known by its units.
fn is_of_package(root: &Path, path: &Path) -> bool {
    path == Path::new(SHARED) && root.join(PACKAGED).join("rcc.target").exists()
}

/// Removes the drop-ins of a cell; with the last cell, all of RCC's files but those of a package.
///
/// # Errors
/// Fails if the system refuses.
pub fn remove(root: &Path, cell: &str, dry: bool) -> Result<Vec<(FileChange, PathBuf)>, Failure> {
    let (own, others) = drop_ins(root, cell)?;
    let mut paths = own;
    if others == 0 {
        let shipped = SHIPPED.iter().map(|(path, _)| Path::new(path));
        let own = shipped.filter(|path| !is_of_package(root, path));
        paths.extend(own.map(|path| root.join(path)));
    }
    let mut removed = Vec::new();
    for path in paths {
        if !read(&path)?.is_some_and(|text| text.starts_with(MARK)) {
            continue;
        }
        if !dry {
            fs::remove_file(&path).map_err(|error| refused(&path, &error))?;
            if let Some(folder) = path.parent().filter(|folder| is_drop_in_folder(folder)) {
                // Fails if the folder holds other drop-ins, and keeps them.
                let _ = fs::remove_dir(folder);
            }
        }
        removed.push((FileChange::Removed, path));
    }
    Ok(removed)
}

fn is_drop_in_folder(folder: &Path) -> bool {
    folder.extension().is_some_and(|extension| extension == "d")
        && folder.to_string_lossy().contains("systemd/system")
}

/// Returns the drop-ins of this cell, and the number of drop-ins of other cells.
fn drop_ins(root: &Path, cell: &str) -> Result<(Vec<PathBuf>, usize), Failure> {
    let units = root.join(UNITS);
    let entries = match fs::read_dir(&units) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok((Vec::new(), 0)),
        Err(error) => return Err(refused(&units, &error)),
    };
    let (mut own, mut others) = (Vec::new(), 0);
    let setup = units
        .join("rcc-rt-setup.service.d")
        .join(format!("50-cell-{cell}.conf"));
    own.push(setup);
    for entry in entries.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = entry.path().join(DROP_IN);
        let Some((kind, instance)) = name.split_once('@') else {
            continue;
        };
        if !kind.starts_with("rcc") || !path.is_file() {
            continue;
        }
        // CELL.target.d, CELL.service.d or CELL.DEVICE.service.d; cell names contain no dot.
        let of = instance.split('.').next().unwrap_or_default();
        if of == cell {
            own.push(path);
        } else {
            others += 1;
        }
    }
    own.sort();
    Ok((own, others))
}

fn read(path: &Path) -> Result<Option<String>, Failure> {
    match file::read_text(path, UNIT_MAX) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(refused(path, &error)),
    }
}

fn store(path: &Path, text: &str) -> Result<(), Failure> {
    let folder = path.parent().unwrap_or(Path::new("/"));
    fs::create_dir_all(folder).map_err(|error| refused(folder, &error))?;
    file::replace(path, text.as_bytes(), Readers::Anybody).map_err(|error| refused(path, &error))
}

fn refused(path: &Path, error: &io::Error) -> Failure {
    let (code, help) = match error.kind() {
        io::ErrorKind::PermissionDenied => (
            codes::NOT_PERMITTED,
            "run with sudo, or write below another folder with --root DIR",
        ),
        _ => (codes::NOT_STORED, ""),
    };
    Failure::new(code, format!("{}: {error}", path.display()), help)
}

/// Removes drop-ins of this cell that are not among `files`: those of removed devices.
///
/// # Errors
/// Fails if the system refuses.
pub fn remove_stale(
    root: &Path,
    cell: &str,
    files: &[UnitFile],
    dry: bool,
) -> Result<Vec<(FileChange, PathBuf)>, Failure> {
    let (own, _) = drop_ins(root, cell)?;
    let known: Vec<PathBuf> = files.iter().map(|file| root.join(&file.path)).collect();
    let mut removed = Vec::new();
    for path in own
        .into_iter()
        .filter(|path| !known.contains(path) && path.is_file())
    {
        if !dry {
            fs::remove_file(&path).map_err(|error| refused(&path, &error))?;
            if let Some(folder) = path.parent() {
                // Fails if the folder holds other drop-ins, and keeps them.
                let _ = fs::remove_dir(folder);
            }
        }
        removed.push((FileChange::Removed, path));
    }
    Ok(removed)
}
