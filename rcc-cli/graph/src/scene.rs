//! A net laid out: boxes, links, and frames around fragments, each frame a drawing of its own within the outer one, so
//! that frames never meet. Pure.

use std::collections::{BTreeMap, BTreeSet};

use rcc_language::anatomy::{Anatomy, PartRole};

use super::layout::{Edge, Pin, Point, Route, Shape, layout};
use super::picture::{Box, boxes};
use super::{Values, frame_title, is_label, links};

/// More boxes are no picture any more.
pub const BOXES_MAX: usize = 400;

/// Above what a frame encloses.
const TITLE: f64 = 30.0;
/// Around what a frame encloses.
const MARGIN: f64 = 18.0;

/// A net with a place for everything.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Boxes and their left upper corners.
    pub boxes: Vec<(Box, Point)>,
    /// Fragments, outer ones first.
    pub frames: Vec<Frame>,
    /// Links, in pieces from frame to frame.
    pub links: Vec<Piece>,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

/// An instance of a fragment.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Its name.
    pub title: String,
    /// Left upper corner.
    pub at: Point,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

/// What a link carries: primitive, output, and whether it is of the cycle before.
pub type Signal = (usize, usize, bool);

/// A piece of a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// What it carries.
    pub signal: Signal,
    /// The primitive and input that it ends at; `None`: at a frame.
    pub to: Option<(usize, usize)>,
    /// Its way.
    pub route: Route,
}

/// A net with too many boxes for a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooMany {
    /// How many it has.
    pub boxes: usize,
}

/// Lays a net out.
///
/// # Errors
/// The net has more than [`BOXES_MAX`] boxes.
pub fn scene(net: &Anatomy, values: Option<&Values>) -> Result<Scene, TooMany> {
    let boxes = boxes(net, values);
    if boxes.len() > BOXES_MAX {
        return Err(TooMany { boxes: boxes.len() });
    }
    let mut root = Group::default();
    for (place, it) in boxes.iter().enumerate() {
        let path: Vec<&str> = net.primitives[it.part].frames().collect();
        root.insert(&path, place);
    }
    let stage = Stage {
        net,
        boxes: &boxes,
        links: wires(net),
    };
    let arranged = stage.arrange(&root, None);
    let at = |place: usize, at: Point| (boxes[place].clone(), at);
    Ok(Scene {
        boxes: arranged
            .boxes
            .into_iter()
            .map(|(place, point)| at(place, point))
            .collect(),
        frames: arranged.frames,
        links: arranged.links,
        width: arranged.width,
        height: arranged.height,
    })
}

/// What is read by whom, of boxes only.
type Wire = (Signal, (usize, usize));

fn wires(net: &Anatomy) -> Vec<Wire> {
    let drawn = links(net).filter(|(reader, _, _, link)| {
        let constant = net.primitives[link.primitive].role == PartRole::Constant;
        !constant && !is_label(net, &net.primitives[*reader])
    });
    let wires = drawn.map(|(reader, input, _, link)| {
        ((link.primitive, link.output, link.delayed), (reader, input))
    });
    let mut seen = BTreeSet::new();
    wires.filter(|wire| seen.insert(*wire)).collect()
}

/// Boxes and groups that are in one instance of a fragment.
#[derive(Default)]
struct Group {
    path: String,
    boxes: Vec<usize>,
    groups: Vec<Group>,
}

impl Group {
    /// `path`: the names of all groups from the outermost to the one that the box is in.
    fn insert(&mut self, path: &[&str], place: usize) {
        let Some((first, rest)) = path.split_first() else {
            self.boxes.push(place);
            return;
        };
        let found = self.groups.iter().position(|group| group.path == *first);
        let found = found.unwrap_or_else(|| {
            self.groups.push(Group {
                path: (*first).to_owned(),
                ..Group::default()
            });
            self.groups.len() - 1
        });
        self.groups[found].insert(rest, place);
    }
}

/// A group with a place for everything in it.
#[derive(Default)]
struct Arranged {
    width: f64,
    height: f64,
    inputs: Vec<(Signal, f64)>,
    outputs: Vec<(Signal, f64)>,
    boxes: Vec<(usize, Point)>,
    frames: Vec<Frame>,
    links: Vec<Piece>,
}

impl Arranged {
    fn shape(&self) -> Shape {
        Shape {
            width: self.width,
            height: self.height,
            inputs: self.inputs.iter().map(|(_, y)| *y).collect(),
            outputs: self.outputs.iter().map(|(_, y)| *y).collect(),
            pin: Pin::Free,
        }
    }

    /// Takes over what is in an inner group.
    fn take(&mut self, inner: Arranged, by: Point) {
        let add = |at: Point| Point {
            x: at.x + by.x,
            y: at.y + by.y,
        };
        let boxes = inner.boxes.into_iter();
        self.boxes.extend(boxes.map(|(place, at)| (place, add(at))));
        let frames = inner.frames.into_iter();
        self.frames.extend(frames.map(|frame| Frame {
            at: add(frame.at),
            ..frame
        }));
        let links = inner.links.into_iter();
        self.links.extend(links.map(|piece| Piece {
            route: piece.route.moved(by),
            ..piece
        }));
    }
}

struct Stage<'a> {
    net: &'a Anatomy,
    boxes: &'a [Box],
    links: Vec<Wire>,
}

/// The ends of a group's edges while they are found.
struct Ends<'a> {
    stage: &'a Stage<'a>,
    group: &'a Group,
    inner: &'a [Arranged],
    /// By primitive: the box or group of this group that it is in.
    owner: BTreeMap<usize, usize>,
    /// What comes in and goes out, by signal: the shape on the border.
    coming: BTreeMap<Signal, usize>,
    going: BTreeMap<Signal, usize>,
    shapes: Vec<Shape>,
}

impl Stage<'_> {
    /// Lays out what is in a group; `title`: the name in its frame.
    fn arrange(&self, group: &Group, title: Option<&str>) -> Arranged {
        let inner: Vec<Arranged> = group
            .groups
            .iter()
            .map(|inner| self.arrange(inner, Some(&frame_title(self.net, &inner.path))))
            .collect();
        let mut ends = Ends::new(self, group, &inner);
        let mut edges: Vec<Edge> = Vec::new();
        let mut known = BTreeSet::new();
        for (signal, to) in &self.links {
            let edge = ends.edge(*signal, *to);
            edges.extend(edge.filter(|edge| known.insert(*edge)));
        }
        let laid = layout(&ends.shapes, &edges);
        let Ends {
            shapes,
            coming,
            going,
            ..
        } = ends;
        let framed = title.is_some();
        let by = Point {
            x: if framed && coming.is_empty() {
                MARGIN
            } else {
                0.0
            },
            y: if framed { TITLE } else { 0.0 },
        };
        let mut out = Arranged {
            width: laid.width
                + by.x
                + if framed && going.is_empty() {
                    MARGIN
                } else {
                    0.0
                },
            height: laid.height + by.y + if framed { MARGIN } else { 0.0 },
            ..Arranged::default()
        };
        let border = |borders: &BTreeMap<Signal, usize>| -> Vec<(Signal, f64)> {
            let borders = borders.iter();
            borders
                .map(|(signal, shape)| (*signal, laid.places[*shape].y + by.y))
                .collect()
        };
        (out.inputs, out.outputs) = (border(&coming), border(&going));
        if let Some(title) = title {
            out.frames.push(Frame {
                title: title.to_owned(),
                at: Point::default(),
                width: out.width,
                height: out.height,
            });
        }
        for (edge, route) in edges.iter().zip(laid.routes) {
            out.links.push(self.piece(
                group,
                &coming,
                edge,
                route.moved(by),
                &inner,
                out.width,
                &shapes,
            ));
        }
        let place = |shape: usize| Point {
            x: laid.places[shape].x + by.x,
            y: laid.places[shape].y + by.y,
        };
        for (shape, it) in group.boxes.iter().enumerate() {
            out.boxes.push((*it, place(shape)));
        }
        for (number, inner) in inner.into_iter().enumerate() {
            out.take(inner, place(group.boxes.len() + number));
        }
        out
    }

    /// The piece of a link that an edge is, led on to the border of the frame where it comes from or goes there.
    #[allow(clippy::too_many_arguments)]
    fn piece(
        &self,
        group: &Group,
        coming: &BTreeMap<Signal, usize>,
        edge: &Edge,
        route: Route,
        inner: &[Arranged],
        width: f64,
        shapes: &[Shape],
    ) -> Piece {
        let (from, output) = edge.from;
        let signal = match group.boxes.get(from) {
            Some(it) => {
                let it = &self.boxes[*it];
                (it.part, it.outputs[output].port, edge.delayed)
            }
            None => match inner.get(from - group.boxes.len()) {
                Some(inner) => inner.outputs[output].0,
                // It comes in: there is one shape for each signal.
                None => coming
                    .iter()
                    .find(|(_, shape)| **shape == from)
                    .map_or((0, 0, false), |(signal, _)| *signal),
            },
        };
        let to = group.boxes.get(edge.to.0).map(|it| {
            let it = &self.boxes[*it];
            (it.part, it.inputs[edge.to.1].port)
        });
        Piece {
            signal,
            to,
            route: to_border(route, shapes[from].pin, shapes[edge.to.0].pin, width),
        }
    }
}

fn to_border(route: Route, from: Pin, to: Pin, width: f64) -> Route {
    let lead = |mut points: Vec<Point>| {
        if let (Pin::First, Some(first)) = (from, points.first().copied()) {
            points.insert(0, Point { x: 0.0, ..first });
        }
        if let (Pin::Last, Some(last)) = (to, points.last().copied()) {
            points.push(Point { x: width, ..last });
        }
        points.dedup();
        points
    };
    match route {
        Route::Curve(points) => Route::Curve(lead(points)),
        Route::Around(points) => Route::Around(lead(points)),
    }
}

impl<'a> Ends<'a> {
    fn new(stage: &'a Stage<'a>, group: &'a Group, inner: &'a [Arranged]) -> Ends<'a> {
        let boxes = group.boxes.iter().map(|it| &stage.boxes[*it]);
        let mut owner: BTreeMap<usize, usize> = boxes
            .clone()
            .enumerate()
            .map(|(shape, it)| (it.part, shape))
            .collect();
        let mut shapes: Vec<Shape> = boxes.map(Box::shape).collect();
        for inner in inner {
            let parts = inner.boxes.iter().map(|(it, _)| stage.boxes[*it].part);
            owner.extend(parts.map(|part| (part, shapes.len())));
            shapes.push(inner.shape());
        }
        Ends {
            stage,
            group,
            inner,
            owner,
            coming: BTreeMap::new(),
            going: BTreeMap::new(),
            shapes,
        }
    }

    /// What a link is in this group; `None`: nothing, or a matter of a group in it.
    fn edge(&mut self, signal: Signal, to: (usize, usize)) -> Option<Edge> {
        let owner = |part: usize| self.owner.get(&part).copied();
        let (source, reader) = (owner(signal.0), owner(to.0));
        let boxes = self.group.boxes.len();
        if source == reader && source.is_none_or(|shape| shape >= boxes) {
            return None;
        }
        let from = match source {
            Some(shape) if shape < boxes => {
                let it = &self.stage.boxes[self.group.boxes[shape]];
                (shape, Box::label(&it.outputs, signal.1)?)
            }
            Some(shape) => {
                let outputs = &self.inner[shape - boxes].outputs;
                (
                    shape,
                    outputs.iter().position(|(known, _)| *known == signal)?,
                )
            }
            None => (
                Ends::border(&mut self.coming, &mut self.shapes, signal, Pin::First),
                0,
            ),
        };
        let to = match reader {
            Some(shape) if shape < boxes => {
                let it = &self.stage.boxes[self.group.boxes[shape]];
                (shape, Box::label(&it.inputs, to.1)?)
            }
            Some(shape) => {
                let inputs = &self.inner[shape - boxes].inputs;
                (
                    shape,
                    inputs.iter().position(|(known, _)| *known == signal)?,
                )
            }
            None => (
                Ends::border(&mut self.going, &mut self.shapes, signal, Pin::Last),
                0,
            ),
        };
        Some(Edge {
            from,
            to,
            // What comes in or goes out is in order, whatever it carries.
            delayed: signal.2 && source.is_some() && reader.is_some(),
        })
    }

    fn border(
        borders: &mut BTreeMap<Signal, usize>,
        shapes: &mut Vec<Shape>,
        signal: Signal,
        pin: Pin,
    ) -> usize {
        *borders.entry(signal).or_insert_with(|| {
            shapes.push(Shape {
                width: 0.0,
                height: 0.0,
                inputs: vec![0.0],
                outputs: vec![0.0],
                pin,
            });
            shapes.len() - 1
        })
    }
}
