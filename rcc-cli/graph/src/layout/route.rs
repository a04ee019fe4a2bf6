//! The columns' places and the links' ways: level through columns, in curves between them; backwards in lanes below the
//! boxes that they pass. Pure.

use super::{Edge, Layered, Layout, Point, Route, Shape};

/// Least distance of two columns.
const COLUMNS_APART: f64 = 56.0;
/// Most.
const COLUMNS_APART_MAX: f64 = 150.0;
/// A curve takes this part of its height in width.
const SLOPE: f64 = 0.3;
/// Between two lanes, and between a box and the first lane.
const LANE: f64 = 14.0;

struct Column {
    left: f64,
    right: f64,
}

/// A link that goes backwards: number of the edge, first and last column of its lane.
#[derive(Clone, Copy)]
struct Back {
    edge: usize,
    first: usize,
    last: usize,
}

/// Everything gets its place.
pub fn finish(layered: &Layered, shapes: &[Shape], edges: &[Edge], tops: &[f64]) -> Layout {
    let mut backs: Vec<Back> = Vec::new();
    for (edge, it) in edges.iter().enumerate() {
        if layered.passes[edge].is_none() {
            let (from, to) = (layered.layer_of[it.from.0], layered.layer_of[it.to.0]);
            backs.push(Back {
                edge,
                first: to,
                last: from,
            });
        }
    }
    backs.sort_by_key(|back| (back.last - back.first, back.edge));
    let columns = columns(layered, shapes, tops, &backs);
    let places: Vec<Point> = shapes
        .iter()
        .enumerate()
        .map(|(shape, it)| {
            let column = &columns[layered.layer_of[shape]];
            Point {
                x: column.left + (column.right - column.left - it.width) / 2.0,
                y: tops[shape],
            }
        })
        .collect();
    let ends = |edge: &Edge| {
        let [(from, output), (to, input)] = [edge.from, edge.to];
        let start = Point {
            x: places[from].x + shapes[from].width,
            y: places[from].y + shapes[from].outputs[output],
        };
        let end = Point {
            x: places[to].x,
            y: places[to].y + shapes[to].inputs[input],
        };
        (start, end)
    };
    let mut routes: Vec<Route> = edges
        .iter()
        .enumerate()
        .map(|(edge, it)| {
            let passes = layered.passes[edge].as_deref().unwrap_or(&[]);
            let (start, end) = ends(it);
            Route::Curve(forward(layered, &columns, passes, tops, start, end, it))
        })
        .collect();
    let mut floor = Floor::new(layered, shapes, tops);
    let width = columns.last().map_or(0.0, |column| column.right);
    let mut turns = vec![0_u32; columns.len() + 1];
    for back in &backs {
        let (start, end) = ends(&edges[back.edge]);
        let y = floor.lane(back.first, back.last);
        let mut turn = |gap: usize| {
            turns[gap] += 1;
            f64::from(turns[gap]) * LANE
        };
        let right = columns[back.last].right + turn(back.last + 1);
        let left = columns[back.first].left - turn(back.first);
        let points = vec![
            start,
            Point {
                x: right,
                y: start.y,
            },
            Point { x: right, y },
            Point { x: left, y },
            Point { x: left, y: end.y },
            end,
        ];
        routes[back.edge] = Route::Around(points);
    }
    finished(places, routes, width, floor.lowest())
}

/// Everything is moved so that nothing is left of 0.
fn finished(places: Vec<Point>, routes: Vec<Route>, width: f64, height: f64) -> Layout {
    let points = || routes.iter().flat_map(Route::points);
    let left = points().map(|point| point.x).fold(0.0, f64::min);
    let right = points().map(|point| point.x).fold(width, f64::max);
    let by = Point { x: -left, y: 0.0 };
    let moved = |at: Point| Point {
        x: at.x + by.x,
        y: at.y,
    };
    Layout {
        places: places.into_iter().map(moved).collect(),
        routes: routes.into_iter().map(|route| route.moved(by)).collect(),
        width: right - left,
        height,
    }
}

fn columns(layered: &Layered, shapes: &[Shape], tops: &[f64], backs: &[Back]) -> Vec<Column> {
    let mut steep = vec![0.0_f64; layered.layers.len()];
    for it in &layered.segments {
        let height = (tops[it.from] + it.from_y - tops[it.to] - it.to_y).abs();
        let gap = &mut steep[layered.vertices[it.from].layer];
        *gap = gap.max(height);
    }
    let mut columns: Vec<Column> = Vec::new();
    let mut left = 0.0;
    for (layer, vertices) in layered.layers.iter().enumerate() {
        let widths = vertices
            .iter()
            .filter_map(|vertex| layered.vertices[*vertex].shape);
        let width = widths.map(|shape| shapes[shape].width).fold(0.0, f64::max);
        let right = left + width;
        columns.push(Column { left, right });
        // Those that turn in the gap behind this column.
        let turns = backs
            .iter()
            .map(|back| usize::from(back.last == layer) + usize::from(back.first == layer + 1));
        let turns = turns.sum::<usize>() as f64;
        let gap = (steep[layer] * SLOPE).clamp(COLUMNS_APART, COLUMNS_APART_MAX);
        left = right + gap.max((turns + 2.0) * LANE);
    }
    columns
}

/// Level through its columns and curved between them.
fn forward(
    layered: &Layered,
    columns: &[Column],
    passes: &[usize],
    tops: &[f64],
    start: Point,
    end: Point,
    edge: &Edge,
) -> Vec<Point> {
    let (first, last) = (layered.layer_of[edge.from.0], layered.layer_of[edge.to.0]);
    let mut points = vec![start];
    let right = columns[first].right;
    points.push(Point {
        x: right,
        y: start.y,
    });
    for vertex in passes {
        let column = &columns[layered.vertices[*vertex].layer];
        let y = tops[*vertex];
        points.push(Point { x: column.left, y });
        points.push(Point { x: column.right, y });
    }
    points.push(Point {
        x: columns[last].left,
        y: end.y,
    });
    points.push(end);
    points.dedup();
    points
}

/// How far down the columns reach.
struct Floor(Vec<f64>);

impl Floor {
    fn new(layered: &Layered, shapes: &[Shape], tops: &[f64]) -> Floor {
        let bottom = |vertex: &usize| {
            let height = layered.vertices[*vertex]
                .shape
                .map_or(0.0, |shape| shapes[shape].height);
            tops[*vertex] + height
        };
        let layers = layered.layers.iter();
        Floor(
            layers
                .map(|layer| layer.iter().map(bottom).fold(0.0, f64::max))
                .collect(),
        )
    }

    /// A lane below these columns, which is theirs from now on.
    fn lane(&mut self, first: usize, last: usize) -> f64 {
        let y = self.0[first..=last].iter().copied().fold(0.0, f64::max) + LANE;
        self.0[first..=last].fill(y);
        y
    }

    fn lowest(&self) -> f64 {
        self.0.iter().copied().fold(0.0, f64::max)
    }
}
