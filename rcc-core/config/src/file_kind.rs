//! The kind of a file (net, library of fragments, cell, robot), recognised by the keys at its root, also in a text with
//! errors. A reader that is given another kind says so, instead of listing the keys that it lacks. Never real-time.

use crate::diagnostic::Span;
use crate::yaml::{self, Node};

/// Kind of a file in YAML or JSON.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum FileKind {
    /// A net.
    Net,
    /// A library of fragments.
    Library,
    /// The configuration of a cell.
    Cell,
    /// The configuration of a robot.
    Robot,
    /// A task: nets and the rules between them, or rules alone.
    Task,
}

/// The key with the name of a file of each kind, and keys that only this kind has.
const KINDS: [(FileKind, &str, &[&str]); 5] = [
    (FileKind::Net, "net", &["primitives"]),
    (FileKind::Library, "library", &["fragments"]),
    (FileKind::Cell, "cell", &["devices"]),
    (FileKind::Robot, "robot", &["kinematics", "joints"]),
    (FileKind::Task, "task", &["rules"]),
];

impl FileKind {
    /// Returns the kind for messages, with its article.
    #[must_use]
    pub const fn described(self) -> &'static str {
        match self {
            FileKind::Net => "a net",
            FileKind::Library => "a library of fragments",
            FileKind::Cell => "the configuration of a cell",
            FileKind::Robot => "the configuration of a robot",
            FileKind::Task => "a task",
        }
    }

    /// Returns how a file of this kind is used.
    #[must_use]
    pub const fn usage(self) -> &'static str {
        match self {
            FileKind::Net => "`rcc-cli check` checks a net, `rcc-cli run` runs it",
            FileKind::Library => "a net uses a library by its path: `use: [FILE]`",
            FileKind::Cell => {
                "`rcc-cli check` checks the file of a cell, `rcc-cli up` starts the cell"
            }
            FileKind::Robot => {
                "`rcc-cli check` checks the file of a robot, a device of a cell names it: `robot: FILE`"
            }
            FileKind::Task => {
                "`rcc-cli check` checks a task, `rcc-cli task` runs it; `rcc-cli rules install` installs rules alone"
            }
        }
    }

    /// Returns the kind of a file with these keys at its root. The key with a name decides; without one, the first key
    /// that only one kind has.
    fn of_keys<'k>(keys: impl Iterator<Item = &'k str> + Clone) -> Option<FileKind> {
        let named = |key| KINDS.iter().find(|(_, name, _)| *name == key);
        let own = |key| KINDS.iter().find(|(.., own)| own.contains(&key));
        // A net may have a wrong key that names another kind, so nets come first.
        let kinds = keys.clone().filter_map(named).map(|(kind, ..)| *kind);
        kinds
            .min()
            .or_else(|| keys.filter_map(own).map(|(kind, ..)| *kind).next())
    }

    /// Returns the kind of a parsed file, and the position of the key that shows it.
    #[must_use]
    pub fn of_tree(root: &Node) -> Option<(FileKind, Span)> {
        let entries = root.map()?;
        let kind = FileKind::of_keys(entries.iter().map(|entry| entry.key.name.as_str()))?;
        let shows = |key: &str| FileKind::of_keys(std::iter::once(key)) == Some(kind);
        let entry = entries.iter().find(|entry| shows(&entry.key.name))?;
        Some((kind, entry.key.span))
    }

    /// Returns the kind of a text, also of one with errors; `None` if no key shows it. Takes one pass over the text, and
    /// parses it only if that finds nothing.
    #[must_use]
    pub fn of_text(text: &str) -> Option<FileKind> {
        let entries = root_entries(text);
        FileKind::of_keys(entries.iter().map(|(key, _)| *key))
            .or_else(|| Some(FileKind::of_tree(&yaml::read(text).0?)?.0))
    }
}

/// Returns the keys at the root of a text, and the rest of their lines as far as it is one value: also from a text with
/// errors, which has no tree. Keys with escapes are left out. Linear.
#[must_use]
pub fn root_entries(text: &str) -> Vec<(&str, &str)> {
    let mut text = text.strip_prefix('\u{feff}').unwrap_or(text);
    loop {
        text = text.trim_start_matches([' ', '\t', '\r', '\n']);
        if !text.starts_with('#') && !text.starts_with("---") && !text.starts_with('%') {
            break;
        }
        let line = text.find('\n').unwrap_or(text.len());
        text = text.get(line..).unwrap_or_default();
    }
    match text.strip_prefix('{') {
        Some(inside) => flow_entries(inside),
        None => block_entries(text),
    }
}

/// The entries of `key: value` lines; lines that are indented further than the first one belong to a value.
fn block_entries(text: &str) -> Vec<(&str, &str)> {
    let mut entries = Vec::new();
    // The first line begins with its key; its indentation is stripped.
    for (number, line) in text.lines().enumerate() {
        let is_root = number == 0 || !line.starts_with([' ', '\t']);
        if !is_root || line.starts_with(['#', '-', '%']) {
            continue;
        }
        let (key, rest) = match quoted(line) {
            Some((key, rest)) => (key, rest.trim_start()),
            None => {
                let end = separator(line).unwrap_or(line.len());
                let (key, rest) = line.split_at(end);
                (key.trim_end(), rest)
            }
        };
        if let Some(value) = rest.strip_prefix(':') {
            entries.push((key, value_of_line(value)));
        }
    }
    entries
}

/// Returns the position of the first `:` that ends a key: one before a blank or at the end of the line.
fn separator(line: &str) -> Option<usize> {
    let mut colons = line.match_indices(':').map(|(at, _)| at);
    colons.find(|at| {
        let behind = line.get(at + 1..).unwrap_or_default();
        behind.is_empty() || behind.starts_with([' ', '\t', '\r'])
    })
}

/// The entries of `{key: value, …}`, behind its `{`.
fn flow_entries(text: &str) -> Vec<(&str, &str)> {
    let mut entries = Vec::new();
    let (mut rest, mut depth, mut at_key) = (text, 0_usize, true);
    while let Some(first) = rest.chars().next() {
        let word = quoted(rest).or_else(|| bare(rest));
        if let Some((word, behind)) = word {
            let value = behind.trim_start().strip_prefix(':');
            if let (true, 0, Some(value)) = (at_key, depth, value) {
                entries.push((word, value_in_flow(value)));
            }
            (rest, at_key) = (behind, false);
            continue;
        }
        match first {
            '{' | '[' => depth += 1,
            '}' | ']' if depth == 0 => break,
            '}' | ']' => depth -= 1,
            ',' => at_key = depth == 0,
            '#' => {
                let line = rest.find('\n').unwrap_or(rest.len());
                rest = rest.get(line..).unwrap_or_default();
                continue;
            }
            _ => {}
        }
        rest = rest.get(first.len_utf8()..).unwrap_or_default();
    }
    entries
}

/// Returns the inside of a quoted text at the start, and what follows it. The inside is empty if it has escapes, and the
/// rest if the quotes are never closed.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| matches!(c, '"' | '\''))?;
    let inside = text.get(1..)?;
    let mut escaped = false;
    for (at, c) in inside.char_indices() {
        match c {
            _ if escaped => escaped = false,
            '\\' if quote == '"' => escaped = true,
            c if c == quote => {
                let word = inside.get(..at)?;
                let word = if word.contains('\\') { "" } else { word };
                return Some((word, inside.get(at + 1..)?));
            }
            _ => {}
        }
    }
    Some(("", ""))
}

/// Returns a word without quotes at the start, and what follows it.
fn bare(text: &str) -> Option<(&str, &str)> {
    let end = text.find(|c: char| ",:{}[]#\"'".contains(c) || c.is_whitespace());
    let end = end.unwrap_or(text.len());
    (end > 0).then(|| text.split_at(end))
}

fn value_of_line(text: &str) -> &str {
    let text = text.trim();
    match quoted(text) {
        Some((inside, _)) => inside,
        None => {
            let end = text.find(" #").unwrap_or(text.len());
            text.get(..end).unwrap_or_default().trim_end()
        }
    }
}

fn value_in_flow(text: &str) -> &str {
    let text = text.trim_start();
    let word = quoted(text).or_else(|| bare(text));
    word.map_or("", |(inside, _)| inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_recognised_however_it_is_written() {
        for (text, kind) in [
            ("net: a\nprimitives: {}\n", FileKind::Net),
            ("\u{feff}net: a\n", FileKind::Net),
            ("net : a\n", FileKind::Net),
            ("net:\ta\n", FileKind::Net),
            ("\tnet: a\n", FileKind::Net),
            ("  net: a\n  primitives: {}\n", FileKind::Net),
            ("# a\n---\n\n\"net\": a\n", FileKind::Net),
            ("'net' : a", FileKind::Net),
            ("primitives:\n  end: {}\n", FileKind::Net),
            ("{net: a}", FileKind::Net),
            (
                r#"{"primitives":{"a":{"net":1,"b":"}\""}},"net":"a"}"#,
                FileKind::Net,
            ),
            (r#"{"description":"cell: b","net":"a"}"#, FileKind::Net),
            (r#"{"\u006eet":"a"}"#, FileKind::Net),
            ("? net\n: a\n", FileKind::Net),
            ("cell: a\nnet: b\n", FileKind::Net),
            ("net: a\nprimitives: [", FileKind::Net),
            ("library: a\nfragments: {}\n", FileKind::Library),
            ("fragments: {}\n", FileKind::Library),
            ("cell: a\nperiod: 1 ms\ndevices: {}\n", FileKind::Cell),
            ("period: 1 ms\ndevices: {}\n", FileKind::Cell),
            (
                "robot: KUKA: 5\nkinematics: {}\njoints: {}\n",
                FileKind::Robot,
            ),
            ("kinematics: {}\n", FileKind::Robot),
        ] {
            assert_eq!(FileKind::of_text(text), Some(kind), "{text:?}");
        }
        for text in [
            "",
            "a: 1\n",
            "a:\n  net: b\n",
            "{\"a\": {\"net\": 1}}",
            "# net: a\n",
            "- net: a\n",
            "nets: 1\n",
            "text net: a\n",
        ] {
            assert_eq!(FileKind::of_text(text), None, "{text:?}");
        }
    }

    #[test]
    fn the_value_of_a_key_ends_where_it_ends_in_the_notation() {
        for (text, value) in [
            ("net: line # a line\n", "line"),
            ("net: \"a b\" # a line\n", "a b"),
            ("net: a#7\n", "a#7"),
            ("{net: line, primitives: {", "line"),
            ("{\"net\":\"line\"", "line"),
            ("net:", ""),
        ] {
            let entries = root_entries(text);
            assert_eq!(entries.first(), Some(&("net", value)), "{text:?}");
        }
    }

    #[test]
    fn the_key_that_shows_the_kind_is_pointed_at() {
        let root = yaml::parse("period: 1 ms\ncell: a\n").unwrap();
        assert_eq!(
            FileKind::of_tree(&root),
            Some((FileKind::Cell, Span::new(13, 17)))
        );
    }
}
