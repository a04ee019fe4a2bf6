//! Horizontal positions of the layers and courses of the links: forward links are horizontal through layers and curved
//! between them; backward links run in lanes below the boxes. Pure.

use super::{Edge, LayeredGraph, Layout, LinkRoute, NodeShape, PlanePoint};

/// Least distance between two layers.
const COLUMNS_APART: f64 = 56.0;
/// Greatest distance between two layers.
const COLUMNS_APART_MAX: f64 = 150.0;
/// Width of a curve relative to its height.
const SLOPE: f64 = 0.3;
/// Distance between two lanes, and between a box and the first lane.
pub const LANE: f64 = 14.0;

struct LayerColumn {
    left: f64,
    right: f64,
}

/// A backward edge, and the first and last layer of its lane.
#[derive(Clone, Copy)]
struct BackwardEdge {
    edge: usize,
    first: usize,
    last: usize,
}

/// Computes all positions and courses in one row, and where it is cut to fit into a page.
pub fn routed_layout(
    layered: &LayeredGraph,
    shapes: &[NodeShape],
    edges: &[Edge],
    tops: &[f64],
    page: f64,
) -> (Layout, Vec<f64>) {
    let mut backs: Vec<BackwardEdge> = Vec::new();
    for (edge, it) in edges.iter().enumerate() {
        if layered.dummies[edge].is_none() {
            let (from, to) = (layered.layer_of[it.from.0], layered.layer_of[it.to.0]);
            backs.push(BackwardEdge {
                edge,
                first: to,
                last: from,
            });
        }
    }
    backs.sort_by_key(|back| (back.last - back.first, back.edge));
    let columns = columns(layered, shapes, tops, &backs);
    let positions: Vec<PlanePoint> = shapes
        .iter()
        .enumerate()
        .map(|(shape, it)| {
            let column = &columns[layered.layer_of[shape]];
            PlanePoint {
                x: column.left + (column.right - column.left - it.width) / 2.0,
                y: tops[shape],
            }
        })
        .collect();
    let ends = |edge: &Edge| {
        let [(from, output), (to, input)] = [edge.from, edge.to];
        let start = PlanePoint {
            x: positions[from].x + shapes[from].width,
            y: positions[from].y + shapes[from].outputs[output],
        };
        let end = PlanePoint {
            x: positions[to].x,
            y: positions[to].y + shapes[to].inputs[input],
        };
        (start, end)
    };
    let mut routes: Vec<LinkRoute> = edges
        .iter()
        .enumerate()
        .map(|(edge, it)| {
            let dummies = layered.dummies[edge].as_deref().unwrap_or(&[]);
            let (start, end) = ends(it);
            LinkRoute::Curve(forward(layered, &columns, dummies, tops, start, end, it))
        })
        .collect();
    let mut floor = LaneAllocator::new(layered, shapes, tops);
    let width = columns.last().map_or(0.0, |column| column.right);
    // Turns on the right of each layer, and on its left.
    let mut turns = [vec![0_u32; columns.len()], vec![0; columns.len()]];
    for back in &backs {
        let (start, end) = ends(&edges[back.edge]);
        let y = floor.allocate(back.first, back.last);
        let mut turn = |side: usize, layer: usize| {
            turns[side][layer] += 1;
            f64::from(turns[side][layer]) * LANE
        };
        let right = columns[back.last].right + turn(0, back.last);
        let left = columns[back.first].left - turn(1, back.first);
        let points = vec![
            start,
            PlanePoint {
                x: right,
                y: start.y,
            },
            PlanePoint { x: right, y },
            PlanePoint { x: left, y },
            PlanePoint { x: left, y: end.y },
            end,
        ];
        routes[back.edge] = LinkRoute::Around(points);
    }
    let cuts = cuts(&columns, &backs, page);
    let first = positions.first().map_or(0.0, |at| at.x);
    let laid = shifted_to_origin(positions, routes, width, floor.lowest());
    let shift = laid.positions.first().map_or(0.0, |at| at.x) - first;
    (laid, cuts.into_iter().map(|cut| cut + shift).collect())
}

/// Returns where the drawing is cut so that each part is at most as wide as the page, or a single layer: in the gap
/// before a layer, between the backward links that turn on its two sides.
fn cuts(columns: &[LayerColumn], backs: &[BackwardEdge], page: f64) -> Vec<f64> {
    let mut cuts = Vec::new();
    let (mut begin, mut first) = (0.0, 0);
    for (layer, column) in columns.iter().enumerate() {
        if layer > first && column.right - begin > page {
            let turns = backs.iter().filter(|back| back.last + 1 == layer).count();
            begin = columns[layer - 1].right + (turns as f64 + 0.5) * LANE;
            first = layer;
            cuts.push(begin);
        }
    }
    cuts
}

/// Moves everything so that the smallest x is 0.
pub fn shifted_to_origin(
    positions: Vec<PlanePoint>,
    routes: Vec<LinkRoute>,
    width: f64,
    height: f64,
) -> Layout {
    let points = || routes.iter().flat_map(LinkRoute::points);
    let left = points().map(|point| point.x).fold(0.0, f64::min);
    let right = points().map(|point| point.x).fold(width, f64::max);
    let by = PlanePoint { x: -left, y: 0.0 };
    let moved = |at: PlanePoint| PlanePoint {
        x: at.x + by.x,
        y: at.y,
    };
    Layout {
        positions: positions.into_iter().map(moved).collect(),
        routes: routes.into_iter().map(|route| route.moved(by)).collect(),
        width: right - left,
        height,
    }
}

fn columns(
    layered: &LayeredGraph,
    shapes: &[NodeShape],
    tops: &[f64],
    backs: &[BackwardEdge],
) -> Vec<LayerColumn> {
    let mut steep = vec![0.0_f64; layered.layers.len()];
    for it in &layered.segments {
        let height = (tops[it.from] + it.from_y - tops[it.to] - it.to_y).abs();
        let gap = &mut steep[layered.vertices[it.from].layer];
        *gap = gap.max(height);
    }
    let mut columns: Vec<LayerColumn> = Vec::new();
    let mut left = 0.0;
    for (layer, vertices) in layered.layers.iter().enumerate() {
        let widths = vertices
            .iter()
            .filter_map(|vertex| layered.vertices[*vertex].shape);
        let width = widths.map(|shape| shapes[shape].width).fold(0.0, f64::max);
        let right = left + width;
        columns.push(LayerColumn { left, right });
        // Backward links that turn in the gap after this layer.
        let turns = backs
            .iter()
            .map(|back| usize::from(back.last == layer) + usize::from(back.first == layer + 1));
        let turns = turns.sum::<usize>() as f64;
        let gap = (steep[layer] * SLOPE).clamp(COLUMNS_APART, COLUMNS_APART_MAX);
        left = right + gap.max((turns + 2.0) * LANE);
    }
    columns
}

/// Returns the points of a forward link: horizontal through layers, curved between them.
fn forward(
    layered: &LayeredGraph,
    columns: &[LayerColumn],
    dummies: &[usize],
    tops: &[f64],
    start: PlanePoint,
    end: PlanePoint,
    edge: &Edge,
) -> Vec<PlanePoint> {
    let (first, last) = (layered.layer_of[edge.from.0], layered.layer_of[edge.to.0]);
    let mut points = vec![start];
    let right = columns[first].right;
    points.push(PlanePoint {
        x: right,
        y: start.y,
    });
    for vertex in dummies {
        let column = &columns[layered.vertices[*vertex].layer];
        let y = tops[*vertex];
        points.push(PlanePoint { x: column.left, y });
        points.push(PlanePoint { x: column.right, y });
    }
    points.push(PlanePoint {
        x: columns[last].left,
        y: end.y,
    });
    points.push(end);
    points.dedup();
    points
}

/// Lowest occupied position of each layer.
struct LaneAllocator(Vec<f64>);

impl LaneAllocator {
    fn new(layered: &LayeredGraph, shapes: &[NodeShape], tops: &[f64]) -> LaneAllocator {
        let bottom = |vertex: &usize| {
            let height = layered.vertices[*vertex]
                .shape
                .map_or(0.0, |shape| shapes[shape].height);
            tops[*vertex] + height
        };
        let layers = layered.layers.iter();
        LaneAllocator(
            layers
                .map(|layer| layer.iter().map(bottom).fold(0.0, f64::max))
                .collect(),
        )
    }

    /// Allocates a lane below these layers.
    fn allocate(&mut self, first: usize, last: usize) -> f64 {
        let y = self.0[first..=last].iter().copied().fold(0.0, f64::max) + LANE;
        self.0[first..=last].fill(y);
        y
    }

    fn lowest(&self) -> f64 {
        self.0.iter().copied().fold(0.0, f64::max)
    }
}
