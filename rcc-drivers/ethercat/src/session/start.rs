//! The start of a session: the line is found, compared with the configured one, set, and brought to SAFEOP.
//! Run by the thread of the session.

use std::time::Duration;

use ethercrab::error::Error;
use ethercrab::std::ethercat_now;
use ethercrab::subdevice_group::{PreOp, SafeOp};
use ethercrab::{DefaultLock, MainDevice, SubDeviceGroup};

use super::{ExpectedTerminal, IMAGE_MAX, ObjectData, SessionError, SessionOptions, TERMINALS_MAX};

/// A line in a state.
pub(super) type Group<State> = SubDeviceGroup<TERMINALS_MAX, IMAGE_MAX, DefaultLock, State>;

/// Register of the watchdog divider: units of 40 ns, less 2 (ETG.1000.4, section 6.3).
const WATCHDOG_DIVIDER: u16 = 0x0400;
/// Register of the watchdog of process data, in units of the divider.
const WATCHDOG_TIME: u16 = 0x0420;
/// Divider for units of 100 µs.
const DIVIDER: u16 = 2498;
/// Unit of the watchdog's time with that divider.
const WATCHDOG_UNIT: Duration = Duration::from_micros(100);

/// Brings the line to SAFEOP.
pub(super) async fn start(
    main: &MainDevice<'_>,
    options: &SessionOptions,
) -> Result<Group<SafeOp>, SessionError> {
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
    group
        .into_safe_op(main)
        .await
        .map_err(|error| fault("SAFEOP", error))
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
