//! Which number of substeps, or size of a net, is tried next, by what came of those before.

/// The most substeps that are tried.
pub(crate) const MOST: usize = 128;

/// A number of substeps that was tried.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rung {
    pub(crate) substeps: usize,
    /// The IAE of its loop, if that did not fail.
    pub(crate) iae: Option<f64>,
    /// Whether the loop is as good as with the most exact model.
    pub(crate) good: bool,
}

/// On the way to a model so exact that another one changes nothing: twice the substeps, from
/// `start` on, until two IAEs in a row agree to a relative `tolerance`. Nothing when that is found,
/// or cannot be.
pub(crate) fn finer(start: usize, tried: &[Rung], tolerance: f64) -> Option<usize> {
    let mut rungs: Vec<&Rung> = tried.iter().filter(|rung| rung.substeps >= start).collect();
    rungs.sort_by_key(|rung| rung.substeps);
    let Some(last) = rungs.last() else { return Some(start) };
    if agree(&rungs, tolerance) {
        return None;
    }
    (last.substeps * 2 <= MOST).then_some(last.substeps * 2)
}

/// Whether such a model is among those tried.
pub(crate) fn is_exact(tried: &[Rung], tolerance: f64) -> bool {
    let mut rungs: Vec<&Rung> = tried.iter().collect();
    rungs.sort_by_key(|rung| rung.substeps);
    agree(&rungs, tolerance)
}

/// Whether the two finest loops of these, sorted by substeps, agree.
fn agree(rungs: &[&Rung], tolerance: f64) -> bool {
    let [.., before, last] = rungs else { return false };
    match (before.iae, last.iae) {
        (Some(before), Some(last)) => (before - last).abs() <= tolerance * last.abs(),
        _ => false,
    }
}

/// On the way to the fewest substeps that are good: from `start` up until some are, then half as
/// many until they are not, then between these. Nothing when that is found, or cannot be.
pub(crate) fn fewer(start: usize, tried: &[Rung]) -> Option<usize> {
    let largest = tried.iter().map(|rung| rung.substeps).max();
    let Some(largest) = largest else { return Some(start) };
    let good = tried.iter().filter(|rung| rung.good).map(|rung| rung.substeps).min();
    let Some(good) = good else { return (largest * 2 <= MOST).then_some(largest * 2) };
    let bad = tried.iter().filter(|rung| rung.substeps < good).map(|rung| rung.substeps).max();
    match bad {
        None => (good > 1).then_some(good / 2),
        // A quarter more is near enough.
        Some(bad) if good - bad >= (good / 4).max(2) => Some(good.midpoint(bad)),
        Some(_) => None,
    }
}

/// The size of a net to try next, as a place in a list from cheap to exact: from `start` up until
/// one is good, or down until one is not. Nothing when the smallest good one is found, or there is
/// none.
pub(crate) fn size(start: usize, sizes: usize, tried: &[(usize, bool)]) -> Option<usize> {
    let largest = tried.iter().map(|(place, _)| *place).max();
    let Some(largest) = largest else { return Some(start) };
    let good = tried.iter().filter(|(_, good)| *good).map(|(place, _)| *place).min();
    match good {
        None => (largest + 1 < sizes).then_some(largest + 1),
        Some(good) => {
            let below = good.checked_sub(1)?;
            tried.iter().all(|(place, _)| *place != below).then_some(below)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The substeps that are tried by `next`, of a method whose loops have the IAE `iae`.
    fn order(
        next: impl Fn(&[Rung]) -> Option<usize>,
        iae: impl Fn(usize) -> Option<f64>,
    ) -> Vec<usize> {
        let mut tried: Vec<Rung> = Vec::new();
        while let Some(substeps) = next(&tried) {
            assert!(tried.iter().all(|rung| rung.substeps != substeps), "{substeps} twice");
            let iae = iae(substeps);
            let good = iae.is_some_and(|iae| iae <= 101.0);
            tried.push(Rung { substeps, iae, good });
        }
        tried.iter().map(|rung| rung.substeps).collect()
    }

    #[test]
    fn exactness_is_found_by_doubling() {
        let iae = |substeps: usize| {
            let halvings = i32::try_from(substeps.ilog2()).unwrap();
            Some(100.0 + 50.0 * 0.01_f64.powi(halvings))
        };
        assert_eq!(order(|tried| finer(4, tried, 1e-3), iae), [4, 8]);
        assert_eq!(order(|tried| finer(1, tried, 1e-3), iae), [1, 2, 4, 8]);
        // What is unstable is passed over.
        let stiff = |substeps: usize| (substeps >= 32).then_some(100.0);
        assert_eq!(order(|tried| finer(4, tried, 1e-3), stiff), [4, 8, 16, 32, 64]);
        assert_eq!(order(|tried| finer(16, tried, 1e-3), |_| None), [16, 32, 64, 128]);
    }

    #[test]
    fn the_fewest_good_substeps_are_found_between_good_and_bad() {
        let from = |least: usize| move |substeps: usize| (substeps >= least).then_some(100.0);
        assert_eq!(order(|tried| fewer(4, tried), from(1)), [4, 2, 1]);
        assert_eq!(order(|tried| fewer(4, tried), from(3)), [4, 2, 3]);
        assert_eq!(order(|tried| fewer(4, tried), from(13)), [4, 8, 16, 12, 14]);
        assert_eq!(order(|tried| fewer(2, tried), from(2)), [2, 1]);
        assert_eq!(order(|tried| fewer(32, tried), |_| None), [32, 64, 128]);
    }

    #[test]
    fn the_smallest_good_net_is_found() {
        let order = |start: usize, least: usize| {
            let mut tried: Vec<(usize, bool)> = Vec::new();
            while let Some(place) = size(start, 5, &tried) {
                tried.push((place, place >= least));
            }
            tried.iter().map(|(place, _)| *place).collect::<Vec<_>>()
        };
        assert_eq!(order(1, 0), [1, 0]);
        assert_eq!(order(1, 1), [1, 0]);
        assert_eq!(order(1, 3), [1, 2, 3]);
        assert_eq!(order(1, 9), [1, 2, 3, 4]);
    }
}
