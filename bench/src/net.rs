//! Translates a graph to the text of a net, with one primitive per node: constants are literals, external inputs are
//! channels of a station, a `delay` is a delayed link. Any thread.

use std::collections::{BTreeMap, BTreeSet};

use crate::graph::{Graph, GraphNode, NodeInput, NodeValue, Op};

/// Name of the device whose channels are the external inputs.
pub const DEVICE: &str = "station";

/// A net, and the outputs that carry the results of the graph's nodes.
#[derive(Clone, Debug)]
pub struct GraphNet {
    /// The text, JSON.
    pub text: String,
    /// The output that carries the result of each node, by node.
    pub outputs: Vec<OutputRef>,
}

/// An output, or one of its elements.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct OutputRef {
    /// Id of the primitive.
    pub id: String,
    /// Name of the output.
    pub port: &'static str,
    /// Index of the element, if it is one.
    pub index: Option<i64>,
}

impl OutputRef {
    fn out(id: String) -> OutputRef {
        OutputRef {
            id,
            port: "out",
            index: None,
        }
    }

    fn text(&self) -> String {
        match self.index {
            Some(index) => format!("{}.{}[{index}]", self.id, self.port),
            None => format!("{}.{}", self.id, self.port),
        }
    }
}

/// Translates a graph to a net.
#[must_use]
pub fn net(graph: &Graph) -> GraphNet {
    let mut writer = GraphNetWriter {
        outputs: outputs(graph),
        primitives: BTreeMap::new(),
        read: BTreeSet::new(),
    };
    for (number, node) in graph.nodes.iter().enumerate() {
        writer.node(number, node);
    }
    writer.primitive("end", "Termination", &[("done", "false".into())], "");
    let all = writer.primitives.keys().filter(|id| *id != "end");
    let unread = all.filter(|id| !writer.read.contains(*id));
    let discard: Vec<String> = unread.map(|id| format!("\"{id}.out\"")).collect();
    let rows: Vec<String> = writer.primitives.into_values().collect();
    let text = format!(
        "{{\"net\": \"{}-{}\", \"primitives\": {{\n{}\n}}, \"discard\": [{}]}}\n",
        graph.mix,
        graph.nodes.len(),
        rows.join(",\n"),
        discard.join(", ")
    );
    GraphNet {
        text,
        outputs: writer.outputs,
    }
}

/// Returns the output with the result of each node: an element of a transform is read in place, everything else is an
/// output of its own.
fn outputs(graph: &Graph) -> Vec<OutputRef> {
    let mut outputs = Vec::new();
    for (number, node) in graph.nodes.iter().enumerate() {
        let element = match (node.op, &node.inputs[..], &node.params[..]) {
            (Op::Mget, [NodeInput::Node(from)], [NodeValue::Int(index)]) => Some((from, index)),
            _ => None,
        };
        outputs.push(match element {
            Some((from, index)) => OutputRef {
                index: Some(*index),
                ..OutputRef::out(format!("n{from}"))
            },
            None => OutputRef::out(format!("n{number}")),
        });
    }
    outputs
}

struct GraphNetWriter {
    outputs: Vec<OutputRef>,
    /// Text of each primitive, by id.
    primitives: BTreeMap<String, String>,
    /// Ids of primitives that have a reader.
    read: BTreeSet<String>,
}

impl GraphNetWriter {
    fn primitive(&mut self, id: &str, ty: &str, inputs: &[(&str, String)], parameters: &str) {
        let inputs: Vec<String> = inputs
            .iter()
            .map(|(port, source)| format!("\"{port}\": {source}"))
            .collect();
        let mut text = format!("\"{id}\": {{\"type\": \"{ty}\"");
        if !parameters.is_empty() {
            text += &format!(", \"parameters\": {{{parameters}}}");
        }
        if !inputs.is_empty() {
            text += &format!(", \"inputs\": {{{}}}", inputs.join(", "));
        }
        self.primitives.insert(id.to_string(), text + "}");
    }

    /// Returns the text of an input's source; external inputs become primitives at their first use.
    fn source(&mut self, source: &NodeInput) -> String {
        let (id, ty, channel) = match source {
            NodeInput::Constant(value) => return literal(value),
            NodeInput::Node(number) => {
                let output = self.outputs[*number].clone();
                self.read.insert(output.id.clone());
                return format!("\"{}\"", output.text());
            }
            NodeInput::Real(k) => (format!("u{k}"), "AnalogInput", format!("u{k}")),
            NodeInput::Bool(k) => (format!("v{k}"), "DigitalInput", format!("v{k}")),
        };
        let parameters = format!("\"device\": \"{DEVICE}\", \"channel\": \"{channel}\"");
        self.primitive(&id, ty, &[], &parameters);
        self.read.insert(id.clone());
        format!("\"{id}.out\"")
    }

    fn node(&mut self, number: usize, node: &GraphNode) {
        if self.outputs[number].index.is_some() {
            return;
        }
        let id = format!("n{number}");
        let inputs: Vec<String> = node.inputs.iter().map(|s| self.source(s)).collect();
        let mut parameters = node.params.iter().map(literal);
        let mut parameter = || parameters.next().unwrap_or_default();
        let (ty, ports): (&str, &[&str]) = match node.op {
            Op::Add | Op::Iadd => ("Add", &["a", "b"]),
            Op::Sub => ("Subtract", &["a", "b"]),
            Op::Mul => ("Multiply", &["a", "b"]),
            Op::Div => ("Divide", &["a", "b"]),
            Op::Min => ("Min", &["a", "b"]),
            Op::Max => ("Max", &["a", "b"]),
            Op::Gt | Op::Igt => ("Greater", &["a", "b"]),
            Op::Lt => ("Less", &["a", "b"]),
            Op::And => ("And", &["a", "b"]),
            Op::Or => ("Or", &["a", "b"]),
            Op::Xor => ("Xor", &["a", "b"]),
            Op::Not => ("Not", &["in"]),
            Op::Abs => ("Abs", &["in"]),
            Op::Neg => ("Negate", &["in"]),
            Op::I2r => ("ToReal", &["in"]),
            Op::Isnull => ("IsNull", &["in"]),
            Op::Count => ("Counter", &["in"]),
            Op::Nullif => ("NullIf", &["in", "condition"]),
            Op::Select => ("Select", &["condition", "no", "yes"]),
            Op::Mmul => ("Compose", &["a", "b"]),
            Op::Minv => ("Invert", &["in"]),
            // Its result is an element of another primitive's output.
            Op::Mget => return,
            Op::Edge => {
                let inputs = with_ports(&["in"], inputs);
                return self.primitive(&id, "RisingEdge", &inputs, "\"initial\": false");
            }
            Op::Lowpass => {
                let gain = format!("\"gain\": {}", parameter());
                return self.primitive(&id, "LowPass", &with_ports(&["in"], inputs), &gain);
            }
            Op::Mkframe => {
                let rows: [String; 3] = std::array::from_fn(|_| {
                    let row: [String; 3] = std::array::from_fn(|_| parameter());
                    format!("[{}]", row.join(", "))
                });
                let rotation = format!("\"rotation\": [{}]", rows.join(", "));
                let inputs = with_ports(&["x", "y", "z"], inputs);
                return self.primitive(&id, "TransformFromPosition", &inputs, &rotation);
            }
            Op::Sqrt => {
                self.primitive(
                    &format!("{id}_abs"),
                    "Abs",
                    &with_ports(&["in"], inputs),
                    "",
                );
                self.read.insert(format!("{id}_abs"));
                let inputs = with_ports(&["in"], vec![format!("\"{id}_abs.out\"")]);
                return self.primitive(&id, "SquareRoot", &inputs, "");
            }
            Op::Limit => {
                let inputs = inputs.into_iter().chain([parameter(), parameter()]);
                let inputs = with_ports(&["in", "low", "high"], inputs.collect());
                return self.primitive(&id, "Limit", &inputs, "");
            }
            Op::Dflt => {
                let inputs = inputs.into_iter().chain([parameter()]).collect();
                return self.primitive(&id, "OrElse", &with_ports(&["in", "other"], inputs), "");
            }
            Op::Iand => {
                let inputs = inputs.into_iter().chain([parameter()]).collect();
                return self.primitive(&id, "BitAnd", &with_ports(&["a", "b"], inputs), "");
            }
            Op::Delay => {
                // Null is delayed too. A delayed link alone would do, but a loop that can keep null forever is refused;
                // the rule accepts this `Select`, whose condition is constant, as a way out of the loop.
                let link = format!(
                    "{{\"from\": {}, \"delayed\": true, \"initial\": {}}}",
                    inputs.join(""),
                    parameter()
                );
                let inputs = vec!["true".to_string(), link, "0.0".to_string()];
                let inputs = with_ports(&["condition", "yes", "no"], inputs);
                return self.primitive(&id, "Select", &inputs, "");
            }
        };
        self.primitive(&id, ty, &with_ports(ports, inputs), "");
    }
}

fn with_ports<'p>(ports: &[&'p str], inputs: Vec<String>) -> Vec<(&'p str, String)> {
    ports.iter().copied().zip(inputs).collect()
}

/// Formats a constant as the shortest text that reads as the same double.
fn literal(value: &NodeValue) -> String {
    match value {
        NodeValue::Bool(value) => value.to_string(),
        NodeValue::Int(value) => value.to_string(),
        NodeValue::Real(value) => format!("{value:?}"),
        NodeValue::Transform(elements) => format!("{elements:?}"),
    }
}
