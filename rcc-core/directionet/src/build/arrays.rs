//! Conversion of arrays: a changed array is a list of links, an element of one a part of a link. Sizes and indices come
//! from a text of anybody, so each is bounded before a list is made. Runs on the loader's threads.

use std::ops::Range;

use rcc_config::diagnostic::Span;
use rcc_language::codes;
use rcc_language::syntax::literal::{Literal, LiteralShape};

use super::{ARRAY_ELEMENTS_MAX, BuiltOutput, BuiltValue, Conversion};
use crate::table::{SpecialConversion, TypeEntry};

/// Longest array, elements.
const ELEMENTS_MAX: u32 = rcc_core::types::ELEMENTS_MAX as u32;

impl Conversion<'_, '_> {
    /// Returns some elements of an array of the text; the range has at most [`ELEMENTS_MAX`] elements.
    fn elements(&mut self, value: &BuiltValue, range: Range<u32>, span: Span) -> Vec<BuiltValue> {
        let index = |index: u32| {
            BuiltValue::Constant(Literal::new(LiteralShape::Int(i64::from(index)), span))
        };
        range
            .map(|it| match value {
                BuiltValue::Refused => BuiltValue::Refused,
                value => self.element(value, &index(it), span),
            })
            .collect()
    }

    /// Converts a new array, an element, a changed array, or a part of one.
    pub(super) fn array(
        &mut self,
        number: usize,
        entry: &'static TypeEntry,
        conversion: SpecialConversion,
    ) {
        let Some(size) = self.count(number, entry, "Size").filter(|size| *size > 0) else {
            return self.bad_size(number, 0);
        };
        if size > ELEMENTS_MAX {
            return self.bad_size(number, size);
        }
        let span = self.span(number);
        if conversion != SpecialConversion::ArrayGet && !self.has_room_for(size, span) {
            return self.put(number, "outArray", BuiltValue::Refused);
        }
        if conversion == SpecialConversion::Array {
            let element = entry.outputs.first().map(|port| port.ty.zero(span));
            let element = element.map_or(BuiltValue::Refused, BuiltValue::Constant);
            return self.put(
                number,
                "outArray",
                BuiltValue::List(vec![element; size as usize]),
            );
        }
        let (array, at) = self.argument(number, entry, "inArray");
        let name = if conversion == SpecialConversion::ArraySlice {
            "Start"
        } else {
            "Index"
        };
        let Some(index) = self.count(number, entry, name) else {
            return;
        };
        match conversion {
            SpecialConversion::ArrayGet => {
                let literal = Literal::new(LiteralShape::Int(i64::from(index)), span);
                let value = self.element(&array, &BuiltValue::Constant(literal), at);
                self.put(number, "outValue", value);
            }
            SpecialConversion::ArraySet => {
                let (value, _) = self.argument(number, entry, "inValue");
                let mut elements = self.elements(&array, 0..size, at);
                match elements.get_mut(index as usize) {
                    Some(element) => *element = value,
                    None => {
                        let message = format!(
                            "element {index} is out of range: the array has {size} elements"
                        );
                        self.error(codes::BAD_ELEMENT, span, message, None);
                    }
                }
                self.put(number, "outArray", BuiltValue::List(elements));
            }
            _ => {
                let elements = self.slice((&array, at), index, size, span);
                self.put(number, "outArray", elements);
            }
        }
    }

    /// Returns `size` elements from `start` on.
    fn slice(
        &mut self,
        (array, at): (&BuiltValue, Span),
        start: u32,
        size: u32,
        span: Span,
    ) -> BuiltValue {
        // The sum of two u32 may overflow.
        let end = start.saturating_add(size);
        if end <= ELEMENTS_MAX {
            return BuiltValue::List(self.elements(array, start..end, at));
        }
        let message = format!(
            "elements {start} to {} are out of range: an array has at most {ELEMENTS_MAX} elements",
            end - 1
        );
        let help = Some("elements are counted from 0; reduce `Start` or `Size`".to_string());
        self.error(codes::BAD_ELEMENT, span, message, help);
        BuiltValue::Refused
    }

    /// Counts the elements of an array of the net. Returns false if all arrays together are too large, which is
    /// reported once.
    fn has_room_for(&mut self, size: u32, span: Span) -> bool {
        self.array_elements = self.array_elements.saturating_add(size as usize);
        if self.array_elements <= ARRAY_ELEMENTS_MAX {
            return true;
        }
        if self.misread.insert(None) {
            let message =
                format!("the net's arrays have more than {ARRAY_ELEMENTS_MAX} elements together");
            let help = Some("use fewer or shorter arrays".to_string());
            self.error(codes::NET_TOO_LARGE, span, message, help);
        }
        false
    }

    fn bad_size(&mut self, number: usize, size: u32) {
        let message = format!("an array has 1 to {ELEMENTS_MAX} elements, not {size}");
        self.error(codes::OUT_OF_RANGE, self.span(number), message, None);
    }

    pub(super) fn array_is_null(&mut self, number: usize, entry: &'static TypeEntry) {
        let (value, span) = self.argument(number, entry, "inValue");
        let made = self.one(number, "IsNull", vec![("in", value, span)]);
        let value = self.built_output(made, "out");
        self.put(number, "outValue", value);
    }

    pub(super) fn array_set_null(&mut self, number: usize, entry: &'static TypeEntry) {
        let size = self.count(number, entry, "Size");
        // Each element may need a primitive of its own that converts its unit.
        let count = size.unwrap_or(0);
        if count > ELEMENTS_MAX {
            self.put(number, "outValue", BuiltValue::Refused);
            return self.bad_size(number, count);
        }
        if !self.has_room_for(count, self.span(number)) {
            return self.put(number, "outValue", BuiltValue::Refused);
        }
        let (value, span) = self.argument(number, entry, "inValue");
        let (condition, at) = self.argument(number, entry, "inNull");
        let inputs = vec![("in", value, span), ("condition", condition, at)];
        let made = self.one(number, "NullIf", inputs);
        let value = match self.built_output(made, "out") {
            BuiltValue::Output(output) => BuiltValue::Output(BuiltOutput {
                length: size,
                ..output
            }),
            value => value,
        };
        self.put(number, "outValue", value);
    }
}
