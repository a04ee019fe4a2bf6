//! Assigns boxes to layers: as far left as their inputs allow, and sources next to their readers. Links across several
//! layers get dummy vertices, which all links of an output share. Pure.

use std::collections::BTreeMap;

use super::{Edge, EdgeSegment, LayerConstraint, LayeredGraph, NodeShape, Vertex};

/// Assigns boxes to layers and inserts dummy vertices.
pub fn layered_graph(shapes: &[NodeShape], edges: &[Edge]) -> LayeredGraph {
    let layer_of = layers(shapes, edges);
    let count = layer_of.iter().max().map_or(0, |last| last + 1);
    let mut layered = LayeredGraph {
        vertices: Vec::new(),
        segments: Vec::new(),
        layers: vec![Vec::new(); count],
        dummies: Vec::new(),
        layer_of,
    };
    for (shape, it) in shapes.iter().enumerate() {
        let layer = layered.layer_of[shape];
        layered.add(layer, it.height, Some(shape));
    }
    let mut shared: BTreeMap<((usize, usize), bool, usize), usize> = BTreeMap::new();
    for edge in edges {
        let dummies = layered.add_edge(edge, shapes, &mut shared);
        layered.dummies.push(dummies);
    }
    layered
}

impl LayeredGraph {
    fn add(&mut self, layer: usize, height: f64, shape: Option<usize>) -> usize {
        let vertex = self.vertices.len();
        self.vertices.push(Vertex {
            layer,
            height,
            shape,
        });
        self.layers[layer].push(vertex);
        vertex
    }

    /// Adds an edge; returns its dummy vertices, created where no other edge of the same output has them. `None` for a
    /// backward edge.
    fn add_edge(
        &mut self,
        edge: &Edge,
        shapes: &[NodeShape],
        shared: &mut BTreeMap<((usize, usize), bool, usize), usize>,
    ) -> Option<Vec<usize>> {
        let (first, last) = (self.layer_of[edge.from.0], self.layer_of[edge.to.0]);
        if last <= first {
            return None;
        }
        let mut dummies = Vec::new();
        // Boxes are the first vertices, in their order.
        let (mut from, mut from_y) = (edge.from.0, shapes[edge.from.0].outputs[edge.from.1]);
        for layer in first + 1..last {
            let key = (edge.from, edge.delayed, layer);
            let vertex = match shared.get(&key) {
                Some(vertex) => *vertex,
                None => {
                    let vertex = self.add(layer, 0.0, None);
                    shared.insert(key, vertex);
                    self.segments.push(EdgeSegment {
                        from,
                        from_y,
                        to: vertex,
                        to_y: 0.0,
                    });
                    vertex
                }
            };
            dummies.push(vertex);
            (from, from_y) = (vertex, 0.0);
        }
        self.segments.push(EdgeSegment {
            from,
            from_y,
            to: edge.to.0,
            to_y: shapes[edge.to.0].inputs[edge.to.1],
        });
        Some(dummies)
    }
}

/// Returns the layer of each box.
fn layers(shapes: &[NodeShape], edges: &[Edge]) -> Vec<usize> {
    let forward = without_cycles(shapes.len(), edges);
    let has_first = shapes
        .iter()
        .any(|shape| shape.constraint == LayerConstraint::First);
    let least =
        |shape: &NodeShape| usize::from(has_first && shape.constraint != LayerConstraint::First);
    let mut layers: Vec<usize> = shapes.iter().map(least).collect();
    let order = topological(shapes.len(), &forward);
    let mut readers = vec![Vec::new(); shapes.len()];
    let mut is_read_late = vec![false; shapes.len()];
    for edge in &forward {
        readers[edge.from.0].push(edge.to.0);
        is_read_late[edge.to.0] = true;
    }
    for shape in &order {
        for reader in &readers[*shape] {
            layers[*reader] = layers[*reader].max(layers[*shape] + 1);
        }
    }
    // Boxes without inputs are placed next to the first of their readers.
    for (shape, readers) in readers.iter().enumerate() {
        let nearest = readers.iter().map(|reader| layers[*reader]).min();
        if let (Some(nearest), false, LayerConstraint::Free) =
            (nearest, is_read_late[shape], shapes[shape].constraint)
        {
            layers[shape] = nearest - 1;
        }
    }
    let free = shapes.iter().zip(&layers);
    let free = free.filter(|(shape, _)| shape.constraint != LayerConstraint::Last);
    let last = free.map(|(_, layer)| layer + 1).max().unwrap_or(0);
    for (shape, layer) in shapes.iter().zip(&mut layers) {
        if shape.constraint == LayerConstraint::Last {
            *layer = last;
        }
    }
    layers
}

/// Returns the edges that constrain the order, without those that close a cycle.
fn without_cycles(shapes: usize, edges: &[Edge]) -> Vec<Edge> {
    let mut out = vec![Vec::new(); shapes];
    for edge in edges
        .iter()
        .filter(|edge| !edge.delayed && edge.from.0 != edge.to.0)
    {
        out[edge.from.0].push(*edge);
    }
    // 0 = not visited, 1 = on the current path, 2 = finished.
    let mut state = vec![0_u8; shapes];
    let mut kept = Vec::new();
    for root in 0..shapes {
        if state[root] != 0 {
            continue;
        }
        state[root] = 1;
        let mut way = vec![(root, 0)];
        while let Some((shape, next)) = way.last_mut() {
            let Some(edge) = out[*shape].get(*next).copied() else {
                state[*shape] = 2;
                way.pop();
                continue;
            };
            *next += 1;
            let to = edge.to.0;
            if state[to] != 1 {
                kept.push(edge);
            }
            if state[to] == 0 {
                state[to] = 1;
                way.push((to, 0));
            }
        }
    }
    kept
}

fn topological(shapes: usize, edges: &[Edge]) -> Vec<usize> {
    let mut waits = vec![0; shapes];
    let mut readers = vec![Vec::new(); shapes];
    for edge in edges {
        waits[edge.to.0] += 1;
        readers[edge.from.0].push(edge.to.0);
    }
    let mut order: Vec<usize> = (0..shapes).filter(|shape| waits[*shape] == 0).collect();
    let mut done = 0;
    while let Some(shape) = order.get(done).copied() {
        done += 1;
        for reader in &readers[shape] {
            waits[*reader] -= 1;
            if waits[*reader] == 0 {
                order.push(*reader);
            }
        }
    }
    order
}
