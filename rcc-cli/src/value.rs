//! Formats port values for people: null stays null, numbers have few digits, angles are in degrees on request. Pure.

use rcc_api::bodies::ValueView;
use serde_json::Value;

use crate::table;

/// Formatting options.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Style {
    /// Show angles in degrees.
    pub degrees: bool,
}

impl Style {
    /// Returns the value in the displayed unit.
    #[must_use]
    pub fn value(self, view: &ValueView) -> Value {
        match self.factor(view) {
            Some(factor) => scaled(&view.value, factor),
            None => view.value.clone(),
        }
    }

    /// Returns the displayed unit; empty if there is none.
    #[must_use]
    pub fn unit(self, view: &ValueView) -> String {
        let unit = view.unit.clone().unwrap_or_default();
        match self.factor(view) {
            Some(_) => unit.replacen("rad", "deg", 1),
            None => unit,
        }
    }

    /// Formats the value for people.
    #[must_use]
    pub fn human(self, view: &ValueView) -> String {
        human(&self.value(view))
    }

    /// Returns the conversion factor of angles and their time derivatives; `None` for other units.
    fn factor(self, view: &ValueView) -> Option<f64> {
        let unit = view.unit.as_deref().unwrap_or_default();
        let angle = unit == "rad" || unit.starts_with("rad/s");
        (self.degrees && angle).then_some(1f64.to_degrees())
    }
}

fn scaled(value: &Value, factor: f64) -> Value {
    match value {
        Value::Number(number) => number
            .as_f64()
            .map_or_else(|| value.clone(), |number| Value::from(number * factor)),
        Value::Array(elements) => elements.iter().map(|value| scaled(value, factor)).collect(),
        other => other.clone(),
    }
}

fn human(value: &Value) -> String {
    match value {
        Value::Number(number) if number.is_f64() => {
            let number = number.as_f64().unwrap_or(f64::NAN);
            match number.abs() {
                size if size != 0.0 && !(1e-4..1e6).contains(&size) => format!("{number:.4e}"),
                _ => format!("{number:.6}"),
            }
        }
        Value::Array(elements) => {
            let elements: Vec<String> = elements.iter().map(human).collect();
            format!("[{}]", elements.join(", "))
        }
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// Formats values as a table, one row per port.
#[must_use]
pub fn rows(values: &[ValueView], style: Style) -> String {
    let mut rows = table::table(&["PORT", "VALUE", "UNIT"]);
    for view in values {
        let unit = match (view.unit.as_ref(), view.ty.as_str()) {
            (Some(_), _) => style.unit(view),
            // The type of these implies their units.
            (None, ty @ ("Pose" | "Rotation" | "Twist" | "Wrench")) => ty.to_owned(),
            (None, _) => String::new(),
        };
        rows.add_row([view.port.clone(), style.human(view), unit]);
    }
    table::text(&rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(unit: &str, value: Value) -> ValueView {
        ValueView {
            port: "a.out".to_owned(),
            ty: "Real".to_owned(),
            unit: Some(unit.to_owned()),
            value,
        }
    }

    #[test]
    fn angles_are_shown_in_degrees_and_nothing_else_is() {
        let style = Style { degrees: true };
        let half = view("rad", Value::from(std::f64::consts::PI));
        assert_eq!(
            (style.human(&half), style.unit(&half)),
            ("180.000000".into(), "deg".into())
        );
        let list = view("rad/s", serde_json::json!([0.0, null]));
        assert_eq!(
            (style.human(&list), style.unit(&list)),
            ("[0.000000, null]".into(), "deg/s".into())
        );
        let length = view("m", Value::from(1.0));
        assert_eq!(
            (style.human(&length), style.unit(&length)),
            ("1.000000".into(), "m".into())
        );
        assert_eq!(Style::default().unit(&half), "rad");
    }

    #[test]
    fn null_is_null_and_numbers_have_few_digits() {
        assert_eq!(human(&Value::Null), "null");
        assert_eq!(human(&Value::from(-7)), "-7");
        assert_eq!(human(&Value::from(1.5e-9)), "1.5000e-9");
        assert_eq!(human(&Value::Bool(true)), "true");
    }
}
