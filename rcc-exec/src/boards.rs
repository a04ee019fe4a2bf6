//! The boards of devices in shared memory, as the engine uses them. Real-time thread.

use rcc_core::message::{CommandImage, Measurement};
use rcc_engine::boards::DeviceBoards;
use rcc_ipc::{BoardReader, CommandWriter};

/// Boards in shared memory.
#[derive(Clone, Copy, Debug)]
pub enum SharedMemory {}

impl DeviceBoards for SharedMemory {
    type Measurements = BoardReader<Measurement>;
    type SetPoints = CommandWriter;

    #[inline]
    fn read(board: &BoardReader<Measurement>) -> Measurement {
        board.read()
    }

    #[inline]
    fn write(board: &mut CommandWriter, image: &CommandImage) {
        board.write(image);
    }
}

/// The engine of the executor.
pub type Engine = rcc_engine::engine::Engine<SharedMemory>;
/// A request to it.
pub type EngineRequest = rcc_engine::queue::EngineRequest<SharedMemory>;
/// A message from it.
pub type EngineReply = rcc_engine::queue::EngineReply<SharedMemory>;
