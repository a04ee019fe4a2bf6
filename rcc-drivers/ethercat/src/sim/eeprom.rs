//! The EEPROM of a SubDevice (Slave Information Interface, ETG.1000.6, section 5.4; ETG.2010): its image, and the
//! registers by which a MainDevice reads it.
//! Built at the start; the registers are served by the thread of the socket.

use super::model::{MAILBOX_IN, MAILBOX_OUT, MAILBOX_SIZE, Model};
use super::registers::{EEPROM_ADDRESS, EEPROM_CONTROL, EEPROM_DATA, Memory};

/// Size of the EEPROM, bytes.
const SIZE: u16 = 2048;
/// Mailbox protocol CANopen over EtherCAT.
const COE: u16 = 0x0004;
/// SDO is supported; complete access is not.
const COE_DETAILS: u8 = 0x01;
/// Status: a read gives 8 bytes.
const READS_8_BYTES: u16 = 0x0040;
/// Status: the command was not carried out.
const REFUSED: u16 = 0x2000;

/// Returns the image of a terminal; its size is a multiple of 8 bytes.
#[must_use]
pub fn image(model: &Model, serial: u32) -> Vec<u8> {
    let mut image = vec![0; 0x80];
    let words: &mut [(usize, u16)] = &mut [
        // PDI control: digital I/O, or a bus of a microcontroller.
        (0x00, if model.has_mailbox() { 0x0005 } else { 0x0004 }),
        (0x3e, SIZE / 128 - 1),
        (0x3f, 1),
    ];
    put_words(&mut image, words);
    for (word, value) in [
        (0x08, model.vendor),
        (0x0a, model.product),
        (0x0c, model.revision),
        (0x0e, serial),
    ] {
        put(&mut image, word * 2, &value.to_le_bytes());
    }
    if model.has_mailbox() {
        put_words(
            &mut image,
            &[
                (0x18, MAILBOX_OUT),
                (0x19, MAILBOX_SIZE),
                (0x1a, MAILBOX_IN),
                (0x1b, MAILBOX_SIZE),
                (0x1c, COE),
            ],
        );
    }
    let check = crc8(&image[..14]);
    put_words(&mut image, &[(0x07, u16::from(check))]);
    categories(model, &mut image);
    let whole = image.len().next_multiple_of(8);
    image.resize(whole, 0xff);
    image
}

fn put(image: &mut [u8], at: usize, bytes: &[u8]) {
    for (place, byte) in image.iter_mut().skip(at).zip(bytes) {
        *place = *byte;
    }
}

fn put_words(image: &mut [u8], words: &[(usize, u16)]) {
    for (word, value) in words {
        put(image, word * 2, &value.to_le_bytes());
    }
}

fn categories(model: &Model, image: &mut Vec<u8>) {
    category(image, 10, &strings(&[model.name, model.description]));
    category(image, 30, &general(model));
    category(image, 40, model.fmmu_uses());
    let mut managers = Vec::new();
    for manager in model.sync_managers() {
        managers.extend(manager.start.to_le_bytes());
        managers.extend(manager.length.to_le_bytes());
        let enabled = u8::from(manager.length > 0);
        managers.extend([manager.control, 0, enabled, manager.kind]);
    }
    category(image, 41, &managers);
    // Inputs and outputs, as the MainDevice sees them.
    for (number, manager) in [(50, model.inputs_manager()), (51, model.outputs_manager())] {
        if let Some((manager, _)) = manager {
            category(image, number, &process_data(model, number == 51, manager));
        }
    }
    image.extend([0xff, 0xff]);
}

fn category(image: &mut Vec<u8>, number: u16, data: &[u8]) {
    let words = u16::try_from(data.len().div_ceil(2)).unwrap_or(u16::MAX);
    image.extend(number.to_le_bytes());
    image.extend(words.to_le_bytes());
    image.extend(data);
    if data.len() % 2 == 1 {
        image.push(0);
    }
}

fn strings(texts: &[&str]) -> Vec<u8> {
    let mut data = vec![texts.len() as u8];
    for text in texts {
        data.push(text.len() as u8);
        data.extend(text.as_bytes());
    }
    data
}

fn general(model: &Model) -> [u8; 32] {
    let mut data = [0; 32];
    // Order number and name: strings 1 and 2.
    data[2] = 1;
    data[3] = 2;
    if model.has_mailbox() {
        data[5] = COE_DETAILS;
    }
    // Current taken from the E-bus, mA.
    data[12..14].copy_from_slice(&90_i16.to_le_bytes());
    // Ports 0 and 1 are E-bus.
    data[16..18].copy_from_slice(&0x0033_u16.to_le_bytes());
    data
}

fn process_data(model: &Model, outputs: bool, manager: u16) -> Vec<u8> {
    let mut data = Vec::new();
    let pdos = model.pdos().into_iter();
    for pdo in pdos.filter(|pdo| pdo.is_output() == outputs) {
        data.extend(pdo.index.to_le_bytes());
        data.extend([pdo.entries.len() as u8, manager as u8, 0, 0, 0, 0]);
        for entry in pdo.entries {
            data.extend(entry.index.to_le_bytes());
            data.extend([entry.sub_index, 0, entry.data_type, entry.bits, 0, 0]);
        }
    }
    data
}

/// CRC-8 of the first 14 bytes: polynomial x⁸ + x² + x + 1, initial value 0xff (ETG.1000.6, table 16).
fn crc8(bytes: &[u8]) -> u8 {
    let step = |crc: u8, _: u8| (crc << 1) ^ (0x07 * (crc >> 7));
    bytes
        .iter()
        .fold(0xff, |crc, byte| (0..8).fold(crc ^ byte, step))
}

/// Carries out the command in the control register: a read loads 8 bytes, everything else is refused. The EEPROM is
/// never busy.
pub fn serve(image: &[u8], memory: &mut Memory) {
    let command = memory.u16(EEPROM_CONTROL) >> 8 & 7;
    let status = match command {
        0 => READS_8_BYTES,
        1 => {
            let at = (memory.u32(EEPROM_ADDRESS) as usize).saturating_mul(2);
            let mut data = [0xff; 8];
            for (place, byte) in data.iter_mut().zip(image.iter().skip(at)) {
                *place = *byte;
            }
            memory.put(EEPROM_DATA, &data);
            READS_8_BYTES
        }
        _ => READS_8_BYTES | REFUSED,
    };
    memory.put_u16(EEPROM_CONTROL, status);
}

#[cfg(test)]
mod tests {
    use super::super::model::MODELS;
    use super::*;

    fn word(image: &[u8], word: usize) -> u16 {
        u16::from_le_bytes([image[word * 2], image[word * 2 + 1]])
    }

    #[test]
    fn the_checksum_finds_a_changed_bit() {
        let image = image(&MODELS[0], 1);
        // The remainder of data and checksum is 0.
        let mut head = image[..15].to_vec();
        assert_eq!(crc8(&head), 0);
        head[3] ^= 1;
        assert_ne!(crc8(&head), 0);
    }

    #[test]
    fn the_categories_of_every_model_form_a_chain_to_the_end() {
        for model in MODELS {
            let image = image(model, 7);
            assert_eq!(u32::from(word(&image, 0x08)), model.vendor & 0xffff);
            let mut at = 0x40;
            let mut found = Vec::new();
            while word(&image, at) != 0xffff {
                found.push(word(&image, at));
                at += 2 + usize::from(word(&image, at + 1));
            }
            let mut wanted = vec![10, 30, 40, 41];
            wanted.extend(model.has_inputs().then_some(50));
            wanted.extend(model.has_outputs().then_some(51));
            assert_eq!(found, wanted, "{}", model.name);
            assert!(image.len() <= usize::from(SIZE));
        }
    }

    #[test]
    fn a_read_loads_8_bytes_and_a_write_is_refused() {
        let image = image(&MODELS[1], 7);
        let mut memory = Memory::default();
        memory.put_u16(EEPROM_CONTROL, 0x0100);
        memory.put(EEPROM_ADDRESS, &[0x0a, 0, 0, 0]);
        serve(&image, &mut memory);
        assert_eq!(memory.u32(EEPROM_DATA), MODELS[1].product);
        assert_eq!(memory.u32(EEPROM_DATA + 4), MODELS[1].revision);
        assert_eq!(memory.u16(EEPROM_CONTROL), 0x0040);
        memory.put_u16(EEPROM_CONTROL, 0x0201);
        serve(&image, &mut memory);
        assert_eq!(memory.u16(EEPROM_CONTROL), 0x2040);
    }

    #[test]
    fn beyond_the_end_there_are_ones() {
        let mut memory = Memory::default();
        memory.put_u16(EEPROM_CONTROL, 0x0100);
        memory.put(EEPROM_ADDRESS, &[0xff; 4]);
        serve(&image(&MODELS[0], 7), &mut memory);
        assert_eq!(memory.u32(EEPROM_DATA), 0xffff_ffff);
    }
}
