//! The live view of `top`, for terminals of any size. Sentences are wrapped, tables are fitted to the width, and the bars
//! get the space that is left. Pure apart from drawing into the frame.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::Line;
use ratatui::widgets::{Block, Borders, Paragraph};

use super::{TopSnapshot, text};
use crate::doctor::histogram::{Detail, fitted_drawing};
use rcc_terminal::columns::{Column, FittedTable, fit};
use rcc_terminal::text::{cut, flowed, wrapped};

/// Narrowest column of histograms beside the table of primitives.
const BARS_MIN: usize = 26;
/// Blanks between them.
const GAP: usize = 2;
/// Rows of the table of nets that always have room: title, headings and two nets.
const NETS_MIN: usize = 4;
/// Keys in the last row.
const KEYS: &str = "q quit   a acknowledge late cycles";

/// A titled part of the view.
struct Section {
    title: String,
    lines: Vec<Line<'static>>,
}

impl Section {
    fn of_table(name: &str, table: FittedTable) -> Section {
        let title = match table.left_out.as_slice() {
            [] => name.to_owned(),
            columns => format!("{name} (no room for {})", columns.join(", ")),
        };
        let lines = table.lines.into_iter().enumerate();
        let lines = lines.map(|(index, line)| match index {
            0 => Line::from(line).bold(),
            _ => Line::from(line),
        });
        Section {
            title,
            lines: lines.collect(),
        }
    }

    /// Rows including the title.
    fn rows(&self) -> usize {
        self.lines.len() + 1
    }

    /// Cuts the section to `rows` rows; the last one gives the number of missing lines.
    fn cut(mut self, rows: usize) -> Section {
        if self.rows() > rows && rows >= 3 {
            let missing = self.rows() - rows + 1;
            self.lines.truncate(rows - 2);
            self.lines.push(Line::from(format!("… and {missing} more")));
        }
        self
    }

    fn draw(self, frame: &mut Frame<'_>, area: Rect) {
        let columns = usize::from(area.width);
        let block = Block::new()
            .borders(Borders::TOP)
            .title(cut(&self.title, columns));
        frame.render_widget(Paragraph::new(self.lines).block(block), area);
    }
}

/// Draws everything; `message` is shown behind the keys.
pub(super) fn draw(frame: &mut Frame<'_>, snapshot: &TopSnapshot, message: &str) {
    let area = frame.area();
    let columns = usize::from(area.width);
    let (head, foot) = (head(snapshot, columns), foot(message, columns));
    let (foot_area, area) = split(area, foot.len(), Edge::Bottom);
    let (head_area, area) = split(area, head.len(), Edge::Top);
    frame.render_widget(Paragraph::new(head), head_area);
    frame.render_widget(Paragraph::new(foot).style(Style::new().dim()), foot_area);

    let section = |name, table: Vec<Column>| Section::of_table(name, fit(table, columns));
    let times = section("time of a cycle", text::quantiles(snapshot));
    let mut nets = section("nets", text::nets(snapshot));
    if nets.lines.len() == 1 {
        nets.lines = vec![Line::from("no net is loaded")];
    }
    let rest = usize::from(area.height).saturating_sub(times.rows());
    let nets = nets.cut((rest / 2).max(NETS_MIN));
    let (nets_area, area) = split(area, nets.rows(), Edge::Top);
    let (times_area, area) = split(area, times.rows(), Edge::Top);
    nets.draw(frame, nets_area);
    times.draw(frame, times_area);
    details(frame, area, snapshot);
}

/// Draws histograms and primitives, side by side if the terminal is wide enough.
fn details(frame: &mut Frame<'_>, area: Rect, snapshot: &TopSnapshot) {
    let columns = usize::from(area.width);
    let types = text::types(snapshot);
    let mut beside = fit(types, columns.saturating_sub(BARS_MIN + GAP));
    let (bars, table) = if beside.left_out.len() < 2 && columns > beside.width + GAP {
        let left = columns - beside.width - GAP;
        let (bars, rest) = split(area, left, Edge::Left);
        (bars, split(rest, GAP, Edge::Left).1)
    } else {
        beside = fit(text::types(snapshot), columns);
        let rows = beside.lines.len() + 1;
        let (table, bars) = split(area, rows, Edge::Top);
        (bars, table)
    };
    let rows = usize::from(table.height);
    Section::of_table("primitives (sampled)", beside)
        .cut(rows)
        .draw(frame, table);
    let mut area = bars;
    for section in histograms(snapshot, area) {
        let (own, rest) = split(area, section.rows(), Edge::Top);
        section.draw(frame, own);
        area = rest;
    }
}

/// Returns the histograms that fit into the area: all of them with few rows rather than one with many.
fn histograms(snapshot: &TopSnapshot, area: Rect) -> Vec<Section> {
    let drawn = |detail, count: usize| -> Vec<Section> {
        let all = text::histograms(snapshot).into_iter().take(count);
        let section = |(name, histogram): (&str, _)| {
            let bars = fitted_drawing(text::buckets(histogram), detail, usize::from(area.width));
            let lines = bars.lines().map(|line| Line::from(line.to_owned()));
            Section {
                title: name.to_owned(),
                lines: lines.collect(),
            }
        };
        all.map(section).collect()
    };
    let choices = [
        (Detail::Fine, 3),
        (Detail::Coarse, 3),
        (Detail::Coarse, 2),
        (Detail::Fine, 1),
        (Detail::Coarse, 1),
    ];
    let fits = |sections: &Vec<Section>| {
        let rows: usize = sections.iter().map(Section::rows).sum();
        rows <= usize::from(area.height)
    };
    let fitting = choices
        .into_iter()
        .map(|(detail, count)| drawn(detail, count));
    fitting.into_iter().find(fits).unwrap_or_default()
}

fn head(snapshot: &TopSnapshot, columns: usize) -> Vec<Line<'static>> {
    let lines = |text: &str| -> Vec<Line<'static>> {
        let rows = wrapped(text, columns);
        rows.lines().map(|row| Line::from(row.to_owned())).collect()
    };
    let cell = flowed(&text::head(snapshot), columns);
    let cell = cell.into_iter().map(|line| Line::from(line).bold());
    let late = text::late(snapshot)
        .into_iter()
        .flat_map(|line| lines(&line));
    let is_late = text::is_late(snapshot);
    let late = late.map(|line| match is_late {
        true => line.fg(Color::Yellow),
        false => line,
    });
    let grade = lines(&snapshot.status.executor.grade);
    cell.chain(grade).chain(late).collect()
}

fn foot(message: &str, columns: usize) -> Vec<Line<'static>> {
    let parts = [KEYS.to_owned(), message.trim().to_owned()];
    let used = if message.trim().is_empty() { 1 } else { 2 };
    let rows = flowed(&parts[..used], columns).into_iter();
    rows.map(Line::from).collect()
}

/// The edge of an area that a part is taken from.
#[derive(Clone, Copy)]
enum Edge {
    Top,
    Bottom,
    Left,
}

/// Splits an area into a part of at most `size` rows or columns at the edge, and the rest.
fn split(area: Rect, size: usize, edge: Edge) -> (Rect, Rect) {
    let size = Constraint::Length(u16::try_from(size).unwrap_or(u16::MAX));
    let rest = Constraint::Min(0);
    let layout = match edge {
        Edge::Top => Layout::vertical([size, rest]),
        Edge::Bottom => Layout::vertical([rest, size]),
        Edge::Left => Layout::horizontal([size, rest]),
    };
    let [first, last] = layout.areas(area);
    match edge {
        Edge::Bottom => (last, first),
        Edge::Top | Edge::Left => (first, last),
    }
}

#[cfg(test)]
mod tests;
