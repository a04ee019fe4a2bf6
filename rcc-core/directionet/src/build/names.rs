//! Checks the names of types, parameters and inputs in a text. Runs on the loader's threads.

use rcc_config::yaml::Key;
use rcc_language::codes;

use super::Conversion;
use crate::flatten::FlatPrimitive;
use crate::table::{self, Counterpart, TypeEntry};

impl<'t> Conversion<'t, '_> {
    /// Looks up the type of a primitive, and checks the names of its parameters and inputs.
    pub(super) fn check_names(
        &mut self,
        primitive: &FlatPrimitive<'t>,
    ) -> Option<&'static TypeEntry> {
        let Some(entry) = table::all().get(primitive.ty.name.as_str()) else {
            let message = format!("the predecessor has no type `{}`", primitive.ty.name);
            let names = table::all().keys().map(String::as_str);
            let help = self.suggest(&primitive.ty.name, names);
            self.error(codes::UNKNOWN_TYPE, primitive.ty.span, message, help);
            return None;
        };
        for (key, ..) in &primitive.parameters {
            if entry.parameter(&key.name).is_none() {
                let known = entry.parameters.iter().map(|port| port.name);
                self.no_such(codes::UNKNOWN_PARAMETER, "parameter", key, entry, known);
            }
        }
        for (key, _) in &primitive.inputs {
            if entry.input(&key.name).is_none() {
                let known = entry.inputs.iter().map(|port| port.name);
                self.no_such(codes::UNKNOWN_INPUT, "input", key, entry, known);
            }
        }
        if let Counterpart::None(_) = entry.row.to {
            let message = format!("`{}` has no counterpart: {}", entry.name, entry.row.note);
            let help =
                Some("docs/from-the-predecessor.md lists the counterpart of each type".into());
            self.error(codes::NO_COUNTERPART, primitive.ty.span, message, help);
            return None;
        }
        Some(entry)
    }

    fn no_such(
        &mut self,
        code: &'static str,
        what: &str,
        key: &Key,
        entry: &TypeEntry,
        known: impl Iterator<Item = &'static str>,
    ) {
        let known: Vec<&str> = known.collect();
        let help = match known.as_slice() {
            [] => Some(format!("it has no {what}s")),
            known => self
                .suggest(&key.name, known.iter().copied())
                .or_else(|| Some(format!("{what}s: {}", known.join(", ")))),
        };
        let message = format!("{} has no {what} `{}`", entry.name, key.name);
        self.error(code, key.span, message, help);
    }
}
