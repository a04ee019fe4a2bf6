//! Encoded bytes against the examples of the standard.

use super::*;

fn message(request: &ModbusRequest<'_>) -> EncodedRequest {
    EncodedRequest::new(0x0102, 17, request).unwrap()
}

fn inbox(bytes: &[u8]) -> ReceiveBuffer {
    let mut inbox = ReceiveBuffer::default();
    inbox.room()[..bytes.len()].copy_from_slice(bytes);
    inbox.filled(bytes.len());
    inbox
}

#[test]
fn requests_are_the_examples_of_the_standard() {
    // MODBUS Application Protocol V1.1b3, sections 6.1, 6.3, 6.5, 6.6, 6.11, 6.12, 6.16.
    let bits = [1, 0, 1, 1, 0, 0, 1, 1, 1, 0].map(|bit| bit == 1);
    let read = |table, first, count| ModbusRequest::Read {
        table,
        first,
        count,
    };
    for (request, body) in [
        (read(Table::Coil, 19, 19), &[1, 0, 0x13, 0, 0x13][..]),
        (read(Table::Holding, 107, 3), &[3, 0, 0x6B, 0, 3]),
        (
            ModbusRequest::WriteCoils {
                first: 172,
                values: &[true],
            },
            &[5, 0, 0xAC, 0xFF, 0],
        ),
        (
            ModbusRequest::WriteRegisters {
                first: 1,
                values: &[3],
            },
            &[6, 0, 1, 0, 3],
        ),
        (
            ModbusRequest::WriteCoils {
                first: 19,
                values: &bits,
            },
            &[15, 0, 0x13, 0, 10, 2, 0xCD, 1],
        ),
        (
            ModbusRequest::WriteRegisters {
                first: 1,
                values: &[10, 0x102],
            },
            &[16, 0, 1, 0, 2, 4, 0, 10, 1, 2],
        ),
        (
            ModbusRequest::Mask {
                address: 4,
                mask: 0xFF0D,
                values: 0x25 & 0xFF0D,
            },
            &[22, 0, 4, 0, 0xF2, 0, 5],
        ),
    ] {
        let message = message(&request);
        let length = body.len() as u8 + 1;
        assert_eq!(message.bytes()[..7], [1, 2, 0, 0, 0, length, 17]);
        assert_eq!(&message.bytes()[7..], body);
    }
}

#[test]
fn a_request_that_is_too_long_is_not_made() {
    let values = [0; 127];
    let request = ModbusRequest::WriteRegisters {
        first: 0,
        values: &values,
    };
    assert!(EncodedRequest::new(1, 1, &request).is_none());
}

#[test]
fn an_answer_comes_out_whole_however_it_came_in() {
    let message = message(&ModbusRequest::Read {
        table: Table::Holding,
        first: 107,
        count: 3,
    });
    let bytes = [1, 2, 0, 0, 0, 9, 17, 3, 6, 2, 0x2B, 0, 0, 0, 0x64];
    for cut in 0..bytes.len() {
        assert_eq!(inbox(&bytes[..cut]).first(), Ok(None));
    }
    let mut inbox = inbox(&[&bytes[..], &bytes[..5]].concat());
    let (incoming, length) = inbox.first().unwrap().unwrap();
    assert_eq!(
        (incoming.transaction, incoming.unit, length),
        (0x0102, 17, 15)
    );
    let Ok(Response::Data(data)) = incoming.answer(&message) else {
        panic!("{incoming:?}")
    };
    assert_eq!(
        [0, 1, 2, 3].map(|index| register(data, index)),
        [0x22B, 0, 0x64, 0]
    );
    inbox.forget(length);
    assert_eq!(inbox.first(), Ok(None));
}

#[test]
fn what_is_no_answer_is_refused_by_what_is_wrong() {
    let read = message(&ModbusRequest::Read {
        table: Table::Coil,
        first: 0,
        count: 9,
    });
    let write = message(&ModbusRequest::WriteRegisters {
        first: 1,
        values: &[3],
    });
    for (message, body, broken) in [
        (
            &read,
            &[2, 2, 0, 0][..],
            FrameError::Function { want: 1, have: 2 },
        ),
        (
            &read,
            &[1, 1, 0],
            FrameError::Size {
                function: 1,
                want: 2,
                have: 1,
            },
        ),
        (
            &read,
            &[1, 2, 0, 0, 0],
            FrameError::Size {
                function: 1,
                want: 2,
                have: 3,
            },
        ),
        (
            &read,
            &[1],
            FrameError::Size {
                function: 1,
                want: 2,
                have: 0,
            },
        ),
        (
            &read,
            &[0x81],
            FrameError::Size {
                function: 1,
                want: 1,
                have: 0,
            },
        ),
        (&write, &[6, 0, 1, 0, 4], FrameError::Echo(6)),
        (&write, &[6, 0, 1, 0], FrameError::Echo(6)),
    ] {
        let incoming = ReceivedFrame {
            transaction: 0,
            unit: 0,
            body,
        };
        assert_eq!(incoming.answer(message), Err(broken), "{body:?}");
    }
    let incoming = ReceivedFrame {
        transaction: 0,
        unit: 0,
        body: &[0x81, 2],
    };
    assert_eq!(incoming.answer(&read), Ok(Response::Exception(2)));
}

#[test]
fn bytes_of_another_protocol_are_noticed_at_once() {
    assert_eq!(
        inbox(b"HTTP/1.1").first(),
        Err(FrameError::Protocol(0x5450))
    );
    assert_eq!(
        inbox(&[0, 1, 0, 0, 0, 1, 1]).first(),
        Err(FrameError::Length(1))
    );
    assert_eq!(
        inbox(&[0, 1, 0, 0, 1, 0, 1]).first(),
        Err(FrameError::Length(256))
    );
}
