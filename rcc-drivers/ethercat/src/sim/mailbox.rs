//! The mailbox of a SubDevice and CANopen over EtherCAT in it (ETG.1000.6, section 5.6): SDO upload, expedited and
//! normal, and expedited and normal download, each in one message.
//! Pure; called by the thread of the socket.

use super::objects::{ObjectDictionary, abort};

/// Mailbox protocol: error.
const ERROR: u8 = 0;
/// Mailbox protocol: CANopen over EtherCAT.
const COE: u8 = 3;
/// CoE service: SDO request; also that of an abort.
const SDO_REQUEST: u16 = 2;
/// CoE service: SDO response.
const SDO_RESPONSE: u16 = 3;

/// Details of a mailbox error (ETG.1000.4, table 30).
mod detail {
    pub const PROTOCOL: u16 = 2;
    pub const SERVICE: u16 = 4;
    pub const SIZE: u16 = 6;
}

/// Answers of a SubDevice to mailbox messages, with their counter.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mailbox {
    /// Counter of the last answer, 1 to 7.
    counter: u8,
    /// The last answer: the MainDevice can ask to have it again.
    pub last: Vec<u8>,
}

impl Mailbox {
    /// Returns the answer to a message, with its header.
    pub fn answer(&mut self, message: &[u8], objects: &mut ObjectDictionary) -> Vec<u8> {
        let (protocol, body) = match respond(message, objects) {
            Ok(body) => (COE, body),
            Err(detail) => {
                let mut body = 1_u16.to_le_bytes().to_vec();
                body.extend(detail.to_le_bytes());
                (ERROR, body)
            }
        };
        self.counter = self.counter % 7 + 1;
        let mut answer = u16::try_from(body.len())
            .unwrap_or(u16::MAX)
            .to_le_bytes()
            .to_vec();
        answer.extend([0, 0, 0, protocol | self.counter << 4]);
        answer.extend(body);
        self.last.clone_from(&answer);
        answer
    }
}

/// Returns the CoE message that answers, or the detail of a mailbox error.
fn respond(message: &[u8], objects: &mut ObjectDictionary) -> Result<Vec<u8>, u16> {
    let (head, rest) = message.split_at_checked(6).ok_or(detail::SIZE)?;
    let length = usize::from(u16::from_le_bytes([head[0], head[1]]));
    if head[5] & 0x0f != COE {
        return Err(detail::PROTOCOL);
    }
    let body = rest.get(..length).ok_or(detail::SIZE)?;
    let (&[low, high], sdo) = body.split_first_chunk().ok_or(detail::SIZE)?;
    if u16::from_le_bytes([low, high]) >> 12 != SDO_REQUEST {
        return Err(detail::SERVICE);
    }
    let (&[command, low, high, sub_index], data) = sdo.split_first_chunk().ok_or(detail::SIZE)?;
    let index = u16::from_le_bytes([low, high]);
    let result = match command >> 5 {
        // An abort by the MainDevice ends nothing here, since every transfer is one message; it is answered as unknown.
        _ if command & 0x10 != 0 => Err(abort::ACCESS),
        1 => download(command, data)
            .and_then(|value| objects.write(index, sub_index, value))
            .map(|()| (0x60, vec![0; 4])),
        2 => objects.read(index, sub_index).map(upload),
        _ => Err(abort::COMMAND),
    };
    let (service, command, data) = match result {
        Ok((command, data)) => (SDO_RESPONSE, command, data),
        Err(code) => (SDO_REQUEST, 0x80, code.to_le_bytes().to_vec()),
    };
    let mut answer = (service << 12).to_le_bytes().to_vec();
    answer.push(command);
    answer.extend(index.to_le_bytes());
    answer.push(sub_index);
    answer.extend(data);
    Ok(answer)
}

/// Returns command and data of the answer to an upload: expedited up to 4 bytes, normal above.
fn upload(value: &[u8]) -> (u8, Vec<u8>) {
    match value.len() {
        size @ 1..=4 => {
            let mut data = value.to_vec();
            data.resize(4, 0);
            (0x43 | (4 - size as u8) << 2, data)
        }
        size => {
            let mut data = u32::try_from(size)
                .unwrap_or(u32::MAX)
                .to_le_bytes()
                .to_vec();
            data.extend(value);
            (0x41, data)
        }
    }
}

/// Returns the value of a download.
fn download(command: u8, data: &[u8]) -> Result<&[u8], u32> {
    let (expedited, sized) = (command & 2 != 0, command & 1 != 0);
    let (first, rest) = data.split_first_chunk::<4>().ok_or(abort::LENGTH)?;
    match (expedited, sized) {
        (true, true) => Ok(&first[..4 - usize::from(command >> 2 & 3)]),
        (true, false) => Ok(first),
        (false, _) => {
            let size = usize::try_from(u32::from_le_bytes(*first)).map_err(|_| abort::LENGTH)?;
            rest.get(..size).ok_or(abort::LENGTH)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::Model;
    use super::super::model_objects;
    use super::*;

    fn message(protocol: u8, service: u16, sdo: &[u8]) -> Vec<u8> {
        let mut message = (sdo.len() as u16 + 2).to_le_bytes().to_vec();
        message.extend([0, 0, 0, protocol | 0x10]);
        message.extend((service << 12).to_le_bytes());
        message.extend(sdo);
        message.resize(128, 0);
        message
    }

    fn ask(sdo: &[u8]) -> Vec<u8> {
        let mut objects = model_objects::of(Model::named("EL4004").unwrap(), 9);
        Mailbox::default().answer(&message(3, 2, sdo), &mut objects)[6..].to_vec()
    }

    #[test]
    fn four_bytes_are_sent_at_once_and_more_with_their_length() {
        let expedited = [0, 0x30, 0x43, 0x18, 0x10, 1, 2, 0, 0, 0];
        assert_eq!(ask(&[0x40, 0x18, 0x10, 1, 0, 0, 0, 0]), expedited);
        let count = [0, 0x30, 0x4f, 0x18, 0x10, 0, 4, 0, 0, 0];
        assert_eq!(ask(&[0x40, 0x18, 0x10, 0, 0, 0, 0, 0]), count);
        let name = ask(&[0x40, 0x08, 0x10, 0, 0, 0, 0, 0]);
        assert_eq!(name[2..10], [0x41, 0x08, 0x10, 0, 6, 0, 0, 0]);
        assert_eq!(&name[10..], b"EL4004");
    }

    #[test]
    fn a_download_changes_a_setting_and_nothing_else() {
        let mut objects = model_objects::of(Model::named("EL4004").unwrap(), 9);
        let mut mailbox = Mailbox::default();
        let expedited = [0x2b, 0x00, 0x80, 0x13, 0x34, 0x12, 0, 0];
        let answer = mailbox.answer(&message(3, 2, &expedited), &mut objects);
        assert_eq!(answer[6..12], [0, 0x30, 0x60, 0, 0x80, 0x13]);
        assert_eq!(objects.default_output(0), 0x1234);
        let normal = [0x21, 0x10, 0x80, 0x13, 2, 0, 0, 0, 0x78, 0x56];
        mailbox.answer(&message(3, 2, &normal), &mut objects);
        assert_eq!(objects.default_output(1), 0x5678);
        let wrong = [0x23, 0x18, 0x10, 0x01, 0, 0, 0, 0];
        let answer = mailbox.answer(&message(3, 2, &wrong), &mut objects);
        assert_eq!(answer[8], 0x80);
        assert_eq!(answer[12..16], abort::READ_ONLY.to_le_bytes());
    }

    #[test]
    fn complete_access_and_unknown_objects_are_aborted() {
        let complete = ask(&[0x50, 0x18, 0x10, 0, 0, 0, 0, 0]);
        assert_eq!(complete[6..], abort::ACCESS.to_le_bytes());
        let missing = ask(&[0x40, 0x00, 0x20, 0, 0, 0, 0, 0]);
        assert_eq!(missing[6..], abort::NO_OBJECT.to_le_bytes());
    }

    #[test]
    fn other_protocols_and_services_get_a_mailbox_error() {
        let mut objects = ObjectDictionary::default();
        let mut mailbox = Mailbox::default();
        let answer = mailbox.answer(&message(4, 2, &[0; 8]), &mut objects);
        assert_eq!(answer[5..10], [0x10, 1, 0, 2, 0]);
        let answer = mailbox.answer(&message(3, 8, &[0; 8]), &mut objects);
        assert_eq!(answer[5..10], [0x20, 1, 0, 4, 0]);
        let mut long = message(3, 2, &[0; 8]);
        long[0] = 0xff;
        assert_eq!(mailbox.answer(&long, &mut objects)[8], 6);
    }

    #[test]
    fn every_answer_has_another_counter_from_1_to_7() {
        let mut objects = ObjectDictionary::default();
        let mut mailbox = Mailbox::default();
        let counters: Vec<u8> = (0..8)
            .map(|_| mailbox.answer(&[], &mut objects)[5] >> 4)
            .collect();
        assert_eq!(counters, [1, 2, 3, 4, 5, 6, 7, 1]);
    }
}
