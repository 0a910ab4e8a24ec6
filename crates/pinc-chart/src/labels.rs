//! Places for words beside points, so that they cover neither points nor one another.

use crate::curve::{Frame, Point};
use crate::figure::Label;
use crate::svg;

/// Between a point and its word.
const AWAY: f64 = 9.0;

/// Gives each word that finds room the left end of its middle line: to the right of its point, or
/// else to the left, above, below or at a corner. `dots` are not covered, nor are the pieces of
/// `curves` where that can be helped.
pub(crate) fn placed<'a>(
    words: impl Iterator<Item = (Point, &'a Label)>,
    dots: &[Point],
    curves: &[Vec<Point>],
    frame: &Frame,
    size: f64,
) -> Vec<(Point, &'a Label)> {
    let mut taken: Vec<Frame> = Vec::new();
    let mut placed = Vec::new();
    for (point, label) in words {
        let width = svg::width_of(&label.text, size);
        let free = |place: &Frame| {
            let inside = frame.contains((place.left, place.top))
                && frame.contains((place.right(), place.bottom()));
            inside
                && taken.iter().all(|other| !overlap(place, other))
                && dots.iter().all(|dot| !place.contains(*dot))
        };
        let clear = |place: &&Frame| {
            let mut pieces = curves.iter().flat_map(|curve| curve.windows(2));
            !pieces.any(|piece| place.is_crossed_by(piece[0], piece[1]))
        };
        let candidates: Vec<Frame> =
            candidates(point, width, size).into_iter().filter(free).collect();
        if let Some(place) = candidates.iter().find(clear).or(candidates.first()).copied() {
            placed.push(((place.left, place.top + 0.5 * place.height), label));
            taken.push(place);
        }
    }
    placed
}

fn candidates((x, y): Point, width: f64, height: f64) -> [Frame; 8] {
    let (right, left, centred) = (x + AWAY, x - AWAY - width, x - 0.5 * width);
    let (level, above, below) = (y - 0.5 * height, y - AWAY - height, y + AWAY);
    [
        (right, level),
        (left, level),
        (centred, above),
        (centred, below),
        (right, above),
        (right, below),
        (left, above),
        (left, below),
    ]
    .map(|(left, top)| Frame { left, top, width, height })
}

fn overlap(a: &Frame, b: &Frame) -> bool {
    a.left < b.right() && b.left < a.right() && a.top < b.bottom() && b.top < a.bottom()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::INK;

    #[test]
    fn words_keep_clear_of_points_and_of_one_another() {
        let frame = Frame { left: 0.0, top: 0.0, width: 300.0, height: 200.0 };
        let dots: Vec<Point> = (0..6).map(|i| (40.0 + 12.0 * f64::from(i), 100.0)).collect();
        let label = Label { at: (0.0, 0.0), text: "4×20".to_owned(), color: INK };
        let words = || dots.iter().map(|dot| (*dot, &label));
        let found = placed(words(), &dots, &[], &frame, 12.0);
        assert!(found.len() >= 4, "only {} words found room", found.len());
        let width = svg::width_of("4×20", 12.0);
        let frames: Vec<Frame> = found
            .iter()
            .map(|((x, y), _)| Frame { left: *x, top: y - 6.0, width, height: 12.0 })
            .collect();
        for (i, a) in frames.iter().enumerate() {
            assert!(dots.iter().all(|dot| !a.contains(*dot)), "{a:?} covers a point");
            assert!(frames[..i].iter().all(|b| !overlap(a, b)), "{a:?} covers a word");
        }
        // Without room there is no word.
        let narrow = Frame { width: 10.0, ..frame };
        assert!(placed(words(), &dots, &[], &narrow, 12.0).is_empty());
    }
    #[test]
    fn words_keep_clear_of_a_curve_where_there_is_room() {
        let frame = Frame { left: 0.0, top: 0.0, width: 300.0, height: 200.0 };
        let lowest = (150.0, 120.0);
        let curve = vec![(0.0, 20.0), (120.0, 115.0), lowest, (180.0, 118.0), (300.0, 110.0)];
        let label = Label { at: (0.0, 0.0), text: "1.2".to_owned(), color: INK };
        let words = || [(lowest, &label)].into_iter();
        let height_beside = placed(words(), &[], &[], &frame, 12.0)[0].0.1;
        assert!((height_beside - lowest.1).abs() < 1.0, "a word stands beside its point if it can");
        let (left, middle) = placed(words(), &[], std::slice::from_ref(&curve), &frame, 12.0)[0].0;
        let width = svg::width_of("1.2", 12.0);
        let place = Frame { left, top: middle - 6.0, width, height: 12.0 };
        assert!(curve.windows(2).all(|piece| !place.is_crossed_by(piece[0], piece[1])));
    }
}
