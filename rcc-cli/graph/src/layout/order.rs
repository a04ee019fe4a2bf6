//! Order within the layers: sweeps that sort each layer by the mean position of its neighbours, then exchanges of
//! adjacent vertices, while crossings decrease. Bounded in number; the best order is kept. Pure.

use super::{EdgeSegment, LayeredGraph, NodeShape};

/// Number of sweeps, in both directions.
const SWEEPS: usize = 24;
/// Number of passes of exchanges.
const EXCHANGES: usize = 8;
/// Largest layer that is improved by exchanges.
const EXCHANGED_MAX: usize = 60;

/// Orders all layers.
pub fn reduce_crossings(layered: &mut LayeredGraph, shapes: &[NodeShape]) {
    let between = by_layer(layered);
    let mut rank = Ranks::new(layered);
    let mut best = layered.layers.clone();
    let mut fewest = count(layered, &between, &rank);
    for sweep in 0..SWEEPS {
        if fewest == 0 {
            break;
        }
        let forward = sweep % 2 == 0;
        let layers = layered.layers.len();
        for step in 1..layers {
            let layer = if forward { step } else { layers - 1 - step };
            let fixed = if forward { layer - 1 } else { layer };
            rank.sort(layered, layer, &between[fixed], forward, shapes);
        }
        let crossings = count(layered, &between, &rank);
        if crossings < fewest {
            fewest = crossings;
            best.clone_from(&layered.layers);
        }
    }
    layered.layers = best;
    rank.renew(layered);
    exchange(layered, &between, &mut rank, fewest);
}

/// Returns the segments that start in each layer.
fn by_layer(layered: &LayeredGraph) -> Vec<Vec<EdgeSegment>> {
    let mut between = vec![Vec::new(); layered.layers.len()];
    for segment in &layered.segments {
        between[layered.vertices[segment.from].layer].push(*segment);
    }
    between
}

/// Position of each vertex in its layer.
struct Ranks(Vec<usize>);

impl Ranks {
    fn new(layered: &LayeredGraph) -> Ranks {
        let mut ranks = Ranks(vec![0; layered.vertices.len()]);
        ranks.renew(layered);
        ranks
    }

    fn renew(&mut self, layered: &LayeredGraph) {
        for layer in &layered.layers {
            for (rank, vertex) in layer.iter().enumerate() {
                self.0[*vertex] = rank;
            }
        }
    }

    /// Sorts a layer by the mean position of its neighbours in the fixed layer beside it.
    fn sort(
        &mut self,
        layered: &mut LayeredGraph,
        layer: usize,
        segments: &[EdgeSegment],
        forward: bool,
        shapes: &[NodeShape],
    ) {
        let mut sums = vec![(0.0, 0_u32); layered.vertices.len()];
        for segment in segments {
            let (vertex, other, y) = match forward {
                true => (segment.to, segment.from, segment.from_y),
                false => (segment.from, segment.to, segment.to_y),
            };
            let height = layered.vertices[other]
                .shape
                .map_or(1.0, |shape| shapes[shape].height);
            let position = self.0[other] as f64 + y / height.max(1.0) * 0.9;
            sums[vertex] = (sums[vertex].0 + position, sums[vertex].1 + 1);
        }
        let mean = |vertex: usize, rank: usize| match sums[vertex] {
            (_, 0) => rank as f64,
            (sum, count) => sum / f64::from(count),
        };
        let mut keyed: Vec<(f64, usize)> = layered.layers[layer]
            .iter()
            .enumerate()
            .map(|(rank, vertex)| (mean(*vertex, rank), *vertex))
            .collect();
        keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
        layered.layers[layer] = keyed.into_iter().map(|(_, vertex)| vertex).collect();
        for (rank, vertex) in layered.layers[layer].iter().enumerate() {
            self.0[*vertex] = rank;
        }
    }
}

/// Counts the crossings of all layers.
fn count(layered: &LayeredGraph, between: &[Vec<EdgeSegment>], rank: &Ranks) -> usize {
    (0..layered.layers.len())
        .map(|layer| crossings(layered, &between[layer], rank, layer + 1))
        .sum()
}

/// Counts the crossings between a layer and the next one: inversions, counted with a Fenwick tree (W. Barth, P. Mutzel,
/// M. Jünger, "Simple and efficient bilayer cross counting", JGAA 8 (2004)).
fn crossings(layered: &LayeredGraph, segments: &[EdgeSegment], rank: &Ranks, next: usize) -> usize {
    if next >= layered.layers.len() {
        return 0;
    }
    let mut ends: Vec<((usize, f64), (usize, f64))> = segments
        .iter()
        .map(|it| ((rank.0[it.from], it.from_y), (rank.0[it.to], it.to_y)))
        .collect();
    let by = |a: &(usize, f64), b: &(usize, f64)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1));
    let mut targets: Vec<(usize, f64)> = ends.iter().map(|(_, to)| *to).collect();
    targets.sort_by(by);
    targets.dedup();
    ends.sort_by(|a, b| by(&a.0, &b.0).then(by(&a.1, &b.1)));
    let mut tree = vec![0_usize; targets.len() + 1];
    let (mut seen, mut sum) = (0, 0);
    for (_, to) in ends {
        let index = targets.partition_point(|known| by(known, &to).is_lt()) + 1;
        // Earlier segments that end above or at the same position do not cross.
        let (mut at, mut before) = (index, 0);
        while at > 0 {
            before += tree[at];
            at &= at - 1;
        }
        sum += seen - before;
        let mut at = index;
        while at < tree.len() {
            tree[at] += 1;
            at += at & at.wrapping_neg();
        }
        seen += 1;
    }
    sum
}

/// Exchanges adjacent vertices while that reduces crossings.
fn exchange(
    layered: &mut LayeredGraph,
    between: &[Vec<EdgeSegment>],
    rank: &mut Ranks,
    mut fewest: usize,
) {
    let around = |layered: &LayeredGraph, rank: &Ranks, layer: usize| {
        let before = match layer.checked_sub(1) {
            Some(before) => crossings(layered, &between[before], rank, layer),
            None => 0,
        };
        before + crossings(layered, &between[layer], rank, layer + 1)
    };
    for _ in 0..EXCHANGES {
        let mut better = false;
        for layer in 0..layered.layers.len() {
            let vertices = layered.layers[layer].len();
            if fewest == 0 || vertices > EXCHANGED_MAX {
                continue;
            }
            for upper in 1..vertices {
                let now = around(layered, rank, layer);
                swap(layered, rank, layer, upper);
                let then = around(layered, rank, layer);
                if then < now {
                    (better, fewest) = (true, fewest - (now - then));
                } else {
                    swap(layered, rank, layer, upper);
                }
            }
        }
        if !better {
            break;
        }
    }
}

fn swap(layered: &mut LayeredGraph, rank: &mut Ranks, layer: usize, upper: usize) {
    layered.layers[layer].swap(upper - 1, upper);
    for index in [upper - 1, upper] {
        rank.0[layered.layers[layer][index]] = index;
    }
}
