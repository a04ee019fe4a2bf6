//! RLIMIT_RTTIME: the kernel kills a process whose real-time thread computes longer than this without sleeping. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// One second; a healthy cell needs less, even when loading a plan under a debugger.
const SUFFICIENT_US: u64 = 1_000_000;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    match facts.limits.rttime.soft {
        None => Vec::new(),
        Some(limit) if limit >= SUFFICIENT_US => vec![HealthFinding::note(format!(
            "the rttime limit is {limit} µs: enough for the cycle"
        ))],
        Some(limit) => {
            let fix = match facts.user.service() {
                Some(service) => format!("LimitRTTIME=infinity in {service}"),
                None => "ulimit -S -R unlimited, or raise `rttime` where it is set (desktop sessions: rtkit)".to_owned(),
            };
            let what = format!("the rttime limit is {limit} µs");
            vec![
                HealthFinding::warn(what, fix)
                    .cause("the kernel kills the executor when one cycle takes longer"),
            ]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;

    #[test]
    fn unlimited_says_nothing_and_a_short_time_warns() {
        let mut facts = MachineFacts::default();
        assert_eq!(check(&facts), []);
        facts.limits.rttime.soft = Some(200_000);
        assert_eq!(check(&facts)[0].level, FindingLevel::Warn);
        facts.limits.rttime.soft = Some(2_000_000);
        assert_eq!(check(&facts)[0].level, FindingLevel::Note);
    }
}
