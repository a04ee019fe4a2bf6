//! Line simplification: removes points whose removal is invisible (Ramer 1972; Douglas and Peucker 1973). Pure.

/// Returns the points needed to stay within `x` horizontally and `y` vertically of all others; keeps the end points and
/// points that are not finite.
#[must_use]
pub fn simplified(points: &[(f64, f64)], x: f64, y: f64) -> Vec<(f64, f64)> {
    let mut stays = vec![false; points.len()];
    let mut open = vec![(0, points.len().saturating_sub(1))];
    if let (Some(first), Some(last)) = (stays.first().copied(), points.len().checked_sub(1)) {
        stays[0] = !first;
        stays[last] = true;
    }
    while let Some((from, to)) = open.pop() {
        let inner = points.get(from + 1..to).unwrap_or_default();
        let far = inner.iter().zip(from + 1..).map(|(point, index)| {
            let far = distance(*point, points[from], points[to], [x, y]);
            (index, far)
        });
        let farthest = far.max_by(|(_, one), (_, other)| one.total_cmp(other));
        if let Some((index, far)) = farthest
            && far > 1.0
        {
            stays[index] = true;
            open.extend([(from, index), (index, to)]);
        }
    }
    let kept = points.iter().zip(stays).filter(|(_, stays)| *stays);
    kept.map(|(point, _)| *point).collect()
}

/// Returns the distance of a point from the line segment between two others, in units of the tolerances.
fn distance(point: (f64, f64), from: (f64, f64), to: (f64, f64), [x, y]: [f64; 2]) -> f64 {
    let [px, py] = [(point.0 - from.0) / x, (point.1 - from.1) / y];
    let [dx, dy] = [(to.0 - from.0) / x, (to.1 - from.1) / y];
    let square = dx * dx + dy * dy;
    let along = if square > 0.0 {
        ((px * dx + py * dy) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let [ex, ey] = [px - along * dx, py - along * dy];
    (ex * ex + ey * ey).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn removed_points_lie_near_the_remaining_line() {
        let wave: Vec<(f64, f64)> = (0..5000)
            .map(|i| (f64::from(i), (f64::from(i) * 0.005).sin()))
            .collect();
        let thin = simplified(&wave, 1.0, 0.01);
        assert!(thin.len() < 200, "{}", thin.len());
        assert_eq!((thin.first(), thin.last()), (wave.first(), wave.last()));
        for point in &wave {
            let near = thin
                .windows(2)
                .map(|pair| distance(*point, pair[0], pair[1], [1.0, 0.01]));
            assert!(near.fold(f64::INFINITY, f64::min) <= 1.0 + 1e-9);
        }
    }

    #[test]
    fn few_points_are_kept() {
        assert!(simplified(&[], 1.0, 1.0).is_empty());
        assert_eq!(simplified(&[(1.0, 2.0)], 1.0, 1.0), [(1.0, 2.0)]);
        let same = [(1.0, 2.0); 3];
        assert_eq!(simplified(&same, 1.0, 1.0), [(1.0, 2.0); 2]);
    }
}
