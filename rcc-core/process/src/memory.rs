//! Which process the kernel ends when memory runs out: never the executor or a driver before a loader, monitor or command
//! line. Written once at a program's start, by its main thread, or by its supervisor.

use std::fs;
use std::io;

/// How gladly the kernel ends the executor and the drivers (-1000 to 1000, see proc(5)).
pub const RUNS_THE_ROBOT: i32 = -900;
/// The loader: it is started again and finds everything as it was.
pub const STARTED_AGAIN: i32 = 300;
/// Programs that only look, and simulators.
pub const ONLY_LOOKS: i32 = 500;

/// Lets the kernel end this process rather than those with a lower score. What a supervisor has set higher stays.
///
/// # Errors
/// There is no /proc.
pub fn end_me_first(score: i32) -> io::Result<()> {
    let now = fs::read_to_string("/proc/self/oom_score_adj")?;
    match now.trim().parse::<i32>() {
        Ok(now) if now < score => set(std::process::id(), score),
        _ => Ok(()),
    }
}

/// Sets the score of a process of the same user. Without the right CAP_SYS_RESOURCE it can only be raised.
///
/// # Errors
/// The process is gone, or the right is missing.
pub fn set(pid: u32, score: i32) -> io::Result<()> {
    fs::write(format!("/proc/{pid}/oom_score_adj"), score.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_only_looks_goes_before_others_and_stays_there() -> io::Result<()> {
        let now = || fs::read_to_string("/proc/self/oom_score_adj").map(|text| text.trim().parse());
        end_me_first(ONLY_LOOKS)?;
        assert_eq!(now()?, Ok(ONLY_LOOKS));
        end_me_first(STARTED_AGAIN)?;
        assert_eq!(now()?, Ok(ONLY_LOOKS), "it is not lowered again");
        const { assert!(RUNS_THE_ROBOT < STARTED_AGAIN && STARTED_AGAIN < ONLY_LOOKS) };
        Ok(())
    }
}
