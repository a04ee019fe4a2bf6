//! The start of a session: the line is found, compared with the configured one, set, and brought to SAFEOP.
//! Run by the thread of the session.

use std::time::Duration;

use ethercrab::error::Error;
use ethercrab::std::ethercat_now;
use ethercrab::subdevice_group::{DcConfiguration, HasDc, NoDc, PreOp, PreOpPdi, SafeOp};
use ethercrab::{DcSync, DefaultLock, MainDevice, SubDeviceGroup};

use super::{
    ClockOptions, ExpectedTerminal, IMAGE_MAX, ObjectData, SessionError, SessionOptions,
    TERMINALS_MAX,
};

/// A line in a state, without distributed clocks unless `Clocks` says otherwise.
pub(super) type Group<State, Clocks = NoDc> =
    SubDeviceGroup<TERMINALS_MAX, IMAGE_MAX, DefaultLock, State, Clocks>;

/// A line in SAFEOP.
#[allow(
    clippy::large_enum_variant,
    reason = "one per session, matched at once"
)]
pub(super) enum StartedLine {
    /// The period is this machine's.
    Free(Group<SafeOp>),
    /// The period is that of the reference clock.
    Clocked(Group<SafeOp, HasDc>),
}

/// Register of the watchdog divider: units of 40 ns, less 2 (ETG.1000.4, section 6.3).
const WATCHDOG_DIVIDER: u16 = 0x0400;
/// Register of the watchdog of process data, in units of the divider.
const WATCHDOG_TIME: u16 = 0x0420;
/// Time from the start of SYNC0 being set until its first signal.
const SYNC_DELAY: Duration = Duration::from_millis(100);
/// Divider for units of 100 µs.
const DIVIDER: u16 = 2498;
/// Unit of the watchdog's time with that divider.
const WATCHDOG_UNIT: Duration = Duration::from_micros(100);

/// Brings the line to SAFEOP.
pub(super) async fn start(
    main: &MainDevice<'_>,
    options: &SessionOptions,
) -> Result<StartedLine, SessionError> {
    let group = main
        .init_single_group::<TERMINALS_MAX, IMAGE_MAX>(ethercat_now)
        .await;
    let group = group.map_err(|error| match error {
        Error::Timeout(_) if main.num_subdevices() == 0 => SessionError::NoAnswer {
            interface: options.interface.to_string(),
        },
        error => fault("PREOP", error),
    })?;
    let found = group.iter(main).map(|terminal| {
        let identity = terminal.identity();
        let name = terminal.name().to_owned();
        (name, identity.vendor_id, identity.product_id)
    });
    compare(&options.line, &found.collect::<Vec<_>>())?;
    set(main, &group, options).await?;
    let safe_op = |error| fault("SAFEOP", error);
    match options.clocks {
        None => {
            let group = group.into_safe_op(main).await.map_err(safe_op)?;
            Ok(StartedLine::Free(group))
        }
        Some(clocks) => {
            let group = set_clocks(main, group, options, clocks).await?;
            let group = group.into_safe_op(main).await.map_err(safe_op)?;
            Ok(StartedLine::Clocked(group))
        }
    }
}

/// Switches SYNC0 of the terminals on that shall have it.
async fn set_clocks(
    main: &MainDevice<'_>,
    mut group: Group<PreOp>,
    options: &SessionOptions,
    clocks: ClockOptions,
) -> Result<Group<PreOpPdi, HasDc>, SessionError> {
    let mut any = false;
    for ((mut terminal, expected), position) in group.iter_mut(main).zip(&options.line).zip(1..) {
        let has_clock = terminal.dc_support().any();
        any |= has_clock;
        if expected.sync0 && !has_clock {
            return Err(SessionError::NoSync {
                position,
                name: expected.name.clone(),
            });
        }
        terminal.set_dc_sync(match expected.sync0 {
            true => DcSync::Sync0,
            false => DcSync::Disabled,
        });
    }
    if !any {
        return Err(SessionError::NoClock);
    }
    let configuration = DcConfiguration {
        start_delay: SYNC_DELAY,
        sync0_period: options.period,
        sync0_shift: clocks.shift,
    };
    let group = group
        .into_pre_op_pdi(main)
        .await
        .map_err(|error| fault("SAFEOP", error))?;
    let group = group.configure_dc_sync(main, configuration).await;
    group.map_err(|error| fault("SAFEOP with distributed clocks", error))
}

/// Returns the error of a step.
pub(super) fn fault(state: &'static str, error: Error) -> SessionError {
    SessionError::Start {
        state,
        cause: error.to_string(),
    }
}

/// Writes the watchdogs and the objects.
async fn set(
    main: &MainDevice<'_>,
    group: &Group<PreOp>,
    options: &SessionOptions,
) -> Result<(), SessionError> {
    for ((terminal, expected), position) in group.iter(main).zip(&options.line).zip(1..) {
        if let Some(watchdog) = expected.watchdog {
            let units = watchdog.as_micros() / WATCHDOG_UNIT.as_micros();
            let units = u16::try_from(units).unwrap_or(u16::MAX).max(1);
            for (register, value) in [(WATCHDOG_DIVIDER, DIVIDER), (WATCHDOG_TIME, units)] {
                let written = terminal.register_write(register, value).await;
                written.map_err(|error| fault("PREOP", error))?;
            }
        }
        for object in &expected.objects {
            let (index, sub_index) = (object.index, object.sub_index);
            let written = match object.value {
                ObjectData::I8(value) => terminal.sdo_write(index, sub_index, value).await,
                ObjectData::U8(value) => terminal.sdo_write(index, sub_index, value).await,
                ObjectData::I16(value) => terminal.sdo_write(index, sub_index, value).await,
                ObjectData::U16(value) => terminal.sdo_write(index, sub_index, value).await,
                ObjectData::U32(value) => terminal.sdo_write(index, sub_index, value).await,
            };
            written.map_err(|error| SessionError::Object {
                position,
                name: expected.name.clone(),
                index,
                sub_index,
                cause: error.to_string(),
            })?;
        }
    }
    Ok(())
}

/// Compares the line that was found, `(name, vendor, product)`, with the configured one.
fn compare(want: &[ExpectedTerminal], found: &[(String, u32, u32)]) -> Result<(), SessionError> {
    for ((want, (name, vendor, product)), position) in want.iter().zip(found).zip(1..) {
        if (want.vendor, want.product) != (*vendor, *product) {
            return Err(SessionError::Terminal {
                position,
                have: name.clone(),
                vendor: *vendor,
                product: *product,
                want: want.name.clone(),
            });
        }
    }
    if want.len() != found.len() {
        return Err(SessionError::Count {
            have: found.len(),
            want: want.len(),
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_is_told_by_its_position() {
        let want = |product| ExpectedTerminal {
            name: "EL1008".into(),
            vendor: 2,
            product,
            watchdog: None,
            objects: Vec::new(),
            sync0: false,
        };
        let found = [("EL1008".to_owned(), 2, 7), ("EL2008".to_owned(), 2, 8)];
        let error = compare(&[want(7), want(7)], &found).unwrap_err();
        assert_eq!(
            error.to_string(),
            "terminal 2 is EL2008 (vendor 0x2, product 0x00000008); the configuration names EL1008"
        );
        let error = compare(&[want(7)], &found).unwrap_err();
        assert_eq!(error, SessionError::Count { have: 2, want: 1 });
    }
}
