//! The screen of a fleet: a line for each cell, first those that need a person. Pure apart from drawing into the frame.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::Line;
use ratatui::widgets::Paragraph;
use rcc_core::counted::Counted;
use rcc_terminal::columns::{Cells, Column, GAP, fit};
use rcc_terminal::text::cut;

use crate::overview::CellOverview;

/// Time without an overview after which a cell counts as silent; one is sent each second.
const SILENT: Duration = Duration::from_secs(5);
/// Narrowest column of events.
const EVENT_MIN: usize = 12;
/// Keys in the last row.
const KEYS: &str = "q quit";

/// News about a cell, `SITE/CELL`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FleetNews {
    /// An incarnation of its executor is alive.
    Alive(String, String),
    /// An incarnation of its executor is gone, or the connection to it.
    Gone(String, String),
    /// Its overview.
    Overview(String, Box<CellOverview>),
}

/// All cells that were seen since the start.
#[derive(Debug, Default)]
pub struct FleetState {
    cells: BTreeMap<String, CellState>,
}

#[derive(Debug, Default)]
struct CellState {
    /// Incarnations of the executor that are alive.
    alive: BTreeSet<String>,
    overview: Option<(Instant, CellOverview)>,
}

/// Why a cell needs a person, or not; the first is the most urgent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Need {
    Gone,
    NoExecutor,
    Silent,
    DeviceLost,
    Late,
    Configuration,
    Error,
    Runs,
    Idle,
}

impl Need {
    fn words(self) -> &'static str {
        match self {
            Need::Gone => "gone",
            Need::NoExecutor => "no executor",
            Need::Silent => "silent",
            Need::DeviceLost => "device lost",
            Need::Late => "late",
            Need::Configuration => "configuration",
            Need::Error => "error",
            Need::Runs => "runs",
            Need::Idle => "idle",
        }
    }

    fn of(cell: &CellState, now: Instant) -> Need {
        let Some((heard, overview)) = &cell.overview else {
            return match cell.alive.is_empty() {
                true => Need::Gone,
                false => Need::Silent,
            };
        };
        let is_silent = now.saturating_duration_since(*heard) > SILENT;
        let is_error = || {
            let event = overview.event.as_ref();
            event.is_some_and(|event| event.severity == "error")
        };
        match cell.alive.is_empty() {
            true if is_silent => Need::Gone,
            true => Need::NoExecutor,
            false if is_silent => Need::Silent,
            // The token of a dead executor is still on its way.
            false if !overview.problem.is_empty() => Need::NoExecutor,
            false if !overview.lost.is_empty() => Need::DeviceLost,
            false if overview.late > 0 => Need::Late,
            false if !overview.configuration.is_empty() => Need::Configuration,
            false if is_error() => Need::Error,
            false if overview.nets_count > 0 => Need::Runs,
            false => Need::Idle,
        }
    }
}

/// A line of the screen.
struct Row<'a> {
    name: &'a str,
    need: Need,
    overview: Option<&'a CellOverview>,
}

impl Row<'_> {
    fn is_alive(&self) -> &'static str {
        match self.need {
            Need::Gone | Need::NoExecutor => "no",
            _ => "yes",
        }
    }

    fn nets(&self) -> String {
        let Some(overview) = self.overview.filter(|it| it.nets_count > 0) else {
            return "–".to_owned();
        };
        let first = overview.nets.first().map_or("?", String::as_str);
        match overview.nets_count {
            1 => first.to_owned(),
            count => format!("{first} +{}", count - 1),
        }
    }

    fn lost(&self) -> String {
        match self.overview.map(|it| it.lost.as_slice()) {
            None | Some([]) => "–".to_owned(),
            Some([one]) => one.clone(),
            Some([first, others @ ..]) => format!("{first} +{}", others.len()),
        }
    }

    fn late(&self) -> String {
        match self.overview.map_or(0, |it| it.late) {
            0 => "–".to_owned(),
            count => count.to_string(),
        }
    }

    /// The problem that the state names, or else the newest event.
    fn event(&self) -> String {
        let Some(overview) = self.overview else {
            return String::new();
        };
        match self.need {
            Need::NoExecutor if !overview.problem.is_empty() => overview.problem.clone(),
            Need::Configuration => overview.configuration.clone(),
            _ => {
                let event = overview.event.as_ref();
                event.map_or_else(String::new, |event| {
                    // `2026-11-21T16:02:03.123456Z`: the time of day is enough.
                    let clock = event.time.get(11..19).unwrap_or("–");
                    format!("{clock} {}", event.words)
                })
            }
        }
    }
}

impl FleetState {
    /// Takes note of something.
    pub fn apply(&mut self, news: FleetNews, now: Instant) {
        match news {
            FleetNews::Alive(cell, incarnation) => {
                self.cells
                    .entry(cell)
                    .or_default()
                    .alive
                    .insert(incarnation);
            }
            FleetNews::Gone(cell, incarnation) => {
                self.cells
                    .entry(cell)
                    .or_default()
                    .alive
                    .remove(&incarnation);
            }
            FleetNews::Overview(cell, overview) => {
                self.cells.entry(cell).or_default().overview = Some((now, *overview));
            }
        }
    }

    /// Returns true while the first overview of an alive cell is missing.
    #[must_use]
    pub fn is_awaited(&self) -> bool {
        let mut cells = self.cells.values();
        cells.any(|cell| !cell.alive.is_empty() && cell.overview.is_none())
    }

    fn rows(&self, now: Instant) -> Vec<Row<'_>> {
        let mut rows: Vec<Row<'_>> = self
            .cells
            .iter()
            .map(|(name, cell)| Row {
                name,
                need: Need::of(cell, now),
                overview: cell.overview.as_ref().map(|(_, overview)| overview),
            })
            .collect();
        // By name within a need, since the sort is stable.
        rows.sort_by_key(|row| row.need);
        rows
    }

    /// Returns the first line, headings, and a line for each cell, fitted to `columns`.
    #[must_use]
    pub fn lines(&self, columns: usize, now: Instant) -> Vec<String> {
        let rows = self.rows(now);
        let mut lines = vec![head(&rows)];
        lines.extend(table(&rows, columns));
        lines
    }

    /// Draws the screen; the last line says how many cells there is no room for.
    pub fn draw(&self, frame: &mut Frame<'_>, now: Instant) {
        let [area, foot] =
            Layout::vertical([Constraint::Min(0), Constraint::Length(1)]).areas(frame.area());
        let rows = self.rows(now);
        let columns = usize::from(area.width);
        let room = usize::from(area.height).saturating_sub(2);
        let mut lines = vec![Line::from(cut(&head(&rows), columns)).bold()];
        let needs = rows.iter().map(|row| row.need);
        let mut table = table(&rows, columns).into_iter();
        lines.extend(table.next().map(|heads| Line::from(heads).bold()));
        let drawn = table.zip(needs).take(room).map(|(line, need)| match need {
            Need::Gone | Need::NoExecutor | Need::Silent | Need::DeviceLost => {
                Line::from(line).fg(Color::Red)
            }
            Need::Late | Need::Configuration | Need::Error => Line::from(line).fg(Color::Yellow),
            Need::Runs => Line::from(line),
            Need::Idle => Line::from(line).dim(),
        });
        lines.extend(drawn);
        frame.render_widget(Paragraph::new(lines), area);
        let keys = match rows.len().saturating_sub(room) {
            0 => KEYS.to_owned(),
            more => format!("{KEYS}   … and {more} more cells: enlarge the terminal"),
        };
        let keys = Paragraph::new(cut(&keys, columns)).style(Style::new().dim());
        frame.render_widget(keys, foot);
    }
}

fn head(rows: &[Row<'_>]) -> String {
    let count = |of: fn(Need) -> bool| rows.iter().filter(|row| of(row.need)).count();
    let cells = Counted(rows.len() as u64, "cell");
    let [need, run, idle] = [
        count(|need| need < Need::Runs),
        count(|need| need == Need::Runs),
        count(|need| need == Need::Idle),
    ];
    format!("{cells}: {need} to look at, {run} running, {idle} idle")
}

/// Returns headings and rows; the column of events gets the room that is left, or is left out.
fn table(rows: &[Row<'_>], columns: usize) -> Vec<String> {
    let words = |of: &dyn Fn(&Row<'_>) -> String| Cells::Words(rows.iter().map(of).collect());
    let all = || {
        vec![
            Column("CELL", words(&|row| row.name.to_owned())),
            Column("STATE", words(&|row| row.need.words().to_owned())),
            Column("ALIVE", words(&|row| row.is_alive().to_owned())),
            Column("NETS", words(&|row| row.nets())),
            Column("LOST", words(&|row| row.lost())),
            Column("LATE", words(&|row| row.late())),
        ]
    };
    let fitted = fit(all(), columns);
    let room = columns.saturating_sub(fitted.width + GAP);
    if !fitted.left_out.is_empty() || room < EVENT_MIN {
        return fitted.lines;
    }
    let events = words(&|row| cut(&row.event(), room));
    let mut with_events = all();
    with_events.push(Column("LAST EVENT", events));
    fit(with_events, columns).lines
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::*;
    use crate::overview::OverviewEvent;

    /// Returns the overview of cell `number` of a hundred, which runs a net if it is even.
    fn overview(number: usize) -> CellOverview {
        CellOverview {
            cycle: 1000,
            nets: number
                .is_multiple_of(2)
                .then(|| "line#3".to_owned())
                .into_iter()
                .collect(),
            nets_count: usize::from(number.is_multiple_of(2)),
            event: Some(OverviewEvent {
                time: "2026-11-21T16:02:03.123456Z".to_owned(),
                severity: "info".to_owned(),
                words: "`line#3` has started".to_owned(),
            }),
            ..CellOverview::default()
        }
    }

    /// A hundred cells, of which seven need a person.
    fn hundred(now: Instant) -> FleetState {
        let mut fleet = FleetState::default();
        for number in 0..100 {
            let cell = format!("lab/cell-{number:02}");
            let incarnation = format!("{number:016x}");
            let mut overview = overview(number);
            let change = &mut overview;
            let mut heard = now;
            let mut alive = true;
            match number {
                90 => change.late = 7,
                81 => change.lost = vec!["arm offline".to_owned(), "box offline".to_owned()],
                72 => change.problem = "RCC4001: no executor is running".to_owned(),
                63 => change.configuration = "the file differs: period".to_owned(),
                54 => change.event.as_mut().expect("an event").severity = "error".to_owned(),
                45 => heard = now - 2 * SILENT,
                36 => (heard, alive) = (now - 2 * SILENT, false),
                _ => {}
            }
            fleet.apply(FleetNews::Alive(cell.clone(), incarnation.clone()), heard);
            fleet.apply(FleetNews::Overview(cell.clone(), Box::new(overview)), heard);
            if !alive {
                fleet.apply(FleetNews::Gone(cell, incarnation), heard);
            }
        }
        fleet
    }

    #[test]
    fn those_that_need_a_person_come_first_and_the_most_urgent_of_them_at_the_top() {
        let now = Instant::now() + 10 * SILENT;
        let lines = hundred(now).lines(120, now);
        assert_eq!(lines[0], "100 cells: 7 to look at, 46 running, 47 idle");
        assert_eq!(
            lines[1],
            "CELL         STATE          ALIVE  NETS    LOST            LATE  LAST EVENT"
        );
        let expected = [
            "lab/cell-36  gone           no     line#3  –               –     16:02:03 `line#3` has started",
            "lab/cell-72  no executor    no     line#3  –               –     RCC4001: no executor is running",
            "lab/cell-45  silent         yes    –       –               –     16:02:03 `line#3` has started",
            "lab/cell-81  device lost    yes    –       arm offline +1  –     16:02:03 `line#3` has started",
            "lab/cell-90  late           yes    line#3  –               7     16:02:03 `line#3` has started",
            "lab/cell-63  configuration  yes    –       –               –     the file differs: period",
            "lab/cell-54  error          yes    line#3  –               –     16:02:03 `line#3` has started",
            "lab/cell-00  runs           yes    line#3  –               –     16:02:03 `line#3` has started",
        ];
        assert_eq!(lines[2..10], expected);
        assert_eq!(lines.len(), 102);
        let states = lines[9..].iter().map(|line| line.contains(" idle "));
        assert!(
            states.is_sorted(),
            "those that run are before the idle ones"
        );
    }

    #[test]
    fn a_screen_of_any_size_has_the_urgent_ones_and_says_how_many_are_missing() {
        let now = Instant::now() + 10 * SILENT;
        let fleet = hundred(now);
        for (width, height) in [(200, 110), (120, 40), (80, 25), (40, 10), (10, 3), (1, 1)] {
            let mut terminal = Terminal::new(TestBackend::new(width, height)).expect("a terminal");
            let shown = terminal
                .draw(|frame| fleet.draw(frame, now))
                .expect("drawn");
            let rows: Vec<String> = shown
                .buffer
                .content
                .chunks(usize::from(width))
                .map(|row| row.iter().map(|cell| cell.symbol()).collect())
                .collect();
            if height >= 10 {
                assert!(rows[2].starts_with("lab/cell-36"), "{width}: {rows:?}");
                assert!(rows[2].contains(" gone "), "{width}: {rows:?}");
            }
            let missing = 100usize.saturating_sub(usize::from(height).saturating_sub(3));
            if missing > 0 && width >= 80 {
                let foot = format!("… and {missing} more cells");
                assert!(
                    rows.last().is_some_and(|row| row.contains(&foot)),
                    "{rows:?}"
                );
            }
        }
    }

    #[test]
    fn a_cell_that_starts_again_is_no_longer_gone() {
        let now = Instant::now();
        let mut fleet = FleetState::default();
        let news = |what: fn(String, String) -> FleetNews, incarnation: &str| {
            what("lab/a".to_owned(), incarnation.to_owned())
        };
        fleet.apply(news(FleetNews::Alive, "1"), now);
        assert!(fleet.lines(80, now)[2].contains(" silent "));
        assert!(fleet.is_awaited());
        fleet.apply(FleetNews::Overview("lab/a".to_owned(), Box::default()), now);
        assert!(!fleet.is_awaited());
        assert!(fleet.lines(80, now)[2].contains(" idle "));
        fleet.apply(news(FleetNews::Gone, "1"), now);
        assert!(fleet.lines(80, now)[2].contains(" no executor "));
        assert!(fleet.lines(80, now + 2 * SILENT)[2].contains(" gone "));
        // The token of the next one may arrive before that of the last one is withdrawn.
        fleet.apply(news(FleetNews::Alive, "2"), now);
        fleet.apply(news(FleetNews::Alive, "3"), now);
        fleet.apply(news(FleetNews::Gone, "2"), now);
        assert!(fleet.lines(80, now)[2].contains(" idle "));
    }
}
