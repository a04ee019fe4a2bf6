//! Properties of the scalar primitives, tested with pseudo-random inputs that include extremes and null: every output
//! is finite or null and in its range, and no input has a permanent effect. Test code only.

use std::vec::Vec;

use super::CATALOGUE;
use crate::primitive::{
    CatalogueEntry, DefaultValue, PROPAGATES, Parameter, ParameterKind, Port, PortType, Role,
};
use crate::testing::PrimitiveHarness;
use crate::types::{NULL_INT, Store, Type};

/// Number of pseudo-random sequences.
const SEEDS: u64 = 20;
const CYCLES: usize = 300;

/// A linear congruential generator (Knuth, TAOCP 2, 3.3.4, table 1, line 26).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 33
    }

    fn real(&mut self) -> f64 {
        let even = self.next() as f64 / (1_u64 << 31) as f64;
        match self.next() % 16 {
            0 => f64::NAN,
            1 => 1e308,
            2 => -1e308,
            3 => f64::MAX,
            4 => -f64::MAX,
            5 => 5e-324,
            6 => -0.0,
            7 => 0.0,
            8 => 1e19 * even,
            9 => -1e300 * even,
            _ => 8.0 * even - 4.0,
        }
    }

    fn int(&mut self) -> i64 {
        match self.next() % 8 {
            0 => NULL_INT,
            1 => i64::MAX,
            2 => -i64::MAX,
            3 => 0,
            _ => self.next() as i64 % 100 - 50,
        }
    }

    fn bool(&mut self) -> Option<bool> {
        [Some(false), Some(true), None][self.next() as usize % 3]
    }
}

/// Returns the arena of ports of a type; `open` is the arena of ports whose type is inferred.
fn store(ty: PortType, open: Store) -> Option<Store> {
    match ty {
        PortType::Is(Type::Real) => Some(Store::Real),
        PortType::Is(Type::Int) => Some(Store::Int),
        PortType::Is(Type::Bool) => Some(Store::Bool),
        PortType::Scalar | PortType::Number => Some(open),
        _ => None,
    }
}

/// Returns the primitives whose ports are all scalars, each with an arena for its open ports.
fn scalars() -> Vec<(&'static CatalogueEntry, Store)> {
    let all = CATALOGUE.iter().flat_map(|entry| {
        let stores = [Store::Real, Store::Int, Store::Bool];
        stores.map(move |store| (*entry, store))
    });
    all.filter(|(entry, open)| {
        let spec = &entry.spec;
        let mut ports = spec.inputs.iter().chain(spec.outputs);
        let is_open = ports.clone().any(|port| port.ty.is_open());
        let kernel = entry.kernel_for(is_open.then_some(*open), 1);
        spec.role == Role::Plain
            && kernel.is_some()
            && (is_open || *open == Store::Real)
            && ports.all(|port| store(port.ty, *open).is_some())
            && spec.parameters.iter().all(|p| {
                let ty = p.kind.value();
                ty.is_some_and(|(ty, _)| store(ty, *open).is_some())
            })
    })
    .collect()
}

/// Returns a harness of the primitive, with parameters in the middle of their ranges.
fn bench((entry, open): (&'static CatalogueEntry, Store)) -> PrimitiveHarness {
    let spec = &entry.spec;
    let mut bench = PrimitiveHarness::wide(spec.name, Some(open), 1);
    for parameter in spec.parameters {
        let ParameterKind::Value(ty, _) = parameter.kind else {
            continue;
        };
        match store(ty, open) {
            Some(Store::Real) => bench.set_real(parameter.name, usual(parameter)),
            Some(Store::Bool) => bench.set_bool(parameter.name, Some(false)),
            _ => bench.set_int(parameter.name, 3),
        };
    }
    if entry.prepare.is_some() {
        bench.prepare().unwrap();
    }
    bench
}

fn usual(parameter: &Parameter) -> f64 {
    match (parameter.default, parameter.at_most) {
        (Some(DefaultValue::Real(value)), _) => value,
        (Some(DefaultValue::Null), _) => f64::NAN,
        (_, Some(most)) => most / 2.0,
        _ if parameter.below_nyquist => 50.0,
        _ => 0.25,
    }
}

/// Sets an input to a pseudo-random value; returns whether it is null.
fn set(bench: &mut PrimitiveHarness, port: &Port, store: Store, random: &mut Random) -> bool {
    match store {
        Store::Real => {
            let value = random.real();
            bench.set_real(port.name, value);
            value.is_nan()
        }
        Store::Int => {
            let value = random.int();
            bench.set_int(port.name, value);
            value == NULL_INT
        }
        Store::Bool => {
            let value = random.bool();
            bench.set_bool(port.name, value);
            value.is_none()
        }
    }
}

/// Returns an output as a number, NaN if it is null.
fn number(bench: &PrimitiveHarness, port: &Port, store: Store) -> f64 {
    match store {
        Store::Real => bench.real(port.name),
        Store::Int if bench.int(port.name) == NULL_INT => f64::NAN,
        Store::Int => bench.int(port.name) as f64,
        Store::Bool => bench
            .bool(port.name)
            .map_or(f64::NAN, |value| f64::from(u8::from(value))),
    }
}

#[test]
fn every_output_is_finite_or_null_and_in_its_range() {
    assert!(scalars().len() > 70);
    for (entry, open) in scalars() {
        let (mut bench, mut random) = (bench((entry, open)), Random(7));
        let spec = &entry.spec;
        for cycle in 0..10 * CYCLES {
            let mut null = false;
            for port in spec.inputs {
                null |= set(&mut bench, port, store(port.ty, open).unwrap(), &mut random);
            }
            bench.step();
            for port in spec.outputs {
                let out = number(&bench, port, store(port.ty, open).unwrap());
                let what = std::format!(
                    "{}.{} ({open:?}) in cycle {cycle}: {out}",
                    spec.name,
                    port.name
                );
                assert!(!out.is_infinite(), "{what}");
                assert!(!port.least.is_some_and(|least| out < least), "{what}");
                assert!(
                    !port.greatest.is_some_and(|greatest| out > greatest),
                    "{what}"
                );
                assert!(!(null && spec.null == PROPAGATES) || out.is_nan(), "{what}");
            }
        }
    }
}

#[test]
fn no_input_has_a_permanent_effect() {
    for (seed, (entry, open)) in
        (0..SEEDS).flat_map(|seed| scalars().into_iter().map(move |it| (seed, it)))
    {
        let (mut bench, mut fresh, mut random) =
            (bench((entry, open)), bench((entry, open)), Random(seed));
        let spec = &entry.spec;
        for round in 0..30 {
            for _ in 0..20 {
                for port in spec.inputs {
                    set(&mut bench, port, store(port.ty, open).unwrap(), &mut random);
                }
                bench.step();
            }
            // Simple inputs, increasing in port order, so that lower bounds are below upper bounds.
            for bench in [&mut bench, &mut fresh] {
                for (index, port) in spec.inputs.iter().enumerate() {
                    match store(port.ty, open).unwrap() {
                        Store::Real => bench.set_real(port.name, 0.25 * (index + 1) as f64),
                        Store::Int => bench.set_int(port.name, index as i64 + 1),
                        Store::Bool => bench.set_bool(port.name, Some(false)),
                    };
                }
                for _ in 0..3 {
                    bench.step();
                }
            }
            for port in spec.outputs {
                let store = store(port.ty, open).unwrap();
                let [have, want] =
                    [&bench, &fresh].map(|bench| number(bench, port, store).is_nan());
                assert_eq!(
                    have, want,
                    "{}.{} ({open:?}) in round {round} of seed {seed}",
                    spec.name, port.name
                );
            }
        }
    }
}
