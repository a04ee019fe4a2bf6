//! The builder: primitives with their sources, delayed links, and the conversion to the model of the language. Used by
//! applications, never on a real-time thread.

use std::cell::RefCell;
use std::collections::HashSet;
use std::marker::PhantomData;

use rcc_config::diagnostic::Faults;
use rcc_config::yaml;
use rcc_config::yaml::layout::{Tree, TreeBlock, TreeEntry, render};
use rcc_language::parse::read_net;
use rcc_language::syntax::Net;
use rcc_language::write;
use thiserror::Error;

use crate::value::{AnyValue, Real, Type, Untyped, Value};

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

/// Source of an input.
#[derive(Clone, Debug)]
pub(crate) enum LinkSource {
    Output(String),
    Constant(Tree),
    Delayed(usize),
}

/// A primitive in the net that is being built.
#[derive(Clone, Copy, Debug)]
pub struct Node<'n> {
    net: &'n NetBuilder,
    index: usize,
}

/// An output of a primitive.
#[derive(Clone, Copy, Debug)]
pub struct Out<'n, T> {
    pub(crate) net: &'n NetBuilder,
    at: OutputLocation,
    ty: PhantomData<T>,
}

/// Location of an output.
#[derive(Clone, Copy, Debug)]
enum OutputLocation {
    /// Port of a primitive by index and name, and optionally an element of it.
    Port(usize, &'static str, Option<usize>),
    /// Index into the table of names that are not `&'static str`, and optionally an element.
    Named(usize, Option<usize>),
}

/// Source of an input: an output, a delayed link, or a constant.
#[derive(Clone, Debug)]
pub struct In<'n, T> {
    source: LinkSource,
    ty: PhantomData<(&'n (), T)>,
}

/// Source of an input whose type is only known when the net is loaded.
#[derive(Clone, Debug)]
pub struct AnyIn<'n> {
    source: LinkSource,
    net: PhantomData<&'n ()>,
}

/// A link that carries the value of the previous cycle. Its source is set later with [`Delayed::feed`], so that loops
/// can be built.
#[derive(Clone, Copy, Debug)]
pub struct Delayed<'n, T> {
    net: &'n NetBuilder,
    index: usize,
    ty: PhantomData<T>,
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

impl NetState {
    /// Returns the outputs that are read or discarded.
    fn read(&self) -> HashSet<String> {
        let sources = self.nodes.iter().flat_map(|node| {
            let inputs = node.inputs.iter().map(|(_, source)| source);
            inputs.chain(&node.active)
        });
        let links = sources.filter_map(|source| match source {
            LinkSource::Output(name) => Some(name),
            LinkSource::Delayed(index) => self.delayed.get(*index)?.from.as_ref(),
            LinkSource::Constant(_) => None,
        });
        let whole = |name: &String| name.split('[').next().unwrap_or_default().to_string();
        links.chain(&self.discard).map(whole).collect()
    }

    fn tree(&self) -> Result<Tree, BuildError> {
        let mut entries = vec![("net".to_string(), Tree::Text(self.name.clone()))];
        entries.extend(self.keys.iter().cloned());
        if !self.fragments.is_empty() {
            entries.push((
                "fragments".to_string(),
                Tree::map(self.fragments.iter().cloned()),
            ));
        }
        entries.extend(self.body()?);
        Ok(Tree::map(entries))
    }

    /// Returns `primitives` and `discard` of a net or a fragment.
    pub(crate) fn body(&self) -> Result<Vec<(String, Tree)>, BuildError> {
        let mut entries = Vec::new();
        for node in &self.nodes {
            entries.push(TreeEntry::new(node.id.as_str(), self.node_tree(node)?));
        }
        let primitives = Tree::Map(TreeBlock {
            open: true,
            ..TreeBlock::new(entries)
        });
        let mut body = vec![("primitives".to_string(), primitives)];
        if !self.discard.is_empty() {
            let outputs = self.discard.iter().map(|name| Tree::Text(name.clone()));
            body.push(("discard".to_string(), Tree::list(outputs)));
        }
        Ok(body)
    }

    fn node_tree(&self, node: &NodeState) -> Result<Tree, BuildError> {
        let mut entries = vec![(node.kind.to_string(), Tree::Text(node.type_name.clone()))];
        if !node.parameters.is_empty() {
            entries.push((
                "parameters".to_string(),
                Tree::map(node.parameters.iter().cloned()),
            ));
        }
        let mut inputs = Vec::new();
        for (input, source) in &node.inputs {
            inputs.push((input.clone(), self.source_tree(node, input, source)?));
        }
        if !inputs.is_empty() {
            entries.push(("inputs".to_string(), Tree::map(inputs)));
        }
        if let Some(active) = &node.active {
            entries.push((
                "active".to_string(),
                self.source_tree(node, "active", active)?,
            ));
        }
        Ok(Tree::map(entries))
    }

    fn source_tree(
        &self,
        node: &NodeState,
        input: &str,
        source: &LinkSource,
    ) -> Result<Tree, BuildError> {
        let index = match source {
            LinkSource::Output(name) => return Ok(Tree::Text(name.clone())),
            LinkSource::Constant(tree) => return Ok(tree.clone()),
            LinkSource::Delayed(index) => *index,
        };
        let delayed = self.delayed.get(index);
        let Some((delayed, from)) =
            delayed.and_then(|delayed| Some((delayed, delayed.from.as_ref()?)))
        else {
            return Err(BuildError::NeverFed {
                primitive: node.id.clone(),
                input: input.to_string(),
            });
        };
        let mut entries = vec![
            ("from".to_string(), Tree::Text(from.clone())),
            ("delayed".to_string(), Tree::Plain("true".to_string())),
        ];
        entries.extend(
            delayed
                .initial
                .clone()
                .map(|initial| ("initial".to_string(), initial)),
        );
        Ok(Tree::map(entries))
    }
}

/// Sets the value of a key, replacing an earlier one.
fn put<V>(entries: &mut Vec<(String, V)>, key: &str, value: V) {
    entries.retain(|(name, _)| name != key);
    entries.push((key.to_string(), value));
}

impl<'n> Node<'n> {
    fn with(self, change: impl FnOnce(&mut NodeState)) {
        if let Some(node) = self.net.state.borrow_mut().nodes.get_mut(self.index) {
            change(node);
        }
    }

    pub(crate) fn parameter(self, name: &str, value: Tree) {
        self.with(|node| put(&mut node.parameters, name, value));
    }

    pub(crate) fn input(self, name: &str, source: LinkSource) {
        self.with(|node| put(&mut node.inputs, name, source));
    }

    pub(crate) fn active(self, source: LinkSource) {
        self.with(|node| node.active = Some(source));
    }

    pub(crate) fn output<T>(self, port: &'static str, diagnostic: bool) -> Out<'n, T> {
        let out = Out {
            net: self.net,
            at: OutputLocation::Port(self.index, port, None),
            ty: PhantomData,
        };
        if !diagnostic {
            let name = out.name();
            self.net.state.borrow_mut().outputs.push(name);
        }
        out
    }

    /// Returns an output by a name that is not from the catalogue.
    pub(crate) fn named<T>(self, port: &str) -> Out<'n, T> {
        let mut state = self.net.state.borrow_mut();
        let id = state
            .nodes
            .get(self.index)
            .map(|node| node.id.clone())
            .unwrap_or_default();
        let name = format!("{id}.{port}");
        let index = state.outputs.iter().position(|output| *output == name);
        let index = index.unwrap_or_else(|| {
            state.outputs.push(name);
            state.outputs.len() - 1
        });
        Out {
            net: self.net,
            at: OutputLocation::Named(index, None),
            ty: PhantomData,
        }
    }
}

impl<'n, T> Out<'n, T> {
    pub(crate) fn name(&self) -> String {
        let state = self.net.state.borrow();
        let (name, element) = match self.at {
            OutputLocation::Port(node, port, element) => {
                let id = state.nodes.get(node).map_or("", |node| node.id.as_str());
                (format!("{id}.{port}"), element)
            }
            OutputLocation::Named(index, element) => (
                state.outputs.get(index).cloned().unwrap_or_default(),
                element,
            ),
        };
        match element {
            Some(element) => format!("{name}[{element}]"),
            None => name,
        }
    }

    fn at<U>(self, element: usize) -> Out<'n, U> {
        Out {
            net: self.net,
            at: match self.at {
                OutputLocation::Port(node, port, _) => {
                    OutputLocation::Port(node, port, Some(element))
                }
                OutputLocation::Named(index, _) => OutputLocation::Named(index, Some(element)),
            },
            ty: PhantomData,
        }
    }
}

impl<'n> Out<'n, Untyped> {
    /// Asserts the type; if it is wrong, the net is refused when it is loaded.
    #[must_use]
    pub fn assume<T: Type>(self) -> Out<'n, T> {
        Out {
            net: self.net,
            at: self.at,
            ty: PhantomData,
        }
    }
}

impl<'n> Out<'n, crate::Joints> {
    /// Returns one joint, counted from 0.
    #[must_use]
    pub fn joint(self, index: usize) -> Out<'n, Real> {
        self.at(index)
    }
}

impl<'n, const N: usize> Out<'n, crate::Reals<N>> {
    /// Returns one element, counted from 0.
    #[must_use]
    pub fn element(self, index: usize) -> Out<'n, Real> {
        self.at(index)
    }
}

impl<'n, const R: usize, const C: usize> Out<'n, crate::Matrix<R, C>> {
    /// Returns one element; row and column are counted from 0.
    #[must_use]
    pub fn element(self, row: usize, column: usize) -> Out<'n, Real> {
        self.at(row * C + column)
    }
}

impl<T> In<'_, T> {
    pub(crate) fn constant(tree: Tree) -> Self {
        In {
            source: LinkSource::Constant(tree),
            ty: PhantomData,
        }
    }

    pub(crate) fn source(self) -> LinkSource {
        self.source
    }
}

impl AnyIn<'_> {
    pub(crate) fn constant(tree: Tree) -> Self {
        AnyIn {
            source: LinkSource::Constant(tree),
            net: PhantomData,
        }
    }

    pub(crate) fn source(self) -> LinkSource {
        self.source
    }
}

impl<'n, T> From<Out<'n, T>> for In<'n, T> {
    fn from(output: Out<'n, T>) -> In<'n, T> {
        In {
            source: LinkSource::Output(output.name()),
            ty: PhantomData,
        }
    }
}

impl<'n, T> From<Delayed<'n, T>> for In<'n, T> {
    fn from(delayed: Delayed<'n, T>) -> In<'n, T> {
        In {
            source: LinkSource::Delayed(delayed.index),
            ty: PhantomData,
        }
    }
}

impl<T> From<Value<T>> for In<'_, T> {
    fn from(value: Value<T>) -> Self {
        In::constant(value.tree())
    }
}

impl<'n, T> From<Out<'n, T>> for AnyIn<'n> {
    fn from(output: Out<'n, T>) -> AnyIn<'n> {
        AnyIn {
            source: LinkSource::Output(output.name()),
            net: PhantomData,
        }
    }
}

impl<'n, T> From<Delayed<'n, T>> for AnyIn<'n> {
    fn from(delayed: Delayed<'n, T>) -> AnyIn<'n> {
        AnyIn {
            source: LinkSource::Delayed(delayed.index),
            net: PhantomData,
        }
    }
}

impl<T> From<Value<T>> for AnyIn<'_> {
    fn from(value: Value<T>) -> Self {
        AnyIn::constant(AnyValue::from(value).tree())
    }
}

impl<'n, T: Type> Delayed<'n, T> {
    /// Sets the source of the link.
    pub fn feed(self, output: Out<'n, T>) {
        let name = output.name();
        if let Some(delayed) = self.net.state.borrow_mut().delayed.get_mut(self.index) {
            delayed.from = Some(name);
        }
    }
}
