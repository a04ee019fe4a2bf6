//! Detects that the reader of the output is gone: without records nothing is written, so no write fails. Called by the
//! monitor's one thread.

use std::os::fd::AsFd;

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

/// Returns true if the other end of this pipe or terminal is closed; always false for a file.
#[must_use]
pub fn is_gone(output: &impl AsFd) -> bool {
    // POLLERR and POLLHUP are always reported, without being requested.
    let mut looked = [PollFd::new(output.as_fd(), PollFlags::empty())];
    let found = poll(&mut looked, PollTimeout::ZERO);
    let ends = PollFlags::POLLERR | PollFlags::POLLHUP;
    let [looked] = looked;
    found.is_ok_and(|count| count > 0) && looked.revents().is_some_and(|got| got.intersects(ends))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_is_gone_when_its_end_is_closed() -> std::io::Result<()> {
        let (reader, writer) = std::io::pipe()?;
        assert!(!is_gone(&writer));
        drop(reader);
        assert!(is_gone(&writer));
        Ok(())
    }
}
