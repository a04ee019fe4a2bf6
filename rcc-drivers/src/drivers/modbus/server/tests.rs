//! The request sequence in virtual time, against a minimal server that parses the bytes independently.

use std::time::Duration;

use rcc_config::OnRelease;
use rcc_core::primitive::ChannelKind::{AnalogInput, AnalogOutput, DigitalInput, DigitalOutput};
use serde_json::json;

use super::super::points::{self, Points};
use super::super::settings::ModbusSettings;
use super::*;
use rcc_driver_kit::conformance::{self, ChannelRow};

mod safe_values;

const MS: Duration = Duration::from_millis(1);

/// A server with 100 points of each kind.
struct ScriptedServer {
    bits: [[bool; 100]; 2],
    registers: [[u16; 100]; 2],
    /// Function codes and first addresses of all requests.
    asked: Vec<(u8, u16)>,
    /// Requests with this function code and address are refused with this exception code.
    refuses: Vec<(u8, u16, u8)>,
}

impl ScriptedServer {
    fn new() -> Self {
        Self {
            bits: [[false; 100]; 2],
            registers: [[0; 100]; 2],
            asked: Vec::new(),
            refuses: Vec::new(),
        }
    }

    /// Returns the response to a request, as bytes.
    fn answer(&mut self, request: &[u8]) -> Vec<u8> {
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let (function, first) = (request[7], word(8));
        self.asked.push((function, first));
        let refusal = self
            .refuses
            .iter()
            .find(|row| (row.0, row.1) == (function, first));
        let mut body = match refusal {
            Some((.., code)) => vec![function | 0x80, *code],
            None => self.serve(function, usize::from(first), &request[10..]),
        };
        let mut answer = request[..4].to_vec();
        answer.extend((body.len() as u16 + 1).to_be_bytes());
        answer.push(request[6]);
        answer.append(&mut body);
        answer
    }

    fn serve(&mut self, function: u8, first: usize, rest: &[u8]) -> Vec<u8> {
        let second = u16::from_be_bytes([rest[0], rest[1]]);
        let count = usize::from(second);
        let echo = |rest: &[u8]| [&[function][..], &(first as u16).to_be_bytes(), rest].concat();
        match function {
            1 | 2 => {
                let bits = &self.bits[usize::from(function) - 1][first..first + count];
                let mut bytes = vec![0; count.div_ceil(8)];
                for (place, on) in bits.iter().enumerate() {
                    bytes[place / 8] |= u8::from(*on) << (place % 8);
                }
                [&[function, bytes.len() as u8][..], &bytes].concat()
            }
            3 | 4 => {
                let registers = &self.registers[usize::from(function) - 3][first..first + count];
                let bytes: Vec<u8> = registers
                    .iter()
                    .flat_map(|word| word.to_be_bytes())
                    .collect();
                [&[function, bytes.len() as u8][..], &bytes].concat()
            }
            5 => {
                self.bits[0][first] = second == 0xFF00;
                echo(rest)
            }
            6 => {
                self.registers[0][first] = second;
                echo(rest)
            }
            15 => {
                for place in 0..count {
                    self.bits[0][first + place] = rest[3 + place / 8] >> (place % 8) & 1 == 1;
                }
                echo(&rest[..2])
            }
            16 => {
                for place in 0..count {
                    let bytes = [rest[3 + 2 * place], rest[4 + 2 * place]];
                    self.registers[0][first + place] = u16::from_be_bytes(bytes);
                }
                echo(&rest[..2])
            }
            22 => {
                let or = u16::from_be_bytes([rest[2], rest[3]]);
                let register = &mut self.registers[0][first];
                *register = (*register & second) | (or & !second);
                echo(rest)
            }
            _ => vec![function | 0x80, 1],
        }
    }
}

/// The request sequence, the server and the time.
struct ServerFixture {
    server: Server,
    device: ScriptedServer,
    now: Instant,
}

impl ServerFixture {
    fn new(mut settings: serde_json::Value, rows: &[ChannelRow<'_>]) -> Self {
        settings["server"] = "127.0.0.1:502".into();
        let device = conformance::device("modbus", settings, rows);
        let mut settings = ModbusSettings::new(&device).unwrap();
        let mut points = Points::new(&device, &settings.servers).unwrap();
        let now = Instant::now();
        let released = points::released(&device);
        let mut server = Server::new(settings.servers.remove(0), points.remove(0), released, now);
        server.connected(now);
        Self {
            server,
            device: ScriptedServer::new(),
            now,
        }
    }

    /// Returns the next request, if any.
    fn request(&mut self) -> Result<Option<Vec<u8>>, ServerFault> {
        self.server.advance(self.now)?;
        let bytes = self.server.to_send(self.now).to_vec();
        self.server.sent(bytes.len());
        Ok((!bytes.is_empty()).then_some(bytes))
    }

    fn receive(&mut self, bytes: &[u8]) -> Result<(), ServerFault> {
        self.server.room()[..bytes.len()].copy_from_slice(bytes);
        self.server.received(bytes.len(), self.now)
    }

    /// Runs until nothing is requested any more.
    fn run(&mut self) -> Result<(), ServerFault> {
        while let Some(request) = self.request()? {
            let answer = self.device.answer(&request);
            self.receive(&answer)?;
        }
        Ok(())
    }

    fn round(&mut self, outputs: &Outputs) -> Result<Inputs, ServerFault> {
        self.now += 10 * MS;
        self.run()?;
        assert!(self.server.tick(self.now));
        self.run()?;
        let mut inputs = Inputs::NONE;
        self.server.take_inputs(&mut inputs);
        self.server.command(outputs, self.now);
        self.run()?;
        Ok(inputs)
    }
}

fn safe(value: f64) -> Option<OnRelease> {
    Some(OnRelease::Safe(value))
}

fn outputs(digital: u64, digital_set: u64, analog: &[f64]) -> Outputs {
    let mut outputs = Outputs {
        digital,
        digital_set,
        ..Outputs::NONE
    };
    outputs.analog[..analog.len()].copy_from_slice(analog);
    outputs
}

#[test]
fn safe_values_come_first_then_on_connect_then_inputs() {
    let settings = json!({"on_connect": [{"address": "holding 50 u32", "value": 70_000}, {"address": "coil 90", "value": true}]});
    let mut bench = ServerFixture::new(
        settings,
        &[
            ("lamp", DigitalOutput, "coil 3".into(), safe(1.0), None),
            (
                "keeps",
                DigitalOutput,
                "coil 4".into(),
                Some(OnRelease::Hold),
                None,
            ),
            (
                "level",
                AnalogOutput,
                "holding 7 i16".into(),
                safe(-2.0),
                Some([-5.0, 5.0]),
            ),
            ("seen", DigitalInput, "discrete 9".into(), None, None),
        ],
    );
    bench.device.bits[0][4] = true;
    bench.round(&Outputs::NONE).unwrap();
    assert_eq!(
        bench.device.asked,
        [(5, 3), (6, 7), (16, 50), (5, 90), (2, 9)]
    );
    assert_eq!(bench.device.bits[0][3..5], [true, true]);
    assert_eq!(bench.device.registers[0][7], 0xFFFE);
    assert_eq!(bench.device.registers[0][50..52], [1, 4464]);
}

#[test]
fn a_safe_value_that_a_locked_device_refuses_is_tried_again_after_on_connect() {
    let settings = json!({"on_connect": [{"address": "holding 50", "value": 1}]});
    let rows = [("lamp", DigitalOutput, "coil 3".into(), safe(0.0), None)];
    let mut bench = ServerFixture::new(settings, &rows);
    bench.device.bits[0][3] = true;
    bench.device.refuses.push((5, 3, 4));
    for _ in 0..2 {
        let request = bench.request().unwrap().unwrap();
        let answer = bench.device.answer(&request);
        bench.receive(&answer).unwrap();
    }
    bench.device.refuses.clear();
    bench.run().unwrap();
    assert_eq!(bench.device.asked, [(5, 3), (6, 50), (5, 3)]);
    assert!(!bench.device.bits[0][3]);
}

#[test]
fn inputs_that_follow_each_other_come_in_one_request_and_a_hole_makes_two() {
    let row = |name, address: &str| (name, AnalogInput, address.into(), None, None);
    let rows = [
        row("a", "input 4 f32"),
        row("b", "input 6 i32 CDAB"),
        row("c", "input 4 u16"),
        row("d", "input 9"),
    ];
    for (gap, asked) in [(0, &[(4, 4), (4, 9)][..]), (1, &[(4, 4)])] {
        let mut bench = ServerFixture::new(json!({"requests": {"gap": gap}}), &rows);
        bench.device.registers[1][4..10].copy_from_slice(&[0x47F1, 0x2000, 0xFFFE, 0xFFFF, 0, 7]);
        let inputs = bench.round(&Outputs::NONE).unwrap();
        assert_eq!(
            inputs.analog[..4],
            [123_456.0, -2.0, f64::from(0x47F1), 7.0]
        );
        assert_eq!(bench.device.asked, asked);
    }
}

#[test]
fn a_request_is_never_larger_than_the_server_takes() {
    let names: Vec<String> = (0..12).map(|number| format!("n{number}")).collect();
    let rows: Vec<ChannelRow<'_>> = names
        .iter()
        .zip(0..)
        .map(|(name, number)| {
            let address = format!("holding {} f32", 2 * number);
            (
                name.as_str(),
                AnalogOutput,
                address.into(),
                safe(0.0),
                Some([-9.0, 9.0]),
            )
        })
        .collect();
    let mut bench = ServerFixture::new(json!({"requests": {"write_registers": 5}}), &rows);
    bench.round(&outputs(0, 0, &[1.5; 12])).unwrap();
    let asked: Vec<(u8, u16)> = (0..6).map(|place| (16, 4 * place)).collect();
    assert_eq!(bench.device.asked, [&asked[..], &asked].concat());
    assert!(
        bench.device.registers[0][..24]
            .chunks(2)
            .all(|pair| pair == [0x3FC0, 0])
    );
}

#[test]
fn only_outputs_that_have_changed_are_written() {
    let rows = [
        ("a", DigitalOutput, "coil 0".into(), safe(0.0), None),
        ("b", DigitalOutput, "coil 1".into(), safe(0.0), None),
        ("c", DigitalOutput, "coil 2".into(), safe(0.0), None),
    ];
    let mut bench = ServerFixture::new(json!({}), &rows);
    for (digital, asked) in [
        (0b000, &[(15, 0)][..]),
        (0b101, &[(5, 0), (5, 2)]),
        (0b110, &[(15, 0)]),
        (0b110, &[]),
    ] {
        bench.round(&outputs(digital, 0b111, &[])).unwrap();
        assert_eq!(bench.device.asked, asked, "{digital:#b}");
        assert_eq!(
            bench.device.bits[0][..3],
            [0, 1, 2].map(|bit| digital >> bit & 1 == 1)
        );
        bench.device.asked.clear();
    }
}

#[test]
fn bits_of_a_register_leave_its_other_bits_alone() {
    let rows = [
        (
            "low",
            DigitalOutput,
            "holding 7 bit 0".into(),
            safe(0.0),
            None,
        ),
        (
            "high",
            DigitalOutput,
            "holding 7 bit 15".into(),
            safe(1.0),
            None,
        ),
        ("is", DigitalInput, "holding 7 bit 15".into(), None, None),
    ];
    for (mask_write, asked) in [
        (true, &[(22, 7), (3, 7), (22, 7)][..]),
        (false, &[(3, 7), (6, 7), (3, 7), (3, 7), (6, 7)]),
    ] {
        let mut bench = ServerFixture::new(json!({"mask_write": mask_write}), &rows);
        bench.device.registers[0][7] = 0x0FF1;
        let inputs = bench.round(&outputs(0b01, 0b11, &[])).unwrap();
        assert_eq!(inputs.digital, 1);
        assert_eq!(bench.device.registers[0][7], 0x0FF1);
        assert_eq!(bench.device.asked, asked);
    }
}

#[test]
fn a_device_without_function_22_is_told_the_setting_by_name() {
    let address = "holding 7 bit 0".into();
    let rows = [("low", DigitalOutput, address, safe(0.0), None)];
    let mut bench = ServerFixture::new(json!({}), &rows);
    bench.device.refuses.push((22, 7, 1));
    let fault = bench.run().expect_err("it does not know the function");
    let words = fault.to_string();
    assert!(
        words.contains("(low)") && words.contains("`mask_write: false`"),
        "{words}"
    );
    assert_eq!(fault.reason(), super::super::fault::NO_MASK_WRITE);
    // Another function that is refused is not this one.
    let row = [("lamp", DigitalOutput, "coil 9".into(), safe(0.0), None)];
    let mut other = ServerFixture::new(json!({}), &row);
    other.device.refuses.push((5, 9, 1));
    let words = other.run().expect_err("it refuses coils").to_string();
    assert!(!words.contains("mask_write"), "{words}");
}

#[test]
fn a_register_whose_bits_are_all_ours_is_written_whole() {
    let names: Vec<String> = (0..16).map(|bit| format!("b{bit}")).collect();
    let row = |(name, bit): (&'static str, usize)| {
        let address = format!("holding 7 bit {bit}");
        (name, DigitalOutput, address.into(), safe(0.0), None)
    };
    let names: Vec<&'static str> = names.iter().map(|name| &*name.clone().leak()).collect();
    let rows: Vec<ChannelRow<'_>> = names.into_iter().zip(0..).map(row).collect();
    let mut bench = ServerFixture::new(json!({}), &rows);
    bench.round(&outputs(0x8001, 0xFFFF, &[])).unwrap();
    assert_eq!(bench.device.asked, [(6, 7), (6, 7)]);
    assert_eq!(bench.device.registers[0][7], 0x8001);
}

#[test]
fn a_refused_output_does_not_block_the_others() {
    let row = |name, address: &str| {
        (
            name,
            AnalogOutput,
            address.into(),
            safe(0.0),
            Some([0.0, 9.0]),
        )
    };
    let rows = [
        row("a", "holding 0"),
        row("b", "holding 1"),
        row("c", "holding 2"),
    ];
    let mut bench = ServerFixture::new(json!({}), &rows);
    bench.run().unwrap();
    bench.device.refuses.extend([(16, 0, 3), (6, 1, 3)]);
    let fault = bench.round(&outputs(0, 0, &[5.0, 6.0, 7.0])).unwrap_err();
    assert_eq!(bench.device.registers[0][..3], [5, 0, 7]);
    let words = fault.to_string();
    assert!(
        words.contains("writing holding 1 (b): exception 3: illegal value"),
        "{words}"
    );
}

#[test]
fn a_refused_output_after_one_without_a_value_is_written_once() {
    let rows = [
        (
            "keeps",
            DigitalOutput,
            "coil 0".into(),
            Some(OnRelease::Hold),
            None,
        ),
        ("lamp", DigitalOutput, "coil 9".into(), safe(0.0), None),
    ];
    let mut bench = ServerFixture::new(json!({}), &rows);
    bench.device.refuses.push((5, 9, 4));
    let words = bench.run().unwrap_err().to_string();
    assert!(
        words.contains("writing coil 9 (lamp): exception 4"),
        "{words}"
    );
    // Once before `on_connect`, and once after it.
    assert_eq!(bench.device.asked, [(5, 9), (5, 9)]);
}

#[test]
fn a_refused_read_says_which_channels_it_was_for() {
    let rows = [("door", DigitalInput, "discrete 4".into(), None, None)];
    let mut bench = ServerFixture::new(json!({}), &rows);
    bench.device.refuses.push((2, 4, 2));
    let words = bench.round(&Outputs::NONE).unwrap_err().to_string();
    assert!(
        words.contains("reading discrete 4 (door): exception 2: illegal address"),
        "{words}"
    );
}

#[test]
fn a_busy_server_is_asked_again_until_the_time_out() {
    let rows = [("door", DigitalInput, "discrete 4".into(), None, None)];
    let mut bench = ServerFixture::new(json!({"timeout": "20 ms"}), &rows);
    bench.run().unwrap();
    assert!(bench.server.tick(bench.now));
    bench.device.refuses.push((2, 4, 6));
    let mut fault = None;
    for _ in 0..10 {
        if let Err(busy) = bench.run() {
            fault = Some(busy);
            break;
        }
        bench.now = bench.server.wake(bench.now).unwrap();
    }
    assert!(
        fault
            .unwrap()
            .to_string()
            .contains("exception 6: the device is busy")
    );
    assert_eq!(bench.device.asked.len(), 4);
    // The same, but with enough time before the time-out.
    let mut bench = ServerFixture::new(json!({"timeout": "20 ms"}), &rows);
    bench.run().unwrap();
    assert!(bench.server.tick(bench.now));
    bench.device.refuses.push((2, 4, 5));
    bench.run().unwrap();
    bench.device.refuses.clear();
    bench.now += 5 * MS;
    bench.run().unwrap();
    assert!(bench.server.is_complete());
}

#[test]
fn late_answers_and_those_of_other_units_are_discarded() {
    let rows = [("door", DigitalInput, "discrete 4".into(), None, None)];
    let mut bench = ServerFixture::new(json!({"unit": 3}), &rows);
    bench.run().unwrap();
    assert!(bench.server.tick(bench.now));
    let request = bench.request().unwrap().unwrap();
    let late = bench.device.answer(&request);
    bench.now += 100 * MS;
    let fault = bench.request().unwrap_err();
    assert!(matches!(fault, ServerFault::Timeout { .. }), "{fault}");
    // On the same connection; the answer of before arrives now, with another content.
    bench.server.prepare(bench.now);
    bench.run().unwrap();
    assert!(bench.server.tick(bench.now));
    bench.device.bits[1][4] = true;
    let request = bench.request().unwrap().unwrap();
    bench.receive(&late).unwrap();
    let mut other = bench.device.answer(&request);
    other[6] = 9;
    bench.receive(&other).unwrap();
    assert!(!bench.server.is_complete());
    assert_eq!(bench.server.counts().discarded, 2);
    let right = bench.device.answer(&request);
    bench.receive(&right).unwrap();
    bench.run().unwrap();
    let mut inputs = Inputs::NONE;
    bench.server.take_inputs(&mut inputs);
    assert_eq!((inputs.digital, inputs.digital_known), (1, 1));
}

#[test]
fn an_answer_from_another_unit_is_reported() {
    let rows = [("door", DigitalInput, "discrete 4".into(), None, None)];
    let mut bench = ServerFixture::new(json!({"unit": 3}), &rows);
    bench.run().unwrap();
    assert!(bench.server.tick(bench.now));
    let request = bench.request().unwrap().unwrap();
    let mut other = bench.device.answer(&request);
    other[6] = 9;
    bench.receive(&other).unwrap();
    bench.now += 100 * MS;
    let words = bench.request().unwrap_err().to_string();
    assert!(
        words.contains("unit 9 answered a request to unit 3"),
        "{words}"
    );
}

#[test]
fn the_watchdog_is_written_only_while_rounds_end() {
    let rows = [("lamp", DigitalOutput, "coil 3".into(), safe(0.0), None)];
    let settings = json!({"watchdog": {"address": "holding 20", "every": "20 ms"}});
    let mut bench = ServerFixture::new(settings, &rows);
    let signs: Vec<u16> = (0..6)
        .map(|_| {
            bench.round(&Outputs::NONE).unwrap();
            bench.device.registers[0][20]
        })
        .collect();
    assert_eq!(signs, [1, 2, 2, 3, 3, 4]);
    // No outputs are commanded: the host has died.
    for _ in 0..5 {
        bench.now += 20 * MS;
        assert!(bench.server.tick(bench.now));
        bench.run().unwrap();
    }
    assert_eq!(bench.device.registers[0][20], 4);
    let settings = json!({"watchdog": {"address": "coil 20"}});
    let mut bench = ServerFixture::new(settings, &rows);
    let signs = [0, 1, 2].map(|_| {
        bench.round(&Outputs::NONE).unwrap();
        bench.device.bits[0][20]
    });
    assert_eq!(signs, [true, false, true]);
}

#[test]
fn a_device_with_a_stopped_heartbeat_is_not_complete() {
    let rows = [("door", DigitalInput, "discrete 4".into(), None, None)];
    let settings = json!({"heartbeat": {"address": "input 9", "within": "50 ms"}});
    let mut bench = ServerFixture::new(settings, &rows);
    let mut complete = Vec::new();
    for beat in [5, 5, 6, 6, 6, 6, 6, 6, 6, 6, 7] {
        bench.device.registers[1][9] = beat;
        bench.round(&Outputs::NONE).unwrap();
        complete.push(bench.server.is_complete());
    }
    let expected = [
        false, false, true, true, true, true, true, true, false, false, true,
    ];
    assert_eq!(complete, expected);
    bench.now += 60 * MS;
    let words = bench.server.standstill(bench.now).unwrap().to_string();
    assert!(words.contains("heartbeat at input 9"), "{words}");
}

#[test]
fn a_value_that_the_registers_cannot_hold_is_a_fault_and_is_not_written() {
    let rows = [
        (
            "a",
            AnalogOutput,
            "holding 0".into(),
            safe(0.0),
            Some([0.0, 9.0]),
        ),
        (
            "b",
            AnalogOutput,
            "holding 1".into(),
            safe(0.0),
            Some([0.0, 9.0]),
        ),
    ];
    let mut bench = ServerFixture::new(json!({}), &rows);
    let words = bench
        .round(&outputs(0, 0, &[65_536.0, 8.0]))
        .unwrap_err()
        .to_string();
    assert!(
        words.contains("output a: 65536 (SI) does not fit"),
        "{words}"
    );
    assert_eq!(bench.device.registers[0][..2], [0, 8]);
}

#[test]
fn an_input_outside_of_its_range_is_unknown() {
    let rows = [(
        "a",
        AnalogInput,
        "input 0 i16".into(),
        None,
        Some([-5.0, 5.0]),
    )];
    let mut bench = ServerFixture::new(json!({}), &rows);
    bench.device.registers[1][0] = 6;
    assert!(bench.round(&Outputs::NONE).unwrap().analog[0].is_nan());
    bench.device.registers[1][0] = 5;
    assert_eq!(bench.round(&Outputs::NONE).unwrap().analog[0], 5.0);
}
