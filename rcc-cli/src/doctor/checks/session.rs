//! logind's RemoveIPC: deletes a person's shared memory when the last session ends, even under a running cell. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    let name = &facts.user.name;
    match facts.remove_ipc {
        None => Vec::new(),
        Some(false) => vec![HealthFinding::ok(
            "logind keeps shared memory (RemoveIPC=no)",
        )],
        Some(true) if facts.user.is_system => vec![HealthFinding::ok(format!(
            "logind keeps shared memory of system users, and {name} is one"
        ))],
        Some(true) => {
            let what = format!(
                "logind deletes the shared memory of {name} when the last session ends (RemoveIPC=yes)"
            );
            let fix = format!(
                "run cells as services of a system user (rcc-cli install-units); or: loginctl enable-linger {name}; or \
                 RemoveIPC=no in /etc/systemd/logind.conf.d/rcc.conf and systemctl restart systemd-logind"
            );
            vec![
                HealthFinding::warn(what, fix)
                    .cause("a cell that keeps running after you log out loses its shared memory"),
            ]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;

    #[test]
    fn only_persons_are_warned() {
        let mut facts = MachineFacts::default();
        assert_eq!(check(&facts), []);
        facts.remove_ipc = Some(true);
        assert_eq!(check(&facts)[0].level, FindingLevel::Warn);
        facts.user.is_system = true;
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
        facts.remove_ipc = Some(false);
        assert_eq!(check(&facts)[0].level, FindingLevel::Ok);
    }
}
