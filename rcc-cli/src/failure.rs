//! Why a verb did not succeed: the same body as over HTTP, and the exit code.
//! Made and printed by the main thread.

use rcc_config::diagnostic::{Faults, DiagnosticRow, DiagnosticPosition, Severity, SourceText, render};
use rcc_core::printable::Printable;
use rcc_loader::server::api::{ErrorBody, Finding};
use rcc_loader::server::codes::{self, Code, exit};
use rcc_loader::server::compile::findings;

/// What is told to the person or program that called us.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// Exit code.
    pub exit: u8,
    /// What, where, what to do. Nothing is printed when it is empty (its code is): the verb said it already.
    pub body: Box<ErrorBody>,
    /// The text that the diagnostics refer to, as name and content.
    pub source: Option<Box<(String, String)>>,
}

impl Failure {
    /// A failure of the table of codes.
    pub fn new(code: Code, message: impl Into<String>, help: impl Into<String>) -> Failure {
        let help = help.into();
        Failure {
            exit: code.exit,
            body: Box::new(ErrorBody {
                code: code.code.to_owned(),
                message: message.into(),
                help: (!help.is_empty()).then_some(help),
                diagnostics: Vec::new(),
            }),
            source: None,
        }
    }

    /// What the server answered.
    #[must_use]
    pub fn answered(body: ErrorBody) -> Failure {
        Failure {
            exit: codes::exit_code(&body.code),
            body: Box::new(body),
            source: None,
        }
    }

    /// Ends with this exit code; everything has been said.
    #[must_use]
    pub fn said(exit: u8) -> Failure {
        Failure {
            exit,
            body: Box::default(),
            source: None,
        }
    }

    /// Ended by Ctrl-C.
    #[must_use]
    pub fn interrupted() -> Failure {
        Failure::said(exit::INTERRUPTED)
    }

    /// A file that cannot be read.
    #[must_use]
    pub fn unreadable(path: &str, error: &std::io::Error) -> Failure {
        let permission = error.kind() == std::io::ErrorKind::PermissionDenied;
        let (code, help) = if permission {
            (codes::NOT_PERMITTED, "grant yourself read permission")
        } else {
            (codes::BAD_REQUEST, "name an existing file")
        };
        Failure::new(code, format!("{path}: {error}"), help)
    }

    /// A text that is not valid, with its findings. The exit code is that of the first error.
    #[must_use]
    pub fn invalid(what: &str, diagnostics: Vec<Finding>, source: (String, String)) -> Failure {
        let first = diagnostics
            .iter()
            .find(|finding| finding.severity == "error");
        let code = first.map_or_else(String::new, |finding| finding.code.clone());
        Failure {
            exit: if code.is_empty() {
                exit::INVALID
            } else {
                codes::exit_code(&code)
            },
            body: Box::new(ErrorBody {
                code,
                message: what.to_owned(),
                help: None,
                diagnostics,
            }),
            source: Some(Box::new(source)),
        }
    }

    /// A configuration that is not valid.
    #[must_use]
    pub fn of_faults(what: &str, faults: &Faults) -> Failure {
        let source = faults
            .sources
            .first()
            .map_or_else(Default::default, |source| {
                (source.name.clone(), source.text.clone())
            });
        let mut failure = Failure::invalid(what, findings(faults), source);
        failure.exit = exit::INVALID;
        failure
    }

    /// As people read it.
    #[must_use]
    pub fn human(&self, colour: bool) -> String {
        let body = &self.body;
        if body.code.is_empty() && body.message.is_empty() {
            return String::new();
        }
        let drawn = self.diagnostics(colour);
        if !drawn.is_empty() {
            return drawn;
        }
        let (red, plain) = if colour {
            ("\x1b[31m", "\x1b[0m")
        } else {
            ("", "")
        };
        let (code, message) = (Printable(&body.code), Printable(&body.message));
        let mut text = format!("{red}error {code}{plain}: {message}\n");
        if let Some(help) = &body.help {
            text.push_str(&format!("       help: {}\n", Printable(help)));
        }
        text
    }

    fn diagnostics(&self, colour: bool) -> String {
        draw(&self.body.diagnostics, self.source.as_deref(), colour)
    }
}

/// Draws findings, with the lines of the text if it is here.
#[must_use]
pub fn draw(findings: &[Finding], source: Option<&(String, String)>, colour: bool) -> String {
    if findings.is_empty() {
        return String::new();
    }
    let local = source.filter(|(name, _)| {
        let mut placed = findings.iter().filter_map(|finding| finding.place.as_ref());
        placed.all(|place| place.file == *name)
    });
    match local {
        Some((name, text)) => {
            let rows: Vec<DiagnosticRow> = findings.iter().map(row).collect();
            let source = SourceText {
                name: name.clone(),
                text: text.clone(),
            };
            render(&rows, &[source], colour)
        }
        None => findings
            .iter()
            .map(|finding| Printable(&finding.rendered).to_string())
            .collect(),
    }
}

fn row(finding: &Finding) -> DiagnosticRow {
    let place = finding.place.clone().unwrap_or_default();
    DiagnosticRow {
        code: finding.code.clone(),
        severity: if finding.severity == "warning" {
            Severity::Warning
        } else {
            Severity::Error
        },
        message: finding.message.clone(),
        file: place.file,
        line: place.line,
        column: place.column,
        length: place.length,
        label: place.label,
        help: finding.help.clone(),
        used_at: finding.used_at.clone().map(|place| DiagnosticPosition {
            file: place.file,
            line: place.line,
            column: place.column,
            length: place.length,
            label: place.label,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_keeps_its_code_and_tells_the_remedy() {
        let failure = Failure::new(codes::BUSY, "line#2 needs lwr, which hold#1 holds", "wait");
        assert_eq!(failure.exit, exit::CONFLICT);
        assert_eq!(
            failure.human(false),
            "error RCC3004: line#2 needs lwr, which hold#1 holds\n       help: wait\n"
        );
    }

    #[test]
    fn an_invalid_text_ends_with_the_code_of_its_first_error() {
        let finding = Finding {
            code: "RCC3014".into(),
            severity: "error".into(),
            ..Finding::default()
        };
        let failure = Failure::invalid("rejected", vec![finding], Default::default());
        assert_eq!(failure.exit, exit::CONFLICT);
    }
}
