//! Target `plan`: plans of shipped nets with arbitrary changes, offered to the executor, then run with devices that
//! measure anything. It must not panic, no set-point may leave the limits, and a refused plan must command nothing. Run
//! by the thread of the target.

use arbitrary::{Arbitrary, Result, Unstructured};
use rcc_core::message::DeviceState;
use rcc_core::plan::{Delay, KernelRun, MonitorPoint, NO_REGION, NullRange, PlanRegion, RunBlock};
use rcc_core::types::Store;
use rcc_engine::queue::EngineRequest;
use rcc_protocol::control::PlanData;

use crate::engine::EngineHarness;
use crate::shipped::shipped;

const CYCLES: usize = 100;
const CHANGES_MAX: usize = 12;

/// Derives a plan from the bytes, and the events while it runs.
pub fn run(data: &[u8]) {
    let mut bytes = Unstructured::new(data);
    // When the bytes run out, the changes end, not the run.
    let plan = changed(&mut bytes);
    run_plan(plan, &mut bytes);
}

/// Offers a plan to the executor and runs it if it is accepted.
pub(crate) fn run_plan(plan: PlanData, bytes: &mut Unstructured<'_>) {
    let mut harness = EngineHarness::new();
    let id = match harness.build(plan) {
        Ok(net) => harness.install(net).unwrap_or(0),
        Err(_) => 0,
    };
    harness.ask(|ticket| EngineRequest::Start {
        ticket,
        id,
        lease: 0,
    });
    for _ in 0..CYCLES {
        if !bytes.is_empty() {
            // Missing bytes read as 0: no event.
            let _ = apply_event(&mut harness, id, bytes);
        }
        harness.step();
    }
    harness.ask(|ticket| EngineRequest::Abort { ticket, id });
    harness.step();
    assert!(
        id != 0 || harness.commanded == 0,
        "a refused plan commands nothing"
    );
    assert!(harness.is_over(id));
    let before = harness.commanded;
    harness.step();
    assert_eq!(
        harness.commanded, before,
        "a net that has ended commands nothing"
    );
}

fn changed(bytes: &mut Unstructured<'_>) -> PlanData {
    let plans = &shipped().plans;
    let index = bytes.int_in_range(0..=plans.len() - 1).unwrap_or(0);
    let mut plan = plans[index].clone();
    let changes = bytes.int_in_range(0..=CHANGES_MAX).unwrap_or(0);
    for _ in 0..changes {
        if change(&mut plan, bytes).is_err() {
            break;
        }
    }
    plan
}

fn change(plan: &mut PlanData, bytes: &mut Unstructured<'_>) -> Result<()> {
    match bytes.int_in_range(0..=18)? {
        0..=2 => set(&mut plan.reals, real, bytes),
        3 => set(&mut plan.bools, u8::arbitrary, bytes),
        4 => set(&mut plan.ints, i64::arbitrary, bytes),
        5..=7 => set(&mut plan.operands, mostly_small_number, bytes),
        8 => set(&mut plan.runs, arbitrary_run, bytes),
        9 => insert(&mut plan.runs, arbitrary_run, bytes),
        10 => insert(&mut plan.delays, arbitrary_delay, bytes),
        11 => insert(&mut plan.monitors, arbitrary_monitor, bytes),
        12 => insert(&mut plan.reals, real, bytes),
        13 => remove(plan, bytes),
        14 => {
            let swap = (
                place(plan.runs.len(), bytes)?,
                place(plan.runs.len(), bytes)?,
            );
            if let (Some(a), Some(b)) = swap {
                plan.runs.swap(a, b);
            }
            Ok(())
        }
        15 => append_region(plan, bytes),
        16 => set(&mut plan.regions, arbitrary_region, bytes),
        17 => match bool::arbitrary(bytes)? {
            true => insert(&mut plan.blocks, arbitrary_block, bytes),
            false => set(&mut plan.blocks, arbitrary_block, bytes),
        },
        _ => {
            plan.clocks = bytes.int_in_range(0..=65)?;
            plan.survives_device_loss = bool::arbitrary(bytes)?;
            if bool::arbitrary(bytes)? {
                plan.rate.every = bytes.int_in_range(0..=12_000)?;
                plan.rate.phase = bytes.int_in_range(0..=12_000)?;
            }
            Ok(())
        }
    }
}

fn remove(plan: &mut PlanData, bytes: &mut Unstructured<'_>) -> Result<()> {
    match bytes.int_in_range(0..=3)? {
        0 => remove_one(&mut plan.runs, bytes),
        1 => remove_one(&mut plan.operands, bytes),
        2 => remove_one(&mut plan.delays, bytes),
        _ => {
            let length = bytes.int_in_range(0..=plan.reals.len())?;
            plan.reals.truncate(length);
            Ok(())
        }
    }
}

fn remove_one<T>(all: &mut Vec<T>, bytes: &mut Unstructured<'_>) -> Result<()> {
    if let Some(index) = place(all.len(), bytes)? {
        all.remove(index);
    }
    Ok(())
}

fn place(length: usize, bytes: &mut Unstructured<'_>) -> Result<Option<usize>> {
    match length.checked_sub(1) {
        Some(last) => bytes.int_in_range(0..=last).map(Some),
        None => Ok(None),
    }
}

type Make<'a, T> = fn(&mut Unstructured<'a>) -> Result<T>;

fn set<'a, T>(all: &mut [T], make: Make<'a, T>, bytes: &mut Unstructured<'a>) -> Result<()> {
    if let Some(index) = place(all.len(), bytes)? {
        all[index] = make(bytes)?;
    }
    Ok(())
}

fn insert<'a, T>(all: &mut Vec<T>, make: Make<'a, T>, bytes: &mut Unstructured<'a>) -> Result<()> {
    let index = bytes.int_in_range(0..=all.len())?;
    all.insert(index, make(bytes)?);
    Ok(())
}

/// Returns a number: a special value, a number of usual size, or any other.
pub(crate) fn real(bytes: &mut Unstructured<'_>) -> Result<f64> {
    const ODD: [f64; 12] = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        f64::MIN_POSITIVE,
        1e-9,
        1e9,
        1e300,
    ];
    match bytes.int_in_range(0..=3)? {
        0 => bytes.choose(&ODD).copied(),
        1 => f64::arbitrary(bytes),
        _ => Ok(f64::from(i16::arbitrary(bytes)?) * 1e-4),
    }
}

fn mostly_small_number(bytes: &mut Unstructured<'_>) -> Result<u32> {
    if bool::arbitrary(bytes)? {
        return u8::arbitrary(bytes).map(u32::from);
    }
    u32::arbitrary(bytes)
}

fn arbitrary_run(bytes: &mut Unstructured<'_>) -> Result<KernelRun> {
    Ok(KernelRun {
        kernel: bytes.int_in_range(0..=300)?,
        first: mostly_small_number(bytes)?,
        operands: mostly_small_number(bytes)?,
    })
}

fn arbitrary_block(bytes: &mut Unstructured<'_>) -> Result<RunBlock> {
    let region = match bool::arbitrary(bytes)? {
        true => NO_REGION,
        false => bytes.int_in_range(0..=3)?,
    };
    Ok(RunBlock {
        region,
        runs: bytes.int_in_range(0..=20)?,
    })
}

fn arbitrary_region(bytes: &mut Unstructured<'_>) -> Result<PlanRegion> {
    Ok(PlanRegion {
        condition: mostly_small_number(bytes)?,
        within: match bool::arbitrary(bytes)? {
            true => NO_REGION,
            false => mostly_small_number(bytes)?,
        },
        active: mostly_small_number(bytes)?,
        blanks: bytes.int_in_range(0..=3)?,
    })
}

/// Puts some of the last runs under a condition, so that the blocks still cover all runs.
fn append_region(plan: &mut PlanData, bytes: &mut Unstructured<'_>) -> Result<()> {
    let region = arbitrary_region(bytes)?;
    for _ in 0..region.blanks {
        plan.blanks.push(NullRange {
            store: arbitrary_store(bytes)?,
            slot: mostly_small_number(bytes)?,
            width: bytes.int_in_range(0..=9)?,
        });
    }
    let number = plan.regions.len() as u32;
    if plan.blocks.is_empty() {
        plan.blocks.push(RunBlock {
            region: NO_REGION,
            runs: plan.runs.len() as u32,
        });
    }
    let runs = match plan.blocks.last_mut() {
        Some(last) => {
            let runs = bytes.int_in_range(0..=last.runs)?;
            last.runs -= runs;
            runs
        }
        None => 0,
    };
    plan.regions.push(region);
    plan.blocks.push(RunBlock {
        region: number,
        runs,
    });
    Ok(())
}

fn arbitrary_store(bytes: &mut Unstructured<'_>) -> Result<Store> {
    bytes
        .choose(&[Store::Real, Store::Bool, Store::Int])
        .copied()
}

fn arbitrary_delay(bytes: &mut Unstructured<'_>) -> Result<Delay> {
    Ok(Delay {
        store: arbitrary_store(bytes)?,
        from: mostly_small_number(bytes)?,
        to: mostly_small_number(bytes)?,
        width: mostly_small_number(bytes)?,
    })
}

fn arbitrary_monitor(bytes: &mut Unstructured<'_>) -> Result<MonitorPoint> {
    Ok(MonitorPoint {
        store: arbitrary_store(bytes)?,
        slot: mostly_small_number(bytes)?,
        width: mostly_small_number(bytes)?,
        every: mostly_small_number(bytes)?,
    })
}

/// Applies an event that may happen before a cycle.
pub(crate) fn apply_event(
    harness: &mut EngineHarness,
    id: u64,
    bytes: &mut Unstructured<'_>,
) -> Result<()> {
    let device = bytes.int_in_range(0..=harness.measured.len() - 1)?;
    match bytes.int_in_range(0..=31)? {
        0 => harness.alive = false,
        1 => (harness.alive, harness.honest, harness.attached) = (true, true, true),
        2 => harness.attached = false,
        3 => harness.honest = false,
        4 => drop(harness.ask(|ticket| EngineRequest::Cancel { ticket, id })),
        5 => drop(harness.ask(|ticket| EngineRequest::Start {
            ticket,
            id,
            lease: 0,
        })),
        6 => {
            harness.measured[device].state =
                bytes.int_in_range(0..=DeviceState::ALL.len() as u32)?
        }
        7 => {
            let joint = bytes.int_in_range(0..=7)?;
            harness.measured[device].hold[joint] = real(bytes)?;
        }
        8 => {
            let joint = bytes.int_in_range(0..=7)?;
            harness.measured[device].position[joint] = real(bytes)?;
        }
        9 => harness.measured[device].wrench[bytes.int_in_range(0..=5)?] = real(bytes)?,
        10 => harness.measured[device].analog[bytes.int_in_range(0..=15)?] = real(bytes)?,
        11 => {
            (
                harness.measured[device].digital,
                harness.measured[device].digital_known,
            ) = <_>::arbitrary(bytes)?
        }
        12 => harness.measured[device].settled_ns = u64::arbitrary(bytes)?,
        13 => harness.measured[device].joints = u32::arbitrary(bytes)?,
        14 => harness.measured[device].sequence = u64::arbitrary(bytes)? >> 1,
        15 => harness.measured[device].magic ^= 1,
        _ => {}
    }
    Ok(())
}
