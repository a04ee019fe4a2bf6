//! Output of the command line. A verb whose result is its output ends the program when that output cannot be written;
//! code that supervises something running prints through a [`BackgroundPrinter`], which never ends the program and
//! never blocks. Control characters in texts of nets, devices and other programs are made harmless before they reach a
//! terminal. Used by the main thread; a printer has a thread of its own.

use std::io::{self, ErrorKind, IsTerminal, Write};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;
use std::{process, thread};

use rcc_api::codes::{self, exit};
use rcc_core::printable::{Coloured, Printable};

use rcc_terminal::text::{TerminalSize, fitted, wrapped};

/// Lines that may wait to be printed; further ones are dropped.
const QUEUE_MAX: usize = 1024;
/// Longest time to wait for the last lines at the end.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(1);

/// Prints a line on stdout, as the result of a verb. A closed pipe ends the program silently, as it ends other filters;
/// any other failure ends it with an error, because the result is lost.
///
/// On a terminal, lines that are too long are wrapped between words.
pub fn print_line(text: &str) {
    let size = TerminalSize::of_stdout();
    write_or_exit(&format!("{}\n", for_terminal(text, size)));
}

/// Prints a line for programs (JSON, completions) like [`print_line`], but never wraps it.
pub fn print_record(text: &str) {
    write_or_exit(&format!("{}\n", for_terminal(text, None)));
}

/// Makes a text printable, and wraps it if it is for a terminal.
fn for_terminal(text: &str, size: Option<TerminalSize>) -> String {
    let text = Printable(text.trim_end_matches('\n')).to_string();
    match size {
        Some(size) => wrapped(&text, size.columns),
        None => text,
    }
}

/// Prints the text of a file like [`print_record`], but byte for byte unless stdout is a terminal.
pub fn print_file(text: &str) {
    if io::stdout().is_terminal() {
        print_record(text);
    } else {
        write_or_exit(&format!("{}\n", text.trim_end_matches('\n')));
    }
}

/// Prints a table with `heads` rows of headings. On a terminal it overwrites the previous one of `before` rows (0: none)
/// and is cut to the screen, so that its headings stay in view. Returns the rows that the next one must overwrite.
pub fn reprint(before: usize, table: &str, heads: usize) -> usize {
    let Some(size) = TerminalSize::of_stdout() else {
        print_record(table);
        return 0;
    };
    let shown = fitted(&Printable(table).to_string(), heads, size);
    let back = match before.min(size.rows.saturating_sub(1)) {
        0 => String::new(),
        // Moves the cursor to the table's first row and erases to the end of the screen.
        before => format!("\x1b[{before}A\x1b[J"),
    };
    write_or_exit(&format!("{back}{shown}\n"));
    shown.lines().count()
}

fn write_or_exit(text: &str) {
    let mut out = io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    if let Err(error) = written {
        process::exit(i32::from(exit_code_of(&error)));
    }
}

/// Returns the exit code of a program whose output cannot be written; prints the error on stderr unless the pipe is
/// closed.
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

/// Prints a note on stderr. A failure to do so is ignored.
pub fn print_note(text: &str) {
    write_stderr(&for_terminal(text, TerminalSize::of_stderr()));
}

/// Prints rendered diagnostics on stderr like [`print_note`], and keeps their colours.
pub fn print_diagnostics(drawing: &str) {
    write_stderr(&Coloured(drawing.trim_end_matches('\n')).to_string());
}

fn write_stderr(text: &str) {
    if !text.is_empty() {
        // A single write, so that lines of several programs do not interleave.
        let _ = io::stderr().write_all(format!("{text}\n").as_bytes());
    }
}

/// Destination of a printer's text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stream {
    /// Standard output.
    Out,
    /// Standard error.
    Err,
}

/// Prints without ever blocking the caller: neither a full disk, nor a closed pipe, nor a reader that does not read (a
/// stopped terminal, a pager) delays it. Text that cannot be printed is dropped.
#[derive(Clone, Debug)]
pub struct BackgroundPrinter {
    texts: SyncSender<PrintJob>,
}

#[derive(Debug)]
enum PrintJob {
    Print(Stream, String),
    /// Everything sent before has been printed.
    Done(SyncSender<()>),
}

impl BackgroundPrinter {
    /// Starts the printing thread. If that fails, nothing is printed.
    #[must_use]
    pub fn start() -> BackgroundPrinter {
        let (texts, waiting) = sync_channel(QUEUE_MAX);
        let run = move || print_all(&waiting, &mut write);
        // A system that cannot start this thread cannot start a cell either; the next step reports that.
        let _ = thread::Builder::new().name("output".into()).spawn(run);
        BackgroundPrinter { texts }
    }

    /// Prints a line on stdout.
    pub fn print_line(&self, text: &str) {
        let text = for_terminal(text, TerminalSize::of_stdout());
        self.send(Stream::Out, format!("{text}\n"));
    }

    /// Prints a line for programs on stdout; never wraps it.
    pub fn print_record(&self, text: &str) {
        self.send(Stream::Out, format!("{}\n", for_terminal(text, None)));
    }

    /// Prints a line on stderr.
    pub fn print_note(&self, text: &str) {
        let text = for_terminal(text, TerminalSize::of_stderr());
        self.send(Stream::Err, format!("{text}\n"));
    }

    /// Overwrites the current line on stdout; `end` appends a line break.
    pub fn overwrite(&self, line: &str, end: bool) {
        let end = if end { "\n" } else { "" };
        self.send(Stream::Out, format!("\r{}\x1b[K{end}", Printable(line)));
    }

    fn send(&self, stream: Stream, text: String) {
        // Dropped if the queue is full or the printer's thread has ended.
        let _ = self.texts.try_send(PrintJob::Print(stream, text));
    }

    /// Waits until everything is printed, at most one second.
    pub fn finish(&self) {
        let (done, printed) = sync_channel(1);
        if self.texts.try_send(PrintJob::Done(done)).is_ok() {
            // Text that is not taken within this time is lost.
            let _: Result<(), RecvTimeoutError> = printed.recv_timeout(FLUSH_TIMEOUT);
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

/// Prints until the last printer is dropped; reports the first failure of stdout on stderr.
fn print_all(texts: &Receiver<PrintJob>, write: &mut dyn FnMut(Stream, &str) -> io::Result<()>) {
    let mut reported = false;
    for text in texts {
        match text {
            PrintJob::Print(stream, text) => {
                if let Err(error) = write(stream, &text)
                    && stream == Stream::Out
                    && !reported
                {
                    reported = true;
                    let note =
                        format!("cannot write to standard output: {error}: going on without it\n");
                    // If stderr fails as well, the error cannot be reported anywhere.
                    let _ = write(Stream::Err, &note);
                }
            }
            // The waiting thread may have given up.
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
    fn a_failing_output_is_reported_once_and_the_rest_is_still_tried() {
        let (texts, waiting) = sync_channel(8);
        let printer = BackgroundPrinter { texts };
        ["a", "b", "c"]
            .iter()
            .for_each(|line| printer.print_line(line));
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
    fn a_printer_that_nobody_reads_from_blocks_nobody() {
        let (texts, waiting) = sync_channel(2);
        let printer = BackgroundPrinter { texts };
        (0..100).for_each(|number| printer.print_line(&number.to_string()));
        // Returns at once even here: the queue is full, so the request to finish is dropped.
        printer.finish();
        assert_eq!(waiting.try_iter().count(), 2);
    }
}
