//! The content of a file as the body of an answer: read piece by piece on blocking threads, as fast as the client takes
//! it, so that a long file occupies one piece of memory. Polled by the thread that serves connections.

use std::fs::File;
use std::io::{self, Read};
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use axum::body::Bytes;
use hyper::body::{Body, Frame, SizeHint};
use tokio::task::JoinHandle;

/// Length of a piece, bytes.
const PIECE: usize = 256 << 10;

/// The file and the bytes that were read from it.
type ReadResult = io::Result<(File, Vec<u8>)>;

/// The rest of a file.
pub struct FileBody {
    /// `None` while a piece is being read, and after an error.
    file: Option<File>,
    reading: Option<JoinHandle<ReadResult>>,
    /// Number of bytes that have not been returned.
    left: u64,
}

impl FileBody {
    /// Returns the next `length` bytes of a file.
    #[must_use]
    pub fn new(file: File, length: u64) -> FileBody {
        FileBody {
            file: Some(file),
            reading: None,
            left: length,
        }
    }
}

fn read_piece(mut file: File, length: usize) -> io::Result<(File, Vec<u8>)> {
    let mut piece = Vec::with_capacity(length);
    (&mut file).take(length as u64).read_to_end(&mut piece)?;
    match piece.is_empty() {
        true => Err(io::ErrorKind::UnexpectedEof.into()),
        false => Ok((file, piece)),
    }
}

impl Body for FileBody {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        if self.left == 0 {
            return Poll::Ready(None);
        }
        if let Some(file) = self.file.take() {
            let length = usize::try_from(self.left).unwrap_or(PIECE).min(PIECE);
            self.reading = Some(tokio::task::spawn_blocking(move || {
                read_piece(file, length)
            }));
        }
        let Some(reading) = &mut self.reading else {
            return Poll::Ready(None);
        };
        let read = ready!(Pin::new(reading).poll(context));
        self.reading = None;
        let (file, piece) = match read.unwrap_or_else(|error| Err(io::Error::other(error))) {
            Ok(read) => read,
            Err(error) => return Poll::Ready(Some(Err(error))),
        };
        self.file = Some(file);
        self.left -= piece.len() as u64;
        Poll::Ready(Some(Ok(Frame::data(piece.into()))))
    }

    fn is_end_stream(&self) -> bool {
        self.left == 0
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.left)
    }
}
