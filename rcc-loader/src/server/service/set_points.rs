//! A set-point channel: lines of input values from one client, of which the executor gets the newest ones. These are
//! values for the inputs of a net; set-points of arms never pass through the loader. Run by a worker thread of its own
//! for each channel, with a port of its own to the executor, so that channels delay neither each other nor other
//! requests.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use axum::body::Bytes;
use rcc_api::error::ApiError;
use rcc_api::streams::{ChannelEnd, ChannelError, ChannelOpened, ChannelSet};
use rcc_core::message::CommandState;
use rcc_language::input_values;
use rcc_protocol::control::{Answer, Call, InputValue, SET_ELEMENTS_MAX, SET_MAX};
use serde::Serialize;
use tokio::sync::Notify;

use super::values::{no_names, refused};
use super::{CommandSummary, Service, unexpected};
use crate::server::executor::ExecutorPort;
use crate::server::live::LiveSender;

/// Maximum number of lines that wait for the executor: it takes one set of values in a cycle. Older ones are
/// superseded.
pub const LINES_MAX: usize = 16;

/// An open channel to the inputs of one command.
pub struct SetPointChannel {
    id: u64,
    entry: Arc<CommandSummary>,
    port: ExecutorPort,
}

impl Service {
    /// Opens a channel to the inputs of a ready or active net.
    ///
    /// # Errors
    /// Returns an error if there is no such command, or the executor has no room for another client.
    pub fn open_channel(&self, name: &str) -> Result<SetPointChannel, ApiError> {
        let (attached, store) = self.attach()?;
        let suits = |state: CommandState| state == CommandState::Ready || state.is_active();
        let id = self.resolve(|| attached.tables(), &store, name, suits)?;
        let entry = store.summary(id).filter(|entry| entry.is_named);
        Ok(SetPointChannel {
            id,
            entry: entry.ok_or_else(|| no_names(id))?,
            port: self.executor.open_port()?,
        })
    }
}

impl SetPointChannel {
    /// Serves the lines until the client ends them or the command takes no more values. With `tells_all`, each set of
    /// values is answered with its cycle, not only errors.
    pub fn serve(self, service: &Service, lines: &LineQueue, client: LiveSender, tells_all: bool) {
        let opened = ChannelOpened {
            id: self.id,
            net: self.entry.names.net.clone(),
        };
        let mut answers = Answers {
            client,
            tells_all,
            unreported: 0,
        };
        answers.tell(&opened);
        let mut end = ChannelEnd::default();
        while let Some(batch) = lines.take() {
            end.superseded += batch.overflowed;
            end.lines += batch.overflowed + batch.lines.len() as u64;
            let mut newest = NewestValues::default();
            for (number, line) in (batch.first_line..).zip(&batch.lines) {
                match self.read(line) {
                    Ok(values) => {
                        if !newest.has_room_for(&values) {
                            self.set(service, &mut newest, &mut end, &mut answers);
                        }
                        newest.add(number, values);
                    }
                    Err(error) => {
                        end.refused += 1;
                        answers.refuse(Some(number), &error);
                    }
                }
            }
            self.set(service, &mut newest, &mut end, &mut answers);
            if end.is_closed {
                lines.close();
                break;
            }
        }
        if let Some(error) = lines.failure() {
            answers.refuse(None, &error);
        }
        end.unreported = answers.unreported;
        answers.client.finish(line_of(&end));
    }

    fn read(&self, line: &[u8]) -> Result<Vec<InputValue>, ApiError> {
        // Invalid bytes become characters that no value has.
        let text = String::from_utf8_lossy(line);
        input_values::read(&text, "values", &self.entry.names).map_err(|faults| refused(&faults))
    }

    /// Sends the values to the executor, and waits until a cycle has them.
    fn set(
        &self,
        service: &Service,
        newest: &mut NewestValues,
        end: &mut ChannelEnd,
        answers: &mut Answers,
    ) {
        let (lines, superseded, values) = newest.take();
        end.superseded += superseded;
        let (Some(last), id) = (lines.last().copied(), self.id) else {
            return;
        };
        let answer = self.port.call(&Call::Set { id, values });
        let error = match answer {
            Ok(Answer::Done { cycle }) => {
                end.set += lines.len() as u64;
                end.cycle = cycle;
                return answers.tell_set(last, cycle);
            }
            Ok(Answer::Refused(refusal)) => {
                let store = service.attach().ok().map(|(_, store)| store);
                service.with_names(store.as_deref(), |names| names.refusal(id, refusal))
            }
            Ok(_) => unexpected(),
            Err(error) => error,
        };
        // The values fit their inputs, so the command or the executor takes no more.
        end.refused += lines.len() as u64;
        end.is_closed = true;
        answers.refuse(Some(last), &error);
    }
}

/// The newest value of each input, and the line that it came with.
#[derive(Debug, Default)]
struct NewestValues {
    values: BTreeMap<u32, (u64, Vec<u64>)>,
    lines: BTreeSet<u64>,
}

impl NewestValues {
    /// Returns true if the values surely fit into one request with those that are there.
    fn has_room_for(&self, values: &[InputValue]) -> bool {
        let here = self.values.values().map(|(_, words)| words.len());
        let there = values.iter().map(|value| value.words.len());
        self.values.len() + values.len() <= SET_MAX
            && here.chain(there).sum::<usize>() <= SET_ELEMENTS_MAX
    }

    fn add(&mut self, line: u64, values: Vec<InputValue>) {
        self.lines.insert(line);
        for InputValue { input, words } in values {
            self.values.insert(input, (line, words));
        }
    }

    /// Takes the values: the lines of which at least one value is left, the number of the others, and the values.
    fn take(&mut self) -> (Vec<u64>, u64, Vec<InputValue>) {
        let all = std::mem::take(&mut self.lines);
        let values = std::mem::take(&mut self.values);
        let left: BTreeSet<u64> = values.values().map(|(line, _)| *line).collect();
        let superseded = (all.len() - left.len()) as u64;
        let values = values.into_iter();
        let values = values.map(|(input, (_, words))| InputValue { input, words });
        (left.into_iter().collect(), superseded, values.collect())
    }
}

/// The answers to a client; one that it has no room for is counted.
struct Answers {
    client: LiveSender,
    tells_all: bool,
    unreported: u64,
}

impl Answers {
    fn tell(&mut self, answer: &impl Serialize) {
        self.unreported += u64::from(self.client.send(line_of(answer)).is_err());
    }

    fn tell_set(&mut self, line: u64, cycle: u64) {
        if self.tells_all {
            self.tell(&ChannelSet { line, cycle });
        }
    }

    fn refuse(&mut self, line: Option<u64>, error: &ApiError) {
        let error = error.body();
        self.tell(&ChannelError { line, error });
    }
}

fn line_of(answer: &impl Serialize) -> String {
    // Serializing numbers and texts cannot fail.
    serde_json::to_string(answer).unwrap_or_default() + "\n"
}

/// The lines that a client has sent and its channel has not taken: written by the serving thread, taken by the worker
/// thread.
#[derive(Debug, Default)]
pub struct LineQueue {
    state: Mutex<QueueState>,
    changed: Condvar,
    closed: Notify,
}

#[derive(Debug, Default)]
struct QueueState {
    lines: VecDeque<Bytes>,
    /// Number of the first line in `lines`, from 1, less one.
    before: u64,
    overflowed: u64,
    is_closed: bool,
    failure: Option<ApiError>,
}

/// Lines taken at once.
struct LineBatch {
    /// Number of the first of them, from 1.
    first_line: u64,
    lines: Vec<Bytes>,
    /// Number of older lines for which there was no room.
    overflowed: u64,
}

impl LineQueue {
    fn state(&self) -> MutexGuard<'_, QueueState> {
        // Every change is one assignment or one operation of a collection.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a line; a full queue drops its oldest one, and a closed one takes none.
    pub fn push(&self, line: Bytes) {
        let mut state = self.state();
        if state.is_closed {
            return;
        }
        if state.lines.len() >= LINES_MAX {
            state.lines.pop_front();
            state.before += 1;
            state.overflowed += 1;
        }
        state.lines.push_back(line);
        self.changed.notify_one();
    }

    /// Closes the queue: no line follows.
    pub fn close(&self) {
        self.state().is_closed = true;
        self.changed.notify_one();
        self.closed.notify_one();
    }

    /// Closes the queue for this reason, which is sent to the client.
    pub fn fail(&self, why: ApiError) {
        self.state().failure = Some(why);
        self.close();
    }

    /// Waits until no line follows.
    pub async fn closed(&self) {
        self.closed.notified().await;
    }

    fn failure(&self) -> Option<ApiError> {
        self.state().failure.take()
    }

    /// Takes the lines that are there.
    #[cfg(test)]
    pub fn lines(&self) -> Vec<Vec<u8>> {
        let batch = self.take().into_iter();
        batch
            .flat_map(|batch| batch.lines)
            .map(|line| line.to_vec())
            .collect()
    }

    /// Waits for lines and takes all of them; `None` at the end.
    fn take(&self) -> Option<LineBatch> {
        let waiting = |state: &mut QueueState| state.lines.is_empty() && !state.is_closed;
        let state = self.changed.wait_while(self.state(), waiting);
        let mut state = state.unwrap_or_else(PoisonError::into_inner);
        let lines: Vec<Bytes> = state.lines.drain(..).collect();
        let first_line = state.before + 1;
        state.before += lines.len() as u64;
        let overflowed = std::mem::take(&mut state.overflowed);
        (!lines.is_empty()).then_some(LineBatch {
            first_line,
            lines,
            overflowed,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(input: u32, word: u64) -> InputValue {
        InputValue {
            input,
            words: vec![word],
        }
    }

    #[test]
    fn the_newest_value_of_each_input_wins_and_a_line_without_any_is_superseded() {
        let mut newest = NewestValues::default();
        newest.add(1, vec![value(0, 10), value(1, 11)]);
        newest.add(2, vec![value(0, 20)]);
        newest.add(3, vec![value(0, 30)]);
        let (lines, superseded, values) = newest.take();
        assert_eq!((lines, superseded), (vec![1, 3], 1));
        assert_eq!(values, [value(0, 30), value(1, 11)]);
        assert!(newest.take().2.is_empty());
    }

    #[test]
    fn values_that_do_not_fit_into_one_request_are_sent_in_two() {
        let mut newest = NewestValues::default();
        newest.add(
            1,
            (0..SET_MAX as u32).map(|input| value(input, 1)).collect(),
        );
        assert!(newest.has_room_for(&[]) && !newest.has_room_for(&[value(0, 2)]));
    }

    #[test]
    fn a_closed_queue_takes_no_line() {
        let queue = LineQueue::default();
        queue.push("1".into());
        queue.close();
        queue.push("2".into());
        assert_eq!(queue.lines(), [b"1"]);
        assert!(queue.take().is_none());
    }

    #[test]
    fn a_full_queue_keeps_the_newest_lines_and_counts_the_others() {
        let queue = LineQueue::default();
        (0..LINES_MAX + 5).for_each(|number| queue.push(number.to_string().into()));
        queue.close();
        let batch = queue.take().map(|batch| {
            let last = batch.lines.last().map(|line| line.to_vec());
            (batch.first_line, batch.lines.len(), batch.overflowed, last)
        });
        let last = Some((LINES_MAX + 4).to_string().into_bytes());
        assert_eq!(batch, Some((6, LINES_MAX, 5, last)));
        assert!(queue.take().is_none());
    }
}
