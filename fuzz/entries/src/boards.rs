//! Target `boards`: arbitrary bytes on the boards shared between processes. Readers must treat them as hostile: no
//! panic, and no set-point outside the limits. Run by the thread of the target.

use arbitrary::{Arbitrary, Result, Unstructured};
use bytemuck::bytes_of_mut;
use rcc_core::impedance::ControlMode;
use rcc_core::message::{CommandImage, DeviceState, JOINTS_MAX, Joints, MAGIC, SetPoint};
use rcc_driver_kit::driver::{Exchange, Inputs};
use rcc_driver_kit::host::device_session::DeviceSession;
use rcc_driver_kit::host::limits::ArmLimits;
use rcc_engine::queue::EngineRequest;

use crate::engine::EngineHarness;
use crate::set_point_checker::SetPointChecker;
use crate::shipped::{HOLD, shipped};

const MS: u64 = 1_000_000;
const STEPS_MAX: usize = 200;

/// The first byte selects whose board is corrupted.
pub fn run(data: &[u8]) {
    let mut bytes = Unstructured::new(data);
    // When the bytes run out, the input ends.
    let _ = match bool::arbitrary(&mut bytes) {
        Ok(true) => measurements(&mut bytes),
        Ok(false) => {
            // Runs the same for a device that the executor's clock follows.
            let rest = bytes.peek_bytes(bytes.len()).unwrap_or_default();
            let _ = images(&mut Unstructured::new(rest), true);
            images(&mut bytes, false)
        }
        Err(error) => Err(error),
    };
}

/// Overwrites some words of a record. The caller restores the magic number, because otherwise nothing would be read at
/// all.
fn corrupt(record: &mut [u8], bytes: &mut Unstructured<'_>) -> Result<()> {
    for _ in 0..bytes.int_in_range(0..=6)? {
        let at = bytes.int_in_range(0..=record.len() / 8 - 1)? * 8;
        let word: [u8; 8] = match bytes.int_in_range(0..=3)? {
            0 => <_>::arbitrary(bytes)?,
            1 => u64::from(u16::arbitrary(bytes)?).to_le_bytes(),
            2 => crate::plan::real(bytes)?.to_le_bytes(),
            _ => [u8::arbitrary(bytes)?; 8],
        };
        record[at..at + 8].copy_from_slice(&word);
    }
    Ok(())
}

/// Simulates a driver that writes arbitrary measurements while a net moves its arm.
fn measurements(bytes: &mut Unstructured<'_>) -> Result<()> {
    let plans = &shipped().plans;
    let mut harness = EngineHarness::new();
    let index = bytes.int_in_range(0..=plans.len() - 1)?;
    let id = match harness.build(plans[index].clone()) {
        Ok(net) => harness.install(net).unwrap_or(0),
        Err(_) => 0,
    };
    harness.ask(|ticket| EngineRequest::Start {
        ticket,
        id,
        lease: 0,
    });
    for _ in 0..STEPS_MAX {
        if bytes.is_empty() {
            break;
        }
        for _ in 0..bytes.int_in_range(0..=20)? {
            harness.step();
        }
        let device = bytes.int_in_range(0..=harness.measured.len() - 1)?;
        corrupt(bytes_of_mut(&mut harness.measured[device]), bytes)?;
        // A real driver only counts up; the executor has no rule for a counter that wraps.
        harness.measured[device].sequence >>= 1;
        if bytes.ratio(7, 8)? {
            harness.measured[device].magic = MAGIC;
        }
        harness.honest = bytes.ratio(3, 4)?;
        harness.step();
    }
    Ok(())
}

/// Simulates an executor that writes arbitrary images to a driver whose arm can be commanded.
fn images(bytes: &mut Unstructured<'_>, leads: bool) -> Result<()> {
    let (_, device) = shipped()
        .cell
        .device("lwr")
        .unwrap_or_else(|| panic!("the demo has an lwr"));
    let limits = ArmLimits::of(device);
    let mut session = DeviceSession::new(device, 0);
    if leads {
        session = session.with_leading_clock();
    }
    let mut image = CommandImage::new(7, MS);
    let mut checker = SetPointChecker::new(limits.joints, 0.0);
    let mut exchange = Exchange {
        ticks: 1,
        period_ns: MS,
        commandable: false,
        startable: true,
        strategy: ControlMode::Position,
        mirror: HOLD,
        quality_permille: 1000,
        reason: 0,
        late: 0,
        refused: 0,
    };
    let outputs = session.exchange(0, &Inputs::NONE, &exchange);
    checker.rests(&outputs.position);
    exchange.commandable = true;
    let mut now_ns = 1_000 * MS;
    let (mut asked, mut step): (Joints, Option<f64>) = (HOLD, None);
    for _ in 0..STEPS_MAX {
        if bytes.is_empty() {
            break;
        }
        match bytes.int_in_range(0..=7)? {
            0 => step = Some(f64::from(i16::arbitrary(bytes)?) * 1e-7),
            1 => step = None,
            2 => corrupt(bytes_of_mut(&mut image), bytes)?,
            3 => now_ns += u64::from(u8::arbitrary(bytes)?) * MS,
            4 => exchange.ticks = u64::from(u8::arbitrary(bytes)?),
            5 => step = Some(crate::plan::real(bytes)?),
            _ => {}
        }
        if bytes.ratio(7, 8)? {
            image.head.magic = MAGIC;
        }
        for _ in 0..bytes.int_in_range(1..=20)? {
            now_ns = now_ns.saturating_add(MS);
            match step {
                Some(step) => asked[0] += step,
                None => asked = session.measurement().hold,
            }
            let point = SetPoint {
                owner: u64::from(step.is_some()),
                has_position: u64::from(step.is_some()),
                position: asked,
                ..SetPoint::NONE
            };
            image.push(image.head.sequence.wrapping_add(1), now_ns, point);
            session.observe(now_ns, Some(&image));
            let position = session.exchange(now_ns, &Inputs::NONE, &exchange).position;
            checker.follow(&position, exchange.ticks.max(1) as f64 * 1e-3);
            if session.measurement().state == DeviceState::Commanded as u32 {
                checker.in_range(&position);
            }
            assert!(position.iter().take(JOINTS_MAX).all(|q| q.is_finite()));
        }
    }
    Ok(())
}
