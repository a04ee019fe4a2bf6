//! LayeredGraph drawing of boxes with ports, from left to right: K. Sugiyama, S. Tagawa, M. Toda, "Methods for visual
//! understanding of hierarchical system structures", IEEE SMC 11 (1981). The same boxes and links give the same drawing.
//! Pure; run by the command line.
//!
//! No layout crate: those that need no foreign program know neither ports at fixed heights nor frames within frames.

mod coordinates;
mod layers;
mod order;
mod route;

/// A box to be placed.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeShape {
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
    /// Heights of its inputs, on its left side, from its top.
    pub inputs: Vec<f64>,
    /// Heights of its outputs, on its right side.
    pub outputs: Vec<f64>,
    /// Where it must be.
    pub constraint: LayerConstraint,
}

/// A place that is prescribed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerConstraint {
    /// None.
    Free,
    /// On the left border.
    First,
    /// On the right border.
    Last,
}

/// A link from an output of one shape to an input of another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Edge {
    /// NodeShape and output.
    pub from: (usize, usize),
    /// NodeShape and input.
    pub to: (usize, usize),
    /// It does not say what comes first.
    pub delayed: bool,
}

/// A point; y grows downwards.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanePoint {
    /// To the right.
    pub x: f64,
    /// Down.
    pub y: f64,
}

/// How a link goes.
#[derive(Clone, Debug, PartialEq)]
pub enum LinkRoute {
    /// Forwards: level at each of these points, in a curve from height to height.
    Curve(Vec<PlanePoint>),
    /// Backwards below the boxes: level and upright by turns, with rounded corners.
    Around(Vec<PlanePoint>),
}

impl LinkRoute {
    /// Its points.
    #[must_use]
    pub fn points(&self) -> &[PlanePoint] {
        match self {
            LinkRoute::Curve(points) | LinkRoute::Around(points) => points,
        }
    }

    /// The same way elsewhere.
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

/// Where everything is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    /// Left upper corners, by shape.
    pub places: Vec<PlanePoint>,
    /// By edge.
    pub routes: Vec<LinkRoute>,
    /// Width of all.
    pub width: f64,
    /// Height of all.
    pub height: f64,
}

/// What stands in a layer: a shape, or a link that dummies.
#[derive(Clone, Debug)]
struct Vertex {
    layer: usize,
    height: f64,
    /// `None`: a link that dummies.
    shape: Option<usize>,
}

/// A part of a link from one layer to the next: vertices, heights within them, and what it counts.
#[derive(Clone, Copy, Debug)]
struct EdgeSegment {
    from: usize,
    from_y: f64,
    to: usize,
    to_y: f64,
}

/// Shapes and passing links in layers.
#[derive(Debug, Default)]
struct LayeredGraph {
    vertices: Vec<Vertex>,
    segments: Vec<EdgeSegment>,
    /// By layer: vertices from top to bottom.
    layers: Vec<Vec<usize>>,
    /// By edge: the vertices where it dummies, in order; `None`: it goes backwards.
    dummies: Vec<Option<Vec<usize>>>,
    /// By shape: its layer.
    layer_of: Vec<usize>,
}

/// Places shapes and leads edges.
#[must_use]
pub fn layout(shapes: &[NodeShape], edges: &[Edge]) -> Layout {
    let mut layered = layers::layered_graph(shapes, edges);
    order::reduce_crossings(&mut layered, shapes);
    let tops = coordinates::tops(&layered, shapes);
    route::routed_layout(&layered, shapes, edges, &tops)
}

#[cfg(test)]
mod tests;
