//! A small constraint solver: variables are assigned once, and constraints propagate known units. Linear in the number
//! of constraints, and deterministic. Runs on the loader's threads.

use std::collections::VecDeque;

use rcc_core::unit::Unit;

use super::UnitTerm;
use crate::adjacency::Adjacency;

/// A constraint between terms.
#[derive(Clone, Copy, Debug)]
pub enum UnitConstraint {
    /// Both units are equal; the first term is the source.
    Equal(UnitTerm, UnitTerm),
    /// The third unit is the product of the first two.
    Product(UnitTerm, UnitTerm, UnitTerm),
}

impl UnitConstraint {
    /// Returns the variables of its terms.
    fn variables(&self) -> impl Iterator<Item = usize> {
        let terms = match *self {
            UnitConstraint::Equal(a, b) => [a, b, UnitTerm::None],
            UnitConstraint::Product(a, b, c) => [a, b, c],
        };
        terms.into_iter().filter_map(|term| match term {
            UnitTerm::Variable(variable) => Some(variable),
            UnitTerm::Fixed(_) | UnitTerm::None => None,
        })
    }
}

/// Variables and constraints.
#[derive(Debug)]
pub struct UnitSolver {
    /// Units of the variables; `None` while unknown.
    pub values: Vec<Option<Unit>>,
    constraints: Vec<UnitConstraint>,
    /// Indices of the constraints that contain a variable, by variable.
    users: Adjacency,
    queue: VecDeque<usize>,
    backwards: bool,
}

impl UnitSolver {
    /// Creates a solver with `variables` unknown units.
    pub fn new(variables: usize, constraints: Vec<UnitConstraint>) -> UnitSolver {
        let used = constraints.iter().map(UnitConstraint::variables);
        UnitSolver {
            values: vec![None; variables],
            users: used.collect::<Adjacency>().reversed(variables),
            constraints,
            queue: VecDeque::new(),
            backwards: false,
        }
    }

    /// Propagates what is known: first only from sources to sinks, so that a conflict is reported where two sources
    /// meet and not somewhere before, then in both directions.
    pub fn solve(&mut self) {
        for backwards in [false, true] {
            self.backwards = backwards;
            self.queue.extend(0..self.constraints.len());
            self.run();
        }
    }

    /// Assigns a variable that is still unknown, and propagates it.
    pub fn decide(&mut self, variable: usize, value: Unit) {
        if self.values.get(variable) == Some(&None) {
            self.set(UnitTerm::Variable(variable), value);
            self.run();
        }
    }

    fn run(&mut self) {
        while let Some(number) = self.queue.pop_front() {
            if let Some(constraint) = self.constraints.get(number).copied() {
                self.propagate(constraint);
            }
        }
    }

    fn propagate(&mut self, constraint: UnitConstraint) {
        match constraint {
            UnitConstraint::Equal(a, b) => {
                if let Some(value) = self.get(a) {
                    self.set(b, value);
                } else if let (Some(value), true) = (self.get(b), self.backwards) {
                    self.set(a, value);
                }
            }
            UnitConstraint::Product(a, b, c) => match (self.get(a), self.get(b), self.get(c)) {
                (Some(a), Some(b), None) => self.set(c, a.times(b)),
                (Some(a), None, Some(c)) if self.backwards => self.set(b, c.per(a)),
                (None, Some(b), Some(c)) => self.set(a, c.per(b)),
                (None, None, Some(c)) if a == b => {
                    if let Some(root) = c.root() {
                        self.set(a, root);
                    }
                }
                _ => {}
            },
        }
    }

    fn get(&self, term: UnitTerm) -> Option<Unit> {
        match term {
            UnitTerm::Fixed(value) => Some(value),
            UnitTerm::Variable(variable) => self.values.get(variable).copied().flatten(),
            UnitTerm::None => None,
        }
    }

    fn set(&mut self, term: UnitTerm, value: Unit) {
        if let UnitTerm::Variable(variable) = term
            && let Some(place @ None) = self.values.get_mut(variable)
        {
            *place = Some(value);
            self.queue.extend(self.users.of(variable));
        }
    }
}
