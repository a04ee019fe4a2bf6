//! Tables of live views: each column of times has one unit, named in its heading. A table is fitted to a width by shortening
//! names and by leaving columns out; a number is never cut. Pure.

use textwrap::core::display_width;

use crate::text::cut;

/// Blanks between two columns.
pub const GAP: usize = 2;
/// Columns that a name keeps if the table is too wide.
const NAME_MIN: usize = 16;

/// Contents of a column.
pub enum Cells {
    /// Names and states, left-aligned.
    Words(Vec<String>),
    /// Parts of a whole, percent.
    Percent(Vec<f64>),
    /// Times, ns; 0 is not known.
    Times(Vec<f64>),
}

/// A column with its heading, without the unit, and its cells.
pub struct Column(pub &'static str, pub Cells);

/// A table fitted to a width.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct FittedTable {
    /// Headings, then the rows.
    pub lines: Vec<String>,
    /// Headings of the columns there was no room for.
    pub left_out: Vec<&'static str>,
    /// Columns of the widest line.
    pub width: usize,
}

/// A column as text.
struct Formatted {
    name: &'static str,
    head: String,
    cells: Vec<String>,
    right: bool,
}

impl Formatted {
    fn new(column: Column) -> Formatted {
        let Column(name, cells) = column;
        let (head, cells, right) = match cells {
            Cells::Words(words) => (name.to_owned(), words, false),
            Cells::Percent(parts) => {
                let cells = parts.iter().map(|part| format!("{part:.1}")).collect();
                (format!("{name} %"), cells, true)
            }
            Cells::Times(times) => {
                let (unit, factor, decimals) = unit(&times);
                let text = |ns: &f64| match *ns {
                    0.0 => "–".to_owned(),
                    ns => format!("{:.decimals$}", ns / factor),
                };
                let cells = times.iter().map(text).collect();
                (format!("{name} {unit}"), cells, true)
            }
        };
        Formatted {
            name,
            head,
            cells,
            right,
        }
    }

    fn width(&self) -> usize {
        let cells = self.cells.iter().chain([&self.head]);
        cells.map(|cell| display_width(cell)).max().unwrap_or(0)
    }

    fn aligned(&self, text: &str, width: usize) -> String {
        let text = cut(text, width);
        let blanks = " ".repeat(width.saturating_sub(display_width(&text)));
        if self.right {
            blanks + &text
        } else {
            text + &blanks
        }
    }
}

/// Returns name, ns and decimals of the unit that suits the longest time.
fn unit(times: &[f64]) -> (&'static str, f64, usize) {
    let longest = times.iter().copied().fold(0.0, f64::max);
    match longest {
        ..100.0 => ("ns", 1.0, 1),
        ..10e3 => ("ns", 1.0, 0),
        ..10e6 => ("µs", 1e3, 1),
        _ => ("ms", 1e6, 1),
    }
}

/// Fits a table to `width`: the first column is shortened, then columns are left out from the right; the first two stay.
#[must_use]
pub fn fit(columns: Vec<Column>, width: usize) -> FittedTable {
    let mut columns: Vec<Formatted> = columns.into_iter().map(Formatted::new).collect();
    let mut widths: Vec<usize> = columns.iter().map(Formatted::width).collect();
    let mut left_out = Vec::new();
    let needed = |widths: &[usize]| widths.iter().sum::<usize>() + GAP * (widths.len() - 1);
    let Some(natural) = widths.first().copied() else {
        return FittedTable::default();
    };
    loop {
        let over = needed(&widths).saturating_sub(width);
        let shortened = natural.saturating_sub(over).max(natural.min(NAME_MIN));
        if let (true, Some(first)) = (over > 0, widths.first_mut()) {
            *first = shortened;
        }
        if needed(&widths) <= width || columns.len() <= 2 {
            break;
        }
        left_out.extend(columns.pop().map(|column| column.name));
        widths.pop();
        if let Some(first) = widths.first_mut() {
            *first = natural;
        }
    }
    let rows = columns.first().map_or(0, |column| column.cells.len());
    let line = |cell: &dyn Fn(&Formatted) -> String| {
        let cells = columns.iter().zip(&widths);
        let cells = cells.map(|(column, width)| column.aligned(&cell(column), *width));
        let line = cells.collect::<Vec<_>>().join(&" ".repeat(GAP));
        line.trim_end().to_owned()
    };
    let head = line(&|column| column.head.clone());
    let rows = (0..rows).map(|row| line(&|column| column.cells[row].clone()));
    left_out.reverse();
    FittedTable {
        lines: std::iter::once(head).chain(rows).collect(),
        left_out,
        width: needed(&widths),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns() -> Vec<Column> {
        let names = ["guarded-line-with-a-long-name#1", "hold#2"].map(str::to_owned);
        vec![
            Column("NET", Cells::Words(names.to_vec())),
            Column("LOAD", Cells::Percent(vec![10.25, 0.5])),
            Column("MEAN", Cells::Times(vec![744.0, 102_400.0])),
            Column("EXPECTED", Cells::Times(vec![0.0, 52.0])),
        ]
    }

    #[test]
    fn each_column_has_one_unit_in_its_heading() {
        assert_eq!(
            fit(columns(), 80).lines,
            [
                "NET                              LOAD %  MEAN µs  EXPECTED ns",
                "guarded-line-with-a-long-name#1    10.2      0.7            –",
                "hold#2                              0.5    102.4         52.0",
            ]
        );
    }

    #[test]
    fn names_are_shortened_and_columns_left_out_before_a_number_is_cut() {
        let narrow = fit(columns(), 50);
        assert_eq!(
            narrow.lines[1],
            "guarded-line-with-a…    10.2      0.7            –"
        );
        assert_eq!(narrow.lines[0].chars().count(), 50);
        let narrower = fit(columns(), 36);
        assert_eq!(narrower.left_out, ["EXPECTED"]);
        assert!(narrower.lines[2].ends_with("0.5    102.4"), "{narrower:?}");
        assert_eq!(fit(columns(), 1).left_out, ["MEAN", "EXPECTED"]);
    }
}
