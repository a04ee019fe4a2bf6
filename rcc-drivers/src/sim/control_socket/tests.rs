//! The socket's mode, its replacement and its removal; which files requests may name.
//! Tests of files in a folder of their own.

use std::os::unix::fs::{PermissionsExt, symlink};
use std::os::unix::net::UnixStream;

use rcc_testing::folder;

use super::*;

#[test]
fn the_socket_is_private_and_removed_with_the_simulator() {
    let place = folder();
    let path = place.path().join("new/sim.sock");
    let (_listener, socket) = ControlSocket::bind(&path).unwrap();
    assert_eq!(socket.path(), path);
    let mode = |path: &Path| fs::metadata(path).unwrap().mode() & 0o7777;
    assert_eq!(mode(&path), 0o600);
    assert_eq!(mode(&place.path().join("new")), 0o700);
    drop(socket);
    assert!(!place.path().join("new").exists());
}

#[test]
fn a_dead_simulators_socket_is_replaced_and_a_living_ones_is_not() {
    let place = folder();
    let path = place.path().join("sim.sock");
    drop(UnixListener::bind(&path).unwrap());
    assert!(path.exists(), "a dead socket's file stays");
    let (_listener, living) = ControlSocket::bind(&path).unwrap();
    let refused = ControlSocket::bind(&path).unwrap_err();
    assert_eq!(refused.kind(), io::ErrorKind::AddrInUse);
    assert!(refused.to_string().contains("listens there"), "{refused}");
    assert!(UnixStream::connect(&path).is_ok());
    // A file that another process has put there must not be removed.
    fs::remove_file(&path).unwrap();
    fs::write(&path, "no socket").unwrap();
    let refused = ControlSocket::bind(&path).unwrap_err().to_string();
    assert!(refused.contains("not a socket"), "{refused}");
    drop(living);
    assert_eq!(fs::read_to_string(&path).unwrap(), "no socket");
}

#[test]
fn a_folder_that_others_can_write_to_is_refused_with_the_remedy() {
    let place = folder();
    fs::set_permissions(place.path(), fs::Permissions::from_mode(0o1777)).unwrap();
    let path = place.path().join("sim.sock");
    let refused = ControlSocket::bind(&path).unwrap_err().to_string();
    assert!(refused.contains("chmod go-w"), "{refused}");
    assert!(!path.exists());
}

#[test]
fn requests_name_files_below_the_folder_only() {
    let place = folder();
    let (inside, outside) = (place.path().join("in"), place.path().join("out"));
    fs::create_dir_all(inside.join("logs")).unwrap();
    fs::create_dir(&outside).unwrap();
    symlink(&outside, inside.join("way")).unwrap();
    symlink(outside.join("new"), inside.join("link")).unwrap();
    symlink(inside.join("logs"), inside.join("home")).unwrap();
    let folder = ControlFolder(inside.clone());
    for good in ["a.csv", "logs/a.csv", "./logs/../a.csv", "home/a.csv"] {
        let path = folder.below(Path::new(good)).unwrap();
        assert!(path.starts_with(&inside), "{good}: {path:?}");
    }
    let whole = inside.join("logs/a.csv");
    assert_eq!(folder.below(&whole).unwrap(), whole);
    let sibling = place.path().join("inside.csv");
    for (bad, part) in [
        (Path::new("../out/a.csv"), "is not below"),
        (Path::new("way/a.csv"), "is not below"),
        (&outside.join("a.csv"), "is not below"),
        (&sibling, "is not below"),
        (Path::new(".."), "is not below"),
        (Path::new("/"), "is not below"),
        (Path::new(""), "is not below"),
        (Path::new("link"), "is a symbolic link"),
        (Path::new("nowhere/a.csv"), "folder of nowhere/a.csv"),
    ] {
        let error = folder.below(bad).unwrap_err().to_string();
        assert!(error.contains(part), "{bad:?}: {error}");
    }
}

#[test]
fn an_address_is_refused_with_the_remedy_and_a_path_is_taken() {
    for old in ["127.0.0.1:0", "localhost:4711", "[::1]:80"] {
        let words = path(old).unwrap_err();
        assert!(words.contains("give the path of one"), "{old}: {words}");
    }
    assert!(path("").is_err());
    for good in ["sim.sock", "/run/rcc/a:1", "a:b"] {
        assert_eq!(path(good), Ok(good.into()));
    }
}
