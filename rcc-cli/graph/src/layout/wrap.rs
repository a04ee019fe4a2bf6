//! Wraps a drawing into the width of a page: cuts it between layers and places the parts below each other, like lines of
//! text. A link that crosses a cut runs around the right border, through the gutter between two bands, and around the
//! left border. Pure.

use std::collections::BTreeMap;

use super::route::{LANE, shifted_to_origin};
use super::{Edge, Layout, LinkRoute, NodeShape, PlanePoint};

/// Links that share a lane at a cut: those of one output in one direction.
type LaneKey = ((usize, usize), bool, bool);

/// One part of the drawing between two cuts.
#[derive(Clone, Copy, Debug, Default)]
struct Band {
    /// Range of x in the flat drawing.
    left: f64,
    right: f64,
    /// Range of y in the flat drawing.
    top: f64,
    bottom: f64,
    /// Where its top is in the wrapped drawing.
    y: f64,
}

impl Band {
    fn cover(&mut self, top: f64, bottom: f64) {
        self.top = self.top.min(top);
        self.bottom = self.bottom.max(bottom);
    }

    /// Moves a point of the flat drawing.
    fn moved(&self, at: PlanePoint) -> PlanePoint {
        PlanePoint {
            x: at.x - self.left,
            y: at.y - self.top + self.y,
        }
    }

    fn end(&self) -> f64 {
        self.y + self.bottom - self.top
    }
}

/// The lanes of the links that cross one cut.
#[derive(Clone, Debug, Default)]
struct CutLanes {
    /// Lane of each link, counted from the top of the gutter.
    lanes: BTreeMap<LaneKey, usize>,
}

/// Wraps a drawing at these positions between layers, which are in ascending order.
pub fn wrapped(laid: Layout, shapes: &[NodeShape], edges: &[Edge], cuts: &[f64]) -> Layout {
    if cuts.is_empty() {
        return laid;
    }
    let mut bands = bands(&laid, shapes, cuts);
    let lanes: Vec<CutLanes> = (0..cuts.len())
        .map(|cut| lanes(&laid, edges, cuts, cut))
        .collect();
    for number in 1..bands.len() {
        let gutter = (lanes[number - 1].lanes.len() + 2) as f64 * LANE;
        bands[number].y = bands[number - 1].end() + gutter;
    }
    let wrap = Wrap {
        cuts,
        bands: &bands,
        lanes: &lanes,
    };
    let positions: Vec<PlanePoint> = (laid.positions.iter())
        .map(|at| bands[wrap.band_of(at.x)].moved(*at))
        .collect();
    let routes: Vec<LinkRoute> = (laid.routes.iter().zip(edges))
        .map(|(route, edge)| wrap.route(route, edge))
        .collect();
    let height = bands.last().map_or(0.0, Band::end);
    let right = bands.iter().map(|band| band.right - band.left);
    shifted_to_origin(positions, routes, right.fold(0.0, f64::max), height)
}

/// Returns the bands, at the places where they are in the flat drawing.
fn bands(laid: &Layout, shapes: &[NodeShape], cuts: &[f64]) -> Vec<Band> {
    let lefts = std::iter::once(0.0).chain(cuts.iter().copied());
    let rights = cuts.iter().copied().chain([laid.width]);
    let mut bands: Vec<Band> = lefts
        .zip(rights)
        .map(|(left, right)| Band {
            left,
            right,
            top: f64::INFINITY,
            bottom: f64::NEG_INFINITY,
            y: 0.0,
        })
        .collect();
    for (at, shape) in laid.positions.iter().zip(shapes) {
        bands[band_of(cuts, at.x)].cover(at.y, at.y + shape.height);
    }
    for route in &laid.routes {
        for pair in route.points().windows(2) {
            for number in between(band_of(cuts, pair[0].x), band_of(cuts, pair[1].x)) {
                for at in pair {
                    bands[number].cover(at.y, at.y);
                }
            }
        }
    }
    bands
}

fn band_of(cuts: &[f64], x: f64) -> usize {
    cuts.iter().filter(|cut| **cut <= x).count()
}

fn between(one: usize, other: usize) -> std::ops::RangeInclusive<usize> {
    one.min(other)..=one.max(other)
}

/// Assigns lanes to the links that cross a cut; the lowest link gets the topmost lane, so that links do not cross on
/// their way down.
fn lanes(laid: &Layout, edges: &[Edge], cuts: &[f64], cut: usize) -> CutLanes {
    let mut heights: BTreeMap<LaneKey, f64> = BTreeMap::new();
    for (route, edge) in laid.routes.iter().zip(edges) {
        for pair in route.points().windows(2) {
            let [from, to] = [pair[0], pair[1]].map(|at| band_of(cuts, at.x));
            if from.min(to) <= cut && cut < from.max(to) {
                let upper = if from < to { pair[0].y } else { pair[1].y };
                heights.insert(key(edge, from < to), upper);
            }
        }
    }
    let mut order: Vec<(LaneKey, f64)> = heights.into_iter().collect();
    order.sort_by(|one, other| other.1.total_cmp(&one.1));
    let lanes = order.into_iter().enumerate();
    CutLanes {
        lanes: lanes.map(|(lane, (key, _))| (key, lane)).collect(),
    }
}

fn key(edge: &Edge, is_forward: bool) -> LaneKey {
    // A backward link has its lane to itself: its end is its own.
    let end = if is_forward { edge.from } else { edge.to };
    (end, edge.delayed, is_forward)
}

struct Wrap<'a> {
    cuts: &'a [f64],
    bands: &'a [Band],
    lanes: &'a [CutLanes],
}

impl Wrap<'_> {
    fn band_of(&self, x: f64) -> usize {
        band_of(self.cuts, x)
    }

    fn route(&self, route: &LinkRoute, edge: &Edge) -> LinkRoute {
        let points = route.points();
        let mut out = Vec::with_capacity(points.len());
        if let Some(first) = points.first() {
            out.push(self.bands[self.band_of(first.x)].moved(*first));
        }
        for pair in points.windows(2) {
            self.cross(pair[0], pair[1], edge, &mut out);
            out.push(self.bands[self.band_of(pair[1].x)].moved(pair[1]));
        }
        match route {
            LinkRoute::Curve(_) => LinkRoute::Curve(out),
            LinkRoute::Around(_) => LinkRoute::Around(out),
        }
    }

    /// Adds the points of a link at the cuts between two of its points.
    fn cross(&self, from: PlanePoint, to: PlanePoint, edge: &Edge, out: &mut Vec<PlanePoint>) {
        let (first, last) = (self.band_of(from.x), self.band_of(to.x));
        let is_forward = first < last;
        let cuts: Vec<usize> = match is_forward {
            true => (first..last).collect(),
            false => (last..first).rev().collect(),
        };
        for cut in cuts {
            let (above, below) = (self.bands[cut], self.bands[cut + 1]);
            let count = self.lanes[cut].lanes.len();
            let lane = self.lanes[cut].lanes.get(&key(edge, is_forward));
            let lane = lane.copied().unwrap_or(0);
            // Heights at which the link leaves the upper and enters the lower band: its own at its ends, and those of
            // its horizontal course in bands between.
            let (upper, lower) = match is_forward {
                true => (from.y, to.y),
                false => (to.y, from.y),
            };
            let at_right = above.moved(PlanePoint {
                x: above.right + (lane + 1) as f64 * LANE,
                y: upper,
            });
            let at_left = below.moved(PlanePoint {
                x: below.left - (count - lane) as f64 * LANE,
                y: lower,
            });
            let y = above.end() + (lane + 1) as f64 * LANE;
            let mut corners = [
                at_right,
                PlanePoint { y, ..at_right },
                PlanePoint { y, ..at_left },
                at_left,
            ];
            if !is_forward {
                corners.reverse();
            }
            out.extend(corners);
        }
    }
}
