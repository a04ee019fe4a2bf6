//! Tests of the state folder. Run by the test harness.

use super::*;
use std::time::Duration;

fn file(path: &Path, size: usize, age_s: u64) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, vec![b'x'; size]).unwrap();
    let time = SystemTime::now() - Duration::from_secs(age_s);
    let file = fs::File::options().write(true).open(path).unwrap();
    file.set_modified(time).unwrap();
}

#[test]
fn the_oldest_go_first_and_the_newest_incident_and_foreign_files_stay() {
    let folder = rcc_testing::folder();
    let state = StateFolder::at(folder.path());
    file(&state.events_file(), 10, 0);
    file(&state.rotated_events_file(1), 10, 500);
    file(&state.rotated_events_file(2), 10, 50);
    for (name, age) in [
        ("a.rcc-incident", 400),
        ("b.rcc-incident", 300),
        ("notes", 900),
    ] {
        file(&state.incidents_dir().join(name), 100, age);
    }
    let is_incident = |path: &Path| path.extension().is_some_and(|is| is == "rcc-incident");
    let removed = |keep| {
        let removed = state.remove_oldest(keep, &[], is_incident).unwrap();
        let names = removed
            .iter()
            .map(|path| path.file_name().unwrap().to_owned());
        names
            .map(|name| name.into_string().unwrap())
            .collect::<Vec<_>>()
    };
    assert_eq!(removed(230), [""; 0]);
    assert_eq!(removed(225), ["events.1.jsonl"]);
    assert_eq!(removed(125), ["a.rcc-incident"]);
    assert_eq!(removed(0), ["events.2.jsonl"]);
    assert!(state.events_file().exists());
    assert!(state.incidents_dir().join("b.rcc-incident").exists());
    assert!(state.incidents_dir().join("notes").exists());
}

fn dated(path: &Path, time: SystemTime) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, [b'x'; 100]).unwrap();
    let file = fs::File::options().write(true).open(path).unwrap();
    file.set_modified(time).unwrap();
}

#[test]
fn after_the_clock_was_set_back_the_files_of_the_future_go_first() {
    let folder = rcc_testing::folder();
    let state = StateFolder::at(folder.path());
    let now = SystemTime::now();
    let incident = |name: &str| state.incidents_dir().join(name);
    let future = now + Duration::from_secs(9000);
    dated(&incident("old"), now - Duration::from_secs(60));
    dated(&incident("new"), now - Duration::from_secs(1));
    dated(&incident("future-1"), future);
    dated(&incident("future-2"), future + Duration::from_secs(1));
    let keep = |keep, newest: &[&Path]| state.remove_oldest(keep, newest, |_| true).unwrap();
    let removed = keep(200, &[]);
    assert_eq!(removed, [incident("future-1"), incident("future-2")]);
    // One that was written just before the clock was set back is known by its name.
    dated(&incident("just-written"), future);
    let run = state.logs_dir().join("2099-01-01");
    dated(&run.join("executor.log"), future);
    fs::File::open(&run).unwrap().set_modified(future).unwrap();
    for name in ["2026-01-01", "2026-01-02"] {
        dated(&state.logs_dir().join(name).join("executor.log"), now);
    }
    assert_eq!(keep(0, &[&incident("just-written"), &run]).len(), 4);
    assert!(incident("just-written").exists() && run.join("executor.log").exists());
}

#[test]
fn the_logs_of_this_run_are_known_by_the_file_of_stderr() {
    let folder = rcc_testing::folder();
    let state = StateFolder::at(folder.path());
    let run = state.logs_dir().join("2026-01-01");
    fs::create_dir_all(&run).unwrap();
    let real = fs::canonicalize(&run).unwrap();
    assert_eq!(state.logs_with(&real.join("executor.log")), Some(run));
    for other in ["/dev/pts/1", "socket:[123]", "/", "/var/log/x/y.log"] {
        assert_eq!(state.logs_with(Path::new(other)), None);
    }
}

#[test]
fn a_configured_folder_is_found_through_a_link_and_left_again() {
    let temporary = rcc_testing::folder();
    let (anchor, other) = (
        temporary.path().join("cells/demo"),
        temporary.path().join("big"),
    );
    create(&anchor, "demo", Some(&other)).unwrap();
    assert_eq!(StateFolder::at(&anchor).path(), other.join("demo"));
    assert!(other.join("demo").is_dir());
    create(&anchor, "demo", Some(&other)).unwrap();
    create(&anchor, "demo", Some(&temporary.path().join("third"))).unwrap();
    assert_eq!(
        StateFolder::at(&anchor).path(),
        temporary.path().join("third/demo")
    );
    create(&anchor, "demo", None).unwrap();
    assert_eq!(StateFolder::at(&anchor).path(), anchor);
    create(&anchor, "demo", None).unwrap();
}

#[test]
fn a_folder_that_cannot_be_made_is_an_error_with_the_remedy() {
    let error = create(Path::new("/proc/version/rcc"), "demo", None).unwrap_err();
    let words = error.to_string();
    assert!(
        words.contains("/proc/version/rcc") && words.contains("RCC_STATE_DIR"),
        "{words}"
    );
}
