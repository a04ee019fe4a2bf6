//! Handles of primitives, outputs, inputs and delayed links. Used by applications, never on a real-time thread.

use std::marker::PhantomData;

use rcc_config::yaml::layout::Tree;

use super::{BuildError, NetBuilder, NodeState};
use crate::value::{AnyValue, Real, Type, Untyped, Value};

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
    pub(super) net: &'n NetBuilder,
    pub(super) index: usize,
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
    Port(usize, &'static str, Option<ElementIndex>),
    /// Index into the table of names that are not `&'static str`, and optionally an element.
    Named(usize, Option<ElementIndex>),
}

/// An element of an output, counted from 0. Whether the output has it is checked when the net is loaded; for a matrix,
/// when it is built.
#[derive(Clone, Copy, Debug)]
enum ElementIndex {
    /// Of an array.
    Array(usize),
    /// Of a matrix: row and column.
    Matrix(usize, usize),
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
    pub(super) net: &'n NetBuilder,
    pub(super) index: usize,
    pub(super) ty: PhantomData<T>,
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
            Some(ElementIndex::Array(index)) => format!("{name}[{index}]"),
            Some(ElementIndex::Matrix(row, column)) => format!("{name}[{row},{column}]"),
            None => name,
        }
    }

    fn at<U>(self, element: ElementIndex) -> Out<'n, U> {
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
        self.at(ElementIndex::Array(index))
    }
}

impl<'n, const N: usize> Out<'n, crate::Reals<N>> {
    /// Returns one element, counted from 0.
    #[must_use]
    pub fn element(self, index: usize) -> Out<'n, Real> {
        self.at(ElementIndex::Array(index))
    }
}

impl<'n, const R: usize, const C: usize> Out<'n, crate::Matrix<R, C>> {
    /// Returns one element; row and column are counted from 0. With one outside the matrix, [`NetBuilder::build`] fails.
    #[must_use]
    pub fn element(self, row: usize, column: usize) -> Out<'n, Real> {
        if row >= R || column >= C {
            let output = self.name();
            let mistake = || BuildError::NoElement {
                output,
                row,
                column,
                rows: R,
                columns: C,
            };
            let earlier = &mut self.net.state.borrow_mut().mistake;
            earlier.get_or_insert_with(mistake);
        }
        self.at(ElementIndex::Matrix(row, column))
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
