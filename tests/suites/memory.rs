//! The loader returns the memory of a long text to the system once the text is compiled. Each test has a cell of its
//! own.

use std::fs;

use rcc_protocol::Role;
use rcc_tests::{TestCell, await_told};

/// Number of primitives of the net, whose text is longer than a megabyte.
const MANY: usize = 20_000;

/// Returns a net that commands nothing and computes many sums of the time.
fn long(name: &str) -> String {
    let rows = (0..MANY).map(|number| {
        format!("  sum{number}: {{type: Add, inputs: {{a: clock.out, b: clock.out}}}}\n")
    });
    let unread = (0..MANY).map(|number| format!("sum{number}.out, "));
    format!(
        "net: {name}
primitives:
  cancel: {{type: Cancel}}
  clock: {{type: Time}}
{}  end: {{type: Termination, inputs: {{done: cancel.requested}}}}
discard: [{}]
",
        rows.collect::<String>(),
        unread.collect::<String>()
    )
}

/// Returns a number of `/proc/PID/status`, kB.
fn kilobytes(pid: u32, key: &str) -> u64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).expect("the process is alive");
    let line = status.lines().find_map(|line| line.strip_prefix(key));
    let number = line.and_then(|rest| rest.split_whitespace().next());
    number.and_then(|number| number.parse().ok()).expect(key)
}

#[test]
fn a_loader_returns_the_memory_of_a_long_text() {
    let cell = TestCell::demo();
    let pid = cell.announced(Role::Loader, "loader").pid;
    let (before, heap) = (kilobytes(pid, "VmRSS:"), kilobytes(pid, "RssAnon:"));
    let (id, row) = cell.load_any(&long("long"));
    // The net may need more time than a cycle has; it is compiled nevertheless.
    assert_eq!(
        row["primitives"].as_u64().map(|count| count >= MANY as u64),
        Some(true),
        "{row}"
    );
    assert_eq!(
        cell.rest("DELETE", &format!("/commands/{id}"), "").status,
        200
    );
    let peak = kilobytes(pid, "VmHWM:");
    assert!(peak > 2 * before, "{before} kB, then {peak} kB");
    await_told("the memory to be given back", || {
        // Pages of the program, which came with the work, stay.
        let now = kilobytes(pid, "RssAnon:");
        match now.saturating_sub(heap) < (peak - before) / 8 {
            true => Ok(()),
            false => Err(format!("{heap} kB, grown by {}, now {now}", peak - before)),
        }
    });
    cell.stop();
}
