//! One graph as straight-line Rust: a `let` a node, in the order of evaluation. What crosses from one function to another
//! or from one cycle to the next, and what nobody reads (the result), is kept in the `State`. Run by the build step.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write;

use serde_json::Value;

/// Nodes in one function: larger ones take the compiler more than linear time.
const NODES_IN_A_FUNCTION: usize = 500;

/// The four kinds of values, and the arrays of the state that hold them.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Real,
    Bool,
    Int,
    Matrix,
}

const KINDS: [(Kind, &str, &str); 4] = [
    (Kind::Real, "r", "0.0"),
    (Kind::Bool, "b", "FALSE"),
    (Kind::Int, "i", "0"),
    (Kind::Matrix, "m", "[0.0; 16]"),
];

/// One node of a graph.
struct Node<'a> {
    op: &'a str,
    inputs: Vec<(&'a str, &'a Value)>,
    params: &'a Vec<Value>,
}

impl Node<'_> {
    /// The nodes that it reads.
    fn sources(&self) -> impl Iterator<Item = usize> {
        let nodes = self.inputs.iter().filter(|(kind, _)| *kind == "n");
        nodes.map(|(_, index)| index.as_u64().unwrap_or(0) as usize)
    }

    fn kind(&self) -> Kind {
        match self.op {
            "gt" | "lt" | "and" | "or" | "not" | "xor" | "edge" | "isnull" | "igt" => Kind::Bool,
            "iadd" | "iand" | "count" => Kind::Int,
            "mkframe" | "mmul" | "minv" => Kind::Matrix,
            _ => Kind::Real,
        }
    }

    /// What it remembers besides its output.
    fn remembers(&self) -> Option<(Kind, String)> {
        match self.op {
            "lowpass" => Some((Kind::Real, "0.0".into())),
            "delay" => Some((Kind::Real, real(self.params.first()?))),
            "edge" => Some((Kind::Bool, "FALSE".into())),
            "count" => Some((Kind::Int, "0".into())),
            _ => None,
        }
    }
}

/// Places in the state.
#[derive(Default)]
struct Places {
    outputs: BTreeMap<usize, String>,
    memories: BTreeMap<usize, String>,
    starts: Vec<(String, String)>,
    counts: BTreeMap<Kind, usize>,
}

impl Places {
    fn take(&mut self, kind: Kind) -> String {
        let count = self.counts.entry(kind).or_default();
        *count += 1;
        format!("s.{}[{}]", KINDS[kind as usize].1, *count - 1)
    }

    fn of(graph: &[Node<'_>], sinks: &[usize]) -> Places {
        let mut places = Places::default();
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
                let place = places.take(node.kind());
                places.outputs.insert(index, place);
            }
            if let Some((kind, start)) = node.remembers() {
                let place = places.take(kind);
                places.starts.push((place.clone(), start));
                places.memories.insert(index, place);
            }
        }
        places
    }
}

/// Writes the module `<name>_<variant>`; `variant` is the module with the operations.
///
/// # Errors
/// The file is no graph.
pub fn write(
    code: &mut String,
    graph: &Value,
    name: &str,
    variant: &str,
) -> Result<(), Box<dyn Error>> {
    let nodes: Option<Vec<Node<'_>>> = graph["nodes"]
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
    let places = Places::of(&nodes, &sinks);
    writeln!(
        code,
        "mod {name}_{variant} {{\nuse super::{{Inputs, {variant}::*}};"
    )?;
    write_state(code, &places)?;
    let functions = nodes.chunks(NODES_IN_A_FUNCTION).enumerate();
    for (number, chunk) in functions.clone() {
        writeln!(
            code,
            "#[inline(never)] fn step_{number}(s: &mut State, x: &Inputs) {{"
        )?;
        for (offset, node) in chunk.iter().enumerate() {
            write_node(code, node, number * NODES_IN_A_FUNCTION + offset, &places)?;
        }
        writeln!(code, "}}")?;
    }
    writeln!(
        code,
        "#[inline(never)] fn step(s: &mut State, x: &Inputs) {{"
    )?;
    for (number, _) in functions {
        writeln!(code, "step_{number}(s, x);")?;
    }
    for (index, memory) in &places.memories {
        if let ("delay", Some(source)) = (nodes[*index].op, nodes[*index].sources().next()) {
            writeln!(code, "{memory} = {};", places.outputs[&source])?;
        }
    }
    writeln!(code, "}}")?;
    writeln!(code, "impl super::Program for State {{")?;
    writeln!(
        code,
        "fn run(&mut self, inputs: &[super::Inputs]) {{ for x in inputs {{ step(self, x); }} }}"
    )?;
    writeln!(
        code,
        "fn hash(&self) -> u64 {{ let (s, mut h) = (self, super::Hash::new());"
    )?;
    for sink in &sinks {
        let kind = KINDS[nodes[*sink].kind() as usize].1;
        writeln!(
            code,
            "{kind}_hash(&mut h, {});",
            places.outputs[sink].replace("s.", "&s.")
        )?;
    }
    writeln!(code, "h.value() }}\n}}\n}}")?;
    Ok(())
}

fn node(value: &Value) -> Option<Node<'_>> {
    let inputs = value["in"].as_array()?.iter();
    let inputs: Option<Vec<_>> = inputs
        .map(|input| Some((input[0].as_str()?, &input[1])))
        .collect();
    Some(Node {
        op: value["op"].as_str()?,
        inputs: inputs?,
        params: value["params"].as_array()?,
    })
}

fn write_state(code: &mut String, places: &Places) -> std::fmt::Result {
    let count = |kind| places.counts.get(&kind).copied().unwrap_or(0);
    writeln!(
        code,
        "#[allow(dead_code)] pub struct State {{ r: [f64; {}], b: [B; {}], i: [i64; {}], m: [[f64; 16]; {}] }}",
        count(Kind::Real),
        count(Kind::Bool),
        count(Kind::Int),
        count(Kind::Matrix)
    )?;
    write!(
        code,
        "impl State {{ pub fn new() -> State {{\nlet mut s = State {{ "
    )?;
    for (kind, array, zero) in KINDS {
        write!(code, "{array}: [{zero}; {}], ", count(kind))?;
    }
    writeln!(code, "}};")?;
    for (place, start) in &places.starts {
        writeln!(code, "{place} = {start};")?;
    }
    writeln!(code, "s }} }}")
}

fn write_node(
    code: &mut String,
    node: &Node<'_>,
    index: usize,
    places: &Places,
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
                let place = places.outputs.get(&source);
                if here {
                    format!("n{source}")
                } else {
                    place.cloned().unwrap_or_default()
                }
            }
        });
    }
    let memory = places.memories.get(&index);
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
    match places.outputs.get(&index) {
        Some(place) => writeln!(code, "{place} = n{index};"),
        None => Ok(()),
    }
}

/// A literal that is read back as the same bits.
fn real(value: &Value) -> String {
    format!("{:?}_f64", value.as_f64().unwrap_or(f64::NAN))
}
