//! Explanation as text: small nets in full, large nets as totals, further tables on request. Pure.

use super::TableSelection;
use super::report::{CellCapacity, Explanation, NetMemory, StepOutput};
use crate::table::{self, counted, grouped, span, time};

/// Nets up to this size are shown in full.
const SMALL: usize = 40;
/// Consequences shown for a large net.
const CONSEQUENCES_MAX: usize = 12;
/// Ids shown at each end of a long path.
const ENDS: usize = 8;

/// Formats an explanation for people.
pub fn human(it: &Explanation, shown: TableSelection) -> String {
    let is_small = it.order.len() <= SMALL && !(shown.order || shown.nulls || shown.path);
    let mut parts = vec![head(it), types(it), regions(it)];
    if is_small || shown.order || shown.all {
        parts.push(order(it));
    }
    if is_small || shown.path || shown.all {
        parts.push(path(it));
    }
    parts.push(motions(it));
    parts.push(nulls(it, shown, is_small));
    if let Some(room) = &it.cell {
        parts.push(capacity(room));
    }
    if !is_small && !shown.all {
        parts.push(
            "`--order`, `--path` and `--nulls` show more, `--all` shows everything".to_owned(),
        );
    }
    parts.retain(|part| !part.is_empty());
    parts.join("\n\n")
}

/// Lists the conditional regions and their conditions.
fn regions(it: &Explanation) -> String {
    let lines = it.regions.iter().map(|region| {
        format!(
            "`{}` is evaluated only while `{}` is true: {}, {} when active",
            region.id,
            region.condition,
            counted(region.primitives, "primitive"),
            time(region.ns.round() as u64)
        )
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Lists the sections of the motions from rest to rest, and what planning them took.
fn motions(it: &Explanation) -> String {
    let Some(motions) = &it.motions else {
        return String::new();
    };
    let mut rows = table::table(&["MOTION", "LEGS", "TAKES", "TIME LAW"]);
    for section in &motions.sections {
        let [first, last] = section.legs;
        rows.add_row([
            section.motion.clone(),
            match first == last {
                true => first.to_string(),
                false => format!("{first} to {last}"),
            },
            format!("{:.3} s", section.duration_s),
            section.time_scaling.to_owned(),
        ]);
    }
    let (rows, planning) = (table::text(&rows), time(motions.planning_ns));
    format!("{rows}\nplanned in {planning}")
}

fn percent(ns: f64, of: u64) -> String {
    format!("{:.1} %", ns * 100.0 / (of.max(1) as f64))
}

fn head(it: &Explanation) -> String {
    let every = match it.every {
        0 | 1 => "every cycle".to_owned(),
        every => format!("every {every} cycles"),
    };
    format!(
        "{}: {} ({} evaluated), expected to take {} {every}, {} of the period of {}\ncosts {}\n{}",
        it.net,
        counted(u64::from(it.primitives), "primitive"),
        grouped(it.evaluated),
        time(it.expected_ns),
        percent(it.expected_ns as f64, it.period_ns),
        time(it.period_ns),
        it.costs,
        memory(&it.memory, it.runs)
    )
}

fn memory(it: &NetMemory, runs: usize) -> String {
    let count = |count: usize| grouped(count as u64);
    let shared = match it.constant_inputs {
        0 => String::new(),
        inputs => format!(
            "\n{} in {}",
            counted(inputs as u64, "constant input"),
            counted(it.constants as u64, "slot")
        ),
    };
    format!(
        "{} of equal kernels, {}; arena {} bytes ({} Real, {} Bool, {} Int): outputs {}, delayed links {}, constants and states {}{shared}",
        counted(runs as u64, "run"),
        counted(it.operands as u64, "operand"),
        count(it.arena_bytes),
        count(it.reals),
        count(it.bools),
        count(it.ints),
        count(it.output_bytes),
        count(it.delayed_bytes),
        count(it.other_bytes),
    )
}

fn types(it: &Explanation) -> String {
    let mut rows = table::table(&["TYPE", "COUNT", "EACH", "TOGETHER", "SHARE"]);
    for row in &it.types {
        rows.add_row([
            row.ty.to_owned(),
            grouped(row.count),
            format!("{:.1} ns", row.all_ns / (row.count.max(1) as f64)),
            format!("{:.1} ns", row.all_ns),
            percent(row.all_ns, it.expected_ns),
        ]);
    }
    table::text(&rows)
}

fn order(it: &Explanation) -> String {
    let mut rows = table::table(&[
        "ORDER",
        "RUN",
        "PRIMITIVE",
        "TYPE",
        "TIME",
        "OUTPUTS",
        "CAN BE NULL",
    ]);
    for step in &it.order {
        let kernel = step
            .kernel
            .as_ref()
            .map_or_else(String::new, |store| format!(" ({store})"));
        let outputs: Vec<String> = step.outputs.iter().map(output).collect();
        rows.add_row([
            step.order.to_string(),
            step.run.to_string(),
            step.id.clone(),
            format!("{}{kernel}", step.ty),
            format!("{:.1} ns", step.ns),
            if outputs.is_empty() {
                "–".to_owned()
            } else {
                outputs.join(", ")
            },
            match (&step.null, step.outputs.is_empty()) {
                (_, true) => "–".to_owned(),
                (None, false) => "never".to_owned(),
                (Some(why), false) => why.clone(),
            },
        ]);
    }
    table::text(&rows)
}

fn output(it: &StepOutput) -> String {
    match &it.unit {
        Some(unit) => format!("{} {} {unit}", it.name, it.ty),
        None => format!("{} {}", it.name, it.ty),
    }
}

fn path(it: &Explanation) -> String {
    let ids: Vec<&str> = it.path.ids.iter().map(String::as_str).collect();
    let shown = match ids.len().checked_sub(2 * ENDS) {
        Some(more @ 1..) => {
            let (first, last) = (&ids[..ENDS], &ids[ids.len() - ENDS..]);
            format!(
                "{} → … {more} more … → {}",
                first.join(" → "),
                last.join(" → ")
            )
        }
        _ => ids.join(" → "),
    };
    match ids.len() {
        0 => String::new(),
        count => format!(
            "critical path: {}, {:.1} ns: {shown}",
            counted(count as u64, "primitive"),
            it.path.ns
        ),
    }
}

fn nulls(it: &Explanation, shown: TableSelection, is_small: bool) -> String {
    let mut lines = Vec::new();
    let count = it.nulls.len();
    if shown.nulls || shown.all {
        let mut rows = table::table(&["CAN BE NULL", "OUTPUTS", "WHY"]);
        for null in &it.nulls {
            rows.add_row([null.id.clone(), null.outputs.join(", "), null.why.clone()]);
        }
        lines.push(table::text(&rows));
    } else if !is_small && count > 0 {
        lines.push(format!(
            "{} can return null",
            counted(count as u64, "primitive")
        ));
    }
    let most = if is_small || shown.nulls || shown.all {
        usize::MAX
    } else {
        CONSEQUENCES_MAX
    };
    for it in it.consequences.iter().take(most) {
        lines.push(format!("null at `{}` ({}): {}", it.input, it.why, it.then));
    }
    if let Some(more @ 1..) = it.consequences.len().checked_sub(most) {
        lines.push(format!("… and {} more", grouped(more as u64)));
    }
    if count == 0 {
        lines.push("no value can be null, except by overflow".to_owned());
    }
    lines.join("\n")
}

fn capacity(room: &CellCapacity) -> String {
    let dearest = room.dearest.as_ref().map_or_else(
        || "no net runs".to_owned(),
        |net| {
            format!(
                "the most expensive one is {net} ({})",
                time(room.dearest_ns)
            )
        },
    );
    format!(
        "cell {}: nets may use {} per cycle, {} in use, {} left; {dearest}",
        room.cell,
        span(room.budget_ns),
        span(room.committed_ns),
        span(room.left_ns)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verbs::explain::report::{
        Consequence, CriticalPath, EvaluationStep, MotionSection, NullSource, PlannedMotions,
        TypeShare,
    };

    fn explanation(steps: usize) -> Explanation {
        let step = |order: usize| EvaluationStep {
            order,
            run: 0,
            id: format!("p{order}"),
            ty: "Add",
            kernel: Some("Real".into()),
            ns: 1.5,
            outputs: vec![StepOutput {
                name: "out".into(),
                ty: "Real".into(),
                unit: Some("m".into()),
                slot: 0,
            }],
            null: (order == 1).then(|| "`lwr` is lost: ft".into()),
        };
        Explanation {
            net: "line".into(),
            primitives: steps as u32,
            evaluated: steps as u64 + 2,
            expected_ns: 2_000,
            period_ns: 1_000_000,
            every: 1,
            costs: "measured now".into(),
            types: vec![TypeShare {
                ty: "LinearMotion",
                count: 2,
                all_ns: 1_500.0,
            }],
            runs: 1,
            regions: Vec::new(),
            memory: NetMemory::default(),
            order: (0..steps).map(step).collect(),
            path: CriticalPath {
                ns: 3.0,
                ids: (0..steps).map(|step| format!("p{step}")).collect(),
            },
            nulls: vec![NullSource {
                id: "p1".into(),
                outputs: vec!["out".into()],
                why: "`lwr` is lost: ft".into(),
            }],
            consequences: vec![Consequence {
                input: "robot.position".into(),
                why: "`lwr` is lost: ft → p1".into(),
                then: "no command".into(),
            }],
            motions: Some(PlannedMotions {
                sections: vec![MotionSection {
                    motion: "move".into(),
                    legs: [1, 3],
                    time_scaling: "time-optimal",
                    duration_s: 1.25,
                }],
                planning_ns: 21_000_000,
            }),
            cell: Some(CellCapacity {
                cell: "demo".into(),
                budget_ns: 500_000,
                committed_ns: 100_000,
                left_ns: 400_000,
                dearest: Some("other#1".into()),
                dearest_ns: 100_000,
            }),
        }
    }

    #[test]
    fn conditional_regions_are_listed_with_their_condition() {
        let mut explanation = explanation(3);
        explanation
            .regions
            .push(super::super::report::ConditionalRegion {
                id: "a".into(),
                condition: "button.out".into(),
                primitives: 500,
                ns: 1500.0,
            });
        let text = human(&explanation, TableSelection::default());
        let line =
            "`a` is evaluated only while `button.out` is true: 500 primitives, 1.5 µs when active";
        assert!(text.contains(line), "{text}");
    }

    #[test]
    fn a_small_net_is_shown_in_full() {
        let text = human(&explanation(3), TableSelection::default());
        for part in [
            "line: 3 primitives (5 evaluated), expected to take 2.0 µs every cycle, 0.2 % of the period of 1.0 ms",
            "LinearMotion  2      750.0 ns  1500.0 ns  75.0 %",
            "1      0    p1         Add (Real)  1.5 ns  out Real m  `lwr` is lost: ft",
            "critical path: 3 primitives, 3.0 ns: p0 → p1 → p2",
            "null at `robot.position` (`lwr` is lost: ft → p1): no command",
            "\nmove    1 to 3  1.250 s  time-optimal\nplanned in 21.0 ms",
            "400.0 µs left; the most expensive one is other#1 (100.0 µs)",
        ] {
            assert!(text.contains(part), "{part}\n{text}");
        }
    }

    #[test]
    fn a_large_net_is_shown_as_totals_and_tables_on_request() {
        let large = explanation(1_000);
        let text = human(&large, TableSelection::default());
        assert!(text.lines().count() < 20, "{text}");
        assert!(
            text.contains("1 primitive can return null") && text.contains("`--order`"),
            "{text}"
        );
        let order = TableSelection {
            order: true,
            ..TableSelection::default()
        };
        assert!(human(&large, order).lines().count() > 1_000);
        let path = TableSelection {
            path: true,
            ..TableSelection::default()
        };
        assert!(
            human(&large, path).contains("p7 → … 984 more … → p992"),
            "{}",
            human(&large, path)
        );
    }
}
