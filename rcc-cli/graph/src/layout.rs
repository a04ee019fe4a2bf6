//! Layered drawing of boxes with ports, from left to right: K. Sugiyama, S. Tagawa, M. Toda, "Methods for visual
//! understanding of hierarchical system structures", IEEE SMC 11 (1981). The same boxes and links give the same
//! drawing. Pure; run by the command line.
//!
//! No layout crate is used: those without an external program support neither ports at fixed heights nor nested frames.

mod coordinates;
mod layers;
mod order;
mod route;
mod wrap;

/// A box to be placed.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeShape {
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
    /// Positions of its inputs on the left side, from the top.
    pub inputs: Vec<f64>,
    /// Positions of its outputs on the right side, from the top.
    pub outputs: Vec<f64>,
    /// Constraint on its layer.
    pub constraint: LayerConstraint,
}

/// Constraint on the layer of a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerConstraint {
    /// No constraint.
    Free,
    /// In the first layer, on the left border.
    First,
    /// In the last layer, on the right border.
    Last,
}

/// A link from an output of one box to an input of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Edge {
    /// Box and output.
    pub from: (usize, usize),
    /// Box and input.
    pub to: (usize, usize),
    /// True if the link does not constrain the order.
    pub delayed: bool,
}

/// A point; y points downwards.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanePoint {
    /// Horizontal position, to the right.
    pub x: f64,
    /// Vertical position, downwards.
    pub y: f64,
}

/// Course of a link.
#[derive(Clone, Debug, PartialEq)]
pub enum LinkRoute {
    /// Forward: through these points, horizontal at each, with curves between different heights.
    Curve(Vec<PlanePoint>),
    /// Backward, below the boxes: alternating horizontal and vertical lines with rounded corners.
    Around(Vec<PlanePoint>),
}

impl LinkRoute {
    /// Returns its points.
    #[must_use]
    pub fn points(&self) -> &[PlanePoint] {
        match self {
            LinkRoute::Curve(points) | LinkRoute::Around(points) => points,
        }
    }

    /// Returns the same course, moved by `by`.
    #[must_use]
    pub fn moved(self, by: PlanePoint) -> LinkRoute {
        let moved = |points: Vec<PlanePoint>| {
            let points = points.into_iter();
            points
                .map(|at| PlanePoint {
                    x: at.x + by.x,
                    y: at.y + by.y,
                })
                .collect()
        };
        match self {
            LinkRoute::Curve(points) => LinkRoute::Curve(moved(points)),
            LinkRoute::Around(points) => LinkRoute::Around(moved(points)),
        }
    }
}

/// Result of the layout.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    /// Top left corners, by box.
    pub positions: Vec<PlanePoint>,
    /// Courses of the links, by edge.
    pub routes: Vec<LinkRoute>,
    /// Total width.
    pub width: f64,
    /// Total height.
    pub height: f64,
}

/// A vertex of a layer: a box, or a dummy vertex of a link that crosses the layer.
#[derive(Clone, Debug)]
struct Vertex {
    layer: usize,
    height: f64,
    /// `None` for a dummy vertex.
    shape: Option<usize>,
}

/// Part of a link between neighbouring layers: its vertices, and the positions of its ends within them.
#[derive(Clone, Copy, Debug)]
struct EdgeSegment {
    from: usize,
    from_y: f64,
    to: usize,
    to_y: f64,
}

/// Boxes and dummy vertices in layers.
#[derive(Debug, Default)]
struct LayeredGraph {
    vertices: Vec<Vertex>,
    segments: Vec<EdgeSegment>,
    /// Vertices of each layer from top to bottom.
    layers: Vec<Vec<usize>>,
    /// Dummy vertices of each edge in order; `None` for a backward edge.
    dummies: Vec<Option<Vec<usize>>>,
    /// Layer of each box.
    layer_of: Vec<usize>,
}

/// Places boxes and routes edges. A drawing that is wider than `page` is wrapped; the lanes of the links that cross from
/// one part to the next come on top of that width. An infinite page never wraps.
#[must_use]
pub fn layout(shapes: &[NodeShape], edges: &[Edge], page: f64) -> Layout {
    let mut layered = layers::layered_graph(shapes, edges);
    order::reduce_crossings(&mut layered, shapes);
    let tops = coordinates::tops(&layered, shapes);
    let (laid, cuts) = route::routed_layout(&layered, shapes, edges, &tops, page);
    wrap::wrapped(laid, shapes, edges, &cuts)
}

#[cfg(test)]
mod tests;
