//! The check pass, [`Typed`] → [`Checked`]: the rules that a net must keep, one function each. Every rule checks the
//! whole net and reports all violations. It skips what another rule or the resolver reports. Runs on the loader's
//! threads.

mod connections;
mod constants;
mod fragments;
mod inputs;
mod limits;
mod links;
mod loops;
mod motions;
mod nulls;
mod topics;
mod transitions;
mod types;

use rcc_config::diagnostic::{Diagnostic, Severity};
use rcc_core::primitive::{ParameterKind, Spec};

use crate::infer::Typed;

pub(crate) use constants::literal_fits;

/// A net that keeps every rule: only such a net is lowered.
#[derive(Clone, Copy)]
pub struct Checked<'a>(Typed<'a>);

impl<'a> Checked<'a> {
    /// Returns the net.
    #[must_use]
    pub fn net(self) -> Typed<'a> {
        self.0
    }
}

type Check = fn(Typed<'_>, &mut Vec<Diagnostic>);

/// All rules, in any order: diagnostics are sorted by their spans.
const CHECKS: &[Check] = &[
    links::elements_exist,
    links::links_fit,
    links::lists_fit,
    types::lengths_are_known,
    constants::literals_fit,
    types::types_suit_their_primitives,
    types::units_of_a_primitive_agree,
    constants::parameters_are_in_range,
    constants::constants_are_in_range,
    constants::outputs_are_commanded_in_range,
    motions::parameters_do_not_contradict,
    motions::reserves_are_of_time_optimal_motions,
    motions::joint_motions_have_a_goal,
    motions::turns_have_a_bit_for_each_joint,
    motions::conditions_of_legs_are_connected,
    motions::goals_are_within_range,
    motions::motion_outputs_are_read,
    motions::commands_are_not_null,
    nulls::commands_can_become_known,
    motions::axes_have_a_direction,
    fragments::inputs_match_fragment_declarations,
    fragments::conditions_are_truth_values,
    fragments::outputs_read_outside_a_region_can_become_null,
    transitions::transitions_are_possible,
    inputs::bounds_are_numeric,
    inputs::units_are_given_for_numbers_only,
    inputs::initial_values_are_within_bounds,
    connections::inputs_are_connected,
    connections::outputs_are_read_or_discarded,
    connections::discards_are_unread_and_unique,
    loops::loops_have_a_delay,
    loops::delayed_loops_have_an_initial_value,
    loops::loops_can_recover_from_null,
    limits::there_is_one_termination,
    limits::resources_are_commanded_once,
    limits::arms_are_commanded_in_every_cycle,
    limits::monitors_are_possible,
    limits::counts_are_within_limits,
    limits::windows_are_possible,
    topics::topics_are_published_once,
    topics::topics_are_of_one_type,
    topics::no_net_subscribes_to_itself,
    limits::commands_can_be_canceled,
];

/// Checks a net against every rule. Returns `None` if this or an earlier pass has reported an error.
pub fn check<'a>(net: Typed<'a>, diagnostics: &mut Vec<Diagnostic>) -> Option<Checked<'a>> {
    for check in CHECKS {
        check(net, diagnostics);
    }
    let mut severities = diagnostics.iter().map(|diagnostic| diagnostic.severity);
    severities
        .all(|severity| severity != Severity::Error)
        .then_some(Checked(net))
}

/// Returns true if a spec has a parameter of this kind.
fn has_parameter(spec: &Spec, kind: ParameterKind) -> bool {
    let mut parameters = spec.parameters.iter();
    parameters.any(|parameter| parameter.kind == kind)
}
