//! Recordings as files: bounds, segments, and what remains when a recorder dies or a disk is full. Run by the threads of
//! the test harness.

use std::path::Path;

use rcc_recording::cdr::CdrWriter;
use rcc_recording::file::{AttachedText, ChannelInfo};
use rcc_recording::read::{ReadEnd, ReadError, read};
use rcc_recording::recording::{Recording, RecordingOptions, WhenFull};
use rcc_recording::sink::{MessageSink, RecordingState};
use rcc_recording::table::{Column, Table, TableKey, TableSubject};
use rcc_testing::folder;

fn table() -> Table {
    let column = Column {
        name: "ik.joints".into(),
        type_name: "Real[7]".into(),
        unit: Some("rad".into()),
        width: 7,
        never_null: false,
    };
    let subject = TableSubject {
        name: "line".into(),
        topic: "/nets/line".into(),
        metadata: [("net".to_owned(), "line".to_owned())].into(),
    };
    Table::new(subject, vec![column])
}

fn options(path: &Path, bytes_max: u64, when_full: WhenFull) -> RecordingOptions {
    RecordingOptions {
        path: path.to_owned(),
        replace: false,
        bytes_max,
        when_full,
    }
}

/// Writes rows until there are `count`, or the recording is full; flushes after every 100; returns the rows written.
fn fill(recording: &mut Recording, count: u64) -> u64 {
    let table = table();
    let channel = recording.channel(ChannelInfo {
        topic: table.topic.clone(),
        schema: table.schema.clone(),
        metadata: table.metadata.clone(),
    });
    let mut out = CdrWriter::new();
    for cycle in 1..=count {
        let key = TableKey { cycle, command: 1 };
        table.encode(key, &[cycle as f64, f64::NAN], &mut out);
        let state = recording.write(channel, 1_000_000 * cycle, out.bytes());
        if state.expect("a disk with space") == RecordingState::Full {
            return cycle - 1;
        }
        if cycle % 100 == 0 {
            recording.flush().expect("a disk with space");
        }
    }
    count
}

/// Returns the cycles of a file, and how it ends.
fn cycles(path: &Path) -> (Vec<u64>, ReadEnd) {
    let mut cycles = Vec::new();
    let end = read(path, |table, _, _, row| {
        assert_eq!(table.elements()[2], "line/ik.joints[2]");
        assert_eq!(table.columns[0].unit.as_deref(), Some("rad"));
        assert_eq!(row.values[0], row.key.cycle as f64);
        assert!(row.values[1..].iter().all(|value| value.is_nan()));
        cycles.push(row.key.cycle);
    });
    (cycles, end.expect("a recording"))
}

#[test]
fn what_is_written_is_read_again() {
    let folder = folder();
    let path = folder.path().join("out.mcap");
    let mut recording = Recording::create(options(&path, 1 << 30, WhenFull::Stop)).expect("new");
    assert_eq!(fill(&mut recording, 1234), 1234);
    let summary = recording.finish().expect("written");
    let length = std::fs::metadata(&path).expect("a file").len();
    assert_eq!((summary.messages, summary.bytes), (1234, length));
    assert_eq!(summary.span_ns, [1_000_000, 1_234_000_000]);
    assert_eq!(cycles(&path), ((1..=1234).collect(), ReadEnd::Complete));
    let again = Recording::create(options(&path, 1 << 30, WhenFull::Stop));
    let error = again.err().expect("an existing file is kept").to_string();
    assert!(
        error.contains("out.mcap") && error.contains("exists"),
        "{error}"
    );
}

#[test]
fn a_killed_recorder_leaves_everything_up_to_its_last_flush() {
    let folder = folder();
    let path = folder.path().join("out.mcap");
    let mut recording = Recording::create(options(&path, 1 << 30, WhenFull::Stop)).expect("new");
    fill(&mut recording, 550);
    // As after kill -9: nothing that is still in memory is written.
    std::mem::forget(recording);
    assert_eq!(cycles(&path), ((1..=500).collect(), ReadEnd::Torn));
}

#[test]
fn a_recording_ends_before_it_is_larger_than_it_may_be() {
    let folder = folder();
    for bytes_max in [20_000, 100_000, 3_000_000] {
        let path = folder.path().join(format!("{bytes_max}.mcap"));
        let options = options(&path, bytes_max, WhenFull::Stop);
        let mut recording = Recording::create(options).expect("new");
        let written = fill(&mut recording, 100_000);
        assert!(written > 10 && written < 100_000, "{written}");
        let summary = recording.finish().expect("written");
        assert!(summary.bytes <= bytes_max, "{summary:?}");
        assert!(summary.bytes > bytes_max * 6 / 10, "{summary:?}");
        assert_eq!(cycles(&path), ((1..=written).collect(), ReadEnd::Complete));
    }
}

#[test]
fn the_oldest_segments_are_removed_and_each_can_be_read_alone() {
    let folder = folder();
    let path = folder.path().join("out.mcap");
    let bytes_max = 800_000;
    let options = options(&path, bytes_max, WhenFull::RemoveOldest);
    let mut recording = Recording::create(options).expect("new");
    let text = AttachedText {
        name: "line.yaml".into(),
        media_type: "application/yaml".into(),
        text: "net: line\n".into(),
    };
    recording.attach(text.clone(), 1).expect("written");
    recording.attach(text, 1).expect("only once");
    assert_eq!(fill(&mut recording, 20_000), 20_000);
    let summary = recording.finish().expect("written");
    assert!(
        summary.removed > 0 && summary.bytes <= bytes_max,
        "{summary:?}"
    );
    let there = std::fs::read_dir(folder.path()).expect("a folder").count();
    assert_eq!(there, summary.files.len());
    let mut all = Vec::new();
    for file in &summary.files {
        let (cycles, end) = cycles(file);
        assert_eq!(end, ReadEnd::Complete, "{}", file.display());
        all.extend(cycles);
        let bytes = std::fs::read(file).expect("a file");
        let found = mcap::Summary::read(&bytes)
            .expect("MCAP")
            .expect("an index");
        assert_eq!(found.attachment_indexes.len(), 1, "{}", file.display());
    }
    assert_eq!(all.last(), Some(&20_000));
    assert!(all.windows(2).all(|pair| pair[0] + 1 == pair[1]), "no gap");
    assert_eq!(summary.span_ns[0], 1_000_000 * all[0]);
}

#[test]
fn a_segment_of_an_earlier_recording_is_refused_at_the_start() {
    let folder = folder();
    let path = folder.path().join("out.mcap");
    let earlier = folder.path().join("out-0003.mcap");
    std::fs::write(&earlier, "kept").expect("a file");
    for other in ["out-3.mcap", "out-0001.json", "other-0001.mcap"] {
        std::fs::write(folder.path().join(other), "").expect("a file");
    }
    let refused = Recording::create(options(&path, 1 << 20, WhenFull::RemoveOldest));
    let error = refused.err().expect("an earlier recording").to_string();
    assert!(
        error.contains("out-0003.mcap: a segment of an earlier recording exists"),
        "{error}"
    );
    assert_eq!(
        std::fs::read_dir(folder.path()).expect("a folder").count(),
        4
    );
    let one_file = Recording::create(options(&path, 1 << 20, WhenFull::Stop));
    assert!(one_file.is_ok());
    std::fs::remove_file(earlier).expect("removed");
    assert!(Recording::create(options(&path, 1 << 20, WhenFull::RemoveOldest)).is_ok());
}

/// The text of a net with this hash, of this size.
fn net_text(hash: &str, bytes: usize) -> AttachedText {
    AttachedText {
        name: format!("line-{hash}.yaml"),
        media_type: "application/yaml".into(),
        text: "x".repeat(bytes),
    }
}

/// Returns the number of attached texts in a file.
fn texts(path: &Path) -> usize {
    let bytes = std::fs::read(path).expect("a file");
    let found = mcap::Summary::read(&bytes)
        .expect("MCAP")
        .expect("an index");
    found.attachment_indexes.len()
}

#[test]
fn texts_never_fill_the_segments() {
    let folder = folder();
    let path = folder.path().join("out.mcap");
    let options = options(&path, 8_000_000, WhenFull::RemoveOldest);
    let mut recording = Recording::create(options).expect("new");
    let cell = AttachedText {
        name: "demo.yaml".into(),
        media_type: "application/yaml".into(),
        text: "x".repeat(5_000),
    };
    recording.attach(cell, 1).expect("written");
    for net in 0..200 {
        let text = net_text(&format!("{net:016x}"), 50_000);
        recording.attach(text, 1).expect("written");
    }
    assert_eq!(fill(&mut recording, 1000), 1000);
    let summary = recording.finish().expect("written");
    assert_eq!(summary.removed, 0, "{summary:?}");
    assert!(summary.files.len() <= 2, "{summary:?}");
    let all = summary.files.iter().flat_map(|file| cycles(file).0);
    assert_eq!(all.collect::<Vec<_>>(), (1..=1000).collect::<Vec<_>>());
}

#[test]
fn the_text_of_a_net_is_in_each_segment_with_its_messages_and_no_other() {
    let folder = folder();
    let path = folder.path().join("out.mcap");
    let options = options(&path, 800_000, WhenFull::RemoveOldest);
    let mut recording = Recording::create(options).expect("new");
    let hash = "0123456789abcdef";
    recording.attach(net_text(hash, 1000), 1).expect("written");
    let mut info = ChannelInfo {
        topic: "/nets/brief".into(),
        schema: table().schema,
        metadata: [("net_hash".to_owned(), hash.to_owned())].into(),
    };
    let brief = recording.channel(info.clone());
    let mut out = CdrWriter::new();
    table().encode(
        TableKey {
            cycle: 1,
            command: 1,
        },
        &[1.0],
        &mut out,
    );
    let write = |recording: &mut Recording, channel| {
        let state = recording.write(channel, 1, out.bytes()).expect("written");
        assert_eq!(state, RecordingState::Open);
    };
    write(&mut recording, brief);
    fill(&mut recording, 4_000);
    let summary = recording.summary();
    let (last, older) = summary.files.split_last().expect("files");
    assert!(older.len() > 2 && last.exists(), "{summary:?}");
    assert_eq!(older.iter().map(|file| texts(file)).sum::<usize>(), 1);
    // Its next message brings the text back, hours later.
    write(&mut recording, brief);
    recording.release(&[brief]);
    fill(&mut recording, 8_000);
    // A released channel is dropped with its text; its place is used again.
    info.topic = "/nets/other".into();
    assert_eq!(recording.channel(info), brief);
    let summary = recording.finish().expect("written");
    assert!(summary.removed > 0);
    let last = summary.files.last().expect("a file");
    assert_eq!(texts(last), 0);
}

#[test]
fn a_full_disk_is_an_error_with_the_files_name() {
    let full = Recording::create(RecordingOptions {
        replace: true,
        ..options(Path::new("/dev/full"), 1 << 30, WhenFull::Stop)
    });
    let error = full.err().expect("no space").to_string();
    assert!(error.starts_with("/dev/full: No space left"), "{error}");
}

#[test]
fn other_files_are_refused_with_the_reason() {
    let folder = folder();
    let path = folder.path().join("text.mcap");
    std::fs::write(&path, "cycle,time_s\n1,0.0\n").expect("a file");
    let refused = read(&path, |_, _, _, _| {});
    assert!(matches!(refused, Err(ReadError::NotMcap)), "{refused:?}");
    std::fs::write(&path, "").expect("a file");
    let refused = read(&path, |_, _, _, _| {});
    assert!(matches!(refused, Err(ReadError::NotMcap)), "{refused:?}");
    let missing = read(&folder.path().join("none.mcap"), |_, _, _, _| {});
    assert!(matches!(missing, Err(ReadError::Io(_))), "{missing:?}");
}
