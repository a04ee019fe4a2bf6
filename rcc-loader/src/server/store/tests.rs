//! Tests of command files, of what is known without them, and of how room is made for new ones. Run by the test
//! harness.

use super::*;

struct TestStore(CommandStore);

impl TestStore {
    fn new(name: &str) -> TestStore {
        let base = std::env::temp_dir().join(format!("rcc-store-{}-{name}", std::process::id()));
        TestStore(CommandStore {
            folder: base.join("00000000000000aa"),
            bytes_max: 4 << 10,
            index: Mutex::default(),
        })
    }
}

impl Drop for TestStore {
    fn drop(&mut self) {
        if let Some(base) = self.0.folder.parent() {
            let _ = fs::remove_dir_all(base);
        }
    }
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
    let folder = TestStore::new("back");
    folder.0.write(&command(7))?;
    assert_eq!(folder.0.read(7), Some(command(7)));
    assert_eq!(folder.0.read(8), None);
    Ok(())
}

#[test]
fn a_sweep_removes_what_does_not_exist_and_nothing_young() -> Result<(), StoreError> {
    let folder = TestStore::new("sweep");
    for id in [1, 2] {
        folder.0.write(&command(id))?;
    }
    folder.0.sweep(|id| id == 1, Duration::from_secs(3600));
    assert!(folder.0.read(2).is_some());
    folder.0.sweep(|id| id == 1, Duration::ZERO);
    assert!(folder.0.read(1).is_some() && folder.0.read(2).is_none());
    Ok(())
}

#[test]
fn folders_of_dead_executors_go() -> Result<(), StoreError> {
    let folder = TestStore::new("others");
    folder.0.write(&command(1))?;
    let other = folder.0.folder.with_file_name("00000000000000bb");
    fs::create_dir_all(&other).expect("a folder");
    folder.0.remove_others();
    assert!(!other.exists() && folder.0.read(1).is_some());
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
    let folder = TestStore::new("index");
    folder.0.write(&command(7))?;
    fs::remove_dir_all(&folder.0.folder).expect("removed");
    assert_eq!(folder.0.named("line"), [7]);
    assert_eq!(
        folder.0.summary(7).map(|summary| summary.net.clone()),
        Some("line".into())
    );
    Ok(())
}

#[test]
fn the_oldest_rejected_files_make_room_and_nothing_else_does() -> Result<(), StoreError> {
    let folder = TestStore::new("room");
    folder.0.write(&command(1))?;
    for id in 2..20 {
        folder.0.write(&rejected(id, 1000))?;
        assert!(folder.0.kept() <= folder.0.bytes_max, "{}", folder.0.kept());
    }
    assert!(folder.0.read(1).is_some() && folder.0.read(19).is_some());
    assert_eq!(folder.0.read(2), None);
    let first = folder.0.summary(2).map(|summary| summary.diagnostics.len());
    assert_eq!(first, Some(1), "its errors are still available");
    let live = CommandFile {
        text: "x".repeat(3 << 10),
        ..command(20)
    };
    folder.0.write(&live)?;
    let refused = folder.0.write(&CommandFile { id: 21, ..live });
    assert!(
        matches!(refused, Err(StoreError::Full { .. })),
        "{refused:?}"
    );
    assert!(folder.0.read(20).is_some() && folder.0.read(21).is_none());
    let left = entries(&folder.0.folder).into_iter();
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
