//! Suggestions for unknown names: "did you mean …?". Runs on the loader's threads.

use rcc_config::diagnostic::NameSearch;
use rcc_core::primitive::{PortType, Spec, UnitRule};
use rcc_core::primitives::CATALOGUE;
use rcc_core::unit::Unit;

use crate::syntax::reference::Reference;

/// Most names that are listed.
const LISTED_MAX: usize = 16;

/// Finds similar names, with a limited total cost.
#[derive(Debug, Default)]
pub struct Suggestions {
    search: NameSearch,
}

impl Suggestions {
    /// Returns the most similar name, if it is similar enough.
    pub fn near<'n>(
        &mut self,
        name: &str,
        known: impl Iterator<Item = &'n str>,
    ) -> Option<&'n str> {
        self.search.near(name, known)
    }

    /// Returns a similar name, or where the name is known, or all names.
    pub fn word<'n>(
        &mut self,
        name: &str,
        what: &str,
        known: impl Iterator<Item = &'n str> + Clone,
        elsewhere: Option<&str>,
    ) -> String {
        if let Some(elsewhere) = elsewhere {
            return format!("`{name}` is {elsewhere}; {}", list(what, known));
        }
        match self.near(name, known.clone()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => list(what, known),
        }
    }

    /// Suggests a type of the catalogue.
    pub fn primitive_type(&mut self, name: &str) -> String {
        let names = CATALOGUE.iter().map(|entry| entry.spec.name);
        match self.near(name, names) {
            Some(near) => format!("did you mean `{near}`?"),
            None => "`rcc-cli primitives` lists all types".to_string(),
        }
    }

    /// Suggests an output of a primitive.
    pub fn output(&mut self, reference: &Reference, spec: &Spec) -> String {
        let names = spec.outputs.iter().map(|port| port.name);
        let all = list("outputs", names.clone());
        let near = match spec.outputs {
            [only] => Some(only.name),
            _ => self.near(&reference.port, names),
        };
        match near {
            Some(near) => {
                let described = describe(spec, near);
                format!(
                    "did you mean `{}.{near}`{described}?   {all}",
                    reference.primitive
                )
            }
            None => all,
        }
    }
}

/// Suggests an output of the primitive `near`.
pub fn primitive(near: &str, port: &str, spec: &Spec) -> String {
    let same = spec.outputs.iter().find(|output| output.name == port);
    match same.or(spec.outputs.first()) {
        Some(output) => format!("did you mean `{near}.{}`?", output.name),
        None => format!("did you mean `{near}`? It has no outputs"),
    }
}

/// Returns type and unit of an output, as in ` (Real, N)`.
fn describe(spec: &Spec, output: &str) -> String {
    let Some((_, port)) = spec.output(output) else {
        return String::new();
    };
    let ty = match port.ty {
        PortType::Is(ty) => ty.to_string(),
        PortType::Joints => "Real, one a joint".to_string(),
        PortType::JointColumns(rows) => format!("Real[{rows},joints]"),
        _ => return String::new(),
    };
    match port.unit {
        UnitRule::Is(unit) => format!(" ({ty}, {unit})"),
        UnitRule::Joint(order) => {
            let [turning, linear] = [false, true].map(|linear| Unit::of_joints(linear, order));
            format!(" ({ty}, {turning} or {linear})")
        }
        _ => format!(" ({ty})"),
    }
}

fn list<'n>(what: &str, names: impl Iterator<Item = &'n str>) -> String {
    // There may be as many names as errors that list them.
    let names: Vec<&str> = names.take(LISTED_MAX + 1).collect();
    match names.len() {
        0 => format!("{what}: none"),
        count if count > LISTED_MAX => {
            let shown = names.get(..LISTED_MAX).unwrap_or_default();
            format!("{what}: {}, …", shown.join(", "))
        }
        _ => format!("{what}: {}", names.join(", ")),
    }
}
