//! The engine's view of the boards of devices: shared memory in the executor, nothing in virtual time. The functions
//! run on the real-time thread and are dispatched statically.

use std::convert::Infallible;
use std::fmt::Debug;

use rcc_core::message::{CommandHead, CommandImage, Measurement, SetPoint};

/// A kind of boards. Its functions neither allocate nor lock nor call the system.
pub trait DeviceBoards: Debug {
    /// Reader of a driver's measurements; opened by a helper thread, attached by a request.
    type Measurements: Debug;
    /// Writer of the set-points for a device; created before the first cycle.
    type SetPoints: Debug;

    /// Copies the newest measurement to `place`.
    fn read(board: &Self::Measurements, place: &mut Measurement);

    /// Writes the newest set-point and its head.
    fn write(board: &mut Self::SetPoints, head: &CommandHead, point: &SetPoint);
}

/// Virtual time: no board is ever attached. Who runs the cycles passes measurements to
/// [`Engine::latch`](crate::engine::Engine::latch) and takes set-points from
/// [`Engine::image`](crate::engine::Engine::image).
#[derive(Clone, Copy, Debug)]
pub enum VirtualBoards {}

impl DeviceBoards for VirtualBoards {
    type Measurements = Infallible;
    type SetPoints = Box<CommandImage>;

    fn read(board: &Infallible, _: &mut Measurement) {
        match *board {}
    }

    fn write(image: &mut Box<CommandImage>, head: &CommandHead, point: &SetPoint) {
        image.head = *head;
        image.keep(head.sequence, *point);
    }
}
