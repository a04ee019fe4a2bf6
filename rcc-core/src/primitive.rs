//! The parts of a primitive: its spec (for the loader and for people) and its kernels (for the cycle).
//!
//! A primitive is one file in the folder of its subject that defines one [`CatalogueEntry`], and two lines in the file of
//! the subject (`primitives/logic.rs`). The loader reads only the spec; the real-time thread runs only kernels.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::types::Store;

mod channel;
mod duration;
mod elements;
mod operand;
mod operand_struct;
mod port;
mod step;
mod wide;
mod window;

pub use crate::branchless::{
    choose, finite, higher, int_unless, lower, real_unless, whole, within,
};
pub use crate::frame::{
    Bool, Channel, Device, Element, Int, MotionIndex, Real, Rotation, Slot, Spatial, Value, Vector3,
};
pub use channel::{each_bit_channel, each_real_channel};
pub use duration::{elapsed, reached};
pub use elements::{ELEMENTS, TRUTHS, fold_bool, reduce};
pub use operand::{CYCLES_MAX, DIMS_MAX, MemorySpec, Operand, Size, SizeList, Sizes, Width};
pub(crate) use operand_struct::operands;
pub use operand_struct::{ByElement, Field, FieldKind, Operands, Prepare, Step};
pub use port::{
    ChannelKind, DefaultValue, Dim, ElementType, Parameter, ParameterKind, Port, PortType,
    TypeFamily, UnitRule,
};
pub use step::{
    Operation, by_element, compare, each, each_bool, each_element, each_finite, each_int,
    each_pair, each_step, map_real, map_whole,
};
pub use wide::{copy, fill_null, is_null};
pub use window::{Fold, WINDOW, each_window};

/// The state that a primitive keeps from cycle to cycle; each kind is one contiguous block in the arena. Reals start as
/// null (NaN), Bools as null and Ints as 0, unless `prepare` or a [`ParameterKind::Start`] sets them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StateSpec {
    /// Number of `f64`.
    pub reals: u32,
    /// Number of `Bool`.
    pub bools: u32,
    /// Number of `i64`.
    pub ints: u32,
}

impl StateSpec {
    /// No state.
    pub const NONE: StateSpec = StateSpec {
        reals: 0,
        bools: 0,
        ints: 0,
    };
}

/// The special treatment that the loader and the executor give a primitive besides running its kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Nothing.
    Plain,
    /// Its `value` input is copied out after the cycle; it has no kernel.
    Monitor,
    /// Its `value` is stored in a constant slot that serves as its output; it has no kernel.
    Constant,
    /// Its output is a slot of its own that starts as `initial` and is written from outside between cycles: through the
    /// control interface or, if it has a topic, by the net that publishes that topic. It has no kernel.
    Input,
    /// Its `value` is published: other nets can read it after the cycle.
    Publish,
    /// Every net has exactly one. Its input takes named conditions as well, the outcomes of the net; each is a group of
    /// operands.
    Termination,
    /// Makes its net cancelable.
    Cancel,
    /// Needs a path clock.
    Motion,
    /// Commands the joints of its device: a unique resource.
    CommandsArm,
    /// Commands a channel of its device: a unique resource.
    CommandsChannel,
}

/// How null passes from inputs to outputs, as the loader evaluates it; [`Spec::null`] states it for people.
///
/// The loader uses the rule to decide whether a loop can lose a null again. It therefore assumes the best case: what
/// the outputs may be if every known input has a favourable value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NullRule {
    /// A null input gives null outputs.
    Propagates,
    /// The outputs are known if at least one input is known.
    AnyKnown,
    /// The outputs are known if the first input and at least one other input are known.
    FirstAndAnyKnown,
    /// The outputs are always known.
    Known,
    /// Once known, the outputs stay known; they are known from the start if a [`ParameterKind::First`] is.
    Remembers,
}

/// The description of a primitive, for the loader and for people.
#[derive(Clone, Copy, Debug)]
pub struct Spec {
    /// Type name as written in nets.
    pub name: &'static str,
    /// Summary in one sentence.
    pub summary: &'static str,
    /// Effect of a null input, in words.
    pub null: &'static str,
    /// The same, for the loader.
    pub null_rule: NullRule,
    /// The known inputs for which the output is null; empty if known inputs always give known outputs. Clauses are
    /// separated by "; ". The loader understands `PORT OP NUMBER` and `PORT OP PORT` with `= < > <= >=` (`b = 0`,
    /// `low > high`) and excludes such a clause if constants and port ranges rule it out. A clause that begins with
    /// "overflow" is ignored by the loader; any other clause is text for people.
    pub undefined: &'static str,
    /// The formula and its source (book, paper, standard); empty if the summary is sufficient.
    pub formula: &'static str,
    /// Worked examples: the manual shows them, and a test runs each through the whole language.
    pub examples: &'static [Example],
    /// Inputs, in operand order.
    pub inputs: &'static [Port],
    /// Outputs, in operand order.
    pub outputs: &'static [Port],
    /// Parameters, in operand order.
    pub parameters: &'static [Parameter],
    /// State.
    pub state: StateSpec,
    /// State of the primitive's open type.
    pub memory: MemorySpec,
    /// Role.
    pub role: Role,
}

/// A worked example of a primitive: a table with one row per cycle.
#[derive(Clone, Copy, Debug)]
pub struct Example {
    /// Title of the example, one phrase.
    pub shows: &'static str,
    /// Parameters as written in a net, `{gain: 0.25}`; empty if there are none.
    pub parameters: &'static str,
    /// Period of the net, ms.
    pub period_ms: u32,
    /// Uses `Int` at ports that accept both `Int` and `Real`.
    pub whole: bool,
    /// The first line names the ports, separated by `|`. Each further line is one cycle with a literal of the language
    /// below each name: the inputs, and the outputs that they must give (to within 1e-12). Inputs without a column are
    /// left unconnected.
    pub table: &'static str,
}

impl Example {
    /// Creates an example with a period of 1 ms.
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

    /// Sets the period, ms.
    pub const fn every_ms(self, period_ms: u32) -> Example {
        Example { period_ms, ..self }
    }

    /// Uses `Int` at ports that accept both `Int` and `Real`.
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
        state: StateSpec::NONE,
        memory: MemorySpec::NONE,
        role: Role::Plain,
    };

    /// Finds an input by name; returns its index and port.
    pub fn input(&self, name: &str) -> Option<(usize, &'static Port)> {
        self.inputs
            .iter()
            .enumerate()
            .find(|(_, port)| port.name == name)
    }

    /// Finds an output by name; returns its index and port.
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
    /// The arena of the open ports; `None` if the primitive has none.
    pub store: Option<Store>,
    /// Handles only single-element values; its operands then have no width.
    pub single: bool,
    /// Applies its operands to each element; the width follows them.
    pub by_element: bool,
    /// Name and kind of the operands; empty for the kernels of shared functions.
    pub fields: &'static [(&'static str, FieldKind)],
    /// Evaluates all primitives of a run: `operands` is a whole number of operand groups.
    pub run: fn(&mut Frame<'_>, operands: &[u32]),
}

impl Kernel {
    /// Creates the kernel of a primitive without open ports.
    pub const fn new(run: fn(&mut Frame<'_>, &[u32])) -> Kernel {
        Kernel {
            store: None,
            single: false,
            by_element: false,
            fields: &[],
            run,
        }
    }

    /// Creates the kernel for one arena.
    pub const fn of(store: Store, run: fn(&mut Frame<'_>, &[u32])) -> Kernel {
        Kernel {
            store: Some(store),
            ..Kernel::new(run)
        }
    }

    /// Creates the kernel for single-element values of one arena, for a primitive that also has a kernel for wide
    /// values.
    pub const fn single(store: Store, run: fn(&mut Frame<'_>, &[u32])) -> Kernel {
        Kernel {
            single: true,
            ..Kernel::of(store, run)
        }
    }

    /// Creates the kernel that evaluates each group of operands by `S`.
    pub const fn each<S: Step>() -> Kernel {
        Kernel {
            store: S::STORE,
            fields: S::FIELDS,
            ..Kernel::new(each_step::<S>)
        }
    }

    /// As [`Kernel::each`], for single-element values: the primitive also has a kernel for wide values.
    pub const fn scalar<S: Step>() -> Kernel {
        Kernel {
            single: true,
            ..Kernel::each::<S>()
        }
    }

    /// Creates the kernel that evaluates each element of wide values by `S`; its operands are those of `S` and the
    /// width.
    pub const fn by_element<S: ByElement>() -> Kernel {
        Kernel {
            store: S::STORE,
            by_element: true,
            fields: S::FIELDS,
            ..Kernel::new(each_element::<S>)
        }
    }
}

/// Computes the start values of one primitive from its group of operands.
pub type PrepareGroup = fn(&mut Preparation<'_>, operands: &[u32]) -> Result<(), PrepareFault>;

fn prepare_group<P: Prepare>(
    preparation: &mut Preparation<'_>,
    operands: &[u32],
) -> Result<(), PrepareFault> {
    P::split(operands).map_or(Ok(()), |(primitive, _)| primitive.prepare(preparation))
}

/// One row of the catalogue.
#[derive(Clone, Copy)]
pub struct CatalogueEntry {
    /// Description for people and the loader.
    pub spec: Spec,
    /// Kernels for the cycle, at most 8. The first one that fits is used, so kernels for single-element values come
    /// first.
    pub kernels: &'static [Kernel],
    /// Computes start values that depend on the devices from one group of operands, off the real-time thread; `None` if
    /// there are none.
    pub prepare: Option<PrepareGroup>,
}

impl CatalogueEntry {
    /// Creates a row without computed start values.
    pub const fn new(spec: Spec, kernels: &'static [Kernel]) -> CatalogueEntry {
        CatalogueEntry {
            spec,
            kernels,
            prepare: None,
        }
    }

    /// Adds the computation of start values by `P`.
    pub const fn prepared_by<P: Prepare>(self) -> CatalogueEntry {
        CatalogueEntry {
            prepare: Some(prepare_group::<P>),
            ..self
        }
    }

    /// Returns the index of the kernel for an arena (of the open ports; `None` if there are none) and a width in
    /// elements.
    pub fn kernel_for(&self, store: Option<Store>, width: u32) -> Option<usize> {
        let fits = |kernel: &Kernel| kernel.store == store && (!kernel.single || width == 1);
        self.kernels.iter().position(fits)
    }
}
