//! Translates one graph to straight-line Rust: one `let` per node, in the order of evaluation. Values that cross
//! functions or cycles, and the sinks, are stored in `State`. Run by the build script.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write;

use serde_json::Value;

/// Maximum number of nodes per function: the compile time of larger functions grows more than linearly.
const NODES_IN_A_FUNCTION: usize = 500;

/// The four types of values, which select the arrays of the state.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum ValueKind {
    Real,
    Bool,
    Int,
    Matrix,
}

const KINDS: [(ValueKind, &str, &str); 4] = [
    (ValueKind::Real, "r", "0.0"),
    (ValueKind::Bool, "b", "FALSE"),
    (ValueKind::Int, "i", "0"),
    (ValueKind::Matrix, "m", "[0.0; 16]"),
];

/// One node of a graph.
struct GeneratedNode<'a> {
    op: &'a str,
    inputs: Vec<(&'a str, &'a Value)>,
    params: &'a Vec<Value>,
}

impl GeneratedNode<'_> {
    /// Returns the nodes that it reads.
    fn sources(&self) -> impl Iterator<Item = usize> {
        let nodes = self.inputs.iter().filter(|(kind, _)| *kind == "n");
        nodes.map(|(_, index)| index.as_u64().unwrap_or(0) as usize)
    }

    fn kind(&self) -> ValueKind {
        match self.op {
            "gt" | "lt" | "and" | "or" | "not" | "xor" | "edge" | "isnull" | "igt" => {
                ValueKind::Bool
            }
            "iadd" | "iand" | "count" => ValueKind::Int,
            "mkframe" | "mmul" | "minv" => ValueKind::Matrix,
            _ => ValueKind::Real,
        }
    }

    /// Returns the type and initial value of its memory, if it has any besides its output.
    fn remembers(&self) -> Option<(ValueKind, String)> {
        match self.op {
            "lowpass" => Some((ValueKind::Real, "0.0".into())),
            "delay" => Some((ValueKind::Real, real(self.params.first()?))),
            "edge" => Some((ValueKind::Bool, "FALSE".into())),
            "count" => Some((ValueKind::Int, "0".into())),
            _ => None,
        }
    }
}

/// Layout of the state: the element that stores each output and memory.
#[derive(Default)]
struct StateLayout {
    outputs: BTreeMap<usize, String>,
    memories: BTreeMap<usize, String>,
    starts: Vec<(String, String)>,
    counts: BTreeMap<ValueKind, usize>,
}

impl StateLayout {
    fn take(&mut self, kind: ValueKind) -> String {
        let count = self.counts.entry(kind).or_default();
        *count += 1;
        format!("s.{}[{}]", KINDS[kind as usize].1, *count - 1)
    }

    fn of(graph: &[GeneratedNode<'_>], sinks: &[usize]) -> StateLayout {
        let mut layout = StateLayout::default();
        let mut kept: Vec<bool> = vec![false; graph.len()];
        sinks.iter().for_each(|sink| kept[*sink] = true);
        for (index, node) in graph.iter().enumerate() {
            for source in node.sources() {
                let elsewhere = source / NODES_IN_A_FUNCTION != index / NODES_IN_A_FUNCTION;
                kept[source] |= elsewhere || node.op == "delay";
            }
        }
        for (index, node) in graph.iter().enumerate() {
            if kept[index] {
                let place = layout.take(node.kind());
                layout.outputs.insert(index, place);
            }
            if let Some((kind, start)) = node.remembers() {
                let place = layout.take(kind);
                layout.starts.push((place.clone(), start));
                layout.memories.insert(index, place);
            }
        }
        layout
    }
}

/// Writes the module `<name>_<variant>`; `variant` names the module with the operations.
///
/// # Errors
/// Returns an error if the value is not a graph.
pub fn write(
    code: &mut String,
    graph: &Value,
    name: &str,
    variant: &str,
) -> Result<(), Box<dyn Error>> {
    let nodes: Option<Vec<GeneratedNode<'_>>> = graph["nodes"]
        .as_array()
        .ok_or("no nodes")?
        .iter()
        .map(node)
        .collect();
    let nodes = nodes.ok_or("a node lacks something")?;
    let sinks = graph["sinks"].as_array().ok_or("no sinks")?.iter();
    let sinks: Vec<usize> = sinks
        .filter_map(Value::as_u64)
        .map(|sink| sink as usize)
        .collect();
    let layout = StateLayout::of(&nodes, &sinks);
    writeln!(
        code,
        "mod {name}_{variant} {{\nuse super::{{GraphInputs, {variant}::*}};"
    )?;
    write_state(code, &layout)?;
    let functions = nodes.chunks(NODES_IN_A_FUNCTION).enumerate();
    for (number, chunk) in functions.clone() {
        writeln!(
            code,
            "#[inline(never)] fn step_{number}(s: &mut State, x: &GraphInputs) {{"
        )?;
        for (offset, node) in chunk.iter().enumerate() {
            write_node(code, node, number * NODES_IN_A_FUNCTION + offset, &layout)?;
        }
        writeln!(code, "}}")?;
    }
    writeln!(
        code,
        "#[inline(never)] fn step(s: &mut State, x: &GraphInputs) {{"
    )?;
    for (number, _) in functions {
        writeln!(code, "step_{number}(s, x);")?;
    }
    for (index, memory) in &layout.memories {
        if let ("delay", Some(source)) = (nodes[*index].op, nodes[*index].sources().next()) {
            writeln!(code, "{memory} = {};", layout.outputs[&source])?;
        }
    }
    writeln!(code, "}}")?;
    writeln!(code, "impl super::CycleProgram for State {{")?;
    writeln!(
        code,
        "fn run(&mut self, inputs: &[super::GraphInputs]) {{ for x in inputs {{ step(self, x); }} }}"
    )?;
    writeln!(
        code,
        "fn hash(&self) -> u64 {{ let (s, mut h) = (self, super::WordHash::new());"
    )?;
    for sink in &sinks {
        let kind = KINDS[nodes[*sink].kind() as usize].1;
        writeln!(
            code,
            "{kind}_hash(&mut h, {});",
            layout.outputs[sink].replace("s.", "&s.")
        )?;
    }
    writeln!(code, "h.value() }}\n}}\n}}")?;
    Ok(())
}

fn node(value: &Value) -> Option<GeneratedNode<'_>> {
    let inputs = value["in"].as_array()?.iter();
    let inputs: Option<Vec<_>> = inputs
        .map(|input| Some((input[0].as_str()?, &input[1])))
        .collect();
    Some(GeneratedNode {
        op: value["op"].as_str()?,
        inputs: inputs?,
        params: value["params"].as_array()?,
    })
}

fn write_state(code: &mut String, layout: &StateLayout) -> std::fmt::Result {
    let count = |kind| layout.counts.get(&kind).copied().unwrap_or(0);
    writeln!(
        code,
        "#[allow(dead_code)] pub struct State {{ r: [f64; {}], b: [B; {}], i: [i64; {}], m: [[f64; 16]; {}] }}",
        count(ValueKind::Real),
        count(ValueKind::Bool),
        count(ValueKind::Int),
        count(ValueKind::Matrix)
    )?;
    write!(
        code,
        "impl State {{ pub fn new() -> State {{\nlet mut s = State {{ "
    )?;
    for (kind, array, zero) in KINDS {
        write!(code, "{array}: [{zero}; {}], ", count(kind))?;
    }
    writeln!(code, "}};")?;
    for (place, start) in &layout.starts {
        writeln!(code, "{place} = {start};")?;
    }
    writeln!(code, "s }} }}")
}

fn write_node(
    code: &mut String,
    node: &GeneratedNode<'_>,
    index: usize,
    layout: &StateLayout,
) -> std::fmt::Result {
    let mut arguments = Vec::new();
    for (kind, value) in &node.inputs {
        arguments.push(match *kind {
            "u" => format!("x.u[{value}]"),
            "v" => format!("truth(x.v[{value}])"),
            "k" if value.is_boolean() => format!("truth({value})"),
            "k" if value.is_i64() => value.to_string(),
            "k" => real(value),
            _ => {
                let source = value.as_u64().unwrap_or(0) as usize;
                let here =
                    source / NODES_IN_A_FUNCTION == index / NODES_IN_A_FUNCTION && source < index;
                let place = layout.outputs.get(&source);
                if here {
                    format!("n{source}")
                } else {
                    place.cloned().unwrap_or_default()
                }
            }
        });
    }
    let memory = layout.memories.get(&index);
    if node.op == "delay" {
        // Its input is copied after the last node.
        writeln!(
            code,
            "let n{index} = {};",
            memory.cloned().unwrap_or_default()
        )?;
    } else {
        let matrices = matches!(node.op, "mget" | "mmul" | "minv");
        if matrices {
            arguments
                .iter_mut()
                .for_each(|argument| argument.insert(0, '&'));
        }
        for param in node.params {
            arguments.push(if param.is_f64() {
                real(param)
            } else {
                param.to_string()
            });
        }
        arguments.extend(memory.map(|memory| format!("&mut {memory}")));
        writeln!(
            code,
            "let n{index} = {}({});",
            node.op,
            arguments.join(", ")
        )?;
    }
    match layout.outputs.get(&index) {
        Some(place) => writeln!(code, "{place} = n{index};"),
        None => Ok(()),
    }
}

/// Formats a literal that reads as the same bits.
fn real(value: &Value) -> String {
    format!("{:?}_f64", value.as_f64().unwrap_or(f64::NAN))
}
