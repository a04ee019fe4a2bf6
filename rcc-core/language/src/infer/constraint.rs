//! A small solver: variables that become known once, and constraints that carry what is known from one to another.
//! Linear in the number of constraints, and the same for the same text. The loader's threads.

use std::collections::VecDeque;

use rcc_core::unit::Unit;

use super::Term;

/// What ties terms together.
#[derive(Clone, Copy, Debug)]
pub enum Constraint {
    /// Both are the same; the first one is the source.
    Equal(Term, Term),
    /// The third one is the product of the others.
    Product(Term, Term, Term),
}

/// Variables and constraints.
#[derive(Debug)]
pub struct Solver {
    /// What is known.
    pub values: Vec<Option<Unit>>,
    constraints: Vec<Constraint>,
    /// By variable: the constraints that it occurs in.
    users: Vec<Vec<usize>>,
    queue: VecDeque<usize>,
    backwards: bool,
}

impl Solver {
    /// With this many variables.
    pub fn new(variables: usize) -> Solver {
        Solver {
            values: vec![None; variables],
            constraints: Vec::new(),
            users: vec![Vec::new(); variables],
            queue: VecDeque::new(),
            backwards: false,
        }
    }

    /// Adds a constraint.
    pub fn add(&mut self, constraint: Constraint) {
        let number = self.constraints.len();
        let terms = match constraint {
            Constraint::Equal(a, b) => [a, b, Term::None],
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
    pub fn decide(&mut self, variable: usize, value: Unit) {
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

    fn carry(&mut self, constraint: Constraint) {
        match constraint {
            Constraint::Equal(a, b) => {
                if let Some(value) = self.get(a) {
                    self.set(b, value);
                } else if let (Some(value), true) = (self.get(b), self.backwards) {
                    self.set(a, value);
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

    fn get(&self, term: Term) -> Option<Unit> {
        match term {
            Term::Fixed(value) => Some(value),
            Term::Open(variable) => self.values.get(variable).copied().flatten(),
            Term::None => None,
        }
    }

    fn set(&mut self, term: Term, value: Unit) {
        if let Term::Open(variable) = term
            && let Some(place @ None) = self.values.get_mut(variable)
        {
            *place = Some(value);
            let users = self.users.get(variable).into_iter().flatten();
            self.queue.extend(users);
        }
    }
}
