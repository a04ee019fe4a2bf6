//! What a primitive is: its spec (for the loader and for people) and its kernels (for the cycle).
//!
//! A primitive is one file in `primitives/` that defines one [`Entry`], and two lines in
//! `primitives.rs`. The loader reads only the spec; the real-time thread runs only kernels.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::types::Store;

mod channel;
mod duration;
mod elements;
mod operand;
mod port;
mod step;
mod wide;
mod window;

pub use channel::{each_bit_channel, each_real_channel};
pub use duration::{elapsed, reached};
pub use elements::{ELEMENTS, TRUTHS, fold_bool, fold_int, fold_real};
pub use operand::{CYCLES_MAX, DIMS_MAX, Memory, Operand, Size, Sizes, Width};
pub use port::{
    ChannelKind, Dim, Elements, Family, Literal, Parameter, ParameterKind, Port, PortType, UnitRule,
};
pub use step::{
    Outcome, choose, compare_int, compare_real, each, each_bool, each_finite, each_int, each_real,
    finite, higher, lower, map_real, map_whole, real_unless, whole, within,
};
pub use wide::{copy, fill_null, is_null, wide_int, wide_real};
pub use window::{Fold, WINDOW, each_window};

/// What a primitive remembers from cycle to cycle; each kind is one contiguous block in the arena.
/// Reals start as null (NaN), Bools as null, Ints as 0, unless `prepare` or a [`ParameterKind::Start`] sets them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct State {
    /// Number of `f64`.
    pub reals: u32,
    /// Number of `Bool`.
    pub bools: u32,
    /// Number of `i64`.
    pub ints: u32,
}

impl State {
    /// Remembers nothing.
    pub const NONE: State = State {
        reals: 0,
        bools: 0,
        ints: 0,
    };
}

/// What the loader and the executor must do for a primitive besides running its kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Nothing.
    Plain,
    /// Its `value` input is copied out after the cycle; it has no kernel.
    Monitor,
    /// Its `value` is put into a constant slot that stands for its output; it has no kernel.
    Constant,
    /// Its output is a slot of its own that begins as its `initial` and is written from outside between cycles: by people
    /// and programs, or, if it has a topic, by the net that publishes that.
    Input,
    /// Its output can be read by other nets after the cycle.
    Publish,
    /// Every net needs one.
    Termination,
    /// A net with one can be cancelled.
    Cancel,
    /// Needs a path clock.
    Motion,
    /// Commands the joints of its device: a unique resource.
    CommandsArm,
    /// Commands a channel of its device: a unique resource.
    CommandsChannel,
}

/// How null passes from inputs to outputs, for the loader; [`Spec::null`] says it to people.
///
/// The loader asks it whether a loop can ever lose a null again, so it takes the best case: what the
/// outputs may be if every known input has a helpful value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NullRule {
    /// A null input gives null outputs.
    Propagates,
    /// One known input is enough for known outputs.
    AnyKnown,
    /// The first input must be known, and one of the others.
    FirstAndAnyKnown,
    /// Outputs are known whatever the inputs are.
    Known,
    /// Once known, outputs stay known; from the beginning if a [`ParameterKind::First`] is.
    Remembers,
}

/// Everything that people and the loader know about a primitive.
#[derive(Clone, Copy, Debug)]
pub struct Spec {
    /// The type's name in nets.
    pub name: &'static str,
    /// One sentence.
    pub summary: &'static str,
    /// What null at an input does.
    pub null: &'static str,
    /// The same for the loader.
    pub null_rule: NullRule,
    /// Which known inputs give null; empty: known inputs, known outputs. Clauses with "; " between them. The loader
    /// understands `PORT OP NUMBER` and `PORT OP PORT` with `= < > <= >=` ("b = 0", "low > high") and rules them out where
    /// constants and ranges of ports do; one that begins with "overflow" it never counts; others are words for people.
    pub undefined: &'static str,
    /// The formula with its source (book, paper, standard); empty where the summary says it all.
    pub formula: &'static str,
    /// Worked values: the manual shows them, and a test runs every one through the whole language.
    pub examples: &'static [Example],
    /// Inputs, in operand order.
    pub inputs: &'static [Port],
    /// Outputs, in operand order.
    pub outputs: &'static [Port],
    /// Parameters, in operand order.
    pub parameters: &'static [Parameter],
    /// State.
    pub state: State,
    /// What it remembers of its open type.
    pub memory: Memory,
    /// Role.
    pub role: Role,
}

/// Worked values of a primitive: a table with one row a cycle.
#[derive(Clone, Copy, Debug)]
pub struct Example {
    /// What it shows, one phrase.
    pub shows: &'static str,
    /// Parameters as in a net, `{gain: 0.25}`; empty if there are none.
    pub parameters: &'static str,
    /// The period of the net, ms.
    pub period_ms: u32,
    /// Numbers at ports that take whole and real ones are whole.
    pub whole: bool,
    /// The first line names ports with `|` between them; each further line is a cycle and has a literal of the language
    /// below each name: what the inputs are, and what the outputs must then be (to 1e-12). Inputs without a column are
    /// left unconnected.
    pub table: &'static str,
}

impl Example {
    /// At a period of 1 ms.
    pub const fn new(
        shows: &'static str,
        parameters: &'static str,
        table: &'static str,
    ) -> Example {
        Example {
            shows,
            parameters,
            period_ms: 1,
            whole: false,
            table,
        }
    }

    /// At another period.
    pub const fn every_ms(self, period_ms: u32) -> Example {
        Example { period_ms, ..self }
    }

    /// Of whole numbers, at ports that take whole and real ones.
    pub const fn whole(self) -> Example {
        Example {
            whole: true,
            ..self
        }
    }
}

/// The null rule of most primitives.
pub const PROPAGATES: &str = "a null input gives null outputs";

impl Spec {
    /// A plain primitive; fill in the rest with struct update syntax.
    pub const PLAIN: Spec = Spec {
        name: "",
        summary: "",
        null: PROPAGATES,
        null_rule: NullRule::Propagates,
        undefined: "",
        formula: "",
        examples: &[],
        inputs: &[],
        outputs: &[],
        parameters: &[],
        state: State::NONE,
        memory: Memory::NONE,
        role: Role::Plain,
    };

    /// Finds an input and its place.
    pub fn input(&self, name: &str) -> Option<(usize, &'static Port)> {
        self.inputs
            .iter()
            .enumerate()
            .find(|(_, port)| port.name == name)
    }

    /// Finds an output and its place.
    pub fn output(&self, name: &str) -> Option<(usize, &'static Port)> {
        self.outputs
            .iter()
            .enumerate()
            .find(|(_, port)| port.name == name)
    }
}

/// The executable form of a primitive for one arena.
#[derive(Clone, Copy)]
pub struct Kernel {
    /// The arena of its open ports; `None` if it has none.
    pub store: Option<Store>,
    /// Only for values of one element; its operands have no width.
    pub single: bool,
    /// Runs all primitives of a run: `operands` is a whole number of operand groups.
    pub run: fn(&mut Frame<'_>, operands: &[u32]),
}

impl Kernel {
    /// The kernel of a primitive without open ports.
    pub const fn new(run: fn(&mut Frame<'_>, &[u32])) -> Kernel {
        Kernel {
            store: None,
            single: false,
            run,
        }
    }

    /// The kernel for one arena.
    pub const fn of(store: Store, run: fn(&mut Frame<'_>, &[u32])) -> Kernel {
        Kernel {
            store: Some(store),
            single: false,
            run,
        }
    }

    /// The kernel for single values of one arena, of a primitive that also takes wide ones.
    pub const fn single(store: Store, run: fn(&mut Frame<'_>, &[u32])) -> Kernel {
        Kernel {
            store: Some(store),
            single: true,
            run,
        }
    }
}

/// Computes the start values of one primitive when its command becomes ready, off the RT thread.
pub type Prepare = fn(&mut Preparation<'_>, operands: &[u32]) -> Result<(), PrepareFault>;

/// One row of the catalogue.
#[derive(Clone, Copy)]
pub struct Entry {
    /// For people and the loader.
    pub spec: Spec,
    /// For the cycle; at most 8. The first one that fits is taken, so that those for single values come first.
    pub kernels: &'static [Kernel],
    /// Start values that depend on the devices.
    pub prepare: Option<Prepare>,
}

impl Entry {
    /// A primitive without start values of its own.
    pub const fn new(spec: Spec, kernels: &'static [Kernel]) -> Entry {
        Entry {
            spec,
            kernels,
            prepare: None,
        }
    }

    /// Adds the computation of start values.
    pub const fn prepared_by(self, prepare: Prepare) -> Entry {
        Entry {
            prepare: Some(prepare),
            ..self
        }
    }

    /// Index of the kernel for an arena (of its open ports, `None` if it has none) and a width.
    pub fn kernel_for(&self, store: Option<Store>, width: u32) -> Option<usize> {
        let fits = |kernel: &Kernel| kernel.store == store && (!kernel.single || width == 1);
        self.kernels.iter().position(fits)
    }
}
