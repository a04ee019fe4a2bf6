//! The boards of devices in shared memory, as the engine uses them. Real-time thread.

use rcc_core::message::{CommandHead, Measurement, SetPoint};
use rcc_engine::boards::DeviceBoards;
use rcc_ipc::{BoardReader, CommandWriter};

/// Boards in shared memory.
#[derive(Clone, Copy, Debug)]
pub enum SharedMemory {}

impl DeviceBoards for SharedMemory {
    type Measurements = BoardReader<Measurement>;
    type SetPoints = CommandWriter;

    #[inline]
    fn read(board: &BoardReader<Measurement>, place: &mut Measurement) {
        board.read_into(place);
    }

    #[inline]
    fn write(board: &mut CommandWriter, head: &CommandHead, point: &SetPoint) {
        board.write_point(head, point);
    }
}

/// The engine of the executor.
pub type Engine = rcc_engine::engine::Engine<SharedMemory>;
/// A request to it.
pub type EngineRequest = rcc_engine::queue::EngineRequest<SharedMemory>;
/// A message from it.
pub type EngineReply = rcc_engine::queue::EngineReply<SharedMemory>;
