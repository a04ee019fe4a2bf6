//! Tests of command files, of what is known without them, and of how room is made for new ones. Run by the test
//! harness.

use rcc_testing::TempDir;

use super::*;

/// Returns an empty store, and the folder it is in.
fn store() -> (CommandStore, TempDir) {
    let base = rcc_testing::folder();
    let store = CommandStore {
        folder: base.path().join("00000000000000aa"),
        bytes_max: 4 << 10,
        index: Published::default(),
    };
    (store, base)
}

fn command(id: u64) -> CommandFile {
    CommandFile {
        id,
        net: "line".into(),
        ..CommandFile::default()
    }
}

#[test]
fn a_written_file_is_read_back() -> Result<(), StoreError> {
    let (store, _folder) = store();
    store.write(&command(7))?;
    assert_eq!(store.read(7), Some(command(7)));
    assert_eq!(store.read(8), None);
    Ok(())
}

#[test]
fn a_sweep_removes_what_does_not_exist_and_nothing_young() -> Result<(), StoreError> {
    let (store, _folder) = store();
    for id in [1, 2] {
        store.write(&command(id))?;
    }
    store.sweep(|id| id == 1, Duration::from_secs(3600));
    assert!(store.read(2).is_some());
    store.sweep(|id| id == 1, Duration::ZERO);
    assert!(store.read(1).is_some() && store.read(2).is_none());
    Ok(())
}

#[test]
fn a_file_of_a_clock_that_was_set_back_since_does_not_stay_for_ever() {
    let folder = rcc_testing::folder();
    let path = folder.path().join("file");
    let file = fs::File::create(&path).expect("a file");
    let (now, age) = (SystemTime::now(), Duration::from_secs(3600));
    for (modified, older) in [
        (now, false),
        (now - 2 * age, true),
        (now + age / 2, false),
        (now + 2 * age, true),
    ] {
        file.set_modified(modified).expect("a date");
        assert_eq!(is_older(&path, age), older, "{modified:?}, now {now:?}");
    }
}

#[test]
fn folders_of_dead_executors_go() -> Result<(), StoreError> {
    let (store, _folder) = store();
    store.write(&command(1))?;
    let other = store.folder.with_file_name("00000000000000bb");
    fs::create_dir_all(&other).expect("a folder");
    store.remove_others();
    assert!(!other.exists() && store.read(1).is_some());
    Ok(())
}

fn rejected(id: u64, text: usize) -> CommandFile {
    let error = Finding {
        code: "RCC1001".into(),
        severity: "error".into(),
        ..Finding::default()
    };
    CommandFile {
        text: "x".repeat(text),
        diagnostics: vec![error],
        ..command(id)
    }
}

#[test]
fn names_are_known_without_any_file() -> Result<(), StoreError> {
    let (store, _folder) = store();
    store.write(&command(7))?;
    fs::remove_dir_all(&store.folder).expect("removed");
    assert_eq!(store.named("line"), [7]);
    assert_eq!(
        store.summary(7).map(|summary| summary.net.clone()),
        Some("line".into())
    );
    Ok(())
}

#[test]
fn the_oldest_rejected_files_make_room_and_nothing_else_does() -> Result<(), StoreError> {
    let (store, _folder) = store();
    store.write(&command(1))?;
    for id in 2..20 {
        store.write(&rejected(id, 1000))?;
        assert!(store.kept() <= store.bytes_max, "{}", store.kept());
    }
    assert!(store.read(1).is_some() && store.read(19).is_some());
    assert_eq!(store.read(2), None);
    let first = store.summary(2).map(|summary| summary.diagnostics.len());
    assert_eq!(first, Some(1), "its errors are still available");
    let live = CommandFile {
        text: "x".repeat(3 << 10),
        ..command(20)
    };
    store.write(&live)?;
    let refused = store.write(&CommandFile { id: 21, ..live });
    assert!(
        matches!(refused, Err(StoreError::Full { .. })),
        "{refused:?}"
    );
    assert!(store.read(20).is_some() && store.read(21).is_none());
    let left = entries(&store.folder).into_iter();
    assert!(
        left.into_iter()
            .all(|path| path.extension().is_some_and(|of| of == "json"))
    );
    Ok(())
}

#[test]
fn a_rejected_text_and_its_findings_are_truncated_to_their_limits() {
    let mut file = rejected(1, 4 << 20);
    let mut long = file.diagnostics[0].clone();
    long.rendered = "y".repeat(1 << 20);
    file.diagnostics = vec![long; 1000];
    discard_excess(&mut file);
    assert!(file.text.len() <= REJECTED_TEXT_MAX + 100 && file.text.contains("4194304 bytes"));
    let bytes = serde_json::to_vec(&file).map_or(usize::MAX, |bytes| bytes.len());
    assert!(
        bytes <= REJECTED_TEXT_MAX + FINDINGS_MAX + (4 << 10),
        "{bytes}"
    );
    assert!(file.is_rejected());
    let last = file.diagnostics.last().map(|row| row.message.clone());
    assert!(last.is_some_and(|last| last.starts_with("1000 findings, ")));
    let mut small = CommandFile {
        text: "x".repeat(4 << 20),
        ..command(1)
    };
    let whole = small.clone();
    discard_excess(&mut small);
    assert_eq!(
        small, whole,
        "a net that can be started is stored completely"
    );
}
