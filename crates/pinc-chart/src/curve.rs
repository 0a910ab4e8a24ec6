//! The way of a curve from data to ink: steps, gaps, cuts at the frame, thinning.

/// A point: in data units or in pixels.
pub type Point = (f64, f64);

/// A curve whose values hold until the next point, with its corners written out.
pub fn held_until_next(points: &[Point]) -> Vec<Point> {
    let corner = |pair: &[Point]| [pair[0], (pair[1].0, pair[0].1)];
    let last = points.last().copied();
    points.windows(2).flat_map(corner).chain(last).collect()
}

/// A curve whose values have held since the previous point, with its corners written out.
pub fn held_since_previous(points: &[Point]) -> Vec<Point> {
    let corner = |pair: &[Point]| [(pair[0].0, pair[1].1), pair[1]];
    let first = points.first().copied();
    first.into_iter().chain(points.windows(2).flat_map(corner)).collect()
}

/// A curve less a baseline, at the positions of the curve that the baseline reaches; between its points
/// the baseline is interpolated linearly. What is less than `rounding` times the values is 0.
pub fn difference(curve: &[Point], baseline: &[Point], rounding: f64) -> Vec<Point> {
    let at = |&(x, value): &Point| {
        let expected = interpolated(baseline, x)?;
        let equal = (value - expected).abs() <= rounding * value.abs().max(expected.abs());
        Some((x, if equal { 0.0 } else { value - expected }))
    };
    curve.iter().filter_map(at).collect()
}

/// The value of a curve at a position, with positions that differ by rounding as one; `None` outside of
/// it.
fn interpolated(curve: &[Point], x: f64) -> Option<f64> {
    let slack = 1e-9 * x.abs();
    let after = curve.partition_point(|point| point.0 < x - slack);
    let (x1, y1) = *curve.get(after)?;
    if x1 <= x + slack {
        return Some(y1);
    }
    let (x0, y0) = *curve.get(after.checked_sub(1)?)?;
    Some(y0 + (x - x0) / (x1 - x0) * (y1 - y0))
}

/// The points without the corners of steps, and with each value once: 1 if a value holds until the
/// next point, -1 if it has held since the previous one, 0 with all points if they are no steps.
pub(crate) fn held(points: &[Point]) -> (i8, Vec<Point>) {
    let equal = |a: f64, b: f64| a.to_bits() == b.to_bits();
    let corners = |x: usize, y: usize| {
        let at = |three: &[Point]| equal(three[1].0, three[x].0) && equal(three[1].1, three[y].1);
        points.len() > 2 && points.windows(3).step_by(2).all(at)
    };
    if points.len().is_multiple_of(2) || !(corners(2, 0) || corners(0, 2)) {
        return (0, points.to_vec());
    }
    let kept = |all: Vec<Point>, repeats: fn(&[Point], usize) -> bool| {
        let last = all.len() - 1;
        let inner = (0..=last).filter(|i| *i == 0 || *i == last || !repeats(&all, *i));
        inner.map(|i| all[i]).collect()
    };
    let all: Vec<Point> = points.iter().step_by(2).copied().collect();
    match corners(2, 0) {
        true => (1, kept(all, |all, i| all[i].1.to_bits() == all[i - 1].1.to_bits())),
        false => (-1, kept(all, |all, i| all[i].1.to_bits() == all[i + 1].1.to_bits())),
    }
}

/// About `most` points at most: of each of many groups the first, the last, the lowest, the highest
/// and a gap.
pub(crate) fn simplified_to(points: &[Point], most: usize) -> Vec<Point> {
    if points.len() <= most {
        return points.to_vec();
    }
    let length = points.len().div_ceil((most / 4).max(1));
    let of_group = |group: &[Point]| {
        let known = || (0..group.len()).filter(|i| group[*i].1.is_finite());
        let by_height = |a: &usize, b: &usize| group[*a].1.total_cmp(&group[*b].1);
        let gap = (0..group.len()).find(|i| !group[*i].1.is_finite());
        let ends = [Some(0), Some(group.len() - 1), gap];
        let extremes = [known().min_by(by_height), known().max_by(by_height)];
        let mut kept: Vec<usize> = ends.into_iter().chain(extremes).flatten().collect();
        kept.sort_unstable();
        kept.dedup();
        kept.into_iter().map(|i| group[i]).collect::<Vec<_>>()
    };
    points.chunks(length).flat_map(of_group).collect()
}

/// The points whose two numbers are finite.
pub fn present(points: Vec<Point>) -> Vec<Point> {
    let finite = |p: &Point| p.0.is_finite() && p.1.is_finite();
    points.into_iter().filter(finite).collect()
}

/// A rectangle in pixels, y downwards.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub left: f64,
    pub top: f64,
    pub width: f64,
    pub height: f64,
}

impl Frame {
    pub(crate) fn right(&self) -> f64 {
        self.left + self.width
    }

    pub(crate) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    pub(crate) fn contains(&self, (x, y): Point) -> bool {
        (self.left..=self.right()).contains(&x) && (self.top..=self.bottom()).contains(&y)
    }

    /// Whether a part of the segment from `a` to `b` lies inside.
    pub(crate) fn is_crossed_by(&self, a: Point, b: Point) -> bool {
        self.cut(a, b).is_some()
    }

    /// The part of the segment from `a` to `b` inside the frame (Liang and Barsky), if any.
    fn cut(&self, a: Point, b: Point) -> Option<(Point, Point)> {
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let edges = [
            (-dx, a.0 - self.left),
            (dx, self.right() - a.0),
            (-dy, a.1 - self.top),
            (dy, self.bottom() - a.1),
        ];
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        for (direction, distance) in edges {
            if direction < 0.0 {
                from = from.max(distance / direction);
            } else if direction > 0.0 {
                to = to.min(distance / direction);
            } else if distance < 0.0 {
                return None;
            }
        }
        let at = |s: f64| (a.0 + s * dx, a.1 + s * dy);
        (from <= to).then(|| (at(from), at(to)))
    }
}

/// The pieces of a curve inside a frame. A `None` in the curve is a gap.
pub(crate) fn pieces(curve: &[Option<Point>], frame: &Frame) -> Vec<Vec<Point>> {
    let mut pieces = Vec::new();
    for run in curve.split(Option::is_none) {
        let run: Vec<Point> = run.iter().flatten().copied().collect();
        match run[..] {
            [] => {}
            [only] if frame.contains(only) => pieces.push(vec![only]),
            _ => pieces_of_run(&run, frame, &mut pieces),
        }
    }
    pieces
}

fn pieces_of_run(run: &[Point], frame: &Frame, pieces: &mut Vec<Vec<Point>>) {
    let mut piece: Vec<Point> = Vec::new();
    for pair in run.windows(2) {
        let Some((from, to)) = frame.cut(pair[0], pair[1]) else {
            pieces.extend(finished(&mut piece));
            continue;
        };
        if piece.is_empty() {
            piece.push(from);
        }
        piece.push(to);
        if !same(to, pair[1]) {
            pieces.extend(finished(&mut piece));
        }
    }
    pieces.extend(finished(&mut piece));
}

fn finished(piece: &mut Vec<Point>) -> Option<Vec<Point>> {
    (!piece.is_empty()).then(|| std::mem::take(piece))
}

/// Whether a segment's end was left where it was, and not cut off.
fn same(a: Point, b: Point) -> bool {
    (a.0 - b.0).abs() + (a.1 - b.1).abs() < 1e-6
}

/// Drops points that a picture cannot show: in columns of some pixels' width with more than four
/// points all but the first, the lowest, the highest and the last.
pub(crate) fn thinned(points: &[Point], width: f64) -> Vec<Point> {
    let mut out = Vec::with_capacity(points.len());
    let column = |p: &Point| (p.0 / width).floor();
    for group in points.chunk_by(|a, b| column(a).total_cmp(&column(b)).is_eq()) {
        if group.len() <= 4 {
            out.extend_from_slice(group);
        } else {
            out.extend(extremes(group));
        }
    }
    out
}

fn extremes(group: &[Point]) -> impl Iterator<Item = Point> {
    let by_height = |a: &usize, b: &usize| group[*a].1.total_cmp(&group[*b].1);
    let lowest = (0..group.len()).min_by(by_height).unwrap_or(0);
    let highest = (0..group.len()).max_by(by_height).unwrap_or(0);
    let mut kept = vec![0, lowest, highest, group.len() - 1];
    kept.sort_unstable();
    kept.dedup();
    kept.into_iter().map(|i| group[i])
}

/// How far a line may be from a point that it leaves out, in pixels: much less than its width.
const INVISIBLE: f64 = 0.1;
/// A line with more points than that is noise, of which whole pixels show as much as halves.
const NOISY: usize = 2000;

/// A line with fewer corners that nobody can tell from the one through all `points` (Douglas and
/// Peucker, 1973).
pub(crate) fn simplified(points: &[Point]) -> Vec<Point> {
    let mut points = thinned(points, 0.5);
    if points.len() > NOISY {
        points = thinned(&points, 1.0);
    }
    let Some(last) = points.len().checked_sub(1) else { return points };
    let mut kept = vec![false; points.len()];
    (kept[0], kept[last]) = (true, true);
    let mut spans = vec![(0, last)];
    while let Some((from, to)) = spans.pop() {
        let distance = |i: &usize| distance_to_segment(points[*i], points[from], points[to]);
        let inner = from + 1..to;
        let farthest = inner.max_by(|a, b| distance(a).total_cmp(&distance(b)));
        if let Some(corner) = farthest.filter(|i| distance(i) > INVISIBLE) {
            kept[corner] = true;
            spans.extend([(from, corner), (corner, to)]);
        }
    }
    points.into_iter().zip(kept).filter_map(|(point, kept)| kept.then_some(point)).collect()
}

fn distance_to_segment(p: Point, a: Point, b: Point) -> f64 {
    let (along, to) = ((b.0 - a.0, b.1 - a.1), (p.0 - a.0, p.1 - a.1));
    let square = along.0 * along.0 + along.1 * along.1;
    let share = if square > 0.0 { (to.0 * along.0 + to.1 * along.1) / square } else { 0.0 };
    let share = share.clamp(0.0, 1.0);
    (to.0 - share * along.0).hypot(to.1 - share * along.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: Frame = Frame { left: 0.0, top: 0.0, width: 10.0, height: 10.0 };

    #[test]
    fn a_segment_is_cut_at_each_edge_of_a_frame() {
        let frame = Frame { left: 1.0, top: 20.0, width: 4.0, height: 10.0 };
        for (from, to, ends) in [
            ((3.0, 10.0), (3.0, 40.0), Some(((3.0, 20.0), (3.0, 30.0)))),
            ((0.0, 25.0), (10.0, 25.0), Some(((1.0, 25.0), (5.0, 25.0)))),
            ((3.0, 10.0), (3.0, 19.0), None),
            ((0.0, 21.0), (0.5, 29.0), None),
        ] {
            assert_eq!(frame.cut(from, to), ends, "{from:?} {to:?}");
        }
    }

    #[test]
    fn curves_are_subtracted_at_their_own_positions() {
        let baseline = [(0.0, 1.0), (2.0, 3.0), (4.0, -1.0)];
        let curve =
            [(-1.0, 9.0), (0.0, 1.0), (0.5, 2.5), (2.0 + 1e-12, 2.0), (3.0, 1.5), (5.0, 0.0)];
        // The baseline is 1.5 at 0.5 and 1 at 3.
        let expected = [(0.0, 0.0), (0.5, 1.0), (2.0, -1.0), (3.0, 0.5)];
        let found = difference(&curve, &baseline, 1e-13);
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (found, expected) in found.iter().zip(expected) {
            let apart = (found.0 - expected.0).abs().max((found.1 - expected.1).abs());
            assert!(apart < 1e-9, "{found:?} instead of {expected:?}");
        }
        assert!(difference(&curve, &[], 1e-13).is_empty());
        assert_eq!(difference(&[(0.0, 1e5 + 1e-10)], &[(0.0, 1e5)], 1e-13), [(0.0, 0.0)]);
    }

    #[test]
    fn steps_get_their_corners() {
        let points = [(0.0, 1.0), (1.0, 2.0)];
        let until = [(0.0, 1.0), (1.0, 1.0), (1.0, 2.0)];
        assert_eq!(held_until_next(&points), until);
        let since = [(0.0, 1.0), (0.0, 2.0), (1.0, 2.0)];
        assert_eq!(held_since_previous(&points), since);
        assert!(held_until_next(&[]).is_empty());
        assert_eq!(held_since_previous(&points[..1]), points[..1]);
    }

    #[test]
    fn a_curve_is_cut_at_the_frame_and_at_gaps() {
        let curve = [
            Some((1.0, 5.0)),
            Some((2.0, 15.0)),
            Some((3.0, 5.0)),
            None,
            Some((8.0, 5.0)),
            Some((8.0, -1e9)),
            None,
            Some((4.0, 4.0)),
            None,
            Some((40.0, 4.0)),
        ];
        let pieces = pieces(&curve, &FRAME);
        let expected: [&[Point]; 4] = [
            &[(1.0, 5.0), (1.5, 10.0)],
            &[(2.5, 10.0), (3.0, 5.0)],
            &[(8.0, 5.0), (8.0, 0.0)],
            &[(4.0, 4.0)],
        ];
        assert_eq!(pieces.len(), expected.len());
        for (piece, expected) in pieces.iter().zip(expected) {
            for (p, e) in piece.iter().zip(expected) {
                assert!(same(*p, *e), "{p:?} is not {e:?}");
            }
        }
    }

    #[test]
    fn thinning_keeps_extremes_and_order() {
        let mut points: Vec<Point> =
            (0..10_000).map(|i| f64::from(i) * 1e-3).map(|x| (x, (700.0 * x).sin())).collect();
        points[4321].1 = 99.0;
        points[7777].1 = -99.0;
        let thin = thinned(&points, 0.5);
        assert!(thin.len() <= 20 * 4, "{} points left", thin.len());
        assert!(thin.contains(&points[4321]) && thin.contains(&points[7777]));
        assert!(thin.is_sorted_by(|a, b| a.0 <= b.0));
        assert_eq!((thin.first(), thin.last()), (points.first(), points.last()));
    }

    #[test]
    fn a_simplified_line_is_too_near_to_see_the_difference() {
        let steps = [(0.0, 1.0), (1.0, 1.0), (2.0, 1.0), (2.0, 3.0), (5.0, 3.0)];
        assert_eq!(simplified(&steps), [(0.0, 1.0), (2.0, 1.0), (2.0, 3.0), (5.0, 3.0)]);
        let wave = |x: f64| 50.0 + 40.0 * (x / 60.0).sin();
        let points: Vec<Point> = (0..1000).map(f64::from).map(|x| (x, wave(x))).collect();
        let line = simplified(&points);
        assert!(line.len() < 150, "{} corners left", line.len());
        for &p in &points {
            let near = line.windows(2).map(|ends| distance_to_segment(p, ends[0], ends[1]));
            assert!(near.fold(f64::INFINITY, f64::min) <= INVISIBLE);
        }
        assert!(simplified(&[]).is_empty());
        assert_eq!(simplified(&points[..1]), points[..1]);
    }
}
