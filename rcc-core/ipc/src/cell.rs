//! A cell by name: its runtime folder, its shared-memory prefix and the paths of its files. Runs on any thread that is
//! not real-time; creates only folders, with mode 0700.

use std::fs::{self, DirBuilder};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

pub use crate::base_folder::base_dir;
use crate::cell_error::SOCKET_PATH_MAX;
pub use crate::cell_error::{CellError, person};
use crate::prefix;
use crate::shm_space::SHM;
use crate::state_folder::{self, StateFolder};

/// Maximum length of a cell name, characters.
const NAME_LENGTH_MAX: usize = 32;
/// Number of attempts to create a folder that another process keeps removing.
const REMOVALS_MAX: u32 = 100;
/// Prefix of the name of a simulator's socket.
const SIMULATOR: &str = "sim-";
/// Suffix of a socket's name.
const SOCKET: &str = ".sock";
/// State folder of a cell in a folder of its own.
const OWN_STATE: &str = "state";

/// One running instance of the whole system. Everything that it shares is in its runtime folder, or in `/dev/shm` under
/// its prefix; what is kept of it afterwards is in its state folder. Two cells never share a file, even if they belong to
/// different users; only cells of one user and one name in different runtime folders share a state folder, unless
/// `$RCC_STATE_DIR` separates them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cell {
    name: String,
    runtime_dir: PathBuf,
    /// State folder, or the folder with the link to it.
    state_anchor: PathBuf,
    prefix: String,
}

impl Cell {
    /// Returns the cell `name` below the default base folder: `$RCC_RUNTIME_DIR`, else `/run/rcc` for root, else
    /// `$XDG_RUNTIME_DIR/rcc`, else `/tmp/rcc-<uid>`. Creates the folders.
    ///
    /// # Errors
    /// Returns an error if the name is invalid, if a folder cannot be created or is not ours, or if the path is too
    /// long for a socket.
    pub fn new(name: &str) -> Result<Cell, CellError> {
        check_name(name)?;
        let base = base_dir();
        unless_removed(|| make_private_dir(&base))?;
        Cell::make(name, &base.join(name), Some(state_folder::anchor(name)))
    }

    /// Returns the cell `name` below the default base folder, or `None` if its folder does not exist. Creates nothing
    /// in that case.
    ///
    /// # Errors
    /// As [`Cell::new`].
    pub fn find(name: &str) -> Result<Option<Cell>, CellError> {
        check_name(name)?;
        let runtime_dir = base_dir().join(name);
        if !runtime_dir.is_dir() {
            return Ok(None);
        }
        Cell::make(name, &runtime_dir, Some(state_folder::anchor(name))).map(Some)
    }

    /// Returns the cell `name` in exactly this folder (tests give each cell its own), with its state folder in it.
    /// Creates the folder and its parents.
    ///
    /// # Errors
    /// As [`Cell::new`].
    pub fn at(name: &str, runtime_dir: &Path) -> Result<Cell, CellError> {
        Cell::make(name, runtime_dir, None)
    }

    /// Returns the cell `name` in exactly these folders; its state folder is `state`, or where a link in it leads.
    /// Creates the runtime folder and its parents.
    ///
    /// # Errors
    /// As [`Cell::new`].
    pub fn in_folders(name: &str, runtime_dir: &Path, state: PathBuf) -> Result<Cell, CellError> {
        Cell::make(name, runtime_dir, Some(state))
    }

    /// Without `state` the state folder is in the runtime folder.
    fn make(name: &str, runtime_dir: &Path, state: Option<PathBuf>) -> Result<Cell, CellError> {
        check_name(name)?;
        let runtime_dir = unless_removed(|| {
            make_private_dir(runtime_dir)?;
            fs::canonicalize(runtime_dir).map_err(|source| CellError::Folder {
                path: runtime_dir.to_owned(),
                source,
            })
        })?;
        let mut cell = Cell {
            name: name.to_owned(),
            state_anchor: state.unwrap_or_else(|| runtime_dir.join(OWN_STATE)),
            runtime_dir,
            prefix: String::new(),
        };
        check_socket_path(&cell.socket())?;
        unless_removed(|| cell.make_folders())?;
        let (file, lock) = (cell.prefix_file(), cell.lock_file());
        cell.prefix = prefix::of(uid(), &cell.runtime_dir, &file, &lock)?;
        Ok(cell)
    }

    /// Returns the name of the cell.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the runtime folder, absolute and without symbolic links.
    #[must_use]
    pub fn runtime_dir(&self) -> &Path {
        &self.runtime_dir
    }

    /// Returns the prefix of all its files in `/dev/shm`: `rcc_` + 10 hexadecimal digits + `_`.
    #[must_use]
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Returns the path of the loader's control socket.
    #[must_use]
    pub fn socket(&self) -> PathBuf {
        self.runtime_dir.join("loader.sock")
    }

    /// Returns the path of the control socket of a simulator of the cell.
    #[must_use]
    pub fn simulator_socket(&self, simulator: &str) -> PathBuf {
        simulator_socket(&self.runtime_dir, simulator)
    }

    /// Returns the folder with one announcement file per process.
    #[must_use]
    pub fn processes_dir(&self) -> PathBuf {
        self.runtime_dir.join("processes")
    }

    /// Returns the folder in which the loader stores the names and texts of the commands.
    #[must_use]
    pub fn commands_dir(&self) -> PathBuf {
        self.runtime_dir.join("commands")
    }

    /// Returns the folder for sockets and other files of `rcc-cli up` that are removed with the cell.
    #[must_use]
    pub fn supervisor_dir(&self) -> PathBuf {
        self.runtime_dir.join("up")
    }

    /// Returns the folder of everything that is kept of the cell. [`Cell::make_state`] creates it.
    #[must_use]
    pub fn state(&self) -> StateFolder {
        StateFolder::at(&self.state_anchor)
    }

    /// Returns the path by which [`Cell::in_folders`] finds the same state folder.
    #[must_use]
    pub fn state_anchor(&self) -> &Path {
        &self.state_anchor
    }

    /// Creates the state folder, below `folder` if the cell's configuration names one (`recorder: {folder: …}`), and
    /// leaves a link by which programs find it that do not read the configuration.
    ///
    /// # Errors
    /// Returns an error if it cannot be created, belongs to another user, or can be written by others.
    pub fn make_state(&self, folder: Option<&Path>) -> Result<(), CellError> {
        state_folder::create(&self.state_anchor, &self.name, folder)
    }

    /// Returns the folder with the connection diagnosis of each driver, one JSON file per device; see `rcc-cli doctor
    /// device`.
    #[must_use]
    pub fn drivers_dir(&self) -> PathBuf {
        self.runtime_dir.join("drivers")
    }

    /// Returns the folder for the files that iceoryx2 does not map, and for long requests. It is next to the shared
    /// memory because iceoryx2 calls fsync on its files: on a busy disk one such call took up to 13.5 s.
    #[must_use]
    pub fn iox_root(&self) -> PathBuf {
        Path::new(SHM).join(format!("{}iox", self.prefix))
    }

    /// Returns the path of the file with a number that no id of a command, rule or lease has reached.
    #[must_use]
    pub fn next_id_file(&self) -> PathBuf {
        self.runtime_dir.join("next-id")
    }

    /// Returns the path of the copy of the configuration that this cell was started with.
    #[must_use]
    pub fn config_copy(&self) -> PathBuf {
        self.runtime_dir.join("cell.yaml")
    }

    /// Returns the path of the file that stores the prefix, if it is not the default one.
    pub(crate) fn prefix_file(&self) -> PathBuf {
        self.runtime_dir.join("prefix")
    }

    /// Checks that the prefix is still the one found when the cell was looked up. Call it while holding the lock of the
    /// cell.
    pub(crate) fn require_same_prefix(&self) -> Result<(), CellError> {
        match prefix::current(uid(), &self.runtime_dir, &self.prefix_file())? {
            now if now == self.prefix => Ok(()),
            _ => Err(CellError::MadeAnew {
                cell: self.name.clone(),
            }),
        }
    }

    /// Every process in the cell holds this lock shared; a process that wipes the cell holds it exclusively.
    pub(crate) fn lock_file(&self) -> PathBuf {
        self.runtime_dir.join("cell.lock")
    }

    /// Held by the janitor while it works.
    pub(crate) fn janitor_lock_file(&self) -> PathBuf {
        self.runtime_dir.join("janitor.lock")
    }

    /// Returns the parent of the runtime folder if it is the default base folder and was not chosen with
    /// `$RCC_RUNTIME_DIR`.
    pub(crate) fn own_base(&self) -> Option<PathBuf> {
        let chosen = std::env::var_os("RCC_RUNTIME_DIR").is_some_and(|value| !value.is_empty());
        let above = self.runtime_dir.parent().map(Path::to_owned);
        above.filter(|above| !chosen && *above == base_dir())
    }

    /// Gives the members of `group` access to the cell's socket: the runtime folder gets that group and mode 0750
    /// (without a group 0700, owner only). With a group the default base folder becomes passable (0711); permissions
    /// are then decided below it.
    ///
    /// # Errors
    /// Returns an error if the folder cannot be given to the group: this process is neither root nor a member.
    pub fn open_to_group(&self, group: Option<u32>) -> Result<(), CellError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |source| CellError::Folder { path, source }
        };
        let folder = &self.runtime_dir;
        let set = |path: &Path, mode| fs::set_permissions(path, fs::Permissions::from_mode(mode));
        if let Some(group) = group {
            std::os::unix::fs::chown(folder, None, Some(group)).map_err(failed(folder))?;
            set(folder, 0o750).map_err(failed(folder))?;
            if let Some(base) = self.own_base() {
                set(&base, 0o711).map_err(failed(&base))?;
            }
        } else {
            set(folder, 0o700).map_err(failed(folder))?;
        }
        Ok(())
    }

    /// Creates the folders of [`Cell::at`] again: a wipe may have removed them since.
    pub(crate) fn make_folders(&self) -> Result<(), CellError> {
        let own = self.state_anchor.starts_with(&self.runtime_dir);
        let state = own.then(|| self.state_anchor.clone());
        let folders = [
            self.runtime_dir.clone(),
            self.processes_dir(),
            self.commands_dir(),
            self.drivers_dir(),
        ];
        for path in folders.into_iter().chain(state) {
            unless_removed(|| make_private_dir(&path))?;
        }
        Ok(())
    }

    /// Creates iceoryx2's folder. Its parent is world-writable, so the owner is checked.
    pub(crate) fn make_iox_root(&self) -> Result<(), CellError> {
        make_private_dir(&self.iox_root())
    }
}

fn uid() -> u32 {
    nix::unistd::getuid().as_raw()
}

fn check_name(name: &str) -> Result<(), CellError> {
    if is_name(name) {
        Ok(())
    } else {
        Err(CellError::BadName {
            name: name.to_owned(),
        })
    }
}

/// Returns the path of the control socket of a simulator, in the runtime folder of its cell.
#[must_use]
pub fn simulator_socket(runtime_dir: &Path, simulator: &str) -> PathBuf {
    runtime_dir.join(format!("{SIMULATOR}{simulator}{SOCKET}"))
}

/// Returns whether a file name in a runtime folder is that of a simulator's control socket.
pub(crate) fn is_simulator_socket(name: &str) -> bool {
    name.starts_with(SIMULATOR) && name.ends_with(SOCKET)
}

/// Refuses a socket path that the system would refuse, and names the remedy.
///
/// # Errors
/// Returns an error if the path is too long.
pub fn check_socket_path(path: &Path) -> Result<(), CellError> {
    let size = path.as_os_str().len();
    if size > SOCKET_PATH_MAX {
        let path = path.to_owned();
        return Err(CellError::PathTooLong { path, size });
    }
    Ok(())
}

/// `[a-z0-9][a-z0-9_-]{0,31}`
fn is_name(name: &str) -> bool {
    name.len() <= NAME_LENGTH_MAX
        && name
            .bytes()
            .all(|b| matches!(b, b'a'..=b'z' | b'0'..=b'9' | b'_' | b'-'))
        && name.starts_with(|first: char| first.is_ascii_alphanumeric())
}

/// Retries `act` while a folder disappears during it: a cell that ends removes its folder while the next one of the
/// same name is created.
fn unless_removed<T>(mut act: impl FnMut() -> Result<T, CellError>) -> Result<T, CellError> {
    for _ in 0..REMOVALS_MAX {
        match act() {
            Err(error) if error.is_passing() => {}
            result => return result,
        }
    }
    act()
}

/// Creates the folder if it is missing (mode 0700), and checks that no other user can have prepared it or can write to
/// it. A folder that others may only read stays as it is, because the cell's configuration may ask for that.
fn make_private_dir(path: &Path) -> Result<(), CellError> {
    let failed = |source| CellError::Folder {
        path: path.to_owned(),
        source,
    };
    let uid = nix::unistd::getuid().as_raw();
    let not_ours = |owner| CellError::NotOurs {
        path: path.to_owned(),
        owner,
        uid,
    };
    // A symbolic link of another user could lead anywhere. Check this first, since the kernel may refuse to follow it.
    if let Ok(named) = fs::symlink_metadata(path)
        && named.is_symlink()
        && named.uid() != uid
        && named.uid() != 0
    {
        return Err(not_ours(named.uid()));
    }
    DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(path)
        .map_err(failed)?;
    let found = fs::metadata(path).map_err(failed)?;
    if found.uid() != uid {
        return Err(not_ours(found.uid()));
    }
    if found.mode() & 0o022 != 0 {
        return Err(CellError::Writable {
            path: path.to_owned(),
            mode: found.mode() & 0o7777,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io;

    #[test]
    fn names_are_short_lower_case_words() {
        for good in ["a", "0", "demo", "cell-2_b", &"x".repeat(32)] {
            assert!(is_name(good), "{good}");
        }
        for bad in [
            "",
            "-a",
            "_a",
            "A",
            "a b",
            "a/b",
            "..",
            "ä",
            &"x".repeat(33),
        ] {
            assert!(
                matches!(Cell::new(bad), Err(CellError::BadName { .. })),
                "{bad}"
            );
        }
    }

    #[test]
    fn a_folder_too_deep_for_a_socket_is_refused() {
        let base = rcc_testing::folder();
        let refused = Cell::at("demo", &base.path().join("d".repeat(120)));
        assert!(matches!(refused, Err(CellError::PathTooLong { size, .. }) if size > 107));
    }

    #[test]
    fn a_folder_that_others_may_write_to_is_refused_with_the_remedy() -> io::Result<()> {
        let folder = rcc_testing::folder();
        let base = folder.path().join("cell");
        for (mode, refuse) in [
            (0o770, true),
            (0o1777, true),
            (0o750, false),
            (0o700, false),
        ] {
            DirBuilder::new().create(&base)?;
            fs::set_permissions(&base, fs::Permissions::from_mode(mode))?;
            let result = Cell::at("demo", &base);
            let still = fs::metadata(&base)?.mode() & 0o7777;
            fs::remove_dir_all(&base)?;
            assert_eq!(still, mode, "the mode is not changed");
            match result {
                Err(error @ CellError::Writable { .. }) if refuse => {
                    assert!(error.to_string().contains("chmod go-w"), "{error}");
                }
                other => assert!(!refuse && other.is_ok(), "{mode:o}: {other:?}"),
            }
        }
        Ok(())
    }

    #[test]
    fn a_folder_of_somebody_else_is_refused() {
        if nix::unistd::getuid().is_root() {
            let folder = rcc_testing::folder();
            let base = folder.path().join("cell");
            let link = base.with_extension("link");
            let made = DirBuilder::new().mode(0o700).create(&base);
            let nobody = Some(nix::unistd::Uid::from_raw(65534));
            let linked = std::os::unix::fs::symlink(&base, &link);
            let own_link = Cell::at("demo", &link);
            let given = std::os::unix::fs::lchown(&link, Some(65534), None);
            let foreign_link = Cell::at("demo", &link);
            let given = given.and(nix::unistd::chown(&base, nobody, None).map_err(Into::into));
            let foreign = Cell::at("demo", &base);
            assert!(made.and(linked).and(given).is_ok());
            assert!(own_link.is_ok());
            for refused in [foreign_link, foreign] {
                assert!(matches!(
                    refused,
                    Err(CellError::NotOurs { owner: 65534, .. })
                ));
            }
        } else {
            // An ordinary user cannot give folders away, but can try a folder of root.
            let refused = Cell::at("demo", Path::new("/usr"));
            assert!(matches!(refused, Err(CellError::NotOurs { owner: 0, .. })));
        }
    }
}
