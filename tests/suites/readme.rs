//! The README and the pages of the book that show how to use a cell are executable: every `rcc-cli` command of their
//! console blocks runs, in order, and their nets are valid. Each test has a cell of its own.

use std::process::Command;

use rcc_tests::{TestCell, await_some, program, repository};
use serde_json::Value;

/// The pages, beside the README, whose commands run in order in one demo cell. Other pages have tests of their own.
const PAGES: [&str; 3] = [
    "docs/getting-started.md",
    "docs/operate.md",
    "docs/write-nets.md",
];

/// Returns the text of every block of a page that begins with ` ```kind `.
fn blocks(page: &str, kind: &str) -> Vec<String> {
    let text = std::fs::read_to_string(repository().join(page)).expect("a page");
    let fence = format!("```{kind}\n");
    let parts = text.split(&fence).skip(1);
    parts
        .map(|part| part.split("```").next().unwrap_or_default().to_owned())
        .collect()
}

/// Returns the commands of all console blocks of a page, without comments; `a && b` are two commands.
fn commands(page: &str) -> Vec<String> {
    let blocks = blocks(page, "console").join("\n");
    let lines = blocks.lines().filter_map(|line| line.strip_prefix("$ "));
    let typed = lines.map(|line| line.split('#').next().unwrap_or_default());
    typed
        .flat_map(|line| line.split("&&"))
        .map(|command| command.trim().to_owned())
        .collect()
}

/// Waits for the first incident file of a cell and returns its path: readers type it where the page says `FILE`.
fn incident_file(cell: &TestCell) -> String {
    await_some("an incident file", || {
        let mut line = cell.program("rcc-cli");
        let output = line.args(["--output", "json", "incidents"]).output();
        let rows: Value = serde_json::from_slice(&output.expect("the program runs").stdout).ok()?;
        Some(rows.as_array()?.last()?["file"].as_str()?.to_owned())
    })
}

/// Runs every `rcc-cli` command of a page in a demo cell, and asserts that each of them succeeds.
fn run_commands(cell: &TestCell, page: &str) {
    let mut run = 0;
    for command in commands(page) {
        let words: Vec<&str> = command.split_whitespace().collect();
        let Some((name, arguments)) = words
            .split_first()
            .filter(|(name, _)| name.ends_with("rcc-cli"))
        else {
            continue;
        };
        // `demo` has a test of its own; `up` is already running as part of the test cell.
        if matches!(arguments.first(), Some(&("demo" | "up")) | None) {
            continue;
        }
        run += 1;
        // A user types more slowly than an arm comes to rest.
        if matches!(arguments.first(), Some(&("run" | "load" | "start"))) {
            cell.await_devices();
        }
        let file = arguments.contains(&"FILE").then(|| incident_file(cell));
        let arguments = arguments.iter().map(|word| match (*word, &file) {
            ("FILE", Some(file)) => file.as_str(),
            (word, _) => word,
        });
        let arguments: Vec<&str> = arguments.collect();
        let mut line = cell.program("rcc-cli");
        let output = line
            .args(&arguments)
            .current_dir(repository())
            .output()
            .expect("the program runs");
        let (out, err) = (
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr),
        );
        // The exit code of a verb that waits for a net tells how it ended.
        let canceled = arguments.first() == Some(&"cancel") && arguments.contains(&"--wait");
        let wanted = if canceled { 8 } else { 0 };
        assert_eq!(
            output.status.code(),
            Some(wanted),
            "{page}: {name} {arguments:?}: {out}\n{err}"
        );
    }
    eprintln!("{page}: {run} commands");
}

#[test]
fn the_demo_runs_and_verifies_everything() {
    let output = Command::new(program("rcc-cli"))
        .arg("demo")
        .current_dir(repository())
        .output()
        .expect("the program runs");
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert_eq!(output.status.code(), Some(0), "{out}\n{err}");
}

#[test]
fn every_rcc_cli_command_of_the_readme_runs() {
    let cell = TestCell::demo();
    run_commands(&cell, "README.md");
    cell.stop();
}

#[test]
fn every_rcc_cli_command_of_the_pages_runs() {
    let cell = TestCell::demo();
    for page in PAGES {
        run_commands(&cell, page);
    }
    cell.stop();
}

#[test]
fn every_net_of_the_readme_and_the_pages_is_valid() {
    let config = repository().join("configs/cells/demo.yaml");
    for page in ["README.md"].into_iter().chain(PAGES) {
        for text in blocks(page, "yaml")
            .iter()
            .filter(|text| text.contains("primitives:"))
        {
            let config = rcc_config::CellConfig::load_offline(&config)
                .unwrap_or_else(|faults| panic!("{faults}"));
            rcc_language::compile(text, page, &config).unwrap_or_else(|faults| panic!("{faults}"));
        }
    }
}
