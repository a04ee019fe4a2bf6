//! Writes the outcomes of the matrix as markdown tables with their legend.
//! Pure functions.

use super::{Case, DISTURBANCES, Disturbance, HELPERS, Outcome, PHASES, Phase, TARGETS, Victim};

/// Returns the document; `machine` is a sentence that names the date and the machine of the run.
pub fn table(outcomes: &[(Case, Outcome)], machine: &str) -> String {
    let held = outcomes
        .iter()
        .filter(|(_, outcome)| matches!(outcome, Outcome::Held { .. }));
    let mut text = format!(
        "{HEAD}\n{machine} {} of {} cases hold.\n",
        held.count(),
        outcomes.len()
    );
    let mut cells = TableCells {
        outcomes,
        broken: Vec::new(),
    };
    for (target, name) in TARGETS {
        text += &format!("\n| {name}, while the cell is |");
        text += &row(DISTURBANCES.map(|(_, disturbance)| disturbance.to_owned()));
        text += &line(1 + DISTURBANCES.len());
        let victim = Victim::One(target);
        for (phase, phase_name) in PHASES {
            text += &format!("| {phase_name} |");
            text += &row(DISTURBANCES.map(|(disturbance, _)| {
                cells.cell(Case {
                    victim,
                    phase,
                    disturbance,
                })
            }));
        }
    }
    text += "\n| killed at the same moment, while the arm moves |";
    text += &row(TARGETS[1..].iter().map(|(_, name)| (*name).to_owned()));
    text += &line(TARGETS.len());
    for (place, (first, name)) in TARGETS[..TARGETS.len() - 1].iter().enumerate() {
        text += &format!("| {name} |");
        text += &row(TARGETS[1..].iter().enumerate().map(|(other, (second, _))| {
            if other < place {
                return String::new();
            }
            let victim = Victim::Pair(*first, *second);
            cells.cell(Case {
                victim,
                phase: Phase::Moving,
                disturbance: Disturbance::Kill,
            })
        }));
    }
    text +=
        "\n| helper thread of the executor, while the arm moves | hangs for ever |\n|---|---|\n";
    for name in HELPERS {
        let victim = Victim::Helper(name);
        let disturbance = Disturbance::Freeze;
        text += &format!("| `{name}` |");
        text += &row([cells.cell(Case {
            victim,
            phase: Phase::Moving,
            disturbance,
        })]);
    }
    text + &cells.explain()
}

/// Formats the cells of the tables and collects the broken cases in the order of the tables.
struct TableCells<'a> {
    outcomes: &'a [(Case, Outcome)],
    broken: Vec<String>,
}

impl TableCells<'_> {
    fn cell(&mut self, case: Case) -> String {
        match self.outcomes.iter().find(|(other, _)| *other == case) {
            None => "not run".to_owned(),
            Some((_, Outcome::Held { words, late: 0 })) => words.clone(),
            Some((_, Outcome::Held { words, late })) => {
                format!("{words}, {late} late with the machine")
            }
            Some((_, Outcome::Broken(words))) => {
                self.broken.push(format!("{case:?}: {words}"));
                format!("**broken ({})**", self.broken.len())
            }
        }
    }

    fn explain(&self) -> String {
        let mut text = String::new();
        if !self.broken.is_empty() {
            text += "\n## Broken\n\n";
        }
        for (number, words) in self.broken.iter().enumerate() {
            let first = words.lines().next().unwrap_or_default();
            let first: String = first.chars().take(600).collect();
            text += &format!("{}. {first}\n", number + 1);
        }
        text
    }
}

fn row(cells: impl IntoIterator<Item = String>) -> String {
    let cells: String = cells.into_iter().map(|cell| format!(" {cell} |")).collect();
    cells + "\n"
}

fn line(columns: usize) -> String {
    format!("|{}\n", "---|".repeat(columns))
}

const HEAD: &str = "# What happens when a process dies

A program makes each process of a cell die or hang, in each phase and in four ways, kills every two processes at the same
moment, and makes each helper thread of the executor hang alone, in the demo cell with its simulated robot, which outlives the
process. The program writes the tables of this page:

```console
$ cargo run -p rcc-tests --example crash_matrix -- --write docs/crashes.md
```

The endurance program keeps a moving cell under load from all sides, in which drivers, the loader and monitors are killed
again and again; its table ([one hour](endurance.md)) explains each late cycle and counts everything that a leak would increase:

```console
$ cargo run -p rcc-tests --example endurance -- --minutes 60 --restarts 2000 --monitors 10000 --pairs 500 --executor-pairs 10
```

A test kills each driver and the loader with strace before every system call of their start, up to their first exchange or
answer; after each death the next process must start and exchange, the executor must not miss a cycle, and nothing may be left:

```console
$ RCC_EVERY_SYSCALL=1 cargo test -p rcc-tests --test suites syscalls
```

Programs of others are struck by tests of their own, while the arm moves; its motion must finish as planned, and no cycle may be
late but with the machine:

| a program of others | killed | stopped | lies | is slow |
|---|---|---|---|---|
| a driver, `driver: {program: …}` | its device is lost, alone; started again, its outputs stay released until a net commands them; the same if it panics or ends by itself | the same; it goes on after SIGCONT | of another layout: not attached, the message names both; no number, infinite, out of range: null; channels that it does not have: not seen; no hold position, a period or a time that no device can have: lost | lost; the same process goes on; one that hangs in an exchange or in an answer is ended and started again |
| a program that writes a driver's shared memory itself | as above | as above | another message, stamps of the future or the past, time that goes back, other joints, no hold position: lost until it tells the truth | lost after `stale_after` |
| a software device, `driver: software` | lost, started again | null after `timeout`; the same process goes on | no number, infinite, another type, of the future, out of range, wrong names: null; too many answers or a flood: the right ones count | null after `timeout` |

```console
$ cargo test --workspace --test suites -- outside foreign software
```

Every case must satisfy:

- **No unrequested motion.** From the moment the arm rests until the next START no joint is faster than
  4 mrad/s (the creep of the simulated arm to its set-point), as the simulated controller saw it every millisecond.
- **The arm stays within its limits** of velocity and acceleration until it rests.
- **The motion goes as planned** unless its driver, the executor or the whole cell was struck: it finishes, or it is
  canceled if a cancel was under way. Otherwise it comes to rest.
- **The executor misses nothing** unless it was struck itself: cycle numbers go on, it is the same process, no record is
  dropped. A late cycle is attributed to the machine only if a thread of higher priority on the same core, which does
  nothing but wake up, was late at that moment too.
- **Everything is available again**: processes that died under supervision are restarted, all devices are ready, and the next
  LOAD and START move the arm.
- **The right output or none.** While the configuration file and the running cell differ, a net that commands `torch`
  switches `torch` or is refused.
- **Nothing is left**: files in shared memory and in the runtime folder, processes, and the executor's descriptors,
  mappings, threads and memory are the same as before.

A cell of the table says how the motion ended: *finished*, *canceled*, *device lost* (the net's fault when its driver is
gone; the controller brakes), *at rest* (the driver brought the arm to rest, its net is gone with the executor), *ended*
(the whole cell ended in order and left nothing), *goes on*, – (no motion in this case). *Starting* means that the process
itself has just been started; it is struck within its first 40 ms (the supervisor: 300 ms). SIGSTOP lasts 300 ms: longer
than every deadline of a driver, shorter than the supervisor's watchdog (2 s). *Its file changed*: `torch` and `gas` have
been exchanged in the file since the cell was started; *refused* and *switched* are the result of a START for `torch`
afterwards. Then the file is restored, and a process that has read the changed one is killed once more.
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_has_its_place_and_a_broken_one_is_explained() {
        let held = |case| {
            let words = "finished".to_owned();
            (case, Outcome::Held { words, late: 2 })
        };
        let mut outcomes: Vec<_> = super::super::cases().into_iter().map(held).collect();
        outcomes[7].1 = Outcome::Broken("the arm moved".to_owned());
        let text = table(&outcomes, "Today.");
        assert!(text.contains("Today. 257 of 258 cases hold."), "{text}");
        assert_eq!(
            text.matches("finished, 2 late with the machine").count(),
            257
        );
        assert!(text.contains("**broken (1)**") && text.contains("the arm moved"));
        assert!(!text.contains("not run"));
    }
}
