//! The configured core: is it there, and may we use it?
//! Pure.

use super::cores;
use crate::doctor::Finding;
use crate::doctor::facts::Facts;

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let cpu = &facts.cpu;
    let Some(core) = facts.wish.core else {
        return vec![Finding::note("no core is configured: the system moves the cycle about as it likes").fix(
            "executor: {core: N} in the cell's file, N a core that is kept free (see `isolation`)",
        )];
    };
    if !cpu.online.is_empty() && !cpu.online.contains(&core) {
        let what = format!("core {core} is not there; there are {}", cores(&cpu.online));
        return vec![Finding::fail(what, "name one of them in executor.core")];
    }
    if !cpu.allowed.is_empty() && !cpu.allowed.contains(&core) {
        return vec![Finding::note(format!(
            "core {core} is not among those of this process ({}); binding to it works unless a cpuset forbids it",
            cores(&cpu.allowed)
        ))];
    }
    vec![Finding::ok(format!("core {core} is there"))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::Level;

    #[test]
    fn a_core_that_is_not_there_prevents_and_none_is_a_note() {
        let mut facts = Facts::default();
        facts.cpu.online = vec![0, 1];
        facts.cpu.allowed = vec![0];
        for (core, level) in [
            (None, Level::Note),
            (Some(0), Level::Ok),
            (Some(1), Level::Note),
            (Some(3), Level::Fail),
        ] {
            facts.wish.core = core;
            assert_eq!(check(&facts)[0].level, level, "{core:?}");
        }
    }
}
