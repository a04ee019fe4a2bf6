//! Which process the kernel ends when memory runs out: never the executor or a driver before a loader, monitor or command
//! line. Written once at a program's start, by its main thread, or by its supervisor.

use std::fs;
use std::io;

/// How gladly the kernel ends the executor and the drivers (-1000 to 1000, see proc(5)).
pub const SCORE_ROBOT: i32 = -900;
/// The loader: it is started again and finds everything as it was.
pub const SCORE_RESTARTABLE: i32 = 300;
/// Programs that only look, and simulators.
pub const SCORE_OBSERVER: i32 = 500;

/// Lets the kernel end this process rather than those with a lower score. What a supervisor has set higher stays.
///
/// # Errors
/// There is no /proc.
pub fn raise_score(score: i32) -> io::Result<()> {
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
        raise_score(SCORE_OBSERVER)?;
        assert_eq!(now()?, Ok(SCORE_OBSERVER));
        raise_score(SCORE_RESTARTABLE)?;
        assert_eq!(now()?, Ok(SCORE_OBSERVER), "it is not lowered again");
        const { assert!(SCORE_ROBOT < SCORE_RESTARTABLE && SCORE_RESTARTABLE < SCORE_OBSERVER) };
        Ok(())
    }
}
