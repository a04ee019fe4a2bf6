//! Values in the process images.
//! Test code only.

use super::*;
use proptest::prelude::*;

fn place(bit: usize, format: Format) -> Place {
    Place {
        terminal: 0,
        bit,
        format,
        status: None,
    }
}

proptest! {
    #[test]
    fn what_is_written_is_read(bit in 0_usize..64, raw in -128_i32..=255) {
        let formats = [Format::U8, Format::I8, Format::U16, Format::I16, Format::U32, Format::I32, Format::F32];
        for format in formats {
            let [lower, upper] = format.bounds();
            let raw = f64::from(raw);
            prop_assume!((lower..=upper).contains(&raw));
            let at = place(bit / 8 * 8, format);
            let mut image = [TerminalImage { inputs: vec![], outputs: vec![0xa5; 16] }];
            write(&mut image, at, raw);
            image[0].inputs = image[0].outputs.clone();
            prop_assert_eq!(read(&image, at), Some(raw));
            let changed = image[0].outputs.iter().enumerate().filter(|(_, byte)| **byte != 0xa5);
            prop_assert!(changed.into_iter().all(|(byte, _)| (bit / 8..bit / 8 + format.bits() / 8).contains(&byte)));
        }
    }

    #[test]
    fn a_bit_changes_no_other_bit(bit in 0_usize..64, before in any::<u64>(), on in any::<bool>()) {
        let mut image = [TerminalImage { inputs: vec![], outputs: before.to_le_bytes().to_vec() }];
        write(&mut image, place(bit, Format::Bit), f64::from(u8::from(on)));
        let after: [u8; 8] = image[0].outputs.clone().try_into().unwrap();
        let wanted = before & !(1 << bit) | u64::from(on) << bit;
        prop_assert_eq!(u64::from_le_bytes(after), wanted);
    }
}

#[test]
fn an_analog_input_with_a_bad_status_has_no_value() {
    let at = Place {
        status: Some(0),
        ..place(16, Format::I16)
    };
    for (status, known) in [
        (0, true),
        (0x8000, true),
        (0x0041, false),
        (0x0042, false),
        (0x4000, false),
    ] {
        let status: u16 = status;
        let inputs = [status.to_le_bytes(), 77_i16.to_le_bytes()].concat();
        let image = [TerminalImage {
            inputs,
            outputs: vec![],
        }];
        assert_eq!(read(&image, at), known.then_some(77.0), "{status:#06x}");
    }
}
