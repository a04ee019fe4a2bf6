//! Fragments: sub-nets with inputs, outputs and parameters, and their instances. Used by applications, never on a
//! real-time thread.

use std::cell::RefCell;
use std::ops::Deref;

use rcc_config::yaml::layout::{Tree, TreeBlock, TreeEntry};

use crate::builder::{AnyIn, BuildError, In, LinkSource, NetBuilder, Node, Out};
use crate::value::{AnyValue, Bool, Type, Value};

/// Builds a fragment: everything that a net has, and ports.
#[derive(Debug)]
pub struct FragmentBuilder {
    body: NetBuilder,
    parameters: RefCell<Vec<String>>,
    inputs: RefCell<Vec<String>>,
    outputs: RefCell<Vec<(String, String)>>,
}

impl Deref for FragmentBuilder {
    type Target = NetBuilder;

    fn deref(&self) -> &NetBuilder {
        &self.body
    }
}

impl FragmentBuilder {
    /// Declares an input, which each instance connects.
    pub fn declare_input<T: Type>(&self, name: &str) -> In<'_, T> {
        let mut inputs = self.inputs.borrow_mut();
        if !inputs.iter().any(|known| known == name) {
            inputs.push(name.to_string());
        }
        In::constant(Tree::Text(name.to_string()))
    }

    /// Declares a parameter, which each instance sets.
    pub fn declare_parameter<T: Type>(&self, name: &str) -> Value<T> {
        let mut parameters = self.parameters.borrow_mut();
        if !parameters.iter().any(|known| known == name) {
            parameters.push(name.to_string());
        }
        Value::new(Tree::Text(format!("${name}")))
    }

    /// Declares an output that each instance provides.
    pub fn declare_output<T: Type>(&self, name: &str, output: Out<'_, T>) {
        let name = name.to_string();
        self.outputs.borrow_mut().push((name, output.name()));
    }

    fn tree(&self) -> Result<Tree, BuildError> {
        let empty = |name: &String| (name.clone(), Tree::map([]));
        let parameters: Vec<_> = self.parameters.borrow().iter().map(empty).collect();
        let inputs: Vec<_> = self.inputs.borrow().iter().map(empty).collect();
        let outputs = self.outputs.borrow();
        let outputs: Vec<_> = outputs
            .iter()
            .map(|(name, from)| (name.clone(), Tree::Text(from.clone())))
            .collect();
        let ports = [
            ("parameters", parameters),
            ("inputs", inputs),
            ("outputs", outputs),
        ];
        let ports = ports.into_iter().filter(|(_, entries)| !entries.is_empty());
        let ports = ports.map(|(key, entries)| (key.to_string(), Tree::map(entries)));
        let entries = ports.chain(self.body.state.borrow().body()?);
        let entries = entries
            .map(|(key, tree)| TreeEntry::new(key, tree))
            .collect();
        Ok(Tree::Map(TreeBlock::new(entries)))
    }
}

impl NetBuilder {
    /// Adds a fragment, to be instantiated with [`NetBuilder::instance`].
    ///
    /// # Errors
    /// Returns an error as [`NetBuilder::build`].
    pub fn fragment(
        &self,
        name: &str,
        make: impl FnOnce(&FragmentBuilder),
    ) -> Result<(), BuildError> {
        let fragment = FragmentBuilder {
            body: NetBuilder::new(name),
            parameters: RefCell::default(),
            inputs: RefCell::default(),
            outputs: RefCell::default(),
        };
        make(&fragment);
        let tree = fragment.tree()?;
        self.state
            .borrow_mut()
            .fragments
            .push((name.to_string(), tree));
        Ok(())
    }

    /// Adds an instance of a fragment. Its ports are checked when the net is loaded.
    pub fn instance(&self, id: &str, fragment: &str) -> Instance<'_> {
        Instance {
            node: self.add_node("fragment", fragment, id),
        }
    }
}

/// An instance of a fragment.
#[derive(Clone, Copy, Debug)]
pub struct Instance<'n> {
    node: Node<'n>,
}

impl<'n> Instance<'n> {
    /// Sets a parameter.
    pub fn parameter(self, name: &str, value: impl Into<AnyValue>) -> Instance<'n> {
        self.node.parameter(name, value.into().tree());
        self
    }

    /// Connects an input.
    pub fn input(self, name: &str, source: impl Into<AnyIn<'n>>) -> Instance<'n> {
        self.node.input(name, source.into().source());
        self
    }

    /// Evaluates the instance only while `source` is true; otherwise its outputs are null.
    pub fn active(self, source: impl Into<In<'n, Bool>>) -> Instance<'n> {
        let source: LinkSource = source.into().source();
        self.node.active(source);
        self
    }

    /// Returns an output.
    #[must_use]
    pub fn output<T: Type>(self, name: &str) -> Out<'n, T> {
        self.node.named(name)
    }
}
