//! What the command line prints. A verb whose result is its output ends when that cannot be written; whatever looks after
//! something that runs prints through a [`Printer`], whose output is never a reason to end or to wait. Whatever a net, a
//! device or another program says, nothing in it commands the terminal.
//! Used by the main thread; a printer has a thread of its own.

use std::io::{self, ErrorKind, IsTerminal, Write};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;
use std::{process, thread};

use rcc_core::printable::{Coloured, Printable};
use rcc_loader::server::codes::{self, exit};

/// Lines that wait while nobody takes them; further ones are dropped.
const LINES_WAITING_MAX: usize = 1024;
/// How long the last lines are waited for at the end.
const LAST_LINES: Duration = Duration::from_secs(1);

/// Prints a line on stdout, as the result of a verb that has nothing else to do. A reader that is gone ends the program
/// without words, as it ends other filters; any other failure ends it with an error, because the result is lost.
pub fn print_line(text: &str) {
    write_or_exit(&format!("{}\n", Printable(text.trim_end_matches('\n'))));
}

/// Prints the text of a file, as [`print_line`], but to the byte as it is unless a terminal shows it.
pub fn print_file(text: &str) {
    if io::stdout().is_terminal() {
        print_line(text);
    } else {
        write_or_exit(&format!("{}\n", text.trim_end_matches('\n')));
    }
}

/// Prints a table, as [`print_line`], in the place of the one before, of so many lines; 0: below what is there.
pub fn reprint(before: usize, text: &str) {
    if before > 0 {
        // Back to its first line, and from there to the end everything is erased.
        write_or_exit(&format!("\x1b[{before}A\x1b[J"));
    }
    print_line(text);
}

fn write_or_exit(text: &str) {
    let mut out = io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    if let Err(error) = written {
        process::exit(i32::from(exit_code_of(&error)));
    }
}

/// The exit code of a program whose output cannot be written; told on stderr unless its reader is gone.
fn exit_code_of(error: &io::Error) -> u8 {
    if error.kind() == ErrorKind::BrokenPipe {
        return exit::READER_GONE;
    }
    print_note(&format!(
        "error {}: cannot write to standard output: {error}\n       help: the operation may have been carried out, but its result \
         is lost: free disk space, or redirect the output elsewhere",
        codes::NOT_STORED.code
    ));
    codes::NOT_STORED.exit
}

/// Prints a remark on stderr. Nobody can be told when that fails, and nothing changes by it.
pub fn print_note(text: &str) {
    write_stderr(&Printable(text.trim_end_matches('\n')).to_string());
}

/// Prints drawings of findings on stderr, as [`print_note`], in the colours that they were drawn in.
pub fn print_diagnostics(drawing: &str) {
    write_stderr(&Coloured(drawing.trim_end_matches('\n')).to_string());
}

fn write_stderr(text: &str) {
    if !text.is_empty() {
        // One write, so that lines of several programs do not mix.
        let _ = io::stderr().write_all(format!("{text}\n").as_bytes());
    }
}

/// Where a printer's text goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stream {
    /// Standard output.
    Out,
    /// Standard error.
    Err,
}

/// Prints while something runs that must not wait for it: neither a full disk, nor a reader that is gone, nor one that
/// does not read (a stopped terminal, a pager) holds up the caller. PrintJob that cannot be printed is dropped.
#[derive(Clone, Debug)]
pub struct Printer {
    texts: SyncSender<PrintJob>,
}

#[derive(Debug)]
enum PrintJob {
    Print(Stream, String),
    /// Everything before is printed.
    Done(SyncSender<()>),
}

impl Printer {
    /// Starts the thread. Without one nothing is printed.
    #[must_use]
    pub fn start() -> Printer {
        let (texts, waiting) = sync_channel(LINES_WAITING_MAX);
        let run = move || print_all(&waiting, &mut write);
        // A system that gives no thread gives none to a cell either, and that is told by what fails next.
        let _ = thread::Builder::new().name("output".into()).spawn(run);
        Printer { texts }
    }

    /// Prints a line on stdout.
    pub fn print_line(&self, text: &str) {
        let line = format!("{}\n", Printable(text.trim_end_matches('\n')));
        self.send(Stream::Out, line);
    }

    /// Prints a line on stderr.
    pub fn print_note(&self, text: &str) {
        let line = format!("{}\n", Printable(text.trim_end_matches('\n')));
        self.send(Stream::Err, line);
    }

    /// Prints a line on stdout over the one that begins there, and ends it or not.
    pub fn overwrite(&self, line: &str, end: bool) {
        let end = if end { "\n" } else { "" };
        self.send(Stream::Out, format!("\r{}\x1b[K{end}", Printable(line)));
    }

    fn send(&self, stream: Stream, text: String) {
        // Full or without a reader: dropped.
        let _ = self.texts.try_send(PrintJob::Print(stream, text));
    }

    /// Waits until everything is printed, at most a second.
    pub fn finish(&self) {
        let (done, printed) = sync_channel(1);
        if self.texts.try_send(PrintJob::Done(done)).is_ok() {
            // Whoever does not read until now does not get the rest.
            let _: Result<(), RecvTimeoutError> = printed.recv_timeout(LAST_LINES);
        }
    }
}

fn write(stream: Stream, text: &str) -> io::Result<()> {
    match stream {
        Stream::Out => {
            let mut out = io::stdout().lock();
            out.write_all(text.as_bytes()).and_then(|()| out.flush())
        }
        Stream::Err => io::stderr().write_all(text.as_bytes()),
    }
}

/// Prints until the last printer is gone; the first failure of stdout is told on stderr.
fn print_all(texts: &Receiver<PrintJob>, write: &mut dyn FnMut(Stream, &str) -> io::Result<()>) {
    let mut told = false;
    for text in texts {
        match text {
            PrintJob::Print(stream, text) => {
                if let Err(error) = write(stream, &text)
                    && stream == Stream::Out
                    && !told
                {
                    told = true;
                    let words = format!("cannot write to standard output: {error}: going on without it\n");
                    // Neither of the two takes anything: there is nobody to tell.
                    let _ = write(Stream::Err, &words);
                }
            }
            // Whoever waited may have given up.
            PrintJob::Done(done) => {
                let _ = done.try_send(());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn output_that_fails_is_told_once_and_the_rest_is_still_tried() {
        let (texts, waiting) = sync_channel(8);
        let printer = Printer { texts };
        ["a", "b", "c"].iter().for_each(|line| printer.print_line(line));
        printer.print_note("d");
        drop(printer);
        let (mut tried, mut errors) = (Vec::new(), String::new());
        print_all(&waiting, &mut |stream, text| match stream {
            Stream::Out => {
                tried.push(text.to_owned());
                Err(io::Error::from(ErrorKind::StorageFull))
            }
            Stream::Err => {
                errors.push_str(text);
                Ok(())
            }
        });
        assert_eq!(tried, ["a\n", "b\n", "c\n"]);
        assert_eq!(errors.matches("going on without it").count(), 1, "{errors}");
        assert!(errors.ends_with("d\n"), "{errors}");
    }

    #[test]
    fn a_printer_that_nobody_reads_from_holds_up_nobody() {
        let (texts, waiting) = sync_channel(2);
        let printer = Printer { texts };
        (0..100).for_each(|number| printer.print_line(&number.to_string()));
        // Not even at the end: there is no room for the question.
        printer.finish();
        assert_eq!(waiting.try_iter().count(), 2);
    }
}
