//! The trace: a record of the datagrams of each cycle, as comma-separated values.
//! Written by a thread of its own: the clock thread only hands records over and never waits.

use super::arm::Joints;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// Capacity of the queue between the two threads, records.
const QUEUE: usize = 8192;
/// Interval at which written lines are flushed to the file.
const FLUSH_EVERY: Duration = Duration::from_millis(100);

/// Header line of a trace.
pub const HEADER: &str = "tick,time_s,sequence,state,quality,answered,\
    q1,q2,q3,q4,q5,q6,q7,c1,c2,c3,c4,c5,c6,c7,frm_bool,x,y,z,fx,fy,fz";

/// One datagram of the robot and the answer to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceRecord {
    /// Cycles since the start.
    pub tick: u64,
    /// Controller's time, s.
    pub time_s: f64,
    /// The sender's counter in the robot's datagram.
    pub sequence: u32,
    /// 1 monitor, 2 command.
    pub state: u16,
    /// 0, the worst, to 3, the best.
    pub quality: u16,
    /// A valid answer was received.
    pub answered: bool,
    /// Joint positions sent as measured, rad, before rounding for the wire.
    pub measured: Joints,
    /// Joint positions of the answer as received, rad; NaN without an answer.
    pub commanded: Joints,
    /// Boolean outputs (`$FRI_FRM_BOOL`) of the answer, or the last values without one.
    pub booleans: u16,
    /// Position of the flange at `measured`, base frame, m.
    pub flange: [f64; 3],
    /// Force on the flange as sent, N, base axes.
    pub force: [f64; 3],
}

impl TraceRecord {
    /// Appends the record as one line; every number can be read back bit-identically.
    pub fn write_to(&self, line: &mut String) -> std::fmt::Result {
        write!(
            line,
            "{},{:?},{},{},{},{}",
            self.tick,
            self.time_s,
            self.sequence,
            self.state,
            self.quality,
            u8::from(self.answered)
        )?;
        self.measured
            .iter()
            .try_for_each(|q| write!(line, ",{q:?}"))?;
        self.commanded
            .iter()
            .try_for_each(|q| write!(line, ",{q:?}"))?;
        write!(line, ",{}", self.booleans)?;
        self.flange
            .iter()
            .chain(&self.force)
            .try_for_each(|value| write!(line, ",{value:?}"))?;
        line.push('\n');
        Ok(())
    }

    /// Parses one line; returns `None` if it is not a complete record.
    pub fn parse(line: &str) -> Option<Self> {
        let mut fields = line.trim_end().split(',');
        let mut next = || fields.next();
        let record = Self {
            tick: next()?.parse().ok()?,
            time_s: next()?.parse().ok()?,
            sequence: next()?.parse().ok()?,
            state: next()?.parse().ok()?,
            quality: next()?.parse().ok()?,
            answered: next()? == "1",
            measured: read(&mut next)?,
            commanded: read(&mut next)?,
            booleans: next()?.parse().ok()?,
            flange: read(&mut next)?,
            force: read(&mut next)?,
        };
        fields.next().is_none().then_some(record)
    }
}

fn read<'a, T: std::str::FromStr + Copy + Default, const N: usize>(
    next: &mut impl FnMut() -> Option<&'a str>,
) -> Option<[T; N]> {
    let mut values = [T::default(); N];
    for value in &mut values {
        *value = next()?.parse().ok()?;
    }
    Some(values)
}

enum TraceMessage {
    Record(TraceRecord),
    Open(PathBuf, SyncSender<io::Result<()>>),
    Close(SyncSender<io::Result<()>>),
    Flush(SyncSender<io::Result<()>>),
}

/// Handle for handing records to the writer thread; clones share the writer.
#[derive(Clone)]
pub struct TraceSink {
    queue: SyncSender<TraceMessage>,
}

/// Why a trace could not be opened, closed or flushed.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// The file cannot be written.
    #[error("the trace cannot be written: {0}")]
    File(#[from] io::Error),
    /// The writer thread does not answer.
    #[error("the trace's writer does not answer within 5 s")]
    NoAnswer,
}

impl TraceSink {
    /// Starts the writer thread, which ends when every sink has been dropped. [`TraceSink::close`] ensures that all
    /// records are in the file.
    ///
    /// # Errors
    /// Returns an error if the operating system refuses to create a thread.
    pub fn start() -> io::Result<Self> {
        let (queue, records) = sync_channel(QUEUE);
        thread::Builder::new()
            .name("trace".into())
            .spawn(move || write_all(&records))?;
        Ok(Self { queue })
    }

    /// Hands a record over without blocking; returns `false` if the queue was full and the record is lost.
    pub fn record(&self, record: TraceRecord) -> bool {
        !matches!(
            self.queue.try_send(TraceMessage::Record(record)),
            Err(TrySendError::Full(_))
        )
    }

    /// Traces into `path` from now on: appends, after a header line if the file is empty.
    ///
    /// # Errors
    /// Returns an error if the file cannot be opened.
    pub fn open(&self, path: PathBuf) -> Result<(), TraceError> {
        self.ask(|answer| TraceMessage::Open(path, answer))
    }

    /// Ends the trace; all records handed over so far are then in the file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn close(&self) -> Result<(), TraceError> {
        self.ask(TraceMessage::Close)
    }

    /// Waits until all records handed over so far are in the file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn flush(&self) -> Result<(), TraceError> {
        self.ask(TraceMessage::Flush)
    }

    fn ask(
        &self,
        message: impl FnOnce(SyncSender<io::Result<()>>) -> TraceMessage,
    ) -> Result<(), TraceError> {
        let (answer, answered) = sync_channel(1);
        self.queue
            .send(message(answer))
            .map_err(|_| TraceError::NoAnswer)?;
        match answered.recv_timeout(Duration::from_secs(5)) {
            Ok(result) => Ok(result?),
            Err(_) => Err(TraceError::NoAnswer),
        }
    }
}

/// The file being written; a failed write closes it and is reported with the next request.
#[derive(Default)]
struct TraceOutput {
    file: Option<BufWriter<File>>,
    failure: Option<io::Error>,
}

impl TraceOutput {
    fn open(&mut self, path: PathBuf) -> io::Result<()> {
        self.close()?;
        // Readable only by its owner, and not through a link that somebody has planted.
        let file = File::options()
            .create(true)
            .append(true)
            .mode(0o600)
            .custom_flags(nix::libc::O_NOFOLLOW | nix::libc::O_NONBLOCK)
            .open(path)?;
        if !file.metadata()?.is_file() {
            return Err(io::Error::other(
                "not a regular file: name a regular file, or a new one",
            ));
        }
        let empty = file.metadata()?.len() == 0;
        let mut file = BufWriter::new(file);
        if empty {
            writeln!(file, "{HEADER}")?;
        }
        self.file = Some(file);
        Ok(())
    }

    fn write(&mut self, record: &TraceRecord, line: &mut String) {
        let Some(file) = &mut self.file else { return };
        line.clear();
        // Writing to a String cannot fail.
        let _ = record.write_to(line);
        if let Err(error) = file.write_all(line.as_bytes()) {
            self.failure = Some(error);
            self.file = None;
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        self.file.as_mut().map_or(Ok(()), BufWriter::flush)
    }

    fn close(&mut self) -> io::Result<()> {
        let result = self.flush();
        self.file = None;
        result
    }
}

fn write_all(records: &Receiver<TraceMessage>) {
    let mut output = TraceOutput::default();
    let mut line = String::with_capacity(512);
    let mut flushed = Instant::now();
    // The requester may be gone by now; an answer that nobody takes is not an error.
    loop {
        match records.recv_timeout(FLUSH_EVERY) {
            Ok(TraceMessage::Record(record)) => output.write(&record, &mut line),
            Ok(TraceMessage::Open(path, answer)) => drop(answer.send(output.open(path))),
            Ok(TraceMessage::Close(answer)) => drop(answer.send(output.close())),
            Ok(TraceMessage::Flush(answer)) => drop(answer.send(output.flush())),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        if flushed.elapsed() >= FLUSH_EVERY {
            flushed = Instant::now();
            if let Err(error) = output.flush() {
                output.failure = Some(error);
            }
        }
    }
    if let Err(error) = output.close() {
        tracing::error!(%error, "the trace is incomplete");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_reads_back_to_the_same_bits() {
        let record = TraceRecord {
            tick: 12,
            time_s: 0.1 + 0.2,
            sequence: 65_535,
            state: 2,
            quality: 3,
            answered: true,
            measured: std::array::from_fn(|i| 1.0 / (i as f64 + 3.0)),
            commanded: std::array::from_fn(|i| 1.0 / (i as f64 - 9.5)),
            booleans: 0x8001,
            flange: [0.1, -0.2, 1e-9],
            force: [0.0, -0.0, 1e300],
        };
        let mut line = String::new();
        record.write_to(&mut line).unwrap();
        assert_eq!(TraceRecord::parse(&line), Some(record));
        assert_eq!(line.split(',').count(), HEADER.split(',').count());
        assert_eq!(
            TraceRecord::parse(line.trim_end().rsplit_once(',').unwrap().0),
            None
        );
        assert_eq!(TraceRecord::parse(HEADER), None);
    }
}
