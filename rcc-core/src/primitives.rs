//! The catalogue: one `mod` line and one row per primitive, sorted by name.

use crate::frame::Frame;
pub use crate::primitive::CatalogueEntry;
use crate::primitive::Kernel;
use crate::topic;

mod abs;
mod add;
mod all_of;
mod analog_input;
mod analog_output;
mod analog_output_state;
mod and;
mod angle_between;
mod any_of;
mod arc_cosine;
mod arc_sine;
mod arc_tangent;
mod arm_angle;
mod arm_angle_limits;
mod at;
mod backlash;
mod biquad;
mod bit_and;
mod bit_not;
mod bit_or;
mod bit_xor;
mod blink;
mod cancel;
mod cartesian_impedance_command;
mod ceiling;
mod circular_motion;
mod compose;
mod concatenate;
mod constant;
mod copy;
mod cosine;
mod counter;
mod cross;
mod cubic_bezier;
mod cubic_hermite;
mod cycle_period;
mod dead_band;
mod debounce;
mod delay;
mod derivative;
mod determinant;
mod device_base;
mod device_status;
mod digital_input;
mod digital_output;
mod digital_output_state;
mod divide;
mod dot;
mod equals;
mod exponential;
mod falling_edge;
mod first_cycle;
mod first_order_low_pass;
mod floor;
mod force_control;
mod force_torque;
mod forward_kinematics;
mod from_bits;
mod greater;
mod high_pass;
mod hold;
mod hypotenuse;
mod hysteresis;
mod input;
mod int_divide;
mod integrator;
mod interpolate;
mod interval;
mod inverse;
mod inverse_kinematics;
mod inverse_kinematics_near;
mod inverse_velocity_kinematics;
mod invert;
mod is_null;
mod jacobian;
mod joint_goal;
mod joint_impedance_command;
mod joint_motion;
mod joint_position_command;
mod joint_state;
mod joint_torque_from_wrench;
mod joint_velocity;
mod last_known;
mod latch;
mod lerp;
mod less;
mod limit;
mod linear_motion;
mod logarithm;
mod lookup;
mod lookup2;
mod low_pass;
mod majority;
mod make_pose;
mod make_twist;
mod make_vector;
mod make_wrench;
mod matrix_apply;
mod matrix_multiply;
mod max;
mod max_element;
mod mean;
mod median;
mod min;
mod min_element;
mod monitor;
mod motion_sequence;
mod multiplexer;
mod multiply;
mod negate;
mod noise;
mod norm;
mod normalize;
mod not;
mod notch;
mod null_if;
mod off_delay;
mod on_delay;
mod online_trajectory;
mod or;
mod or_else;
mod path_correction;
mod path_motion;
mod peak_hold;
mod pid;
mod pose_add_twist;
mod pose_error;
mod pose_from_transform;
mod pose_goal;
mod power;
mod publish;
mod pulse;
mod quantize;
mod rate_limit;
mod remainder;
mod rising_edge;
mod rotate;
mod rotation_bezier;
mod rotation_error;
mod rotation_from_axes;
mod rotation_from_axis_angle;
mod rotation_from_matrix;
mod rotation_from_quaternion;
mod rotation_from_rpy;
mod rotation_from_two_vectors;
mod rotation_from_vector;
mod rotation_to_axis_angle;
mod rotation_to_matrix;
mod rotation_to_quaternion;
mod rotation_to_rpy;
mod rotation_to_vector;
mod round;
mod scalar_goal;
mod scale;
mod second_order_low_pass;
mod select;
mod set_element;
mod shift;
mod sign;
mod signal_generator;
mod sine;
mod solve;
mod spline_motion;
mod split_pose;
mod split_twist;
mod split_vector;
mod split_wrench;
mod square_root;
mod start_pose;
mod state_machine;
mod subscribe;
mod subtract;
mod sum;
mod tangent;
mod tare;
mod termination;
mod time;
mod to_bits;
mod to_real;
mod toggle;
mod transform_from_pose;
mod transform_from_position;
mod transform_point;
mod transpose;
mod trapezoidal_progress;
mod trigger;
mod true_in_window;
mod truncate;
mod twist_from_poses;
mod twist_shift;
mod twist_transform;
mod unwrap;
mod up_down_counter;
mod velocity_kinematics;
mod window_max;
mod window_mean;
mod window_min;
mod window_rms;
mod wrap;
mod wrench_compensation;
mod wrench_shift;
mod wrench_transform;
mod xor;

/// All primitives, sorted by name.
pub const CATALOGUE: &[&CatalogueEntry] = &[
    &abs::ENTRY,
    &add::ENTRY,
    &all_of::ENTRY,
    &analog_input::ENTRY,
    &analog_output::ENTRY,
    &analog_output_state::ENTRY,
    &and::ENTRY,
    &angle_between::ENTRY,
    &any_of::ENTRY,
    &arc_cosine::ENTRY,
    &arc_sine::ENTRY,
    &arc_tangent::ENTRY,
    &arm_angle::ENTRY,
    &arm_angle_limits::ENTRY,
    &at::ENTRY,
    &backlash::ENTRY,
    &biquad::ENTRY,
    &bit_and::ENTRY,
    &bit_not::ENTRY,
    &bit_or::ENTRY,
    &bit_xor::ENTRY,
    &blink::ENTRY,
    &cancel::ENTRY,
    &cartesian_impedance_command::ENTRY,
    &ceiling::ENTRY,
    &circular_motion::ENTRY,
    &compose::ENTRY,
    &concatenate::ENTRY,
    &constant::ENTRY,
    &copy::ENTRY,
    &cosine::ENTRY,
    &counter::ENTRY,
    &cross::ENTRY,
    &cubic_bezier::ENTRY,
    &cubic_hermite::ENTRY,
    &cycle_period::ENTRY,
    &dead_band::ENTRY,
    &debounce::ENTRY,
    &delay::ENTRY,
    &derivative::ENTRY,
    &determinant::ENTRY,
    &device_base::ENTRY,
    &device_status::ENTRY,
    &digital_input::ENTRY,
    &digital_output::ENTRY,
    &digital_output_state::ENTRY,
    &divide::ENTRY,
    &dot::ENTRY,
    &equals::ENTRY,
    &exponential::ENTRY,
    &falling_edge::ENTRY,
    &first_cycle::ENTRY,
    &first_order_low_pass::ENTRY,
    &floor::ENTRY,
    &force_control::ENTRY,
    &force_torque::ENTRY,
    &forward_kinematics::ENTRY,
    &from_bits::ENTRY,
    &greater::ENTRY,
    &high_pass::ENTRY,
    &hold::ENTRY,
    &hypotenuse::ENTRY,
    &hysteresis::ENTRY,
    &input::ENTRY,
    &int_divide::ENTRY,
    &integrator::ENTRY,
    &interpolate::ENTRY,
    &interval::ENTRY,
    &inverse::ENTRY,
    &inverse_kinematics::ENTRY,
    &inverse_kinematics_near::ENTRY,
    &inverse_velocity_kinematics::ENTRY,
    &invert::ENTRY,
    &is_null::ENTRY,
    &jacobian::ENTRY,
    &joint_goal::ENTRY,
    &joint_impedance_command::ENTRY,
    &joint_motion::ENTRY,
    &joint_position_command::ENTRY,
    &joint_state::ENTRY,
    &joint_torque_from_wrench::ENTRY,
    &joint_velocity::ENTRY,
    &last_known::ENTRY,
    &latch::ENTRY,
    &lerp::ENTRY,
    &less::ENTRY,
    &limit::ENTRY,
    &linear_motion::ENTRY,
    &logarithm::ENTRY,
    &lookup::ENTRY,
    &lookup2::ENTRY,
    &low_pass::ENTRY,
    &majority::ENTRY,
    &make_pose::ENTRY,
    &make_twist::ENTRY,
    &make_vector::ENTRY,
    &make_wrench::ENTRY,
    &matrix_apply::ENTRY,
    &matrix_multiply::ENTRY,
    &max::ENTRY,
    &max_element::ENTRY,
    &mean::ENTRY,
    &median::ENTRY,
    &min::ENTRY,
    &min_element::ENTRY,
    &monitor::ENTRY,
    &motion_sequence::ENTRY,
    &multiplexer::ENTRY,
    &multiply::ENTRY,
    &negate::ENTRY,
    &noise::ENTRY,
    &norm::ENTRY,
    &normalize::ENTRY,
    &not::ENTRY,
    &notch::ENTRY,
    &null_if::ENTRY,
    &off_delay::ENTRY,
    &on_delay::ENTRY,
    &online_trajectory::ENTRY,
    &or::ENTRY,
    &or_else::ENTRY,
    &pid::ENTRY,
    &path_correction::ENTRY,
    &peak_hold::ENTRY,
    &pose_add_twist::ENTRY,
    &pose_error::ENTRY,
    &pose_from_transform::ENTRY,
    &pose_goal::ENTRY,
    &power::ENTRY,
    &publish::ENTRY,
    &pulse::ENTRY,
    &quantize::ENTRY,
    &rate_limit::ENTRY,
    &remainder::ENTRY,
    &rising_edge::ENTRY,
    &rotate::ENTRY,
    &rotation_bezier::ENTRY,
    &rotation_error::ENTRY,
    &rotation_from_axes::ENTRY,
    &rotation_from_axis_angle::ENTRY,
    &rotation_from_matrix::ENTRY,
    &rotation_from_quaternion::ENTRY,
    &rotation_from_rpy::ENTRY,
    &rotation_from_two_vectors::ENTRY,
    &rotation_from_vector::ENTRY,
    &rotation_to_axis_angle::ENTRY,
    &rotation_to_matrix::ENTRY,
    &rotation_to_quaternion::ENTRY,
    &rotation_to_rpy::ENTRY,
    &rotation_to_vector::ENTRY,
    &round::ENTRY,
    &scalar_goal::ENTRY,
    &scale::ENTRY,
    &second_order_low_pass::ENTRY,
    &select::ENTRY,
    &set_element::ENTRY,
    &shift::ENTRY,
    &sign::ENTRY,
    &signal_generator::ENTRY,
    &sine::ENTRY,
    &solve::ENTRY,
    &spline_motion::ENTRY,
    &split_pose::ENTRY,
    &split_twist::ENTRY,
    &split_vector::ENTRY,
    &split_wrench::ENTRY,
    &square_root::ENTRY,
    &start_pose::ENTRY,
    &state_machine::ENTRY,
    &subscribe::ENTRY,
    &subtract::ENTRY,
    &sum::ENTRY,
    &tangent::ENTRY,
    &tare::ENTRY,
    &termination::ENTRY,
    &time::ENTRY,
    &to_bits::ENTRY,
    &to_real::ENTRY,
    &toggle::ENTRY,
    &transform_from_pose::ENTRY,
    &transform_from_position::ENTRY,
    &transform_point::ENTRY,
    &transpose::ENTRY,
    &trapezoidal_progress::ENTRY,
    &trigger::ENTRY,
    &true_in_window::ENTRY,
    &truncate::ENTRY,
    &twist_from_poses::ENTRY,
    &twist_shift::ENTRY,
    &twist_transform::ENTRY,
    &unwrap::ENTRY,
    &up_down_counter::ENTRY,
    &velocity_kinematics::ENTRY,
    &window_max::ENTRY,
    &window_mean::ENTRY,
    &window_min::ENTRY,
    &window_rms::ENTRY,
    &wrap::ENTRY,
    &wrench_compensation::ENTRY,
    &wrench_shift::ENTRY,
    &wrench_transform::ENTRY,
    &xor::ENTRY,
];

/// Maximum number of kernels of one primitive.
pub const KERNELS_MAX: usize = 8;

/// Finds a primitive by name.
pub fn find(name: &str) -> Option<(usize, &'static CatalogueEntry)> {
    let index = CATALOGUE
        .binary_search_by_key(&name, |entry| entry.spec.name)
        .ok()?;
    Some((index, CATALOGUE.get(index)?))
}

/// Returns the number in plans of kernel `kernel` of row `entry`.
pub const fn kernel_number(entry: usize, kernel: usize) -> u16 {
    (entry * KERNELS_MAX + kernel) as u16
}

/// Returns the kernel with this number and its primitive.
#[inline]
pub fn kernel(number: u16) -> Option<(&'static CatalogueEntry, &'static Kernel)> {
    let number = usize::from(number);
    let entry = CATALOGUE.get(number / KERNELS_MAX)?;
    Some((entry, entry.kernels.get(number % KERNELS_MAX)?))
}

/// A kernel's function: evaluates all primitives of a run.
pub type RunKernel = fn(&mut Frame<'_>, operands: &[u32]);

/// Kernel functions by kernel number: the cycle finds a kernel with one lookup instead of four.
static RUNS: [RunKernel; CATALOGUE.len() * KERNELS_MAX] = runs();

// Evaluated at compile time: an index out of bounds does not compile.
#[allow(clippy::indexing_slicing)]
const fn runs() -> [RunKernel; CATALOGUE.len() * KERNELS_MAX] {
    let mut runs = [nothing as RunKernel; CATALOGUE.len() * KERNELS_MAX];
    let mut number = 0;
    while number < runs.len() {
        let kernels = CATALOGUE[number / KERNELS_MAX].kernels;
        if number % KERNELS_MAX < kernels.len() {
            runs[number] = kernels[number % KERNELS_MAX].run;
        }
        number += 1;
    }
    runs
}

/// The function of a number without a kernel.
fn nothing(_: &mut Frame<'_>, _: &[u32]) {}

/// Runs the kernel with this number; does nothing if it does not exist.
#[inline]
pub fn run(number: u16, frame: &mut Frame<'_>, operands: &[u32]) {
    if let Some(run) = RUNS.get(usize::from(number)) {
        run(frame, operands);
    }
}

/// Returns a hash of names, ports and parameters: builds with equal fingerprints agree on the meaning of kernel
/// numbers.
pub fn fingerprint() -> u64 {
    topic::hash(CATALOGUE.iter().flat_map(|entry| {
        let spec = &entry.spec;
        let ports = spec.inputs.iter().chain(spec.outputs);
        let names = ports.map(|port| port.name);
        let parameters = spec.parameters.iter().map(|parameter| parameter.name);
        [spec.name].into_iter().chain(names).chain(parameters)
    }))
}

#[cfg(test)]
mod scalar_properties;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitive::{NullRule, PROPAGATES, ParameterKind, Role};

    #[test]
    fn the_catalogue_is_sorted_and_free_of_duplicates() {
        assert!(
            CATALOGUE
                .windows(2)
                .all(|pair| pair[0].spec.name < pair[1].spec.name)
        );
    }

    #[test]
    fn names_in_the_docs_are_names_of_primitives() {
        let text = include_str!("../../docs/names.md");
        let rows = text
            .lines()
            .filter_map(|line| line.strip_prefix("| ")?.split_once(" | "));
        let here = rows
            .skip(1)
            .flat_map(|(_, here)| here.split('`').skip(1).step_by(2));
        let names: std::vec::Vec<_> = here.collect();
        assert!(names.len() > 50);
        for name in names {
            assert!(find(name).is_some(), "{name}");
        }
    }

    #[test]
    fn every_primitive_is_documented() {
        for entry in CATALOGUE {
            let spec = &entry.spec;
            assert!(
                spec.summary.ends_with('.'),
                "{}: the summary is a sentence",
                spec.name
            );
            assert!(!spec.null.is_empty(), "{}", spec.name);
            let ports = spec.inputs.iter().chain(spec.outputs);
            assert!(
                ports.clone().all(|port| !port.doc.is_empty()),
                "{}",
                spec.name
            );
            assert!(
                spec.parameters
                    .iter()
                    .all(|parameter| !parameter.doc.is_empty()),
                "{}",
                spec.name
            );
        }
    }

    #[test]
    fn the_null_rule_agrees_with_its_description() {
        for entry in CATALOGUE {
            let spec = &entry.spec;
            if spec.null == PROPAGATES {
                assert_eq!(spec.null_rule, NullRule::Propagates, "{}", spec.name);
            }
        }
    }

    #[test]
    fn names_are_unique_within_a_primitive() {
        for entry in CATALOGUE {
            let inputs = entry.spec.inputs.iter().map(|port| port.name);
            let names: std::vec::Vec<_> = inputs
                .chain(entry.spec.parameters.iter().map(|p| p.name))
                .collect();
            let mut unique = names.clone();
            unique.sort_unstable();
            unique.dedup();
            assert_eq!(unique.len(), names.len(), "{}", entry.spec.name);
        }
    }

    #[test]
    fn kernels_fit_the_role_and_the_ports() {
        for entry in CATALOGUE {
            let spec = &entry.spec;
            let without = matches!(spec.role, Role::Monitor | Role::Constant | Role::Input);
            assert_eq!(entry.kernels.is_empty(), without, "{}", spec.name);
            assert!(entry.kernels.len() <= KERNELS_MAX, "{}", spec.name);
            let any = spec
                .inputs
                .iter()
                .chain(spec.outputs)
                .any(|p| p.ty.is_open());
            if any && !without {
                assert!(
                    entry.kernels.iter().all(|kernel| kernel.store.is_some()),
                    "{}",
                    spec.name
                );
            }
            let device = spec
                .parameters
                .iter()
                .position(|p| matches!(p.kind, ParameterKind::Arm | ParameterKind::Device));
            let channel = spec
                .parameters
                .iter()
                .position(|p| matches!(p.kind, ParameterKind::Channel(_)));
            assert!(
                channel.is_none() || device < channel,
                "{}: the device comes before the channel",
                spec.name
            );
        }
    }

    /// The name of a field for a port or parameter; a name that several have is written out in the struct.
    fn is_field(field: &str, name: &str) -> bool {
        match name {
            "in" => field == "input",
            _ => field == name || field.ends_with(&std::format!("_{name}")) || field == "flange",
        }
    }

    /// A field at the wrong position would read another operand: names and kinds agree with the spec.
    #[test]
    fn the_fields_of_kernels_are_the_operands_of_their_specs() {
        let (mut fields, mut wrong) = (0, std::vec![]);
        for entry in CATALOGUE {
            let spec = &entry.spec;
            let names = spec.operand_names();
            for kernel in entry
                .kernels
                .iter()
                .filter(|kernel| !kernel.fields.is_empty())
            {
                let operands: std::vec::Vec<_> = spec.operands(kernel).collect();
                let width = usize::from(kernel.by_element);
                assert_eq!(operands.len(), kernel.fields.len() + width, "{}", spec.name);
                for ((field, kind), operand) in kernel.fields.iter().zip(&operands) {
                    assert!(kind.fits(*operand), "{}: {field} is {operand:?}", spec.name);
                }
                let pairs = kernel.fields.iter().zip(names.clone());
                let others = pairs.filter(|((field, _), name)| !is_field(field, name));
                wrong.extend(others.map(|((field, _), name)| (spec.name, *field, name)));
                fields += kernel.fields.len();
            }
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
        assert!(fields > 800, "{fields}");
    }
}
