//! Totals of `check` over all files, and what it did not check.

use std::collections::BTreeMap;

use super::search::{CheckedKind, FoundFiles};
use super::verdict::FileVerdict;
use crate::context::Context;
use crate::failure::Failure;
use crate::table::counted;

/// Most files and endings that are named; further ones are counted.
const NAMED_MAX: usize = 8;

/// Totals over all files.
#[derive(Debug, Default)]
pub struct CheckSummary {
    kinds: BTreeMap<CheckedKind, u64>,
    valid: u64,
    /// Number of files with errors or denied findings.
    pub invalid: u64,
    errors: u64,
    warnings: u64,
    /// Files and folders that were not checked, with the reason.
    not_checked: Vec<(String, &'static str)>,
    other_endings: BTreeMap<String, u64>,
    /// Exit code for the first file that could not be read.
    pub unreadable: Option<u8>,
}

impl CheckSummary {
    /// Returns the number of checked files.
    pub fn checked(&self) -> u64 {
        self.valid + self.invalid
    }

    /// Adds a verdict.
    pub fn count(&mut self, verdict: &FileVerdict) {
        let errors = verdict
            .diagnostics
            .iter()
            .filter(|finding| finding.severity == "error");
        let errors = errors.count() as u64;
        self.errors += errors;
        self.warnings += verdict.diagnostics.len() as u64 - errors;
        *self.kinds.entry(verdict.kind).or_default() += 1;
        if verdict.valid {
            self.valid += 1;
        } else {
            self.invalid += 1;
        }
    }

    /// Adds a file that could not be read, and prints why.
    pub fn unreadable(&mut self, context: &Context, failure: &Failure) {
        context.print_failure(failure);
        self.unreadable.get_or_insert(failure.exit);
    }

    /// Adds what a search found besides the files to check.
    pub fn passed_over(&mut self, found: &mut FoundFiles) {
        self.not_checked.append(&mut found.passed_over);
        for (ending, count) in std::mem::take(&mut found.other_endings) {
            *self.other_endings.entry(ending).or_default() += count;
        }
    }

    /// Adds a file whose kind is not recognised.
    pub fn of_no_kind(&mut self, file: String) {
        let reason = "no key `net`, `library`, `task`, `cell` or `robot`";
        self.not_checked.push((file, reason));
    }

    /// Describes what was not checked, one line a reason; empty if that is nothing.
    pub fn not_checked(&self) -> Vec<String> {
        let mut lines: Vec<String> = self
            .not_checked
            .iter()
            .take(NAMED_MAX)
            .map(|(file, reason)| format!("not checked: {file}: {reason}"))
            .collect();
        if let Some(more @ 1..) = self.not_checked.len().checked_sub(NAMED_MAX) {
            let more = counted(more as u64, "other file");
            lines.push(format!("not checked: {more} of no known kind"));
        }
        if !self.other_endings.is_empty() {
            let count = self.other_endings.values().sum();
            let named = self.other_endings.keys().take(NAMED_MAX);
            let named: Vec<String> = named
                .map(|ending| match ending.as_str() {
                    "" => "none".to_owned(),
                    ending => format!(".{ending}"),
                })
                .collect();
            let more = match self.other_endings.len() > NAMED_MAX {
                true => ", …",
                false => "",
            };
            lines.push(format!(
                "not checked: {} by {} ({}{more})",
                counted(count, "file"),
                if count == 1 {
                    "its ending"
                } else {
                    "their endings"
                },
                named.join(", ")
            ));
        }
        lines
    }

    /// Returns the totals in one line.
    pub fn text(&self, seconds: f64) -> String {
        let mut summary = match self.invalid {
            0 if self.checked() == 1 => format!("{}: valid", self.files()),
            0 => format!("{}: all valid", self.files()),
            invalid => format!(
                "{}: {} valid, {} not",
                self.files(),
                crate::table::grouped(self.valid),
                crate::table::grouped(invalid)
            ),
        };
        let found = [
            (self.errors, counted(self.errors, "error")),
            (self.warnings, counted(self.warnings, "warning")),
        ];
        for (count, text) in found {
            if count > 0 {
                summary.push_str(&format!(", {text}"));
            }
        }
        format!("{summary}; {seconds:.2} s")
    }

    /// Counts the checked files by their kinds: `22 nets, 6 cells and 7 robots`.
    fn files(&self) -> String {
        let count = |kind| self.kinds.get(&kind).copied().unwrap_or(0);
        let nets = count(CheckedKind::Net) + count(CheckedKind::DirectIoNet);
        let kinds = [
            (nets, "net"),
            (count(CheckedKind::Library), "library"),
            (count(CheckedKind::Task), "task"),
            (count(CheckedKind::Cell), "cell"),
            (count(CheckedKind::Robot), "robot"),
        ];
        let present = kinds.into_iter().filter(|(count, _)| *count > 0);
        let parts: Vec<String> = present.map(|(count, noun)| counted(count, noun)).collect();
        match parts.as_slice() {
            [] => "0 nets".to_owned(),
            [only] => only.clone(),
            [first @ .., last] => format!("{} and {last}", first.join(", ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_api::bodies::Finding;

    fn verdict(kind: CheckedKind, valid: bool, severities: &[&str]) -> FileVerdict {
        let finding = |severity: &&str| Finding {
            severity: (*severity).to_owned(),
            ..Finding::default()
        };
        FileVerdict {
            file: String::new(),
            kind,
            valid,
            net: String::new(),
            primitives: 0,
            rehearsal: None,
            diagnostics: severities.iter().map(finding).collect(),
            summary: String::new(),
        }
    }

    #[test]
    fn a_summary_counts_files_by_kind_and_their_findings() {
        let mut summary = CheckSummary::default();
        summary.count(&verdict(CheckedKind::Net, true, &[]));
        assert_eq!(summary.text(0.5), "1 net: valid; 0.50 s");
        summary.count(&verdict(CheckedKind::DirectIoNet, true, &["warning"]));
        summary.count(&verdict(
            CheckedKind::Net,
            false,
            &["error", "error", "warning"],
        ));
        assert_eq!(
            summary.text(0.5),
            "3 nets: 2 valid, 1 not, 2 errors, 2 warnings; 0.50 s"
        );
        summary.count(&verdict(CheckedKind::Cell, true, &[]));
        summary.count(&verdict(CheckedKind::Robot, true, &[]));
        assert_eq!(
            summary.text(0.5),
            "3 nets, 1 cell and 1 robot: 4 valid, 1 not, 2 errors, 2 warnings; 0.50 s"
        );
    }

    #[test]
    fn what_is_not_checked_is_named_with_its_reason_and_cut_with_a_count() {
        let mut summary = CheckSummary::default();
        assert!(summary.not_checked().is_empty());
        summary.of_no_kind("package.json".to_owned());
        let endings = ["", "md"].map(|ending| (ending.to_owned(), 2));
        summary.passed_over(&mut FoundFiles {
            files: Vec::new(),
            other_endings: endings.into(),
            passed_over: vec![("pipe.yaml".to_owned(), "not a regular file")],
        });
        assert_eq!(
            summary.not_checked(),
            [
                "not checked: package.json: no key `net`, `library`, `task`, `cell` or `robot`",
                "not checked: pipe.yaml: not a regular file",
                "not checked: 4 files by their endings (none, .md)",
            ]
        );
        (0..20).for_each(|number| summary.of_no_kind(number.to_string()));
        let lines = summary.not_checked();
        assert_eq!(lines.len(), NAMED_MAX + 2);
        assert_eq!(
            lines[NAMED_MAX],
            "not checked: 14 other files of no known kind"
        );
    }
}
