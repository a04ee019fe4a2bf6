//! The objects of a simulated drive (CiA 402; IEC 61800-7-201) in its object dictionary: settings with their defaults, and
//! present values.
//! Called by the thread of the socket.

use std::time::Duration;

use super::drive::{Drive, DriveSettings};
use super::objects::{ObjectDictionary, Setting};

/// Default window of the following error, counts.
const WINDOW: [u8; 4] = 100_000_u32.to_le_bytes();

/// The settings: index, sub-index, default, and the only value that is supported, if there is only one.
const SETTINGS: &[Setting] = &[
    // Abort connection option code: quick stop, if the MainDevice requests another state than OP.
    (0x6007, 0, &[3, 0], Some(&[3, 0])),
    // Quick stop option code: the quick stop ramp, then `switch on disabled`.
    (0x605a, 0, &[2, 0], Some(&[2, 0])),
    // Fault reaction option code: the quick stop ramp.
    (0x605e, 0, &[2, 0], Some(&[2, 0])),
    // Mode of operation: none.
    (0x6060, 0, &[0], None),
    // Window of the following error, counts, and its time-out, ms.
    (0x6065, 0, &WINDOW, None),
    (0x6066, 0, &[10, 0], None),
    // Largest speed, counts/s.
    (0x607f, 0, &50_000_000_u32.to_le_bytes(), None),
    // Quick stop deceleration, counts/s².
    (0x6085, 0, &100_000_000_u32.to_le_bytes(), None),
    // Interpolation time: mantissa and exponent of 10, s.
    (0x60c2, 1, &[1], None),
    (0x60c2, 2, &[0xfd], None),
];

impl DriveSettings {
    /// Reads the settings of an object dictionary.
    #[must_use]
    pub fn read(objects: &ObjectDictionary) -> DriveSettings {
        let number = |index| {
            let bytes = objects.read(index, 0).unwrap_or_default();
            let place = |(at, byte): (usize, &u8)| u32::from(*byte) << (8 * at);
            bytes.iter().take(4).enumerate().map(place).sum::<u32>()
        };
        let byte = |part| objects.read(0x60c2, part).ok()?.first().copied();
        let [units, exponent] = [1, 2].map(|part| byte(part).unwrap_or(0));
        let interpolation_s = f64::from(units) * 10.0_f64.powi(i32::from(exponent.cast_signed()));
        DriveSettings {
            interpolation_s,
            mode: (number(0x6060) as u8).cast_signed(),
            following_window: number(0x6065),
            following_timeout: Duration::from_millis(u64::from(number(0x6066))),
            quick_stop_deceleration: number(0x6085),
            speed_max: number(0x607f),
        }
    }
}

/// Adds the objects of a drive after power-on.
pub fn add(objects: &mut ObjectDictionary) {
    objects.settings(SETTINGS);
    // Supported modes: cyclic synchronous position.
    objects.constant(0x6502, 0, &0x80_u32.to_le_bytes());
    show(objects, &Drive::new(0));
}

/// Stores the present values as objects that can be read.
pub fn show(objects: &mut ObjectDictionary, drive: &Drive) {
    let settings = DriveSettings::read(objects);
    objects.constant(0x603f, 0, &drive.error().to_le_bytes());
    objects.constant(0x6040, 0, &drive.controlword().to_le_bytes());
    objects.constant(0x6041, 0, &drive.statusword().to_le_bytes());
    objects.constant(0x6061, 0, &settings.mode.to_le_bytes());
    objects.constant(0x6064, 0, &drive.position().to_le_bytes());
    objects.constant(0x607a, 0, &drive.target().to_le_bytes());
    let following = drive.target().wrapping_sub(drive.position());
    objects.constant(0x60f4, 0, &following.to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::super::model::Model;
    use super::super::model_objects;
    use super::super::objects::abort;
    use super::*;

    #[test]
    fn the_settings_are_those_of_the_dictionary() {
        let mut objects = model_objects::of(Model::named("CiA402").unwrap(), 1);
        objects.write(0x6060, 0, &[8]).unwrap();
        objects.write(0x6065, 0, &70_000_u32.to_le_bytes()).unwrap();
        objects.write(0x6066, 0, &[0x2c, 1]).unwrap();
        let settings = DriveSettings::read(&objects);
        assert_eq!((settings.mode, settings.following_window), (8, 70_000));
        assert_eq!(settings.following_timeout, Duration::from_millis(300));
        assert_eq!(settings.quick_stop_deceleration, 100_000_000);
        show(&mut objects, &Drive::new(-5));
        assert_eq!(objects.read(0x6064, 0), Ok(&(-5_i32).to_le_bytes()[..]));
        assert_eq!(objects.read(0x6061, 0), Ok(&[8][..]));
        assert_eq!(objects.read(0x6041, 0), Ok(&[0x50, 0x02][..]));
    }

    #[test]
    fn an_option_that_is_not_simulated_is_refused() {
        let mut objects = model_objects::of(Model::named("CiA402").unwrap(), 1);
        assert_eq!(objects.write(0x605a, 0, &[2, 0]), Ok(()));
        assert_eq!(objects.write(0x605a, 0, &[6, 0]), Err(abort::VALUE));
        assert_eq!(objects.write(0x6041, 0, &[6, 0]), Err(abort::READ_ONLY));
        assert_eq!(objects.read(0x60c2, 0), Ok(&[2][..]));
    }
}
