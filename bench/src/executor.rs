//! A whole executor in one thread, without its sleep: engine, flight recorder, boards in shared memory in a cell of its
//! own, and drivers that answer at once. Used by the benchmarks; the cell is removed when it is dropped.

use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

use bytemuck::Zeroable;
use rcc_core::message::{DeviceState, Joints, MAGIC, Measurement};
use rcc_engine::engine::EngineConfig;
use rcc_engine::net::Net;
use rcc_engine::queue::{HelperRingEnds, rings};
use rcc_engine::record::{FlightRecorder, FlightRecorderConfig, FlightRecorderHelper};
use rcc_exec::boards::{Engine, EngineReply, EngineRequest, SharedMemory};
use rcc_exec::rt::{self, Boards};
use rcc_ipc::{BoardError, BoardWriter, Cell, CellError, CommandReader, Session, SessionError};
use rcc_language::devices::DeviceTable;
use rcc_os::clock::monotonic_ns;
use rcc_protocol::Role;
use rcc_protocol::control::{Answer, HELPERS, PlanData, Refusal, STATUS, TABLES, TIMING};

/// The defaults of a cell's configuration.
const RECORDER_MEMORY: usize = 64 << 20;
const RECORDER_SPAN_NS: u64 = 10_000_000_000;
static NEXT_CELL: AtomicU32 = AtomicU32::new(0);

/// The reason why the executor or a net cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum BenchExecutorError {
    /// The cell cannot be created.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The session cannot be opened.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// A board cannot be created.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The net was refused.
    #[error("the net was refused: {0:?}")]
    Refused(Refusal),
    /// The engine gave an unexpected answer.
    #[error("unexpected answer of the engine: {0:?}")]
    Answer(Option<Box<Answer>>),
}

/// A driver whose device follows set-points at once.
struct InstantDriver {
    measurement: Measurement,
    board: BoardWriter<Measurement>,
    commands: CommandReader,
}

impl InstantDriver {
    fn exchange(&mut self, now_ns: u64) {
        let image = self.commands.read();
        let measurement = &mut self.measurement;
        measurement.sequence += 1;
        measurement.stamp_ns = now_ns;
        let newest = image
            .at(image.head.sequence)
            .filter(|_| image.head.magic == MAGIC);
        if let Some(newest) = newest.filter(|newest| newest.has_position == 1) {
            measurement.state = DeviceState::Commanded as u32;
            measurement.position = newest.position;
            measurement.hold = newest.position;
        } else {
            measurement.state = DeviceState::Ready as u32;
            measurement.settled_ns = newest.map_or(0, |newest| newest.logical_ns);
        }
        self.board.write(measurement);
    }
}

/// An executor in one thread; see the module.
pub struct BenchExecutor {
    engine: Engine,
    boards: Boards,
    drivers: Vec<InstantDriver>,
    ends: HelperRingEnds<SharedMemory>,
    devices: DeviceTable,
    hold: Joints,
    next_ticket: u64,
    _recorder: FlightRecorderHelper,
    _session: Session,
    _cell_guard: CellGuard,
}

/// Removes everything of the cell when dropped; declared last, so that its users are dropped first.
struct CellGuard {
    cell: Cell,
    folder: PathBuf,
}

impl Drop for CellGuard {
    fn drop(&mut self) {
        remove(&self.cell);
        // An error is ignored: the rest stays in the temporary folder.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Removes what a cell without processes has left in shared memory.
pub fn remove(cell: &Cell) {
    // Errors are ignored: the rest stays in temporary folders; nothing else can be done about it here.
    for path in cell.leftovers().unwrap_or_default() {
        let _ = fs::remove_file(path);
    }
    let _ = fs::remove_dir_all(cell.iox_root());
}

impl BenchExecutor {
    /// Creates an executor for these devices; arms are held at `hold`, rad.
    ///
    /// # Errors
    /// Returns an error if the cell, its session or a board cannot be created.
    pub fn new(devices: DeviceTable, hold: Joints) -> Result<BenchExecutor, BenchExecutorError> {
        // Numbers the cells of this process.
        let number = NEXT_CELL.fetch_add(1, Ordering::Relaxed);
        let folder =
            std::env::temp_dir().join(format!("rcc-bench-{}-{number}", std::process::id()));
        let cell = Cell::at("bench", &folder)?;
        let cell_guard = CellGuard {
            cell: cell.clone(),
            folder,
        };
        let session = Session::join(&cell, Role::Executor, "exec")?;
        let models = devices.models();
        let commands = devices
            .devices
            .iter()
            .map(|device| session.create_commands(&format!("command.{}", device.name)));
        let boards = Boards {
            status: session.create_board(STATUS)?,
            tables: session.create_board(TABLES)?,
            timing: session.create_board(TIMING)?,
            helpers: session.create_board(HELPERS)?,
            beats: Box::default(),
        };
        let commands = commands.collect::<Result<Vec<_>, _>>()?;
        let services: Vec<_> = (commands.iter())
            .map(|board| board.service().to_owned())
            .collect();
        let recorder = FlightRecorderConfig {
            span_ns: RECORDER_SPAN_NS,
            memory: RECORDER_MEMORY,
            period_ns: devices.period_ns,
        };
        let (recorder, helper) = FlightRecorder::new(recorder, models.len());
        let (rt, ends) = rings();
        let config = EngineConfig {
            incarnation: session.incarnation(),
            first_id: 1,
            period_ns: devices.period_ns,
            stale_after_ns: 50_000_000,
            late_in_a_row_max: 0,
            models,
        };
        let engine = Engine::with_boards(config, rt, commands).recorded_by(recorder);
        let mut executor = BenchExecutor {
            engine,
            boards,
            drivers: Vec::new(),
            ends,
            devices,
            hold,
            next_ticket: 1,
            _recorder: helper,
            _session: session,
            _cell_guard: cell_guard,
        };
        executor.attach_drivers(&services)?;
        Ok(executor)
    }

    /// `services` are the boards with the set-points, by device.
    fn attach_drivers(&mut self, services: &[String]) -> Result<(), BenchExecutorError> {
        for (device, commands) in services.iter().enumerate() {
            let name = &self.devices.devices[device].name;
            let board: BoardWriter<Measurement> =
                self._session.create_board(&format!("measured.{name}"))?;
            let mut measurement = Measurement::zeroed();
            measurement.magic = MAGIC;
            measurement.joints = self.devices.devices[device].model.joints;
            measurement.state = DeviceState::Ready as u32;
            measurement.hold = self.hold;
            measurement.position = self.hold;
            measurement.digital_known = u64::MAX;
            let reader = Box::new(self._session.open_board(board.service())?);
            let commands = self._session.open_commands(commands)?;
            self.drivers.push(InstantDriver {
                measurement,
                board,
                commands,
            });
            let order = EngineRequest::Attach {
                device,
                incarnation: 1,
                board: reader,
            };
            self.ends
                .requests
                .push(order)
                .map_err(|_| BenchExecutorError::Answer(None))?;
        }
        self.cycles(3);
        Ok(())
    }

    /// Loads a plan, starts it, and returns the command's id.
    ///
    /// # Errors
    /// Returns an error if the plan is refused.
    pub fn start(&mut self, plan: PlanData) -> Result<u64, BenchExecutorError> {
        let holds: Vec<_> = self
            .drivers
            .iter()
            .map(|driver| Some(driver.measurement.hold))
            .collect();
        let dt_s = self.devices.period_ns as f64 * 1e-9;
        let net = Net::build(
            plan,
            &self.devices.models(),
            self.devices.fingerprint,
            &holds,
            dt_s,
        );
        let net = net.map_err(BenchExecutorError::Refused)?;
        let id = match self.ask(|ticket| EngineRequest::Reserve { ticket })? {
            Answer::Reserved { id } => id,
            other => return Err(BenchExecutorError::Answer(Some(Box::new(other)))),
        };
        for answer in [
            self.ask(|ticket| EngineRequest::Install { ticket, id, net })?,
            self.ask(|ticket| EngineRequest::Start {
                ticket,
                id,
                lease: 0,
            })?,
        ] {
            if !matches!(answer, Answer::Done { .. }) {
                return Err(BenchExecutorError::Answer(Some(Box::new(answer))));
            }
        }
        Ok(id)
    }

    /// Aborts a net and frees its row.
    ///
    /// # Errors
    /// Returns an error if the engine does not answer.
    pub fn end(&mut self, id: u64) -> Result<(), BenchExecutorError> {
        self.ask(|ticket| EngineRequest::Abort { ticket, id })?;
        self.cycles(20);
        self.ask(|ticket| EngineRequest::Unload { ticket, id })?;
        Ok(())
    }

    fn ask(
        &mut self,
        order: impl FnOnce(u64) -> EngineRequest,
    ) -> Result<Answer, BenchExecutorError> {
        let ticket = self.next_ticket;
        self.next_ticket += 1;
        self.ends
            .requests
            .push(order(ticket))
            .map_err(|_| BenchExecutorError::Answer(None))?;
        for _ in 0..3 {
            self.cycle();
            while let Ok(outcome) = self.ends.replies.pop() {
                if let EngineReply::Answer { ticket: of, answer } = outcome
                    && of == ticket
                {
                    return Ok(answer);
                }
            }
        }
        Err(BenchExecutorError::Answer(None))
    }

    /// Runs `count` cycles; returns their total duration, ns.
    pub fn cycles(&mut self, count: usize) -> u64 {
        (0..count).map(|_| self.cycle()).sum()
    }

    /// Runs one cycle as the real-time thread does, without the sleep; returns its duration as the executor measures
    /// it, ns.
    pub fn cycle(&mut self) -> u64 {
        let before_ns = monotonic_ns();
        self.drivers
            .iter_mut()
            .for_each(|driver| driver.exchange(before_ns));
        while self.ends.records.pop().is_ok() || self.ends.events.pop().is_ok() {}
        let woke_ns = monotonic_ns();
        self.engine.latch_boards(woke_ns);
        self.engine.cycle(woke_ns);
        rt::write(&mut self.engine, &mut self.boards);
        let exec_ns = monotonic_ns() - woke_ns;
        self.engine.account(0, exec_ns, 0);
        exec_ns
    }

    /// Returns the number of running nets.
    #[must_use]
    pub fn running(&self) -> u32 {
        self.engine.status().running
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::Graph;
    use crate::instance::cell;
    use crate::net::net;
    use rcc_language::compile_for;

    #[test]
    fn nets_run_in_it_and_its_files_are_removed() {
        let text = net(&Graph::load("full", 50).unwrap()).text;
        let plan = compile_for(&text, "graph.json", &cell()).unwrap().plan;
        let mut executor = BenchExecutor::new(cell(), [0.0; 8]).unwrap();
        let first = executor.start(plan.clone()).unwrap();
        executor.start(plan).unwrap();
        executor.cycles(100);
        assert_eq!(executor.running(), 2);
        executor.end(first).unwrap();
        assert_eq!(executor.running(), 1);
        let CellGuard { cell, folder } = &executor._cell_guard;
        let (cell, folder) = (cell.clone(), folder.clone());
        assert!(folder.exists() && !cell.leftovers().unwrap().is_empty());
        drop(executor);
        assert!(!folder.exists() && !cell.iox_root().exists());
        assert_eq!(cell.leftovers().unwrap(), Vec::<PathBuf>::new());
    }
}
