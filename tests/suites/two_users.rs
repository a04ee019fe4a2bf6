//! The cell of another user: a client is told whose it is, and can do nothing in it; with `access: {group: …}` a member of
//! the group can. Needs root, to run clients as `nobody`; otherwise the tests say that they are skipped. Run by the threads
//! of the test harness.

use std::fs;
use std::os::unix::fs::{PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use nix::unistd::{Group, Uid, User};
use rcc_tests::{TestCell, nets, program};

/// A user without rights, with a copy of `rcc-cli`, because folders of the build may be closed to it.
struct OtherUser {
    uid: u32,
    gid: u32,
    folder: PathBuf,
}

impl OtherUser {
    /// Returns `None`, with the name of the test and the reason, if clients cannot run as another user.
    fn find(test: &str) -> Option<OtherUser> {
        let nobody = User::from_name("nobody").ok().flatten();
        let (Some(nobody), true) = (nobody, Uid::effective().is_root()) else {
            eprintln!("skipped: needs root and the user nobody ({test})");
            return None;
        };
        let folder = std::env::temp_dir().join(format!("rcc-{test}-{}", std::process::id()));
        let own = folder.join("run");
        fs::create_dir_all(&own).expect("a folder");
        fs::set_permissions(&folder, fs::Permissions::from_mode(0o755)).expect("ours");
        fs::copy(program("rcc-cli"), folder.join("rcc-cli")).expect("copied");
        let (uid, gid) = (nobody.uid.as_raw(), nobody.gid.as_raw());
        chown(&own, Some(uid), Some(gid)).expect("we are root");
        Some(OtherUser { uid, gid, folder })
    }

    /// Runs `rcc-cli` as this user, with this folder for cells.
    fn cli(&self, runtime: &Path, arguments: &[&str]) -> Output {
        let mut command = Command::new(self.folder.join("rcc-cli"));
        command
            .current_dir("/")
            .env_clear()
            .env("RCC_RUNTIME_DIR", runtime)
            .env("RCC_STATE_DIR", self.folder.join("run/state"))
            .args(["--cell", "test"])
            .args(arguments)
            .stdin(Stdio::null())
            .uid(self.uid)
            .gid(self.gid);
        command.output().expect("rcc-cli runs")
    }
}

impl Drop for OtherUser {
    fn drop(&mut self) {
        // Only this test uses the folder; a leftover is harmless.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

fn words(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Lets others pass the folder of the test, which is private; the cell's folder in it stays as it is.
fn open(cell: &TestCell) {
    let mode = fs::Permissions::from_mode(0o711);
    fs::set_permissions(cell.folder(), mode).expect("ours");
}

#[test]
fn the_cell_of_another_user_is_named_with_its_owner_and_nothing_is_done_in_it() {
    let Some(other) = OtherUser::find("the_cell_of_another_user") else {
        return;
    };
    let cell = TestCell::demo();
    open(&cell);
    let line = cell.run(&nets::line("line", 0.2, 0.02));
    // Its own folder has no such cell: the message finds it by its executor.
    let elsewhere = other.cli(&other.folder.join("run"), &["ls"]);
    assert_eq!(elsewhere.status.code(), Some(4), "{elsewhere:?}");
    let told = words(&elsewhere);
    assert!(
        told.contains("belongs to another user: test (") && told.contains("root"),
        "{told}"
    );
    assert!(told.contains("access: {group: …}"), "{told}");
    // The cell's folder is closed.
    for arguments in [
        &["ls"][..],
        &["cancel", "line"],
        &["abort", "line"],
        &["run", "/dev/null"],
        &["down"],
        &["events"],
    ] {
        let refused = other.cli(cell.folder(), arguments);
        let told = words(&refused);
        assert!(
            !refused.status.success() && told.contains("root"),
            "{arguments:?}: {refused:?}"
        );
    }
    assert_eq!(cell.state(line)["state"], "running");
    cell.done(line, "cancel");
    cell.assert_ends(line, "canceled");
    cell.stop();
}

#[test]
fn a_member_of_the_group_uses_the_cell_of_another_user() {
    let Some(other) = OtherUser::find("a_member_of_the_group") else {
        return;
    };
    let group = Group::from_gid(other.gid.into()).ok().flatten();
    let group = group.expect("the group of nobody").name;
    let cell = TestCell::changed(|text| format!("{text}access: {{group: {group}}}\n"));
    open(&cell);
    let line = cell.run(&nets::line("line", 0.2, 0.02));
    let listed = other.cli(cell.folder(), &["ls"]);
    let shown = String::from_utf8_lossy(&listed.stdout).into_owned();
    assert!(listed.status.success(), "{listed:?}");
    assert!(shown.contains("line"), "{shown}");
    let canceled = other.cli(cell.folder(), &["cancel", "line"]);
    assert!(canceled.status.success(), "{canceled:?}");
    cell.assert_ends(line, "canceled");
    // It uses the cell, but does not own it.
    let refused = other.cli(cell.folder(), &["down"]);
    assert!(!refused.status.success(), "{refused:?}");
    cell.stop();
}
