//! DirectIONet, the predecessor's notation of nets: read into the same syntax tree as YAML, so that all later passes are
//! the same, and written from it. Runs on the loader's threads and in `rcc-cli`.

mod build;
pub mod document;
mod flatten;
pub mod table;
pub mod text;
pub mod values;
pub mod write;

use std::collections::HashMap;

use rcc_config::diagnostic::{Diagnostic, Span, closest};
use rcc_language::devices::DeviceTable;
use rcc_language::parse::Notation;
use rcc_language::syntax::{NAME_MAX, Net, bad_net_name};
use rcc_language::{Compiler, codes};

pub use text::looks_like;

/// The reader, for [`rcc_language::Compiler`].
pub const NOTATION: Notation = Notation {
    recognises: looks_like,
    read,
};

/// Returns a compiler that reads DirectIONet besides YAML and JSON.
#[must_use]
pub fn compiler(cell: &DeviceTable) -> Compiler<'_> {
    Compiler {
        notations: &[NOTATION],
        ..Compiler::of(cell)
    }
}

/// Options from the header lines before a net: `# devices: kr=arm`.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Name of the net.
    pub name: String,
    /// Names of devices in the cell, by their names in the text.
    pub devices: HashMap<String, String>,
    /// Names of channels in the cell, by the device in the text, with type and port (`InBool.8`).
    pub channels: HashMap<(String, String), String>,
    /// Keys of values sent to the application that end the net when they are true, with their spans.
    pub end: Vec<(String, Span)>,
}

impl Options {
    fn device<'a>(&'a self, name: &'a str) -> &'a str {
        self.devices.get(name).map_or(name, String::as_str)
    }

    fn channel(&self, device: &str, foreign: &str) -> Option<&str> {
        let key = (device.to_owned(), foreign.to_owned());
        self.channels.get(&key).map(String::as_str)
    }
}

const HEADER_KEYS: &[&str] = &["net", "devices", "channels", "end"];

/// Reads a net. Its name is derived from `file` if no header line gives one.
pub fn read(
    text: &str,
    file: &str,
    cell: &DeviceTable,
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<Net> {
    let (header, root) = match text::parse(text) {
        Ok(parsed) => parsed,
        Err(diagnostic) => {
            diagnostics.push(*diagnostic);
            return None;
        }
    };
    let before = diagnostics.len();
    let options = options(&header, file, diagnostics);
    let flat = flatten::flatten(&root, diagnostics);
    let net = build::build(&flat, &options, cell, diagnostics);
    let new = diagnostics.get(before..).unwrap_or_default();
    let failed = new
        .iter()
        .any(|diagnostic| diagnostic.severity == rcc_config::diagnostic::Severity::Error);
    (!failed).then_some(net)
}

/// Returns the name of a net for a file name: `lwr_lin-02.net` gives `lwr-lin-02`.
fn name_of(file: &str) -> String {
    let stem = file.rsplit(['/', '\\']).next().unwrap_or_default();
    net_name(stem.rsplit_once('.').map_or(stem, |(stem, _)| stem))
}

/// Converts a name of the predecessor to a valid name of a net.
fn net_name(foreign: &str) -> String {
    let mut name: String = foreign
        .chars()
        .map(|c| match c.to_ascii_lowercase() {
            c @ ('a'..='z' | '0'..='9') => c,
            _ => '-',
        })
        .take(NAME_MAX)
        .collect();
    let begins = name.find(|c: char| c != '-').unwrap_or(name.len());
    name.drain(..begins);
    if name.is_empty() {
        name.push_str("directionet");
    }
    if name.starts_with(|c: char| c.is_ascii_digit()) {
        name.insert_str(0, "net-");
        name.truncate(NAME_MAX);
    }
    name
}

fn options(header: &text::HeaderLines, file: &str, diagnostics: &mut Vec<Diagnostic>) -> Options {
    let mut options = Options {
        name: name_of(file),
        ..Options::default()
    };
    for (key, value) in &header.entries {
        let parts = || {
            value
                .name
                .split(',')
                .map(str::trim)
                .filter(|part| !part.is_empty())
        };
        match key.name.as_str() {
            "net" => {
                diagnostics.extend(bad_net_name(value));
                options.name = value.name.to_string();
            }
            "end" => options
                .end
                .extend(parts().map(|end| (end.to_string(), value.span))),
            "devices" | "channels" => {
                for part in parts() {
                    let pair = part.split_once('=');
                    let pair = pair
                        .map(|(foreign, rcc_name)| (foreign.trim(), rcc_name.trim().to_string()));
                    let channel = pair
                        .as_ref()
                        .and_then(|(foreign, _)| foreign.split_once('.'));
                    match (pair.clone(), channel) {
                        (Some((foreign, rcc_name)), _) if key.name == "devices" => {
                            // The first mapping of a name counts.
                            options
                                .devices
                                .entry(foreign.to_string())
                                .or_insert(rcc_name);
                        }
                        (Some((_, rcc_name)), Some((device, number))) => {
                            let key = (device.to_string(), number.to_string());
                            options.channels.entry(key).or_insert(rcc_name);
                        }
                        _ => {
                            let message = format!("invalid mapping `{part}`");
                            let diagnostic =
                                Diagnostic::error(codes::WRONG_SHAPE, value.span, message);
                            diagnostics.push(diagnostic.help(
                                "write `# devices: NAME=DEVICE` and `# channels: device.InBool.8=name`",
                            ));
                        }
                    }
                }
            }
            // Any other line is a comment; a key that resembles a known one is reported as a typing error.
            other => {
                let near = closest(other, HEADER_KEYS.iter().copied());
                if let Some(near) = near.filter(|_| !other.contains(' ')) {
                    let message = format!("unknown header key `# {other}:`");
                    let diagnostic = Diagnostic::error(codes::UNKNOWN_KEY, key.span, message);
                    diagnostics.push(diagnostic.help(format!("did you mean `# {near}:`?")));
                }
            }
        }
    }
    options
}
