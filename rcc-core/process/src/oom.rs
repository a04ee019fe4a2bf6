//! OOM scores: which process the kernel kills when memory runs out. The executor and the drivers go last, after the
//! loader, monitors and the command line. Written once at a program's start, by its main thread, or by its supervisor.

use std::fs;
use std::io;

/// OOM score of the executor and the drivers (-1000 to 1000, see proc(5)).
pub const SCORE_ROBOT: i32 = -900;
/// OOM score of the loader, which is restarted without loss.
pub const SCORE_RESTARTABLE: i32 = 300;
/// OOM score of programs that only observe, and of simulators.
pub const SCORE_OBSERVER: i32 = 500;

/// Raises the OOM score of this process to `score`. A higher score set by a supervisor stays.
///
/// # Errors
/// Returns an error if /proc is missing.
pub fn raise_score(score: i32) -> io::Result<()> {
    let now = fs::read_to_string("/proc/self/oom_score_adj")?;
    match now.trim().parse::<i32>() {
        Ok(now) if now < score => set(std::process::id(), score),
        _ => Ok(()),
    }
}

/// Sets the OOM score of a process of the same user. Lowering it needs CAP_SYS_RESOURCE.
///
/// # Errors
/// Returns an error if the process is gone or the capability is missing.
pub fn set(pid: u32, score: i32) -> io::Result<()> {
    fs::write(format!("/proc/{pid}/oom_score_adj"), score.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_observer_is_killed_before_others_and_stays_so() -> io::Result<()> {
        let now = || fs::read_to_string("/proc/self/oom_score_adj").map(|text| text.trim().parse());
        raise_score(SCORE_OBSERVER)?;
        assert_eq!(now()?, Ok(SCORE_OBSERVER));
        raise_score(SCORE_RESTARTABLE)?;
        assert_eq!(now()?, Ok(SCORE_OBSERVER), "the score is not lowered again");
        const { assert!(SCORE_ROBOT < SCORE_RESTARTABLE && SCORE_RESTARTABLE < SCORE_OBSERVER) };
        Ok(())
    }
}
