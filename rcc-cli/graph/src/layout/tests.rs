//! Rules of the layout: layers from left to right, no overlaps, deterministic.

use proptest::prelude::*;

use super::*;

fn shape(ports: usize) -> NodeShape {
    let ys: Vec<f64> = (0..ports).map(|port| 20.0 * port as f64 + 10.0).collect();
    NodeShape {
        width: 60.0 + 10.0 * ports as f64,
        height: 20.0 * ports as f64 + 20.0,
        inputs: ys.clone(),
        outputs: ys,
        constraint: LayerConstraint::Free,
    }
}

fn overlap(a: (&NodeShape, PlanePoint), b: (&NodeShape, PlanePoint)) -> bool {
    let apart = |a0: f64, a1: f64, b0: f64, b1: f64| a1 <= b0 || b1 <= a0;
    !(apart(a.1.x, a.1.x + a.0.width, b.1.x, b.1.x + b.0.width)
        || apart(a.1.y, a.1.y + a.0.height, b.1.y, b.1.y + b.0.height))
}

/// Returns true if a straight segment of a link crosses a box.
fn is_in(shape: (&NodeShape, PlanePoint), from: PlanePoint, to: PlanePoint) -> bool {
    let (it, at) = shape;
    let between =
        |a: f64, b: f64, low: f64, high: f64| a.min(b) < high - 0.01 && a.max(b) > low + 0.01;
    between(from.x, to.x, at.x, at.x + it.width) && between(from.y, to.y, at.y, at.y + it.height)
}

fn nets() -> impl Strategy<Value = (Vec<NodeShape>, Vec<Edge>)> {
    (1_usize..25).prop_flat_map(|count| {
        let ports = prop::collection::vec(1_usize..4, count);
        let edge = (
            0..count,
            0..count,
            0_usize..4,
            0_usize..4,
            prop::bool::weighted(0.2),
        );
        let edges = prop::collection::vec(edge, 0..60);
        (ports, edges).prop_map(|(ports, edges)| {
            let edges = edges
                .into_iter()
                .map(|(from, to, output, input, delayed)| Edge {
                    from: (from, output % ports[from]),
                    to: (to, input % ports[to]),
                    delayed,
                });
            let mut edges: Vec<Edge> = edges.collect();
            edges.sort();
            edges.dedup();
            (ports.iter().map(|ports| shape(*ports)).collect(), edges)
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn boxes_never_overlap_and_links_end_at_their_ports(
        (shapes, edges) in nets(),
        page in prop::sample::select(vec![f64::INFINITY, 400.0, 150.0]),
    ) {
        let laid = layout(&shapes, &edges, page);
        for (number, a) in shapes.iter().enumerate() {
            for (other, b) in shapes.iter().enumerate().skip(number + 1) {
                prop_assert!(!overlap((a, laid.positions[number]), (b, laid.positions[other])), "{number} {other}");
            }
            let at = laid.positions[number];
            prop_assert!(at.x >= 0.0 && at.y >= 0.0);
            prop_assert!(at.x + a.width <= laid.width + 0.01 && at.y + a.height <= laid.height + 0.01);
        }
        for (edge, route) in edges.iter().zip(&laid.routes) {
            let (from, to) = (laid.positions[edge.from.0], laid.positions[edge.to.0]);
            let points = route.points();
            let start = PlanePoint { x: from.x + shapes[edge.from.0].width, y: from.y + shapes[edge.from.0].outputs[edge.from.1] };
            let end = PlanePoint { x: to.x, y: to.y + shapes[edge.to.0].inputs[edge.to.1] };
            let meets = |point: Option<&PlanePoint>, port: PlanePoint| {
                point.is_some_and(|point| (point.x - port.x).abs() < 1e-6 && (point.y - port.y).abs() < 1e-6)
            };
            prop_assert!(meets(points.first(), start), "{:?} {:?}", points.first(), start);
            prop_assert!(meets(points.last(), end), "{:?} {:?}", points.last(), end);
            for pair in points.windows(2) {
                for (shape, position) in shapes.iter().zip(&laid.positions) {
                    // Curves stay within the gap between two layers, where no box is.
                    prop_assert!(!is_in((shape, *position), pair[0], pair[1]), "{:?}", route);
                }
            }
        }
    }

    #[test]
    fn sources_are_left_of_their_readers((shapes, edges) in nets()) {
        // Only from earlier to later boxes, so there are no cycles.
        let edges: Vec<Edge> = edges.into_iter().filter(|edge| edge.from.0 < edge.to.0).collect();
        let laid = layout(&shapes, &edges, f64::INFINITY);
        for edge in edges.iter().filter(|edge| !edge.delayed) {
            let right = laid.positions[edge.from.0].x + shapes[edge.from.0].width;
            prop_assert!(right < laid.positions[edge.to.0].x);
        }
    }

    #[test]
    fn the_same_net_gives_the_same_drawing((shapes, edges) in nets()) {
        prop_assert_eq!(layout(&shapes, &edges, f64::INFINITY), layout(&shapes, &edges, f64::INFINITY));
    }
}

#[test]
fn links_are_drawn_without_crossings_where_possible() {
    // Two chains whose boxes are given in crossed order.
    let shapes = vec![shape(1); 6];
    let edge = |from: usize, to: usize| Edge {
        from: (from, 0),
        to: (to, 0),
        delayed: false,
    };
    let laid = layout(
        &shapes,
        &[edge(0, 3), edge(1, 2), edge(3, 4), edge(2, 5)],
        f64::INFINITY,
    );
    for chain in [[0, 3, 4], [1, 2, 5]] {
        let heights = chain.map(|shape| laid.positions[shape].y);
        assert!(
            heights.iter().all(|y| (y - heights[0]).abs() < 0.01),
            "{heights:?}"
        );
    }
}

#[test]
fn a_long_chain_is_wrapped_into_the_width_of_the_page() {
    let shapes = vec![shape(1); 12];
    let edge = |from: usize, to: usize, delayed: bool| Edge {
        from: (from, 0),
        to: (to, 0),
        delayed,
    };
    let mut edges: Vec<Edge> = (1..12).map(|to| edge(to - 1, to, false)).collect();
    // One link far forwards and one back to the beginning.
    edges.extend([edge(0, 11, false), edge(11, 0, true)]);
    let flat = layout(&shapes, &edges, f64::INFINITY);
    assert!(flat.width > 1000.0, "{}", flat.width);
    let page = layout(&shapes, &edges, 500.0);
    assert!(page.width < 600.0, "{}", page.width);
    assert!(page.height > 2.0 * flat.height, "{}", page.height);
    let rows = |laid: &Layout| {
        let mut lefts = laid.positions.windows(2);
        lefts.by_ref().filter(|pair| pair[1].x < pair[0].x).count() + 1
    };
    // The width of the page is for four of the twelve boxes in a row.
    assert_eq!((rows(&flat), rows(&page)), (1, 3));
    // Every link still runs along the axes or within the gap of two layers, from port to port.
    for (edge, route) in edges.iter().zip(&page.routes) {
        let (first, last) = (route.points()[0], route.points()[route.points().len() - 1]);
        let (from, to) = (page.positions[edge.from.0], page.positions[edge.to.0]);
        assert_eq!((first.x, last.x), (from.x + shapes[0].width, to.x));
    }
}

#[test]
fn an_empty_graph_has_an_empty_layout() {
    assert_eq!(layout(&[], &[], 100.0), Layout::default());
}
