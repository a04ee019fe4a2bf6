//! Measures the time from the write of a value to the cycle that sees it, and what the cycle costs meanwhile: through a
//! set-point channel at several rates, and by requests over one kept-open connection; quiet, and beside a moving arm.
//! Runs on the threads of the program or test that measures.

use std::fmt;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::time::Duration;

use rcc_os::clock::{monotonic_ns, sleep_until};
use rcc_testing::quantile;
use serde_json::Value;

use crate::TestCell;
use crate::cell_fixture::ExecutorBoards;
use crate::nets;
use crate::waiting::LIMIT;

/// The net whose input is set.
const NET: &str = "\
net: wanted
primitives:
  speed:  {type: Input, parameters: {initial: 0.0, expires: 2 s}}
  cancel: {type: Cancel}
  end:    {type: Termination, inputs: {done: cancel.requested}}
  watch:  {type: Monitor, parameters: {rate: 10 Hz}, inputs: {value: speed.value}}
";

/// Rates and durations of the measurement.
#[derive(Clone, Debug)]
pub struct MeasurementPlan {
    /// Rates of the channel, Hz.
    pub rates: Vec<u32>,
    /// Duration of each row, s.
    pub seconds: f64,
}

/// One row of the result: times in ns.
#[derive(Clone, Debug, Default)]
pub struct MeasuredRow {
    /// How values were written, and beside what.
    pub title: String,
    /// Values that were written.
    pub written: usize,
    /// Values that took effect.
    pub set: usize,
    /// Values that newer ones overtook.
    pub superseded: u64,
    /// Time that it took.
    pub took_ns: u64,
    /// From the write to the cycle that sees the value; for requests, to the answer. Sorted.
    pub latencies: Vec<u64>,
    /// Computation times of cycles meanwhile. Sorted.
    pub cycles: Vec<u64>,
    /// Late cycles meanwhile.
    pub late: u64,
}

impl fmt::Display for MeasuredRow {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |part| quantile(&self.latencies, part).unwrap_or(0) as f64 * 1e-6;
        let us = |part| quantile(&self.cycles, part).unwrap_or(0) as f64 * 1e-3;
        let rate = self.set as f64 / (self.took_ns.max(1) as f64 * 1e-9);
        write!(
            formatter,
            "| {} | {rate:.0} | {} | {:.2} | {:.2} | {:.2} | {:.1} | {:.1} | {} |",
            self.title,
            self.superseded,
            ms(0.5),
            ms(0.99),
            ms(1.0),
            us(0.5),
            us(0.99),
            self.late
        )
    }
}

/// The heading of the rows.
pub const HEADING: &str = "\
| | set per second | superseded | p50, ms | p99, ms | max, ms | cycle p50, µs | cycle p99, µs | late cycles |
|---|---|---|---|---|---|---|---|---|";

/// Measures everything of the plan in a cell of its own.
pub fn measure(plan: &MeasurementPlan) -> Vec<MeasuredRow> {
    let cell = TestCell::demo();
    let id = cell.run(NET);
    let mut rows = Vec::new();
    for beside in ["quiet", "beside a moving arm"] {
        if beside != "quiet" {
            // 0.2 m at 1 mm/s: longer than any measurement.
            cell.run(&nets::line("line", 0.1, 0.001));
        }
        let bench = Bench {
            cell: &cell,
            id,
            watch: cell.watch(),
            seconds: plan.seconds,
        };
        rows.push(bench.without(&format!("nothing set, {beside}")));
        for rate in &plan.rates {
            rows.push(bench.channel(*rate, &format!("channel, {rate} Hz, {beside}")));
        }
        rows.push(bench.requests(&format!("PUT, one connection, {beside}")));
    }
    cell.stop();
    rows
}

struct Bench<'a> {
    cell: &'a TestCell,
    id: u64,
    watch: ExecutorBoards,
    seconds: f64,
}

impl Bench<'_> {
    fn span_ns(&self) -> u64 {
        (self.seconds * 1e9) as u64
    }

    /// Runs `step` until the time is over, and takes the computation time of a cycle after each.
    fn repeat(&self, row: &mut MeasuredRow, mut step: impl FnMut(&mut MeasuredRow, u64)) {
        let (begun, late) = (monotonic_ns(), self.watch.status().late);
        for number in 0.. {
            step(row, number);
            row.cycles.push(self.watch.status().exec_last_ns);
            if monotonic_ns() - begun >= self.span_ns() {
                break;
            }
        }
        row.took_ns = monotonic_ns() - begun;
        row.late = self.watch.status().late - late;
        row.latencies.sort_unstable();
        row.cycles.sort_unstable();
    }

    fn without(&self, title: &str) -> MeasuredRow {
        let mut row = titled(title);
        self.repeat(&mut row, |_, _| {
            std::thread::sleep(Duration::from_millis(1))
        });
        row
    }

    fn channel(&self, rate: u32, title: &str) -> MeasuredRow {
        let mut row = titled(title);
        let socket = self.cell.cell().socket();
        let path = format!("/commands/{}/inputs/stream?answers=all", self.id);
        let mut channel = LineChannel::open(&socket, &path);
        let answers = channel.answers();
        let watch = self.cell.watch();
        let reader = std::thread::spawn(move || {
            let seen = answers.map(|answer| (stamp_of(&answer, &watch), answer));
            seen.collect::<Vec<_>>()
        });
        let mut written = Vec::new();
        let (begun, period) = (monotonic_ns(), 1_000_000_000 / u64::from(rate));
        self.repeat(&mut row, |_, number| {
            sleep_until(begun + (number + 1) * period);
            written.push(monotonic_ns());
            channel.line(&format!("{{\"speed\": {}}}", number % 7));
        });
        channel.end();
        let answers = reader.join().expect("no panic");
        for (stamp, answer) in &answers {
            let line = answer["line"]
                .as_u64()
                .and_then(|line| written.get(line as usize - 1));
            if let (Some(stamp), Some(line)) = (stamp, line) {
                row.latencies.push(stamp.saturating_sub(*line));
            }
        }
        row.latencies.sort_unstable();
        let (_, end) = answers.last().expect("the last line");
        row.written = written.len();
        row.set = end["set"].as_u64().expect("a count") as usize;
        row.superseded = end["superseded"].as_u64().expect("a count");
        row
    }

    fn requests(&self, title: &str) -> MeasuredRow {
        let mut row = titled(title);
        let socket = self.cell.cell().socket();
        let mut stream = BufReader::new(UnixStream::connect(socket).expect("a loader"));
        stream
            .get_ref()
            .set_read_timeout(Some(LIMIT))
            .expect("a limit");
        let path = format!("/commands/{}/inputs", self.id);
        self.repeat(&mut row, |row, number| {
            let begun = monotonic_ns();
            let status = put(
                &mut stream,
                &path,
                &format!("{{\"speed\": {}}}", number % 7),
            );
            assert_eq!(status, 200, "{row:?}");
            row.latencies.push(monotonic_ns() - begun);
        });
        (row.written, row.set) = (row.latencies.len(), row.latencies.len());
        row
    }
}

fn titled(title: &str) -> MeasuredRow {
    MeasuredRow {
        title: title.to_owned(),
        ..MeasuredRow::default()
    }
}

/// Returns when the cycle of an answer began, from a cycle that began soon after; ns on the monotonic clock.
fn stamp_of(answer: &Value, watch: &ExecutorBoards) -> Option<u64> {
    let cycle = answer["line"].as_u64().and(answer["cycle"].as_u64())?;
    let status = watch.status();
    let ago = status.cycle.checked_sub(cycle)?;
    status.stamp_ns.checked_sub(ago * status.period_ns)
}

/// Sends a request over a kept-open connection and reads its answer; returns the status.
fn put(stream: &mut BufReader<UnixStream>, path: &str, body: &str) -> u16 {
    let length = body.len();
    let request =
        format!("PUT {path} HTTP/1.1\r\nhost: rcc\r\ncontent-length: {length}\r\n\r\n{body}");
    stream
        .get_mut()
        .write_all(request.as_bytes())
        .expect("sent");
    let (status, length) = head(stream);
    let mut body = vec![0; length.unwrap_or(0)];
    stream.read_exact(&mut body).expect("the body");
    status
}

/// Reads the head of an answer; returns the status and the length of the body, if it is known.
fn head(stream: &mut impl BufRead) -> (u16, Option<usize>) {
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        assert_ne!(
            stream.read_line(&mut head).expect("text"),
            0,
            "closed: {head}"
        );
    }
    let head = head.to_lowercase();
    let length = head
        .lines()
        .find_map(|line| line.strip_prefix("content-length: "));
    let status = head
        .split(' ')
        .nth(1)
        .and_then(|status| status.parse().ok());
    (
        status.expect("a status"),
        length.and_then(|length| length.parse().ok()),
    )
}

/// A set-point channel, and the lines of its answer.
#[derive(Debug)]
pub struct LineChannel {
    stream: UnixStream,
    answers: Option<BufReader<UnixStream>>,
}

impl LineChannel {
    /// Opens a channel; panics unless it is accepted.
    pub fn open(socket: &std::path::Path, path: &str) -> LineChannel {
        let mut stream = UnixStream::connect(socket).expect("a loader");
        stream.set_read_timeout(Some(LIMIT)).expect("a limit");
        let request =
            format!("POST {path} HTTP/1.1\r\nhost: rcc\r\ntransfer-encoding: chunked\r\n\r\n");
        stream.write_all(request.as_bytes()).expect("sent");
        let mut answers = BufReader::new(stream.try_clone().expect("a descriptor"));
        assert_eq!(head(&mut answers).0, 200);
        LineChannel {
            stream,
            answers: Some(answers),
        }
    }

    /// Sends a line.
    pub fn line(&mut self, line: &str) {
        let chunk = format!("{:x}\r\n{line}\n\r\n", line.len() + 1);
        self.stream.write_all(chunk.as_bytes()).expect("sent");
    }

    /// Returns the lines of the answer as they come; call it once.
    pub fn answers(&mut self) -> impl Iterator<Item = Value> + Send + use<> {
        let answers = self.answers.take().expect("called once");
        let lines = answers.lines().map_while(Result::ok);
        // The other lines are the lengths of the chunks.
        let lines = lines.filter(|line| line.starts_with('{'));
        lines.map(|line| serde_json::from_str(&line).expect("JSON"))
    }

    /// Ends the channel.
    pub fn end(&mut self) {
        self.stream.write_all(b"0\r\n\r\n").expect("sent");
    }

    /// Leaves without ending the channel, as a client that dies.
    pub fn leave(self) {
        // Also if the reader of the answers still has the connection.
        let _ = self.stream.shutdown(Shutdown::Both);
    }
}

/// Opens a stream of server-sent events; panics unless it is accepted.
pub fn events(socket: &std::path::Path, path: &str) -> BufReader<UnixStream> {
    let mut stream = UnixStream::connect(socket).expect("a loader");
    stream.set_read_timeout(Some(LIMIT)).expect("a limit");
    let request = format!("GET {path} HTTP/1.1\r\nhost: rcc\r\n\r\n");
    stream.write_all(request.as_bytes()).expect("sent");
    let mut stream = BufReader::new(stream);
    assert_eq!(head(&mut stream).0, 200);
    stream
}

/// Returns the next event of a stream: its name and its data.
pub fn next_event(stream: &mut impl BufRead) -> (String, Value) {
    let mut name = String::new();
    for line in stream.lines() {
        let line = line.expect("an event");
        if let Some(event) = line.strip_prefix("event: ") {
            name = event.to_owned();
        } else if let Some(data) = line.strip_prefix("data: ") {
            return (name, serde_json::from_str(data).expect("JSON"));
        }
    }
    panic!("the stream ended");
}
