//! logind's RemoveIPC: shared memory of a person is deleted when his last session ends, under a running cell too.
//! Pure.

use crate::doctor::Finding;
use crate::doctor::facts::Facts;

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let name = &facts.user.name;
    match facts.remove_ipc {
        None => Vec::new(),
        Some(false) => vec![Finding::ok("logind keeps shared memory (RemoveIPC=no)")],
        Some(true) if facts.user.is_system => vec![Finding::ok(format!(
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
                Finding::warn(what, fix)
                    .cause("a cell that goes on after you log out loses its boards"),
            ]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::Level;

    #[test]
    fn only_persons_are_warned() {
        let mut facts = Facts::default();
        assert_eq!(check(&facts), []);
        facts.remove_ipc = Some(true);
        assert_eq!(check(&facts)[0].level, Level::Warn);
        facts.user.is_system = true;
        assert_eq!(check(&facts)[0].level, Level::Ok);
        facts.remove_ipc = Some(false);
        assert_eq!(check(&facts)[0].level, Level::Ok);
    }
}
