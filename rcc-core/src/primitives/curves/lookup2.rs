//! `Lookup2`: a two-dimensional table with bilinear interpolation.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Dim, ElementType, Example, Kernel, Parameter, ParameterKind, Port, PortType,
    Real, Slot, Spec, Step, UnitRule, operands, real_unless,
};
use crate::types::Type;

const ROWS: Dim = Dim::Var(0);
const COLUMNS: Dim = Dim::Var(1);

const fn axis(length: Dim) -> PortType {
    PortType::Array(ElementType::Are(Type::Real), length)
}

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Lookup2",
        summary: "Looks two numbers up in a table over a grid, with bilinear interpolation; outside the grid, the values of its edge hold.",
        undefined: "overflow",
        formula: "(1-u)·((1-v)·z[i,j] + v·z[i,j+1]) + u·((1-v)·z[i+1,j] + v·z[i+1,j+1]), u and v relative positions in the grid cell (Press et al.: Numerical Recipes, 3.6)",
        inputs: &[
            Port::real(
                "x",
                UnitRule::Var(0),
                "value to look up along the rows' axis",
            ),
            Port::real(
                "y",
                UnitRule::Var(1),
                "value to look up along the columns' axis",
            ),
        ],
        outputs: &[Port::real("out", UnitRule::Var(2), "interpolated value")],
        parameters: &[
            Parameter::new(
                "rows",
                ParameterKind::Value(axis(ROWS), UnitRule::Var(0)),
                "x of each row, increasing",
            )
            .rising(),
            Parameter::new(
                "columns",
                ParameterKind::Value(axis(COLUMNS), UnitRule::Var(1)),
                "y of each column, increasing",
            )
            .rising(),
            Parameter::new(
                "table",
                ParameterKind::Value(PortType::Matrix(ROWS, COLUMNS), UnitRule::Var(2)),
                "values at the grid points: a list of rows",
            ),
        ],
        examples: &[Example::new(
            "two rows of three",
            "{rows: [0.0, 1.0], columns: [0.0, 1.0, 3.0], table: [[0.0, 10.0, 20.0], [4.0, 14.0, 24.0]]}",
            "x | y | out
             0.0 | 0.0 | 0.0
             0.5 | 0.5 | 7.0
             0.25 | 2.0 | 16.0
             -1.0 | 9.0 | 20.0
             1.0 | 1.0 | 14.0
             null | 1.0 | null
             1.0 | null | null",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::each::<Lookup2>()],
);

operands! {
    struct Lookup2 {
        x: Slot<Real>, y: Slot<Real>, out: Slot<Real>, rows: Slot<Real>, columns: Slot<Real>, table: Slot<Real>,
        row_count: u32, column_count: u32,
    }
}

impl Step for Lookup2 {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (x, y) = (frame.get(self.x)?, frame.get(self.y)?);
        let (above, below, u) = place(frame, self.rows, self.row_count, x)?;
        let (left, right, v) = place(frame, self.columns, self.column_count, y)?;
        let at = |row: u32, column: u32| frame.get(self.table + row * self.column_count + column);
        let upper = (1.0 - v) * at(above, left)? + v * at(above, right)?;
        let lower = (1.0 - v) * at(below, left)? + v * at(below, right)?;
        let value = (1.0 - u) * upper + u * lower;
        frame.put(self.out, real_unless(x.is_nan() | y.is_nan(), value))
    }
}

/// Returns the indices of the points before and after a number on an axis, and its relative position between them, 0 to
/// 1.
#[inline(always)]
fn place(frame: &Frame<'_>, axis: Slot<Real>, length: u32, at: f64) -> Option<(u32, u32, f64)> {
    let (mut low, mut high) = (0, length.saturating_sub(1));
    // Bisection: at most one step for each bit of the length.
    for _ in 0..u32::BITS {
        if high - low < 2 {
            break;
        }
        let middle = low + (high - low) / 2;
        if frame.get(axis + middle)? <= at {
            low = middle;
        } else {
            high = middle;
        }
    }
    let (before, after) = (frame.get(axis + low)?, frame.get(axis + high)?);
    let part = if at <= before {
        0.0
    } else if at >= after {
        1.0
    } else {
        (at - before) / (after - before)
    };
    Some((low, high, part))
}
