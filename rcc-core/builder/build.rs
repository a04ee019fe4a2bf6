//! Generates a method of `NetBuilder` for every primitive of the catalogue: required parameters and inputs are
//! arguments, optional ones are methods of the returned type, outputs are its fields.

use std::fmt::Write;
use std::path::Path;

use rcc_core::primitive::{Parameter, ParameterKind, Port, PortType, Spec};
use rcc_core::primitives::CATALOGUE;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let mut code = String::new();
    for entry in CATALOGUE {
        primitive(&mut code, &entry.spec);
    }
    let folder = std::env::var("OUT_DIR").expect("cargo sets it");
    std::fs::write(Path::new(&folder).join("primitives.rs"), code)
        .expect("cargo created the folder");
}

/// Rust type of a port.
enum RustType {
    /// A type of the language, as a path.
    Is(String),
    /// The generic type of the primitive.
    Open,
    /// Only known when the net is loaded.
    Untyped,
}

fn kind(ty: PortType) -> RustType {
    if let PortType::Is(ty) = ty {
        let name = format!("{ty:?}");
        return match name.split_once('(') {
            None => RustType::Is(format!("crate::{name}")),
            Some(("Reals", length)) => {
                RustType::Is(format!("crate::Reals<{}>", length.trim_end_matches(')')))
            }
            Some(("Matrix", sizes)) => {
                RustType::Is(format!("crate::Matrix<{}>", sizes.trim_end_matches(')')))
            }
            Some(_) => RustType::Untyped,
        };
    }
    match format!("{ty:?}").as_str() {
        "Any" | "Scalar" | "Number" | "Linear" => RustType::Open,
        "Joints" => RustType::Is("crate::Joints".to_string()),
        _ => RustType::Untyped,
    }
}

/// Returns the trait bound of the generic type.
fn bound(spec: &Spec) -> Option<&'static str> {
    let ports = spec.inputs.iter().chain(spec.outputs).map(|port| port.ty);
    let values = spec
        .parameters
        .iter()
        .filter_map(|parameter| Some(parameter.kind.value()?.0));
    let names: Vec<String> = ports.chain(values).map(|ty| format!("{ty:?}")).collect();
    ["Number", "Scalar", "Linear", "Any"]
        .into_iter()
        .find(|wanted| names.iter().any(|name| name == wanted))
}

fn bound_path(bound: &str) -> &'static str {
    match bound {
        "Number" => "crate::Number",
        "Scalar" => "crate::Scalar",
        "Linear" => "crate::Linear",
        _ => "crate::Type",
    }
}

fn input_type(port: &Port) -> String {
    match kind(port.ty) {
        RustType::Is(ty) => format!("crate::In<'n, {ty}>"),
        RustType::Open => "crate::In<'n, T>".to_string(),
        RustType::Untyped => "crate::AnyIn<'n>".to_string(),
    }
}

fn output_type(port: &Port) -> String {
    match kind(port.ty) {
        RustType::Is(ty) => ty,
        RustType::Open => "T".to_string(),
        RustType::Untyped => "crate::Untyped".to_string(),
    }
}

fn parameter_type(parameter: &Parameter) -> String {
    let is_name = matches!(
        parameter.kind,
        ParameterKind::Arm
            | ParameterKind::Device
            | ParameterKind::Channel(_)
            | ParameterKind::Word(_)
            | ParameterKind::Topic
            | ParameterKind::Type
            | ParameterKind::Unit(_)
    );
    if is_name {
        return "crate::Value<crate::Text>".to_string();
    }
    if matches!(parameter.kind, ParameterKind::Rate) {
        return "crate::Value<crate::Real>".to_string();
    }
    match parameter.kind.value().map(|(ty, _)| kind(ty)) {
        Some(RustType::Is(ty)) => format!("crate::Value<{ty}>"),
        Some(RustType::Open) => "crate::Value<T>".to_string(),
        _ => "crate::AnyValue".to_string(),
    }
}

fn snake(name: &str) -> String {
    let mut snake = String::new();
    let mut before = '_';
    for c in name.chars() {
        if c.is_uppercase() && (before.is_lowercase() || before.is_ascii_digit()) {
            snake.push('_');
        }
        snake.extend(c.to_lowercase());
        before = c;
    }
    word(&snake)
}

/// Escapes a name that is a Rust keyword.
fn word(name: &str) -> String {
    const WORDS: &[&str] = &[
        "in", "type", "match", "loop", "move", "where", "while", "if", "else", "for", "as", "mod",
        "use", "let", "fn", "self", "true", "false", "ref", "box", "yield", "final", "id",
        "static", "const",
    ];
    let end = if WORDS.contains(&name) { "_" } else { "" };
    format!("{name}{end}")
}

fn doc(text: &str) -> String {
    text.replace('\n', " ")
        .replace('[', "\\[")
        .replace(']', "\\]")
        .replace('<', "&lt;")
}

/// Writing to a String cannot fail.
macro_rules! put {
    ($code:expr, $($more:tt)*) => { writeln!($code, $($more)*).expect("writing to a String cannot fail") };
}

fn primitive(code: &mut String, spec: &Spec) {
    let name = spec.name;
    let bound = bound(spec);
    let optional_inputs: Vec<&Port> = spec
        .inputs
        .iter()
        .filter(|port| port.default.is_some())
        .collect();
    let optional: Vec<&Parameter> = spec
        .parameters
        .iter()
        .filter(|one| one.default.is_some())
        .collect();
    let mut used: Vec<String> = spec.outputs.iter().map(output_type).collect();
    used.extend(optional_inputs.iter().map(|port| input_type(port)));
    used.extend(optional.iter().map(|one| parameter_type(one)));
    let is_open = |ty: &String| ty == "T" || ty.contains(" T>") || ty.contains("<T>");
    let generic = bound.is_some() && used.iter().any(is_open);
    let (of, bounded) = match bound {
        Some(bound) if generic => ("<'n, T>", format!("<'n, T: {}>", bound_path(bound))),
        _ => ("<'n>", "<'n>".to_string()),
    };
    put!(code, "/// {}", doc(spec.summary));
    put!(
        code,
        "#[derive(Clone, Copy, Debug)]\npub struct {name}{of} {{"
    );
    put!(code, "    node: crate::Node<'n>,");
    for port in spec.outputs {
        put!(code, "    /// {}.", doc(port.doc));
        put!(
            code,
            "    pub {}: crate::Out<'n, {}>,",
            word(port.name),
            output_type(port)
        );
    }
    if generic {
        put!(code, "    open: core::marker::PhantomData<T>,");
    }
    put!(code, "}}\n");
    put!(code, "impl{bounded} {name}{of} {{");
    for one in &optional {
        put!(code, "    /// {}.", doc(one.doc));
        put!(
            code,
            "    pub fn {}(self, value: impl Into<{}>) -> Self {{",
            word(one.name),
            parameter_type(one)
        );
        put!(
            code,
            "        self.node.parameter({:?}, value.into().tree());\n        self\n    }}",
            one.name
        );
    }
    for port in &optional_inputs {
        put!(code, "    /// {}.", doc(port.doc));
        put!(
            code,
            "    pub fn {}(self, source: impl Into<{}>) -> Self {{",
            word(port.name),
            input_type(port)
        );
        put!(
            code,
            "        self.node.input({:?}, source.into().source());\n        self\n    }}",
            port.name
        );
    }
    let taken = spec.parameters.iter().any(|one| one.name == "active")
        || spec.inputs.iter().any(|port| port.name == "active");
    if !taken {
        put!(
            code,
            "    /// Evaluates the primitive only while `source` is true; otherwise its outputs are null."
        );
        put!(
            code,
            "    pub fn active(self, source: impl Into<crate::In<'n, crate::Bool>>) -> Self {{"
        );
        put!(
            code,
            "        self.node.active(source.into().source());\n        self\n    }}"
        );
    }
    put!(code, "}}\n");
    method(code, spec, bound, generic);
}

fn method(code: &mut String, spec: &Spec, bound: Option<&str>, generic: bool) {
    let name = spec.name;
    let parameters = || spec.parameters.iter().filter(|one| one.default.is_none());
    let inputs = || spec.inputs.iter().filter(|port| port.default.is_none());
    let (open, of) = match bound {
        Some(bound) => (
            format!("<'n, T: {}>", bound_path(bound)),
            if generic { "<'n, T>" } else { "<'n>" },
        ),
        None => ("<'n>".to_string(), "<'n>"),
    };
    put!(
        code,
        "impl crate::NetBuilder {{\n    /// {}",
        doc(spec.summary)
    );
    put!(code, "    ///");
    for one in parameters() {
        put!(code, "    /// - `{}`: {}", word(one.name), doc(one.doc));
    }
    for port in inputs() {
        put!(code, "    /// - `{}`: {}", word(port.name), doc(port.doc));
    }
    put!(code, "    ///\n    /// Null: {}.", doc(spec.null));
    put!(code, "    pub fn {}{open}(&'n self, id: &str", snake(name));
    for one in parameters() {
        put!(
            code,
            "        , {}: impl Into<{}>",
            word(one.name),
            parameter_type(one)
        );
    }
    for port in inputs() {
        let twin = parameters().any(|one| one.name == port.name);
        let end = if twin { "_input" } else { "" };
        put!(
            code,
            "        , {}{end}: impl Into<{}>",
            word(port.name),
            input_type(port)
        );
    }
    put!(
        code,
        "    ) -> {name}{of} {{\n        let node = self.node({name:?}, id);"
    );
    for one in parameters() {
        put!(
            code,
            "        node.parameter({:?}, {}.into().tree());",
            one.name,
            word(one.name)
        );
    }
    for port in inputs() {
        let twin = parameters().any(|one| one.name == port.name);
        let end = if twin { "_input" } else { "" };
        put!(
            code,
            "        node.input({:?}, {}{end}.into().source());",
            port.name,
            word(port.name)
        );
    }
    put!(code, "        {name} {{\n            node,");
    for port in spec.outputs {
        put!(
            code,
            "            {}: node.output({:?}, {}),",
            word(port.name),
            port.name,
            port.diagnostic
        );
    }
    if generic {
        put!(code, "            open: core::marker::PhantomData,");
    }
    put!(code, "        }}\n    }}\n}}\n");
}
