//! Target `modbus`: a loopback server that answers the Modbus driver with arbitrary bytes. The driver must not panic,
//! must answer within its time, and must report no value that is not configured. Run by the thread of the target; a
//! second thread is the server.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::Duration;

use arbitrary::{Arbitrary, Unstructured};
use rcc_config::{CellConfig, DeviceConfig};
use rcc_core::primitive::ChannelKind;
use rcc_driver_kit::driver::{Driver, Inputs, Outputs};
use rcc_drivers::drivers::modbus::Modbus;

use crate::plan::real;

/// Number of exchanges per input.
const EXCHANGES: usize = 4;

struct ScriptedServer {
    address: SocketAddr,
    /// Bytes with which the next connection is answered.
    answers: Sender<Vec<u8>>,
    /// Signals the end of a connection.
    ended: Receiver<()>,
}

static SERVER: LazyLock<Mutex<ScriptedServer>> = LazyLock::new(|| {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap_or_else(|error| panic!("{error}"));
    let address = listener
        .local_addr()
        .unwrap_or_else(|error| panic!("{error}"));
    let (answers, to_answer) = channel::<Vec<u8>>();
    let (end, ended) = channel();
    std::thread::spawn(move || {
        for data in to_answer {
            if let Ok((stream, _)) = listener.accept() {
                // A broken connection counts as an ended one.
                let _ = serve(stream, &data);
            }
            if end.send(()).is_err() {
                return;
            }
        }
    });
    Mutex::new(ScriptedServer {
        address,
        answers,
        ended,
    })
});

/// The last eighth of the input selects the outputs to write, the rest is what the server answers.
pub fn run(data: &[u8]) {
    let server = SERVER.lock().unwrap_or_else(PoisonError::into_inner);
    let device = device(server.address);
    let mut driver = Modbus::open(&device).unwrap_or_else(|error| panic!("{error}"));
    let (said, written) = data.split_at(data.len() - data.len() / 8);
    assert!(
        server.answers.send(said.to_vec()).is_ok(),
        "the server runs"
    );
    let mut bytes = Unstructured::new(written);
    let mut inputs = Inputs::NONE;
    let mut met = false;
    for _ in 0..EXCHANGES {
        let received = driver.receive(Duration::from_millis(40), &mut inputs);
        met = true;
        if let Ok(exchange) = received {
            assert!(exchange.ticks > 0 && exchange.period_ns > 0);
            let known = device.channels_of(ChannelKind::DigitalInput).count();
            assert_eq!(
                inputs.digital_known >> known,
                0,
                "only what is configured is known"
            );
            let analog = device.channels_of(ChannelKind::AnalogInput).count();
            assert!(
                inputs
                    .analog
                    .iter()
                    .skip(analog)
                    .all(|value| value.is_nan())
            );
        } else {
            break;
        }
        let mut outputs = Outputs::NONE;
        (outputs.digital, outputs.digital_set) = <_>::arbitrary(&mut bytes).unwrap_or((1, 1));
        for place in outputs.analog.iter_mut().take(3) {
            *place = real(&mut bytes).unwrap_or(f64::NAN);
        }
        if driver.send(&outputs).is_err() {
            break;
        }
    }
    drop(driver);
    if met {
        // The server thread is finished with this connection when it ends.
        let _ = server.ended.recv_timeout(Duration::from_secs(5));
    }
}

/// A device with every kind of Modbus point.
const CELL: &str = "
cell: fuzz
period: 1 ms
devices:
  io:
    driver: modbus
    settings: {server: '127.0.0.1:1', unit: 1, period: 1 ms}
    channels:
      lamp:  {kind: digital output, address: coil 0, on_release: hold}
      clamp: {kind: digital output, address: coil 1, on_release: hold}
      gate:  {kind: digital output, address: holding 9 bit 3, on_release: hold}
      lamp_on: {kind: digital input, address: discrete 0}
      coil_on: {kind: digital input, address: coil 7}
      ready:   {kind: digital input, address: input 9 bit 15}
      speed:  {kind: analog output, address: holding 0, unit: m/s, scale: 1 mm/s, range: [0 m/s, 60 m/s], on_release: hold}
      force:  {kind: analog output, address: holding 2 f32 CDAB, unit: N, range: [-1000 N, 1000 N], on_release: hold}
      far:    {kind: analog output, address: holding 4 i64, unit: m, range: [-5000000 m, 5000000 m], on_release: hold}
      speed_is: {kind: analog input, address: input 0 i16, unit: m/s, scale: 1 mm/s}
      force_is: {kind: analog input, address: input 2 f32 BADC, unit: N}
      count:    {kind: analog input, address: input 4 u64, unit: 1}
      exact:    {kind: analog input, address: holding 20 f64 HGFEDCBA, unit: 1}
";

static DEVICE: LazyLock<DeviceConfig> = LazyLock::new(|| {
    let cell = CellConfig::parse(CELL, "cell.yaml", Path::new(""), &BTreeMap::new());
    let cell = cell.unwrap_or_else(|faults| panic!("{faults}"));
    cell.devices[0].clone()
});

fn device(server: SocketAddr) -> DeviceConfig {
    let settings = serde_json::json!({
        "server": server.to_string(), "unit": 1, "period": "1 ms", "timeout": "20 ms",
        "watchdog": {"address": "coil 15", "every": "1 ms"},
        "heartbeat": {"address": "input 10", "within": "500 ms"},
        "on_connect": [{"address": "holding 100", "value": 500}],
    });
    DeviceConfig {
        settings,
        ..DEVICE.clone()
    }
}

/// Answers requests: one byte selects how, the bytes after it are the answer.
fn serve(mut stream: TcpStream, data: &[u8]) -> std::io::Result<()> {
    stream.set_read_timeout(Some(Duration::from_secs(2)))?;
    stream.set_nodelay(true)?;
    let mut bytes = Unstructured::new(data);
    loop {
        let mut header = [0; 8];
        stream.read_exact(&mut header)?;
        let length = usize::from(u16::from_be_bytes([header[4], header[5]]));
        let mut request = vec![0; length.saturating_sub(2).min(260)];
        stream.read_exact(&mut request)?;
        let how = u8::arbitrary(&mut bytes).unwrap_or(0);
        let size = usize::from(u8::arbitrary(&mut bytes).unwrap_or(0)).min(bytes.len());
        let said = bytes.bytes(size).unwrap_or(&[]);
        let answer = match how % 8 {
            // Raw bytes.
            0 if size > 0 => said.to_vec(),
            // Any function code and data after a correct header.
            1 => framed(&header, said),
            // An exception.
            2 => framed(
                &header,
                &[header[7] | 0x80, said.first().copied().unwrap_or(2)],
            ),
            // The right function code with any data.
            3 => framed(&header, &[&[header[7]], said].concat()),
            // A correct answer.
            _ => framed(&header, &correct_answer(header[7], &request, said)),
        };
        if size == 0 && how % 8 == 0 && bytes.is_empty() {
            return Ok(());
        }
        stream.write_all(&answer)?;
    }
}

fn framed(header: &[u8; 8], pdu: &[u8]) -> Vec<u8> {
    let length = u16::try_from(pdu.len() + 1)
        .unwrap_or(u16::MAX)
        .to_be_bytes();
    let mut answer = vec![header[0], header[1], 0, 0, length[0], length[1], header[6]];
    answer.extend(pdu);
    answer
}

/// Builds a correct answer with these values.
fn correct_answer(function: u8, request: &[u8], said: &[u8]) -> Vec<u8> {
    let count = usize::from(u16::from_be_bytes([
        request.get(2).copied().unwrap_or(0),
        request.get(3).copied().unwrap_or(0),
    ]));
    let size = match function {
        1 | 2 => count.div_ceil(8),
        3 | 4 => count * 2,
        _ => return [&[function], request.get(..4).unwrap_or(request)].concat(),
    };
    let mut values: Vec<u8> = said.to_vec();
    values.resize(size.min(250), 0);
    [&[function, values.len() as u8], &values[..]].concat()
}
