//! Client of a simulator's control port, and reader of its traces of the datagrams on the wire. Blocks the demo's main
//! thread for at most a few seconds.

use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::{Value, json};

/// Longest time that the simulator may take to answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(6);
/// Value of the trace's `state` column while the robot follows set-points.
const COMMAND_STATE: &str = "2";

/// Client of the control port of `lwr-sim` or `io-sim`.
pub struct SimulatorClient {
    stream: BufReader<UnixStream>,
}

/// One measurement datagram of the controller and our answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DatagramExchange {
    /// Joint positions of our answer as the robot received them, rad.
    pub commanded: [f64; 7],
    /// `$FRI_FRM_BOOL` of our answer.
    pub booleans: u16,
    /// Position of the simulated flange, base frame, m.
    pub flange: [f64; 3],
    /// Force on the flange, base axes, N.
    pub force: [f64; 3],
}

impl SimulatorClient {
    /// Connects to a simulator's socket.
    ///
    /// # Errors
    /// Returns the system's error.
    pub fn connect(path: &Path) -> io::Result<SimulatorClient> {
        let stream = UnixStream::connect(path)?;
        stream.set_read_timeout(Some(ANSWER_TIMEOUT))?;
        stream.set_write_timeout(Some(ANSWER_TIMEOUT))?;
        Ok(SimulatorClient {
            stream: BufReader::new(stream),
        })
    }

    /// Sends one command and returns the answer.
    ///
    /// # Errors
    /// Returns the system's error or the simulator's refusal.
    pub fn ask(&mut self, command: &Value) -> io::Result<Value> {
        self.stream
            .get_mut()
            .write_all(format!("{command}\n").as_bytes())?;
        let mut line = String::new();
        self.stream.read_line(&mut line)?;
        let answer: Value = serde_json::from_str(&line).map_err(io::Error::other)?;
        match answer.get("error") {
            Some(error) => Err(io::Error::other(format!("it refuses: {error}"))),
            None => Ok(answer),
        }
    }

    /// Places a floor at this height (m) with this stiffness (N/m), which pushes upwards.
    ///
    /// # Errors
    /// As [`SimulatorClient::ask`].
    pub fn floor(&mut self, height: f64, stiffness: f64) -> io::Result<()> {
        let (point, normal) = ([0.0, 0.0, height], [0.0, 0.0, 1.0]);
        let wall =
            json!({"point": point, "normal": normal, "stiffness": stiffness, "damping": 0.0});
        self.ask(&json!({ "wall": wall })).map(|_| ())
    }

    /// Removes the floor.
    ///
    /// # Errors
    /// As [`SimulatorClient::ask`].
    pub fn no_floor(&mut self) -> io::Result<()> {
        self.ask(&json!({"wall": null})).map(|_| ())
    }

    /// Starts a trace into a new file, which must be below the folder of the simulator's socket.
    ///
    /// # Errors
    /// As [`SimulatorClient::ask`].
    pub fn begin_trace(&mut self, path: &Path) -> io::Result<ActiveTrace> {
        match std::fs::remove_file(path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        self.ask(&json!({"trace": {"path": path}}))?;
        Ok(ActiveTrace {
            path: path.to_owned(),
        })
    }

    /// Ends the trace and reads it.
    ///
    /// # Errors
    /// As [`SimulatorClient::ask`]; also fails if the file is not a trace.
    pub fn end_trace(&mut self, trace: ActiveTrace) -> io::Result<Vec<DatagramExchange>> {
        self.ask(&json!({"trace": null}))?;
        let text = std::fs::read_to_string(&trace.path)?;
        read_trace(&text)
    }
}

/// A trace that is being written.
pub struct ActiveTrace {
    path: PathBuf,
}

/// Returns the exchanges of a trace in which the robot followed set-points.
fn read_trace(text: &str) -> io::Result<Vec<DatagramExchange>> {
    let malformed = |what: &str| io::Error::other(format!("lwr-sim's trace: {what}"));
    let mut lines = text.lines();
    let heads: Vec<&str> = lines
        .next()
        .unwrap_or_default()
        .split(',')
        .map(str::trim)
        .collect();
    let column = |name: &str| {
        let found = heads.iter().position(|head| *head == name);
        found.ok_or_else(|| malformed(&format!("no column {name}")))
    };
    let (state, answered) = (column("state")?, column("answered")?);
    let (c1, booleans, x, fx) = (
        column("c1")?,
        column("frm_bool")?,
        column("x")?,
        column("fx")?,
    );
    let mut exchanges = Vec::new();
    for line in lines {
        let fields: Vec<&str> = line.split(',').collect();
        let field = |index: usize| fields.get(index).copied().unwrap_or_default();
        if field(state) != COMMAND_STATE || field(answered) != "1" {
            continue;
        }
        let real = |index: usize| field(index).parse::<f64>().map_err(|_| malformed(line));
        let mut exchange = DatagramExchange {
            commanded: [0.0; 7],
            booleans: field(booleans).parse().map_err(|_| malformed(line))?,
            flange: [real(x)?, real(x + 1)?, real(x + 2)?],
            force: [real(fx)?, real(fx + 1)?, real(fx + 2)?],
        };
        for (joint, slot) in exchange.commanded.iter_mut().enumerate() {
            // Printed as the shortest text of a binary32: parsed as such, then widened.
            let value: f32 = field(c1 + joint).parse().map_err(|_| malformed(line))?;
            *slot = f64::from(value);
        }
        exchanges.push(exchange);
    }
    Ok(exchanges)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADS: &str = "tick,time_s,sequence,state,quality,answered,\
        q1,q2,q3,q4,q5,q6,q7,c1,c2,c3,c4,c5,c6,c7,frm_bool,x,y,z,fx,fy,fz";

    #[test]
    fn only_exchanges_in_which_the_robot_followed_are_read() -> io::Result<()> {
        let row = |state: u8, answered: u8| {
            format!(
                "1,0.1,2,{state},3,{answered},0,0,0,0,0,0,0,0.1,2,3,4,5,6,7,1,0.5,0.6,0.7,0,0,9"
            )
        };
        let text = [HEADS.to_owned(), row(2, 1), row(1, 1), row(2, 0)].join("\n");
        let read = read_trace(&text)?;
        assert_eq!(read.len(), 1);
        assert_eq!(read[0].commanded[0], f64::from(0.1_f32));
        assert_eq!(
            (read[0].booleans, read[0].flange, read[0].force[2]),
            (1, [0.5, 0.6, 0.7], 9.0)
        );
        Ok(())
    }

    #[test]
    fn a_file_that_is_not_a_trace_is_refused() {
        assert!(read_trace("a,b\n1,2").is_err());
        assert!(read_trace(&format!("{HEADS}\n1,0.1,2,2,3,1,x")).is_err());
    }
}
