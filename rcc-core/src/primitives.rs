//! The catalogue: a folder for each subject, with one `mod` line and one row for each primitive.

use crate::frame::Frame;
pub use crate::primitive::CatalogueEntry;
use crate::primitive::{Kernel, Port};
use crate::{fnv, topic};

mod arithmetic;
mod arms;
mod arrays;
mod bits;
mod curves;
mod devices;
mod filters;
mod logic;
mod motion;
mod nets;
mod selection;
mod space;
mod start;
mod timing;

/// A subject: a folder of primitives, and a chapter of the manual.
pub struct Subject {
    /// Title of the chapter.
    pub title: &'static str,
    entries: &'static [&'static CatalogueEntry],
}

const fn subject(title: &'static str, entries: &'static [&'static CatalogueEntry]) -> Subject {
    Subject { title, entries }
}

/// The subjects, in the order of the manual.
pub const SUBJECTS: &[Subject] = &[
    subject("Nets", nets::ENTRIES),
    subject("Motion", motion::ENTRIES),
    subject("Arms", arms::ENTRIES),
    subject("Devices", devices::ENTRIES),
    subject("Logic", logic::ENTRIES),
    subject("Timing", timing::ENTRIES),
    subject("Arithmetic", arithmetic::ENTRIES),
    subject("Bits", bits::ENTRIES),
    subject("Curves and tables", curves::ENTRIES),
    subject("Filters and control", filters::ENTRIES),
    subject("Arrays and matrices", arrays::ENTRIES),
    subject("Space", space::ENTRIES),
    subject("Selection and null", selection::ENTRIES),
];

impl Subject {
    /// Returns the subject of a primitive.
    #[must_use]
    pub fn of(name: &str) -> Option<&'static Subject> {
        let has = |entry: &&CatalogueEntry| entry.spec.name == name;
        SUBJECTS
            .iter()
            .find(|subject| subject.entries.iter().any(has))
    }
}

/// All primitives, sorted by name.
pub const CATALOGUE: &[&CatalogueEntry] = &sorted();

// Evaluated at compile time, as what follows: an index out of bounds does not compile.
#[allow(clippy::indexing_slicing)]
const COUNT: usize = {
    let (mut count, mut subject) = (0, 0);
    while subject < SUBJECTS.len() {
        count += SUBJECTS[subject].entries.len();
        subject += 1;
    }
    count
};

#[allow(clippy::indexing_slicing)]
const fn sorted() -> [&'static CatalogueEntry; COUNT] {
    let mut all = [SUBJECTS[0].entries[0]; COUNT];
    let (mut count, mut subject) = (0, 0);
    while subject < SUBJECTS.len() {
        let entries = SUBJECTS[subject].entries;
        let mut next = 0;
        while next < entries.len() {
            let mut place = count;
            while place > 0 && is_before(entries[next].spec.name, all[place - 1].spec.name) {
                all[place] = all[place - 1];
                place -= 1;
            }
            all[place] = entries[next];
            count += 1;
            next += 1;
        }
        subject += 1;
    }
    all
}

#[allow(clippy::indexing_slicing)]
const fn is_before(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut i = 0;
    while i < a.len() && i < b.len() {
        if a[i] != b[i] {
            return a[i] < b[i];
        }
        i += 1;
    }
    a.len() < b.len()
}

/// Maximum number of kernels of one primitive.
pub const KERNELS_MAX: usize = 8;

/// Where the names of each first byte begin in the catalogue, and those of the next one.
static INITIALS: [u16; 129] = initials();

#[allow(clippy::indexing_slicing)] // As above.
const fn initials() -> [u16; 129] {
    let mut initials = [0; 129];
    let (mut byte, mut row) = (0, 0);
    while byte < initials.len() {
        while row < CATALOGUE.len() && (CATALOGUE[row].spec.name.as_bytes()[0] as usize) < byte {
            row += 1;
        }
        initials[byte] = row as u16;
        byte += 1;
    }
    initials
}

/// Finds a primitive by name.
pub fn find(name: &str) -> Option<(usize, &'static CatalogueEntry)> {
    let first = usize::from(*name.as_bytes().first()?);
    let (from, to) = (*INITIALS.get(first)?, *INITIALS.get(first + 1)?);
    let rows = CATALOGUE.get(usize::from(from)..usize::from(to))?;
    let index = rows.binary_search_by_key(&name, |entry| entry.spec.name);
    let index = usize::from(from) + index.ok()?;
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

/// Kernel functions by kernel number.
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

/// The function of the kernel with this number; one that does nothing if it does not exist.
#[must_use]
pub fn function(number: u16) -> RunKernel {
    RUNS.get(usize::from(number)).copied().unwrap_or(nothing)
}

/// Version of the time laws of motions. It is to be changed with every change of a set-point of a motion, so that an incident
/// that was recorded before is refused instead of being evaluated to other values.
const TIME_LAWS: &str = "time laws 3";

/// Returns a hash of names, ports and parameters, and of the version of time laws: builds with equal fingerprints agree on
/// the meaning of kernel numbers and plan the same motions.
pub const fn fingerprint() -> u64 {
    FINGERPRINT
}

// Evaluated at compile time: every net that is loaded is compared with it several times.
#[allow(clippy::indexing_slicing)]
const FINGERPRINT: u64 = {
    let (mut hash, mut row) = (fnv::EMPTY, 0);
    while row < CATALOGUE.len() {
        let spec = &CATALOGUE[row].spec;
        hash = topic::add(hash, spec.name);
        hash = add_ports(add_ports(hash, spec.inputs), spec.outputs);
        let mut next = 0;
        while next < spec.parameters.len() {
            hash = topic::add(hash, spec.parameters[next].name);
            next += 1;
        }
        row += 1;
    }
    topic::add(hash, TIME_LAWS)
};

#[allow(clippy::indexing_slicing)]
const fn add_ports(mut hash: u64, ports: &[Port]) -> u64 {
    let mut next = 0;
    while next < ports.len() {
        hash = topic::add(hash, ports[next].name);
        next += 1;
    }
    hash
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
            _ => field == name || field.ends_with(&std::format!("_{name}")),
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
