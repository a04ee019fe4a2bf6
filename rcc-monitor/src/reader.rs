//! Whether anybody still reads what is printed: without records there is nothing to write, and nothing that fails.
//! Asked by the monitor's one thread.

use std::os::fd::AsFd;

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

/// True if the other end of this pipe or terminal is closed; never of a file.
#[must_use]
pub fn is_gone(output: &impl AsFd) -> bool {
    // Errors and hang-ups are told without being asked for.
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
