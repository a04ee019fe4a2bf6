//! Arguments of primitives, with null replaced as the predecessor does: by the last known value, or by a constant. Runs
//! on the loader's threads.

use rcc_config::diagnostic::Span;
use rcc_language::syntax::literal::{Literal, LiteralShape};

use super::{BuiltValue, Conversion};
use crate::flatten::FlatSource;
use crate::table::{ForeignPort, NullReading, TypeEntry};

impl<'t> Conversion<'t, '_> {
    /// Returns the value of an input or parameter of a primitive, which the net of its row refers to as `parent.name`.
    pub(super) fn argument(
        &mut self,
        number: usize,
        entry: &'static TypeEntry,
        name: &str,
    ) -> (BuiltValue, Span) {
        let span = self.span(number);
        let Some(port) = entry.input(name).copied() else {
            let literal = self.parameter(number, entry, name);
            let span = literal.as_ref().map_or(span, |literal| literal.span);
            return (
                literal.map_or(BuiltValue::Refused, BuiltValue::Constant),
                span,
            );
        };
        let otherwise = name
            .strip_prefix("in")
            .filter(|stem| entry.parameter(stem).is_some());
        let constant = |build: &mut Self| match otherwise {
            Some(stem) => build.parameter(number, entry, stem),
            None => Some(port.ty.zero(span)),
        };
        let Some((key, source)) = self.given(number, name) else {
            let constant = constant(self).map_or(BuiltValue::Refused, BuiltValue::Constant);
            return (constant, span);
        };
        let value = self.value(source);
        if !self.can_be_null(source) || entry.row.reads == NullReading::Null {
            return (value, key.span);
        }
        let Some(constant) = constant(self) else {
            return (BuiltValue::Refused, key.span);
        };
        (
            self.without_null(value, constant, entry.row.reads, port),
            key.span,
        )
    }

    /// Returns true if an output of the text can be null in the predecessor: conditional primitives, and some types.
    fn can_be_null(&self, source: FlatSource<'t>) -> bool {
        let FlatSource::Output { primitive, .. } = source else {
            return false;
        };
        let entry = self.entries.get(primitive).copied().flatten();
        let conditional = self
            .flat
            .primitives
            .get(primitive)
            .is_some_and(|primitive| {
                !primitive.active.is_empty()
                    || primitive
                        .inputs
                        .iter()
                        .any(|(key, _)| key.name == "inActive")
            });
        conditional || entry.is_some_and(|entry| entry.row.may_be_null)
    }

    /// Replaces null as the predecessor does: by the last known value, or by a constant.
    fn without_null(
        &mut self,
        value: BuiltValue,
        constant: Literal,
        reads: NullReading,
        port: ForeignPort,
    ) -> BuiltValue {
        match value {
            BuiltValue::Refused | BuiltValue::Constant(_) => value,
            BuiltValue::List(elements) => {
                let mut constants = match constant.shape {
                    LiteralShape::List(constants) => constants.into_iter(),
                    _ => Vec::new().into_iter(),
                };
                let elements = elements.into_iter().map(|element| {
                    let constant = constants.next();
                    let constant = constant.unwrap_or_else(|| port.ty.zero(Span::default()));
                    self.without_null(element, constant, reads, port)
                });
                BuiltValue::List(elements.collect())
            }
            value => {
                let span = self.span(self.current);
                let key = format!("{reads:?} {value:?} {constant:?}");
                let inputs = vec![("in", value, span)];
                let name = if reads == NullReading::Parameter {
                    "known"
                } else {
                    "last"
                };
                let made = self.shared(key, "OrElse", name, Vec::new(), inputs);
                let other = match (reads, self.built_output(made, "out")) {
                    // The last known value: the output itself, in the previous cycle.
                    (NullReading::Last, BuiltValue::Output(output)) => {
                        BuiltValue::Before(Box::new((output, constant)))
                    }
                    _ => BuiltValue::Constant(constant),
                };
                if let Some(built) = self
                    .built
                    .get_mut(made)
                    .filter(|built| built.inputs.len() == 1)
                {
                    built.inputs.push(("other", other, span));
                }
                self.built_output(made, "out")
            }
        }
    }
}
