//! The live view of `top`, for terminals of any size. Pure apart from drawing into the frame.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph, Row, Table};

use super::{TopSnapshot, text};

/// Draws everything; `message` is the message in the last line.
pub(super) fn draw(frame: &mut Frame<'_>, snapshot: &TopSnapshot, message: &str) {
    let head = text::head(snapshot);
    let nets = text::nets(snapshot);
    let rows = u16::try_from(nets.len()).unwrap_or(u16::MAX);
    let head_rows = u16::try_from(head.len()).unwrap_or(u16::MAX);
    let [top, middle, below, foot] = Layout::vertical([
        Constraint::Length(head_rows),
        Constraint::Max(rows.max(1).saturating_add(3)),
        Constraint::Min(0),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    let [left, right] =
        Layout::horizontal([Constraint::Percentage(60), Constraint::Percentage(40)]).areas(below);
    let late = snapshot.status.executor.late > snapshot.status.executor.late_acknowledged;
    let lines = head
        .into_iter()
        .enumerate()
        .map(|(index, line)| match index {
            0 => Line::from(line).bold(),
            2.. if late => Line::from(line).fg(Color::Yellow),
            _ => Line::from(line),
        });
    frame.render_widget(Paragraph::new(lines.collect::<Vec<_>>()), top);
    table(frame, middle, "nets", text::NET_HEADS, nets);
    histograms(frame, left, snapshot);
    table(
        frame,
        right,
        "primitives (sampled)",
        text::TYPE_HEADS,
        text::types(snapshot),
    );
    let keys = "q quit   a acknowledge late cycles   ";
    frame.render_widget(
        Paragraph::new(format!("{keys}{message}")).style(Style::new().dim()),
        foot,
    );
}

fn histograms(frame: &mut Frame<'_>, area: Rect, snapshot: &TopSnapshot) {
    let parts = text::histograms(snapshot);
    let heights = parts.each_ref().map(|(_, drawing)| {
        let lines = u16::try_from(drawing.lines().count()).unwrap_or(u16::MAX);
        Constraint::Max(lines.max(1).saturating_add(2))
    });
    let areas: [Rect; 3] = Layout::vertical(heights).areas(area);
    for ((title, drawing), area) in parts.into_iter().zip(areas) {
        let block = Block::bordered().title(title);
        frame.render_widget(Paragraph::new(drawing).block(block), area);
    }
}

fn table<const N: usize>(
    frame: &mut Frame<'_>,
    area: Rect,
    title: &str,
    heads: [&str; N],
    rows: Vec<[String; N]>,
) {
    let mut widths = heads.map(|head| head.chars().count());
    for row in &rows {
        for (width, cell) in widths.iter_mut().zip(row) {
            *width = (*width).max(cell.chars().count());
        }
    }
    let widths = widths.map(|width| Constraint::Max(u16::try_from(width).unwrap_or(u16::MAX)));
    let table = Table::new(rows.into_iter().map(Row::new), widths)
        .header(Row::new(heads).bold())
        .column_spacing(2)
        .block(Block::bordered().title(title.to_owned()));
    frame.render_widget(table, area);
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use rcc_api::bodies::{BucketView, CommandView, HistogramView, LateView, PrimitiveTimeView};

    use super::*;

    fn snapshot() -> TopSnapshot {
        let mut snapshot = TopSnapshot::default();
        snapshot.status.cell = "demo".into();
        let executor = &mut snapshot.status.executor;
        (executor.cycle, executor.period_ns) = (12_345, 1_000_000);
        executor.late = 3;
        executor.late_acknowledged = 1;
        executor.first_late = Some(LateView {
            cycle: 777,
            cause: "computed long".into(),
            wake_ns: 2_000,
            exec_ns: 1_500_000,
            skipped_periods: 1,
            net: Some("dear#2".into()),
            net_ns: 1_400_000,
        });
        let net = |id, name: &str, exec_mean_ns| CommandView {
            id,
            net: name.into(),
            state: "running".into(),
            exec_mean_ns,
            exec_max_ns: 2 * exec_mean_ns,
            ..CommandView::default()
        };
        let over = CommandView {
            state: "terminated".into(),
            ..net(9, "over", 1)
        };
        snapshot.nets = vec![net(1, "cheap", 2_000), net(2, "dear", 100_000), over];
        snapshot.timing.exec = HistogramView {
            count: 5,
            mean_ns: 102_000,
            p99_ns: 200_000,
            buckets: vec![BucketView {
                to_ns: 150_000,
                count: 5,
            }],
            ..HistogramView::default()
        };
        snapshot.timing.primitives = vec![PrimitiveTimeView {
            ty: "LinearMotion".into(),
            runs: 4,
            primitives: 8,
            sum_ns: 4_000,
            max_ns: 1_200,
        }];
        snapshot
    }

    fn drawn(width: u16, height: u16, message: &str) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal
            .draw(|frame| draw(frame, &snapshot(), message))
            .unwrap();
        let buffer = terminal.backend().buffer();
        let rows = buffer.content().chunks(usize::from(width));
        rows.map(|row| row.iter().map(|cell| cell.symbol()).collect::<String>() + "\n")
            .collect()
    }

    #[test]
    fn the_view_has_nets_histograms_primitives_and_late_cycles() {
        let picture = drawn(120, 40, "as told");
        for part in [
            "cell demo  cycle 12 345  period 1.0 ms  load 10.2 % (99 %: 20.0 %)",
            "2 late cycles, 3 since the start",
            "first: cycle 777 computed long: woke up 2.0 µs late, computed for 1.5 ms, most of it dear#2 (1.4 ms)",
            "execution: median",
            "≤ 200 µs",
            "LinearMotion  500.0 ns  100.0 %",
            "q quit   a acknowledge late cycles   as told",
        ] {
            assert!(picture.contains(part), "{part}\n{picture}");
        }
        let position = |what| picture.find(what);
        assert!(
            position("dear#2   running") < position("cheap#1  running"),
            "the dearest first\n{picture}"
        );
        assert!(!picture.contains("over#9"));
    }

    #[test]
    fn a_small_terminal_shows_what_fits() {
        for (width, height) in [(1, 1), (20, 5), (40, 10), (300, 3)] {
            assert_eq!(
                drawn(width, height, "").lines().count(),
                usize::from(height)
            );
        }
    }

    #[test]
    fn the_text_has_the_same_contents() {
        let text = text::text(&snapshot());
        for part in [
            "computed long",
            "LinearMotion",
            "dear#2",
            "10.0 %",
            "≤ 200 µs",
        ] {
            assert!(text.contains(part), "{part}\n{text}");
        }
    }
}
