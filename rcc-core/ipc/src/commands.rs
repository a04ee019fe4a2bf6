//! The commands of a device as they cross from the executor to its driver: one set-point a cycle, and the driver finds the
//! last [`SET_POINTS`] of them. Opened by helper threads; written and read by the real-time threads.

use bytemuck::Zeroable;
use rcc_core::message::{CommandHead, CommandImage, SET_POINTS, SetPoint};

use crate::board::BoardError;
use crate::ring::{RingReader, RingWriter};
use crate::session::Session;

/// Fits `u32` by far.
const LENGTH: u32 = SET_POINTS as u32;

/// Where the executor writes the commands of one device.
#[derive(Debug)]
pub struct CommandWriter(RingWriter<CommandHead, SetPoint>);

impl CommandWriter {
    /// Writes the newest set-point of `image`, and its head. Call it for each cycle. Real-time safe.
    pub fn write(&mut self, image: &CommandImage) {
        let number = image.head.sequence;
        // Nothing is written before the first cycle.
        if let Some(point) = image.at(number) {
            self.0.write(number, point, &image.head);
        }
    }

    /// Full name under which a driver opens it.
    #[must_use]
    pub fn service(&self) -> &str {
        self.0.service()
    }
}

/// Where a driver reads the commands of its device.
#[derive(Debug)]
pub struct CommandReader {
    ring: RingReader<CommandHead, SetPoint>,
    image: Box<CommandImage>,
}

impl CommandReader {
    /// Whose set-points there are, and how far they go.
    #[must_use]
    pub fn head(&self) -> CommandHead {
        self.ring.head()
    }

    /// Takes over what is new. Real-time safe: copies the set-points since the last look, at most [`SET_POINTS`].
    pub fn read(&mut self) -> &CommandImage {
        let head = self.ring.head();
        let oldest = head.sequence.saturating_sub(SET_POINTS as u64 - 1);
        let first = oldest.max(self.image.head.sequence.saturating_add(1));
        for number in first..=head.sequence {
            // One that was overwritten meanwhile has another number, and `CommandImage::at` does not find it.
            self.image.keep(number, self.ring.at(number));
        }
        self.image.head = head;
        &self.image
    }
}

impl Session {
    /// Creates where the commands of a device are written.
    ///
    /// # Errors
    /// As [`Session::create_board`].
    pub fn create_commands(&self, name: &str) -> Result<CommandWriter, BoardError> {
        self.create_ring(name, LENGTH).map(CommandWriter)
    }

    /// Opens the commands of that full name, as the executor announced them.
    ///
    /// # Errors
    /// As [`Session::open_board`].
    pub fn open_commands(&self, service: &str) -> Result<CommandReader, BoardError> {
        Ok(CommandReader {
            ring: self.open_ring(service, LENGTH)?,
            image: Box::new(CommandImage::zeroed()),
        })
    }
}
