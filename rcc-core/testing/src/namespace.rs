//! A network namespace of one test, with a pair of virtual Ethernet interfaces in it. The namespace ends with its last process,
//! whatever happens to the test. Run by a thread of its own, since a namespace belongs to a thread.

use std::process::Command;

use nix::sched::{CloneFlags, unshare};

/// Name of the interface on this side.
pub const NEAR: &str = "rcc0";
/// Name of the interface on the other side.
pub const FAR: &str = "rcc1";

/// Runs `test` in a network namespace of its own with a pair of interfaces, both up. Skipped with words where the system does
/// not permit it.
///
/// # Panics
/// Panics if the test does, and if the interfaces cannot be made.
pub fn in_namespace(name: &'static str, test: impl FnOnce() + Send + 'static) {
    let inside = std::thread::spawn(move || {
        if Command::new("ip").arg("-V").output().is_err() {
            return println!("skipped: {name} (no iproute2)");
        }
        if let Err(error) = unshare(CloneFlags::CLONE_NEWNET) {
            return println!("skipped: {name} (no network namespace: {error})");
        }
        ip("link set lo up");
        ip(&format!("link add {NEAR} type veth peer name {FAR}"));
        ip(&format!("link set {NEAR} up"));
        ip(&format!("link set {FAR} up"));
        test();
    });
    if let Err(panic) = inside.join() {
        std::panic::resume_unwind(panic);
    }
}

/// Runs `ip` with these words.
///
/// # Panics
/// Panics if it fails.
pub fn ip(words: &str) {
    let status = Command::new("ip").args(words.split(' ')).status();
    assert!(status.expect("iproute2").success(), "ip {words}");
}

/// Pulls the cable between the two interfaces.
pub fn pull_cable() {
    ip(&format!("link set {FAR} down"));
}

/// Puts the cable back.
pub fn plug_cable() {
    ip(&format!("link set {FAR} up"));
}
