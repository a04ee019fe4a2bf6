//! Layout of a net with boxes, links and frames around fragments. Each frame is laid out separately within the outer
//! one, so frames never overlap. Pure.

use std::collections::{BTreeMap, BTreeSet};

use rcc_language::structure::{NetStructure, PrimitiveRole};

use super::boxes::{PrimitiveBox, boxes};
use super::layout::{Edge, LayerConstraint, LinkRoute, NodeShape, PlanePoint, layout};
use super::{PortValues, frame_title, is_label, links};

/// Largest number of boxes that is drawn.
pub const BOXES_MAX: usize = 400;

/// Height of a frame's title.
const TITLE: f64 = 30.0;
/// Width of a page, from which on a drawing is wrapped.
pub const PAGE: f64 = 1100.0;
/// Margin within a frame.
const MARGIN: f64 = 18.0;

/// A laid-out net.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NetScene {
    /// Boxes and their top left corners.
    pub boxes: Vec<(PrimitiveBox, PlanePoint)>,
    /// Frames of fragments, outer ones first.
    pub frames: Vec<FragmentFrame>,
    /// Links, in segments from frame to frame.
    pub links: Vec<LinkSegment>,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

/// Frame of an instance of a fragment.
#[derive(Clone, Debug, PartialEq)]
pub struct FragmentFrame {
    /// Title.
    pub title: String,
    /// Top left corner.
    pub at: PlanePoint,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

/// Source of a link: primitive, output, and true if delayed by a cycle.
pub type Signal = (usize, usize, bool);

/// Segment of a link.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkSegment {
    /// Source of the link.
    pub signal: Signal,
    /// Primitive and input at its end; `None` if it ends at a frame.
    pub to: Option<(usize, usize)>,
    /// Course of the segment.
    pub route: LinkRoute,
}

/// A net with too many boxes for a diagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooManyBoxes {
    /// Number of its boxes.
    pub boxes: usize,
}

/// Lays out a net.
///
/// # Errors
/// Fails if the net has more than [`BOXES_MAX`] boxes.
pub fn scene(net: &NetStructure, values: Option<&PortValues>) -> Result<NetScene, TooManyBoxes> {
    let boxes = boxes(net, values);
    if boxes.len() > BOXES_MAX {
        return Err(TooManyBoxes { boxes: boxes.len() });
    }
    let mut root = FrameGroup::default();
    for (number, it) in boxes.iter().enumerate() {
        let path: Vec<&str> = net.primitives[it.part].frames().collect();
        root.insert(&path, number);
    }
    let builder = SceneBuilder {
        net,
        boxes: &boxes,
        links: drawn_links(net),
    };
    let arranged = builder.arrange(&root, None);
    let at = |number: usize, at: PlanePoint| (boxes[number].clone(), at);
    Ok(NetScene {
        boxes: arranged
            .boxes
            .into_iter()
            .map(|(number, point)| at(number, point))
            .collect(),
        frames: arranged.frames,
        links: arranged.links,
        width: arranged.width,
        height: arranged.height,
    })
}

/// A link between two boxes: source, and reading primitive and input.
type DrawnLink = (Signal, (usize, usize));

fn drawn_links(net: &NetStructure) -> Vec<DrawnLink> {
    let drawn = links(net).filter(|(reader, _, _, link)| {
        let constant = net.primitives[link.primitive].role == PrimitiveRole::Constant;
        !constant && !is_label(net, &net.primitives[*reader])
    });
    let drawn_links = drawn.map(|(reader, input, _, link)| {
        ((link.primitive, link.output, link.delayed), (reader, input))
    });
    let mut seen = BTreeSet::new();
    drawn_links.filter(|link| seen.insert(*link)).collect()
}

/// Boxes and groups within one instance of a fragment.
#[derive(Default)]
struct FrameGroup {
    path: String,
    boxes: Vec<usize>,
    groups: Vec<FrameGroup>,
}

impl FrameGroup {
    /// Adds a box; `path` names all groups from the outermost to the one that contains the box.
    fn insert(&mut self, path: &[&str], number: usize) {
        let Some((first, rest)) = path.split_first() else {
            self.boxes.push(number);
            return;
        };
        let found = self.groups.iter().position(|group| group.path == *first);
        let found = found.unwrap_or_else(|| {
            self.groups.push(FrameGroup {
                path: (*first).to_owned(),
                ..FrameGroup::default()
            });
            self.groups.len() - 1
        });
        self.groups[found].insert(rest, number);
    }
}

/// Layout of a group.
#[derive(Default)]
struct GroupLayout {
    width: f64,
    height: f64,
    inputs: Vec<(Signal, f64)>,
    outputs: Vec<(Signal, f64)>,
    boxes: Vec<(usize, PlanePoint)>,
    frames: Vec<FragmentFrame>,
    links: Vec<LinkSegment>,
}

impl GroupLayout {
    fn shape(&self) -> NodeShape {
        NodeShape {
            width: self.width,
            height: self.height,
            inputs: self.inputs.iter().map(|(_, y)| *y).collect(),
            outputs: self.outputs.iter().map(|(_, y)| *y).collect(),
            constraint: LayerConstraint::Free,
        }
    }

    /// Adds the contents of an inner group, moved by `by`.
    fn absorb(&mut self, inner: GroupLayout, by: PlanePoint) {
        let add = |at: PlanePoint| PlanePoint {
            x: at.x + by.x,
            y: at.y + by.y,
        };
        let boxes = inner.boxes.into_iter();
        self.boxes
            .extend(boxes.map(|(number, at)| (number, add(at))));
        let frames = inner.frames.into_iter();
        self.frames.extend(frames.map(|frame| FragmentFrame {
            at: add(frame.at),
            ..frame
        }));
        let links = inner.links.into_iter();
        self.links.extend(links.map(|segment| LinkSegment {
            route: segment.route.moved(by),
            ..segment
        }));
    }
}

struct SceneBuilder<'a> {
    net: &'a NetStructure,
    boxes: &'a [PrimitiveBox],
    links: Vec<DrawnLink>,
}

/// Builds the edges of a group.
struct EdgeBuilder<'a> {
    builder: &'a SceneBuilder<'a>,
    group: &'a FrameGroup,
    inner: &'a [GroupLayout],
    /// Box or inner group that contains each primitive.
    owner: BTreeMap<usize, usize>,
    /// Shapes on the border for each incoming and outgoing signal.
    incoming: BTreeMap<Signal, usize>,
    outgoing: BTreeMap<Signal, usize>,
    shapes: Vec<NodeShape>,
}

impl SceneBuilder<'_> {
    /// Lays out a group; `title` is the title of its frame.
    fn arrange(&self, group: &FrameGroup, title: Option<&str>) -> GroupLayout {
        let inner: Vec<GroupLayout> = group
            .groups
            .iter()
            .map(|inner| self.arrange(inner, Some(&frame_title(self.net, &inner.path))))
            .collect();
        let mut ends = EdgeBuilder::new(self, group, &inner);
        let mut edges: Vec<Edge> = Vec::new();
        let mut known = BTreeSet::new();
        for (signal, to) in &self.links {
            let edge = ends.edge(*signal, *to);
            edges.extend(edge.filter(|edge| known.insert(*edge)));
        }
        // Frames stay whole: their links must end on their borders.
        let page = if title.is_none() { PAGE } else { f64::INFINITY };
        let laid = layout(&ends.shapes, &edges, page);
        let EdgeBuilder {
            shapes,
            incoming,
            outgoing,
            ..
        } = ends;
        let framed = title.is_some();
        let by = PlanePoint {
            x: if framed && incoming.is_empty() {
                MARGIN
            } else {
                0.0
            },
            y: if framed { TITLE } else { 0.0 },
        };
        let mut out = GroupLayout {
            width: laid.width
                + by.x
                + if framed && outgoing.is_empty() {
                    MARGIN
                } else {
                    0.0
                },
            height: laid.height + by.y + if framed { MARGIN } else { 0.0 },
            ..GroupLayout::default()
        };
        let border = |borders: &BTreeMap<Signal, usize>| -> Vec<(Signal, f64)> {
            let borders = borders.iter();
            borders
                .map(|(signal, shape)| (*signal, laid.positions[*shape].y + by.y))
                .collect()
        };
        (out.inputs, out.outputs) = (border(&incoming), border(&outgoing));
        if let Some(title) = title {
            out.frames.push(FragmentFrame {
                title: title.to_owned(),
                at: PlanePoint::default(),
                width: out.width,
                height: out.height,
            });
        }
        for (edge, route) in edges.iter().zip(laid.routes) {
            out.links.push(self.link_segment(
                group,
                &incoming,
                edge,
                route.moved(by),
                &inner,
                out.width,
                &shapes,
            ));
        }
        let point = |shape: usize| PlanePoint {
            x: laid.positions[shape].x + by.x,
            y: laid.positions[shape].y + by.y,
        };
        for (shape, it) in group.boxes.iter().enumerate() {
            out.boxes.push((*it, point(shape)));
        }
        for (number, inner) in inner.into_iter().enumerate() {
            out.absorb(inner, point(group.boxes.len() + number));
        }
        out
    }

    /// Creates the link segment of an edge, extended to the border of the frame where the link enters or leaves.
    #[allow(clippy::too_many_arguments)]
    fn link_segment(
        &self,
        group: &FrameGroup,
        incoming: &BTreeMap<Signal, usize>,
        edge: &Edge,
        route: LinkRoute,
        inner: &[GroupLayout],
        width: f64,
        shapes: &[NodeShape],
    ) -> LinkSegment {
        let (from, output) = edge.from;
        let signal = match group.boxes.get(from) {
            Some(it) => {
                let it = &self.boxes[*it];
                (it.part, it.outputs[output].port, edge.delayed)
            }
            None => match inner.get(from - group.boxes.len()) {
                Some(inner) => inner.outputs[output].0,
                // An incoming signal: there is one shape per signal.
                None => incoming
                    .iter()
                    .find(|(_, shape)| **shape == from)
                    .map_or((0, 0, false), |(signal, _)| *signal),
            },
        };
        let to = group.boxes.get(edge.to.0).map(|it| {
            let it = &self.boxes[*it];
            (it.part, it.inputs[edge.to.1].port)
        });
        LinkSegment {
            signal,
            to,
            route: to_border(
                route,
                shapes[from].constraint,
                shapes[edge.to.0].constraint,
                width,
            ),
        }
    }
}

fn to_border(
    route: LinkRoute,
    from: LayerConstraint,
    to: LayerConstraint,
    width: f64,
) -> LinkRoute {
    let extended = |mut points: Vec<PlanePoint>| {
        if let (LayerConstraint::First, Some(first)) = (from, points.first().copied()) {
            points.insert(0, PlanePoint { x: 0.0, ..first });
        }
        if let (LayerConstraint::Last, Some(last)) = (to, points.last().copied()) {
            points.push(PlanePoint { x: width, ..last });
        }
        points.dedup();
        points
    };
    match route {
        LinkRoute::Curve(points) => LinkRoute::Curve(extended(points)),
        LinkRoute::Around(points) => LinkRoute::Around(extended(points)),
    }
}

impl<'a> EdgeBuilder<'a> {
    fn new(
        builder: &'a SceneBuilder<'a>,
        group: &'a FrameGroup,
        inner: &'a [GroupLayout],
    ) -> EdgeBuilder<'a> {
        let boxes = group.boxes.iter().map(|it| &builder.boxes[*it]);
        let mut owner: BTreeMap<usize, usize> = boxes
            .clone()
            .enumerate()
            .map(|(shape, it)| (it.part, shape))
            .collect();
        let mut shapes: Vec<NodeShape> = boxes.map(PrimitiveBox::shape).collect();
        for inner in inner {
            let parts = inner.boxes.iter().map(|(it, _)| builder.boxes[*it].part);
            owner.extend(parts.map(|part| (part, shapes.len())));
            shapes.push(inner.shape());
        }
        EdgeBuilder {
            builder,
            group,
            inner,
            owner,
            incoming: BTreeMap::new(),
            outgoing: BTreeMap::new(),
            shapes,
        }
    }

    /// Returns the edge of a link in this group; `None` if the link is outside of the group or within an inner group.
    fn edge(&mut self, signal: Signal, to: (usize, usize)) -> Option<Edge> {
        let owner = |part: usize| self.owner.get(&part).copied();
        let (source, reader) = (owner(signal.0), owner(to.0));
        let boxes = self.group.boxes.len();
        if source == reader && source.is_none_or(|shape| shape >= boxes) {
            return None;
        }
        let from = match source {
            Some(shape) if shape < boxes => {
                let it = &self.builder.boxes[self.group.boxes[shape]];
                (shape, PrimitiveBox::label(&it.outputs, signal.1)?)
            }
            Some(shape) => {
                let outputs = &self.inner[shape - boxes].outputs;
                (
                    shape,
                    outputs.iter().position(|(known, _)| *known == signal)?,
                )
            }
            None => (
                EdgeBuilder::border(
                    &mut self.incoming,
                    &mut self.shapes,
                    signal,
                    LayerConstraint::First,
                ),
                0,
            ),
        };
        let to = match reader {
            Some(shape) if shape < boxes => {
                let it = &self.builder.boxes[self.group.boxes[shape]];
                (shape, PrimitiveBox::label(&it.inputs, to.1)?)
            }
            Some(shape) => {
                let inputs = &self.inner[shape - boxes].inputs;
                (
                    shape,
                    inputs.iter().position(|(known, _)| *known == signal)?,
                )
            }
            None => (
                EdgeBuilder::border(
                    &mut self.outgoing,
                    &mut self.shapes,
                    signal,
                    LayerConstraint::Last,
                ),
                0,
            ),
        };
        Some(Edge {
            from,
            to,
            // Incoming and outgoing links always constrain the order, even if delayed.
            delayed: signal.2 && source.is_some() && reader.is_some(),
        })
    }

    fn border(
        borders: &mut BTreeMap<Signal, usize>,
        shapes: &mut Vec<NodeShape>,
        signal: Signal,
        constraint: LayerConstraint,
    ) -> usize {
        *borders.entry(signal).or_insert_with(|| {
            shapes.push(NodeShape {
                width: 0.0,
                height: 0.0,
                inputs: vec![0.0],
                outputs: vec![0.0],
                constraint,
            });
            shapes.len() - 1
        })
    }
}
