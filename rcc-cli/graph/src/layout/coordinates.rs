//! Vertical coordinates: places each box where its links are as horizontal as the order and the distances in its layer
//! allow. Sweeps over the layers in both directions; within a layer it finds the least-squares positions by pooling
//! adjacent violators (M. Ayer et al., "An empirical distribution function for sampling with incomplete information",
//! 1955). Pure.

use super::{LayeredGraph, NodeShape};

/// Distance between two boxes.
const BOXES_APART: f64 = 26.0;
/// Distance between two dummy vertices.
const LINKS_APART: f64 = 13.0;
/// Distance between a box and a dummy vertex.
const APART: f64 = 18.0;
/// Number of sweeps over all layers.
const ROUNDS: usize = 16;
/// Weight of segments between dummy vertices, to keep long links horizontal.
const LONG: f64 = 6.0;

/// A linked vertex, and how much lower its top should be for a horizontal link.
struct Neighbour {
    vertex: usize,
    offset: f64,
    weight: f64,
}

/// Returns the positions of the tops of all vertices; the least is 0.
pub fn tops(layered: &LayeredGraph, shapes: &[NodeShape]) -> Vec<f64> {
    let (before, after) = neighbours(layered);
    let mut tops = initial_tops(layered, shapes);
    let count = layered.layers.len();
    for round in 0..ROUNDS {
        let both = round + 2 >= ROUNDS;
        let forward = round % 2 == 0;
        for step in 0..count {
            let layer = if forward { step } else { count - 1 - step };
            let sides: &[&Vec<Vec<Neighbour>>] = match (both, forward) {
                (true, _) => &[&before, &after],
                (false, true) => &[&before],
                (false, false) => &[&after],
            };
            place_layer(layered, shapes, layer, sides, &mut tops);
        }
    }
    let least = tops.iter().copied().fold(f64::INFINITY, f64::min);
    tops.iter_mut().for_each(|top| *top -= least);
    tops
}

fn neighbours(layered: &LayeredGraph) -> (Vec<Vec<Neighbour>>, Vec<Vec<Neighbour>>) {
    let none = || -> Vec<Vec<Neighbour>> { layered.vertices.iter().map(|_| Vec::new()).collect() };
    let (mut before, mut after) = (none(), none());
    for it in &layered.segments {
        let is_dummy = |vertex: usize| layered.vertices[vertex].shape.is_none();
        let weight = if is_dummy(it.from) && is_dummy(it.to) {
            LONG
        } else {
            1.0
        };
        let offset = it.from_y - it.to_y;
        before[it.to].push(Neighbour {
            vertex: it.from,
            offset,
            weight,
        });
        after[it.from].push(Neighbour {
            vertex: it.to,
            offset: -offset,
            weight,
        });
    }
    (before, after)
}

/// Returns the least distance from the top of the upper vertex to the top of the lower one.
fn distance(layered: &LayeredGraph, shapes: &[NodeShape], upper: usize, lower: usize) -> f64 {
    let [upper, lower] = [upper, lower].map(|vertex| &layered.vertices[vertex]);
    let border = |shape: Option<usize>| shape.is_some_and(|shape| shapes[shape].height == 0.0);
    let apart = match (upper.shape, lower.shape) {
        (Some(_), Some(_)) if border(upper.shape) || border(lower.shape) => APART,
        (Some(_), Some(_)) => BOXES_APART,
        (None, None) => LINKS_APART,
        _ => APART,
    };
    upper.height + apart
}

fn initial_tops(layered: &LayeredGraph, shapes: &[NodeShape]) -> Vec<f64> {
    let mut tops = vec![0.0; layered.vertices.len()];
    for layer in &layered.layers {
        for pair in layer.windows(2) {
            tops[pair[1]] = tops[pair[0]] + distance(layered, shapes, pair[0], pair[1]);
        }
    }
    tops
}

/// A block of touching vertices: sum of weighted desired positions, sum of weights, and number.
struct Pool {
    sum: f64,
    weight: f64,
    count: usize,
}

/// Places the vertices of a layer as close as possible to their desired positions.
fn place_layer(
    layered: &LayeredGraph,
    shapes: &[NodeShape],
    layer: usize,
    sides: &[&Vec<Vec<Neighbour>>],
    tops: &mut [f64],
) {
    let vertices = &layered.layers[layer];
    let mut shift = 0.0;
    let mut shifts = Vec::new();
    let mut pools: Vec<Pool> = Vec::new();
    for (index, vertex) in vertices.iter().enumerate() {
        if let Some(upper) = index.checked_sub(1) {
            shift += distance(layered, shapes, vertices[upper], *vertex);
        }
        shifts.push(shift);
        let (desired, weight) = desired(*vertex, sides, tops);
        let mut pool = Pool {
            sum: (desired - shift) * weight,
            weight,
            count: 1,
        };
        while let Some(above) =
            pools.pop_if(|above| above.sum / above.weight > pool.sum / pool.weight)
        {
            pool.sum += above.sum;
            pool.weight += above.weight;
            pool.count += above.count;
        }
        pools.push(pool);
    }
    let levels = pools.iter().flat_map(|pool| {
        let level = pool.sum / pool.weight;
        std::iter::repeat_n(level, pool.count)
    });
    for ((vertex, shift), level) in vertices.iter().zip(shifts).zip(levels) {
        tops[*vertex] = level + shift;
    }
}

/// Returns the desired top of a vertex, the weighted median that makes its links horizontal, and its weight.
fn desired(vertex: usize, sides: &[&Vec<Vec<Neighbour>>], tops: &[f64]) -> (f64, f64) {
    let all = sides.iter().flat_map(|side| &side[vertex]);
    let mut desired_tops: Vec<(f64, f64)> = all
        .map(|it| (tops[it.vertex] + it.offset, it.weight))
        .collect();
    desired_tops.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = desired_tops.iter().map(|(_, weight)| weight).sum();
    let mut below = 0.0;
    for (index, (desired, weight)) in desired_tops.iter().enumerate() {
        below += weight;
        if below * 2.0 > total {
            return (*desired, total);
        }
        if below * 2.0 == total {
            let next = desired_tops
                .get(index + 1)
                .map_or(*desired, |(next, _)| *next);
            return ((desired + next) / 2.0, total);
        }
    }
    // An unlinked vertex keeps its position unless others need the space.
    (tops[vertex], 0.01)
}
