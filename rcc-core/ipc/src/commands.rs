//! The set-points of one device on their way from the executor to its driver: one per cycle, of which the driver finds
//! the last [`SET_POINTS`]. Opened by helper threads; written and read by the real-time threads.

use bytemuck::Zeroable;
use rcc_core::message::{CommandHead, CommandImage, SET_POINTS, SetPoint};

use crate::board::BoardError;
use crate::ring::{RingReader, RingWriter};
use crate::session::Session;

/// Well within `u32`.
const LENGTH: u32 = SET_POINTS as u32;

/// Writing end of a device's set-points, in the executor.
#[derive(Debug)]
pub struct CommandWriter(RingWriter<CommandHead, SetPoint>);

impl CommandWriter {
    /// Writes the newest set-point, of cycle `head.sequence`, and its head. To be called once per cycle. Real-time safe.
    #[inline]
    pub fn write_point(&mut self, head: &CommandHead, point: &SetPoint) {
        self.0.write(head.sequence, point, head);
    }

    /// As [`CommandWriter::write_point`], with the newest set-point of an image.
    pub fn write(&mut self, image: &CommandImage) {
        // Nothing is written before the first cycle.
        if let Some(point) = image.at(image.head.sequence) {
            self.write_point(&image.head, point);
        }
    }

    /// Returns the full name under which a driver opens it.
    #[must_use]
    pub fn service(&self) -> &str {
        self.0.service()
    }
}

/// Reading end of a device's set-points, in the driver.
#[derive(Debug)]
pub struct CommandReader {
    ring: RingReader<CommandHead, SetPoint>,
    image: Box<CommandImage>,
}

impl CommandReader {
    /// Returns the newest head: the source of the set-points and the number of the newest one.
    #[must_use]
    pub fn head(&self) -> CommandHead {
        self.ring.head()
    }

    /// Copies the set-points that are new since the last call, at most [`SET_POINTS`]. Real-time safe.
    pub fn read(&mut self) -> &CommandImage {
        let head = self.ring.head();
        let oldest = head.sequence.saturating_sub(SET_POINTS as u64 - 1);
        let first = oldest.max(self.image.head.sequence.saturating_add(1));
        for number in first..=head.sequence {
            // A set-point that was overwritten meanwhile has another number; `CommandImage::at` does not return it.
            self.image.keep(number, self.ring.at(number));
        }
        self.image.head = head;
        &self.image
    }
}

impl Session {
    /// Creates the ring of set-points of a device.
    ///
    /// # Errors
    /// As [`Session::create_board`].
    pub fn create_commands(&self, name: &str) -> Result<CommandWriter, BoardError> {
        self.create_ring(name, LENGTH).map(CommandWriter)
    }

    /// Opens the ring of set-points by the full name that the executor announced.
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
