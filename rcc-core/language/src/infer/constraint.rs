//! A small solver: variables that become known once, and constraints that carry what is known from one to another.
//! Linear in the number of constraints, and the same for the same text. The loader's threads.

use std::collections::VecDeque;

use rcc_core::types::Type;
use rcc_core::unit::Unit;

use super::Term;

/// What ties terms together.
#[derive(Clone, Copy, Debug)]
pub enum Constraint<T> {
    /// Both are the same; the first one is the source.
    Equal(Term<T>, Term<T>),
    /// The second one is the type of the first one's elements.
    Element(Term<T>, Term<T>),
    /// The third one is the product of the others.
    Product(Term<T>, Term<T>, Term<T>),
}

/// What types and units can do.
pub trait Domain: Copy + PartialEq {
    /// The type of the elements.
    fn element(self) -> Option<Self>;
    /// The product.
    fn times(self, other: Self) -> Self;
    /// The quotient.
    fn per(self, other: Self) -> Self;
    /// What times itself is this; `None` if there is no such thing.
    fn root(self) -> Option<Self>;
}

impl Domain for Type {
    fn element(self) -> Option<Type> {
        Type::element(self)
    }

    fn times(self, _: Type) -> Type {
        self
    }

    fn per(self, _: Type) -> Type {
        self
    }

    fn root(self) -> Option<Type> {
        Some(self)
    }
}

impl Domain for Unit {
    fn element(self) -> Option<Unit> {
        Some(self)
    }

    fn times(self, other: Unit) -> Unit {
        Unit::times(self, other)
    }

    fn per(self, other: Unit) -> Unit {
        Unit::per(self, other)
    }

    fn root(self) -> Option<Unit> {
        Unit::root(self)
    }
}

/// Variables and constraints.
#[derive(Debug)]
pub struct Solver<T> {
    /// What is known.
    pub values: Vec<Option<T>>,
    constraints: Vec<Constraint<T>>,
    /// By variable: the constraints that it occurs in.
    users: Vec<Vec<usize>>,
    queue: VecDeque<usize>,
    backwards: bool,
    /// By variable: what it can be.
    allowed: Vec<fn(T) -> bool>,
}

impl<T: Domain> Solver<T> {
    /// With this many variables.
    pub fn new(variables: usize) -> Solver<T> {
        Solver {
            values: vec![None; variables],
            constraints: Vec::new(),
            users: vec![Vec::new(); variables],
            queue: VecDeque::new(),
            backwards: false,
            allowed: vec![|_| true; variables],
        }
    }

    /// Restricts a variable: what does not fit is not carried to it, so that the fault is found at the link.
    pub fn allow(&mut self, variable: usize, allowed: fn(T) -> bool) {
        if let Some(place) = self.allowed.get_mut(variable) {
            *place = allowed;
        }
    }

    /// Adds a constraint.
    pub fn add(&mut self, constraint: Constraint<T>) {
        let number = self.constraints.len();
        let terms = match constraint {
            Constraint::Equal(a, b) | Constraint::Element(a, b) => [a, b, Term::None],
            Constraint::Product(a, b, c) => [a, b, c],
        };
        for term in terms {
            if let Term::Open(variable) = term
                && let Some(users) = self.users.get_mut(variable)
            {
                users.push(number);
            }
        }
        self.constraints.push(constraint);
    }

    /// Carries on what is known: first only from sources to sinks, so that a fault is found where two sources meet and
    /// not somewhere before, then in all directions.
    pub fn solve(&mut self) {
        for backwards in [false, true] {
            self.backwards = backwards;
            self.queue.extend(0..self.constraints.len());
            self.run();
        }
    }

    /// Decides a variable that is still open, and what follows from it.
    pub fn decide(&mut self, variable: usize, value: T) {
        if self.values.get(variable) == Some(&None) {
            self.set(Term::Open(variable), value);
            self.run();
        }
    }

    fn run(&mut self) {
        while let Some(number) = self.queue.pop_front() {
            if let Some(constraint) = self.constraints.get(number).copied() {
                self.carry(constraint);
            }
        }
    }

    fn carry(&mut self, constraint: Constraint<T>) {
        match constraint {
            Constraint::Equal(a, b) => {
                if let Some(value) = self.get(a) {
                    self.set(b, value);
                } else if let (Some(value), true) = (self.get(b), self.backwards) {
                    self.set(a, value);
                }
            }
            Constraint::Element(a, b) => {
                if let Some(value) = self.get(a).and_then(T::element) {
                    self.set(b, value);
                }
            }
            Constraint::Product(a, b, c) => match (self.get(a), self.get(b), self.get(c)) {
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

    fn get(&self, term: Term<T>) -> Option<T> {
        match term {
            Term::Fixed(value) => Some(value),
            Term::Open(variable) => self.values.get(variable).copied().flatten(),
            Term::None => None,
        }
    }

    fn set(&mut self, term: Term<T>, value: T) {
        if let Term::Open(variable) = term
            && self
                .allowed
                .get(variable)
                .is_some_and(|allowed| allowed(value))
            && let Some(place @ None) = self.values.get_mut(variable)
        {
            *place = Some(value);
            let users = self.users.get(variable).into_iter().flatten();
            self.queue.extend(users);
        }
    }
}
