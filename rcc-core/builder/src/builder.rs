//! The builder of one net: its primitives, delayed links and discarded outputs, converted to the syntax tree of the
//! language. Used by applications, never on a real-time thread.

mod ports;
mod tree;

use std::cell::RefCell;
use std::marker::PhantomData;

use rcc_config::diagnostic::Faults;
use rcc_config::yaml;
use rcc_config::yaml::layout::{Tree, render};
use rcc_language::parse::read_net;
use rcc_language::syntax::Net;
use rcc_language::write;
use thiserror::Error;

use crate::value::{Real, Type, Value};

pub(crate) use ports::LinkSource;
pub use ports::{AnyIn, Delayed, In, Node, Out};

/// Error while building a net.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum BuildError {
    /// A delayed link was used but never connected to a source.
    #[error("the delayed link of `{primitive}.{input}` has no source: call `feed` on it")]
    NeverFed {
        /// Id of the primitive whose input the link feeds.
        primitive: String,
        /// Name of the input.
        input: String,
    },
    /// A matrix has no such element.
    #[error(
        "`{output}[{row},{column}]` does not exist: the matrix has {rows} rows and {columns} columns, counted from 0"
    )]
    NoElement {
        /// The output: `primitive.port`.
        output: String,
        /// Row, from 0.
        row: usize,
        /// Column, from 0.
        column: usize,
        /// Number of rows.
        rows: usize,
        /// Number of columns.
        columns: usize,
    },
    /// A name or a constant is not valid in the language, or an id is used twice. The diagnostics refer to the
    /// generated text.
    #[error("{0}")]
    Faulty(Faults),
}

/// Builds one net.
#[derive(Debug)]
pub struct NetBuilder {
    pub(crate) state: RefCell<NetState>,
}

#[derive(Debug, Default)]
pub(crate) struct NetState {
    name: String,
    /// Top-level keys of the net that precede its primitives.
    keys: Vec<(String, Tree)>,
    pub(crate) fragments: Vec<(String, Tree)>,
    pub(crate) nodes: Vec<NodeState>,
    delayed: Vec<DelayedState>,
    discard: Vec<String>,
    /// Outputs that must be read or discarded.
    outputs: Vec<String>,
    /// The first mistake that the types of the ports do not exclude.
    mistake: Option<BuildError>,
    /// Number of generated ids.
    generated_ids: usize,
}

#[derive(Debug)]
pub(crate) struct NodeState {
    pub(crate) id: String,
    pub(crate) kind: &'static str,
    pub(crate) type_name: String,
    parameters: Vec<(String, Tree)>,
    inputs: Vec<(String, LinkSource)>,
    active: Option<LinkSource>,
}

#[derive(Debug)]
struct DelayedState {
    initial: Option<Tree>,
    from: Option<String>,
}

impl NetBuilder {
    /// Creates a net without primitives. Names consist of lower-case letters, digits and `-`.
    #[must_use]
    pub fn new(name: &str) -> NetBuilder {
        NetBuilder {
            state: RefCell::new(NetState {
                name: name.to_string(),
                ..NetState::default()
            }),
        }
    }

    /// Sets the description for people.
    pub fn describe(&self, description: &str) {
        self.key("description", Tree::Text(description.to_string()));
    }

    /// Sets the evaluation period, a multiple of the cell's period: `5e-3` or `"5 ms"`.
    pub fn every(&self, period: impl Into<Value<Real>>) {
        self.key("period", period.into().tree());
    }

    /// Lets the net continue with null when a device that it commands is lost.
    pub fn survive_device_loss(&self) {
        self.key("on_device_loss", Tree::Plain("null".to_string()));
    }

    fn key(&self, key: &str, value: Tree) {
        let keys = &mut self.state.borrow_mut().keys;
        keys.retain(|(name, _)| name != key);
        keys.push((key.to_string(), value));
    }

    /// Creates a delayed link with this value in the first cycle.
    pub fn delayed<T: Type>(&self, initial: impl Into<Value<T>>) -> Delayed<'_, T> {
        self.delayed_link(Some(initial.into().tree()))
    }

    /// Creates a delayed link that is null in the first cycle; only for links that close no loop.
    pub fn delayed_from_null<T: Type>(&self) -> Delayed<'_, T> {
        self.delayed_link(None)
    }

    fn delayed_link<T>(&self, initial: Option<Tree>) -> Delayed<'_, T> {
        let delayed = &mut self.state.borrow_mut().delayed;
        delayed.push(DelayedState {
            initial,
            from: None,
        });
        Delayed {
            net: self,
            index: delayed.len() - 1,
            ty: PhantomData,
        }
    }

    /// Declares that an output is deliberately not read.
    pub fn discard<T: Type>(&self, output: Out<'_, T>) {
        let name = output.name();
        self.state.borrow_mut().discard.push(name);
    }

    /// Declares that all outputs that are not read so far are deliberately not read.
    pub fn discard_rest(&self) {
        let mut state = self.state.borrow_mut();
        let read = state.read();
        let rest: Vec<String> = state
            .outputs
            .iter()
            .filter(|name| !read.contains(*name))
            .cloned()
            .collect();
        state.discard.extend(rest);
    }

    /// Adds a primitive.
    pub(crate) fn node(&self, type_name: &str, id: &str) -> Node<'_> {
        self.add_node("type", type_name, id)
    }

    pub(crate) fn add_node(&self, kind: &'static str, type_name: &str, id: &str) -> Node<'_> {
        let nodes = &mut self.state.borrow_mut().nodes;
        nodes.push(NodeState {
            id: id.to_string(),
            kind,
            type_name: type_name.to_string(),
            parameters: Vec::new(),
            inputs: Vec::new(),
            active: None,
        });
        Node {
            net: self,
            index: nodes.len() - 1,
        }
    }

    /// Generates an id that no primitive has.
    pub(crate) fn id(&self, word: &str) -> String {
        let mut state = self.state.borrow_mut();
        loop {
            state.generated_ids += 1;
            let id = format!("{word}_{}", state.generated_ids);
            if state.nodes.iter().all(|node| node.id != id) {
                return id;
            }
        }
    }

    /// Returns the net as the model of the language.
    ///
    /// # Errors
    /// Returns the faults, with positions in the generated text, if the net is not valid. Types, units and loops are
    /// checked when it is loaded.
    pub fn build(&self) -> Result<Net, BuildError> {
        let state = self.state.borrow();
        let text = render(&state.tree()?);
        let file = state.name.as_str();
        let root = yaml::parse(&text)
            .map_err(|faults| BuildError::Faulty(Faults::new(file, &text, faults)))?;
        let mut faults = Vec::new();
        let net = read_net(&root, &mut faults);
        match net {
            Some(net) if faults.is_empty() => Ok(net),
            _ => Err(BuildError::Faulty(Faults::new(file, &text, faults))),
        }
    }

    /// Returns the net as text in the layout of `rcc-cli fmt`, for example for `rcc-cli load -`.
    ///
    /// # Errors
    /// As [`NetBuilder::build`].
    pub fn to_yaml(&self) -> Result<String, BuildError> {
        self.build().map(|net| write::yaml(&net))
    }
}
