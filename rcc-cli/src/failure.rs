//! Failures of verbs: the same body as over HTTP, plus the exit code. Created and printed by the main thread.

use rcc_api::bodies::{ErrorBody, Finding};
use rcc_api::codes::{self, ErrorCode, exit};
use rcc_api::compile::findings;
use rcc_config::diagnostic::{
    DiagnosticPosition, DiagnosticRow, DrawingStyle, Faults, Severity, SourceText, render,
};
use rcc_core::printable::Printable;

use rcc_terminal::text::between_words;

/// A verb's failure, as reported to the person or program that called it.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// Exit code of the program.
    pub exit: u8,
    /// Code, message and help. Nothing is printed if code and message are empty: the verb has already printed its own.
    pub body: Box<ErrorBody>,
    /// Name and content of the text that the diagnostics refer to.
    pub source: Option<Box<(String, String)>>,
}

impl Failure {
    /// Creates a failure with a code of the table.
    pub fn new(code: ErrorCode, message: impl Into<String>, help: impl Into<String>) -> Failure {
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

    /// Converts the server's error answer.
    #[must_use]
    pub fn from_server(body: ErrorBody) -> Failure {
        Failure {
            exit: codes::exit_code(&body.code),
            body: Box::new(body),
            source: None,
        }
    }

    /// Ends with this exit code without printing anything more.
    #[must_use]
    pub fn reported(exit: u8) -> Failure {
        Failure {
            exit,
            body: Box::default(),
            source: None,
        }
    }

    /// Failure of a verb that was ended by Ctrl-C.
    #[must_use]
    pub fn interrupted() -> Failure {
        Failure::reported(exit::INTERRUPTED)
    }

    /// Failure to read a file.
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

    /// Failure for an invalid text, with its findings. The exit code is that of the first error.
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

    /// Failure for an invalid configuration.
    #[must_use]
    pub fn from_faults(what: &str, faults: &Faults) -> Failure {
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

    /// Formats the failure as text for people.
    #[must_use]
    pub fn human(&self, style: DrawingStyle) -> String {
        let body = &self.body;
        if body.code.is_empty() && body.message.is_empty() {
            return String::new();
        }
        let drawn = draw(&body.diagnostics, self.source.as_deref(), style);
        if !drawn.is_empty() {
            return drawn;
        }
        let (red, plain) = if style.colour {
            ("\x1b[31m", "\x1b[0m")
        } else {
            ("", "")
        };
        let code = Printable(&body.code).to_string();
        let message = hanging(
            "error : ",
            code.chars().count(),
            &body.message,
            style.columns,
        );
        let mut text = format!("{red}error {code}{plain}: {message}\n");
        if let Some(help) = &body.help {
            let help = hanging("       help: ", 0, help, style.columns);
            text.push_str(&format!("       help: {help}\n"));
        }
        text
    }
}

/// Wraps a sentence that stands behind `head` and `more` columns on a terminal; further rows are indented by 7.
fn hanging(head: &str, more: usize, sentence: &str, columns: Option<usize>) -> String {
    let sentence = Printable(sentence).to_string();
    let Some(columns) = columns else {
        return sentence;
    };
    let first = " ".repeat(head.chars().count() + more);
    let options = between_words(columns)
        .initial_indent(&first)
        .subsequent_indent("       ");
    let filled = textwrap::fill(&sentence, options);
    filled.get(first.len()..).unwrap_or(&sentence).to_owned()
}

/// Renders findings; includes lines of the text if all places refer to it.
#[must_use]
pub fn draw(
    findings: &[Finding],
    source: Option<&(String, String)>,
    style: DrawingStyle,
) -> String {
    if findings.is_empty() {
        return String::new();
    }
    let local = source.filter(|(name, _)| {
        let mut placed = findings.iter().filter_map(|finding| finding.place.as_ref());
        placed.all(|location| location.file == *name)
    });
    if let Some((name, text)) = local {
        let rows: Vec<DiagnosticRow> = findings.iter().map(row).collect();
        let source = SourceText {
            name: name.clone(),
            text: text.clone(),
        };
        return render(&rows, &[source], style);
    }
    // The compiler drew them with lines of texts that are not here, for 100 columns.
    let fits = |drawn: &str| {
        let widest = drawn.lines().map(|line| line.chars().count()).max();
        style
            .columns
            .is_none_or(|columns| widest.unwrap_or(0) <= columns)
    };
    findings
        .iter()
        .map(|finding| match fits(&finding.rendered) {
            true => Printable(&finding.rendered).to_string(),
            false => render(&[row(finding)], &[], style),
        })
        .collect()
}

fn row(finding: &Finding) -> DiagnosticRow {
    let location = finding.place.clone().unwrap_or_default();
    DiagnosticRow {
        code: finding.code.clone(),
        severity: if finding.severity == "warning" {
            Severity::Warning
        } else {
            Severity::Error
        },
        message: finding.message.clone(),
        file: location.file,
        line: location.line,
        column: location.column,
        length: location.length,
        label: location.label,
        help: finding.help.clone(),
        used_at: finding.used_at.clone().map(|location| DiagnosticPosition {
            file: location.file,
            line: location.line,
            column: location.column,
            length: location.length,
            label: location.label,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_keeps_its_code_and_shows_the_remedy() {
        let failure = Failure::new(codes::BUSY, "line#2 needs lwr, which hold#1 holds", "wait");
        assert_eq!(failure.exit, exit::CONFLICT);
        assert_eq!(
            failure.human(DrawingStyle::default()),
            "error RCC3004: line#2 needs lwr, which hold#1 holds\n       help: wait\n"
        );
        let narrow = DrawingStyle {
            colour: false,
            columns: Some(40),
        };
        assert_eq!(
            failure.human(narrow),
            "error RCC3004: line#2 needs lwr, which\n       hold#1 holds\n       help: wait\n"
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
