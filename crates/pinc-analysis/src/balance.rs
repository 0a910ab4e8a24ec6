//! Matrices whose rows and columns are of a like size.

use faer::Mat;

/// Rows and columns are scaled as long as that makes their sum smaller by this factor.
const GAIN: f64 = 0.95;

/// D^-1 A D with a diagonal D of powers of 2 that makes each row about as large as its column. It has the
/// eigenvalues of A, which are then not lost in the rounding of entries in other units.
///
/// Reference: B. N. Parlett, C. Reinsch, "Balancing a matrix for calculation of eigenvalues and
/// eigenvectors", Numerische Mathematik 13 (1969).
pub(crate) fn balanced(a: &Mat<f64>) -> Mat<f64> {
    let (n, mut a) = (a.nrows(), a.clone());
    let mut changed = true;
    while changed {
        changed = false;
        for i in 0..n {
            let others = || (0..n).filter(move |k| *k != i);
            let row = others().map(|k| a[(i, k)].abs()).sum::<f64>();
            let column = others().map(|k| a[(k, i)].abs()).sum::<f64>();
            let unit = (row / column).sqrt().log2().round().exp2();
            if !unit.is_normal() || column * unit + row / unit >= GAIN * (column + row) {
                continue;
            }
            for k in others() {
                a[(i, k)] /= unit;
                a[(k, i)] *= unit;
            }
            changed = true;
        }
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_do_not_count() {
        let plain =
            Mat::from_fn(3, 3, |i, k| [[-3.0, 1.0, 0.5], [2.0, -2.0, 0.5], [0.0, 1.0, -1.0]][i][k]);
        let units = [1e-9, 1.0, 1e12];
        let scaled = Mat::from_fn(3, 3, |i, k| plain[(i, k)] * units[i] / units[k]);
        let found = balanced(&scaled);
        for (i, k) in (0..3).flat_map(|i| (0..3).map(move |k| (i, k))) {
            let factor = (found[(i, k)] / plain[(i, k)]).abs();
            assert!(plain[(i, k)] == 0.0 || (0.2..5.0).contains(&factor), "{i} {k}: {factor}");
        }
        // A state that acts on nothing, or is acted on by nothing, stays as it is.
        let chain = Mat::from_fn(2, 2, |i, k| {
            if (i, k) == (0, 1) { 1e9 } else { -1.0 * f64::from(u8::from(i == k)) }
        });
        assert_eq!(balanced(&chain), chain);
    }
}
