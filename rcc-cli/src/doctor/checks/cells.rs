//! Running cells and their health. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;
use crate::doctor::facts::cells::CellFacts;
use crate::table::{grouped, time};

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    let alive = facts
        .cells
        .iter()
        .filter(|cell| !cell.living.is_empty() || cell.refused.is_some());
    alive.flat_map(cell_findings).collect()
}

fn cell_findings(cell: &CellFacts) -> Vec<HealthFinding> {
    let name = &cell.name;
    if let Some(words) = &cell.refused {
        let fix = format!("ask its owner, or inspect {}", cell.folder.display());
        return vec![HealthFinding::warn(
            format!("cannot inspect cell {name}: {words}"),
            fix,
        )];
    }
    let mut found = Vec::new();
    if !cell.dead.is_empty() {
        let what = format!(
            "cell {name}: dead processes that were not restarted: {}",
            cell.dead.join(", ")
        );
        found.push(HealthFinding::warn(
            what,
            "see `rcc-cli events` and the cell's supervisor (`rcc-cli up`, or systemctl status 'rcc*')",
        ));
    }
    match &cell.executor {
        None => {
            let what = format!(
                "cell {name} runs ({} processes) but its loader or executor does not answer",
                cell.living.len()
            );
            found.push(HealthFinding::warn(
                what,
                format!("run `rcc-cli --cell {name} status` and start what is missing"),
            ));
        }
        Some(executor) if executor.late > 0 => {
            let what = format!(
                "cell {name} runs: cycle {}, {} late (last {}), worst wake-up latency {}",
                grouped(executor.cycle),
                grouped(executor.late),
                grouped(executor.last_late.as_ref().map_or(0, |late| late.cycle)),
                time(executor.worst_wake_ns)
            );
            found.push(HealthFinding::note(what).cause(executor.grade.clone()));
        }
        Some(executor) => {
            let what = format!(
                "cell {name} runs: cycle {}, no late cycles",
                grouped(executor.cycle)
            );
            found.push(HealthFinding::ok(what).cause(executor.grade.clone()));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use rcc_api::bodies::ExecutorView;

    #[test]
    fn a_running_cell_is_reported_with_its_health() {
        let cell = CellFacts {
            name: "demo".to_owned(),
            living: vec!["executor/exec (pid 7)".to_owned()],
            executor: Some(ExecutorView {
                cycle: 81_422,
                ..ExecutorView::default()
            }),
            ..CellFacts::default()
        };
        let mut facts = MachineFacts {
            cells: vec![cell],
            ..MachineFacts::default()
        };
        assert!(
            check(&facts)[0]
                .what
                .contains("cycle 81 422, no late cycles")
        );
        facts.cells[0].executor = None;
        assert_eq!(check(&facts)[0].level, FindingLevel::Warn);
        facts.cells[0].dead = vec!["driver/lwr (pid 8)".to_owned()];
        assert!(check(&facts)[0].what.contains("driver/lwr"));
    }

    #[test]
    fn a_dead_cell_is_left_to_the_leftovers_check() {
        let cell = CellFacts {
            name: "demo".to_owned(),
            files: 3,
            ..CellFacts::default()
        };
        let facts = MachineFacts {
            cells: vec![cell],
            ..MachineFacts::default()
        };
        assert_eq!(check(&facts), []);
    }
}
