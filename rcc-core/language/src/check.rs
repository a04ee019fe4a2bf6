//! The rules that a net must keep, one function each. Every rule looks at the whole net and reports all that breaks it;
//! what another rule or the resolver has reported is passed over. The loader's threads.

mod connections;
mod fragments;
mod inputs;
mod limits;
mod loops;
mod motions;
mod topics;
mod values;

use rcc_config::diagnostic::Diagnostic;

use crate::infer::Inferred;
use crate::resolve::Graph;

pub use limits::{every, window};
pub(crate) use loops::components;
pub(crate) use values::literal_fits;

/// A net with its types and units.
#[derive(Clone, Copy)]
pub struct Typed<'a> {
    /// The net.
    pub graph: &'a Graph<'a>,
    /// Its types and units.
    pub inferred: &'a Inferred,
}

type Check = fn(Typed<'_>, &mut Vec<Diagnostic>);

/// All rules; their order does not matter, faults are sorted by place.
const CHECKS: &[Check] = &[
    values::elements_exist,
    values::links_fit,
    values::lists_fit,
    values::lengths_are_known,
    values::literals_fit,
    values::types_suit_their_primitives,
    values::units_of_a_primitive_agree,
    values::parameters_are_in_range,
    values::constants_are_in_range,
    motions::parameters_do_not_contradict,
    motions::motions_have_an_end,
    motions::turns_are_of_joints,
    motions::goals_are_within_range,
    motions::motions_lead_somewhere,
    motions::commands_are_known,
    motions::axes_have_a_direction,
    fragments::inputs_are_as_fragments_say,
    fragments::conditions_are_truth_values,
    fragments::what_leaves_a_region_can_become_null,
    inputs::bounds_are_of_numbers,
    inputs::units_are_of_numbers,
    inputs::first_values_are_within_bounds,
    connections::inputs_are_connected,
    connections::outputs_are_read_or_discarded,
    connections::discards_are_sensible,
    loops::loops_have_a_delay,
    loops::delayed_loops_have_a_first_value,
    loops::loops_can_lose_null,
    limits::there_is_one_termination,
    limits::resources_are_commanded_once,
    limits::arms_are_commanded_in_every_cycle,
    limits::monitors_are_possible,
    limits::counts_are_within_limits,
    limits::windows_are_possible,
    topics::topics_are_published_once,
    topics::topics_are_of_one_type,
    topics::no_net_subscribes_to_itself,
    limits::what_moves_can_be_cancelled,
];

/// Reports everything that is wrong with a net.
pub fn check(net: Typed<'_>, faults: &mut Vec<Diagnostic>) {
    for check in CHECKS {
        check(net, faults);
    }
}
