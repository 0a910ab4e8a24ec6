//! Linear plants with known gains and zeros.

use super::plant;
use pinc_analysis::{
    Complex, Growth, OperatingPoint, StateSpace, TimeScales, TransmissionZeros, common_plane,
};

fn finite(plant: &StateSpace) -> Vec<Complex> {
    match plant.transmission_zeros() {
        TransmissionZeros::Finite(mut zeros) => {
            zeros.sort_by(|a, b| a.re.total_cmp(&b.re).then(a.im.total_cmp(&b.im)));
            zeros
        }
        other @ TransmissionZeros::Degenerate { .. } => panic!("{other:?}"),
    }
}

#[track_caller]
fn assert_near(found: &[Complex], expected: &[(f64, f64)], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for (found, &(re, im)) in found.iter().zip(expected) {
        let error = (found.re - re).hypot(found.im - im);
        assert!(error <= tolerance * re.hypot(im).max(1.0), "{found:?} is not {re} + {im}i");
    }
}

/// The matrices of the controller form of (b\[0\] + b\[1\] s + ..) / (s^n + a\[n-1\] s^(n-1) + ..).
fn controller_matrices(a: &[f64], b: &[f64]) -> [Vec<f64>; 3] {
    let n = a.len();
    let mut matrix = vec![0.0; n * n];
    for i in 1..n {
        matrix[(i - 1) * n + i] = 1.0;
    }
    for (to, a) in matrix[(n - 1) * n..].iter_mut().zip(a) {
        *to = -a;
    }
    let input: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i == n - 1))).collect();
    let output: Vec<f64> = (0..n).map(|i| b.get(i).copied().unwrap_or(0.0)).collect();
    [matrix, input, output]
}

fn controller_form(a: &[f64], b: &[f64]) -> StateSpace {
    let [matrix, input, output] = controller_matrices(a, b);
    StateSpace::new(&matrix, &input, &output, a.len())
}

/// The controller form with four states reflected at a plane, so that all entries of the matrices
/// count.
fn reflected_controller_form(a: &[f64; 4], b: &[f64]) -> StateSpace {
    let [mut matrix, mut input, mut output] = controller_matrices(a, b);
    // Unit vectors.
    let normal = [0.1, -0.5, 0.7, 0.5];
    let reflect = |values: &mut [f64], at: [usize; 4]| {
        let along: f64 = normal.iter().zip(at).map(|(v, k)| v * values[k]).sum();
        normal.iter().zip(at).for_each(|(v, k)| values[k] -= 2.0 * v * along);
    };
    for k in 0..4 {
        reflect(&mut matrix, [0, 1, 2, 3].map(|i| 4 * i + k));
    }
    for i in 0..4 {
        reflect(&mut matrix, [0, 1, 2, 3].map(|k| 4 * i + k));
    }
    reflect(&mut input, [0, 1, 2, 3]);
    reflect(&mut output, [0, 1, 2, 3]);
    StateSpace::new(&matrix, &input, &output, 4)
}

#[test]
fn zeros_of_a_transfer_function_are_the_roots_of_its_numerator() {
    let poles = [24.0, 50.0, 35.0, 10.0];
    assert_near(&finite(&controller_form(&poles, &[1.0])), &[], 0.0);
    assert_near(&finite(&controller_form(&poles, &[-2.0, 1.0])), &[(2.0, 0.0)], 1e-12);
    // s^2 + 2 s + 5 and (s + 1) (s + 2) (s - 3)
    let pair = controller_form(&poles, &[5.0, 2.0, 1.0]);
    assert_near(&finite(&pair), &[(-1.0, -2.0), (-1.0, 2.0)], 1e-12);
    let three = controller_form(&poles, &[-6.0, -7.0, 0.0, 1.0]);
    assert_near(&finite(&three), &[(-2.0, 0.0), (-1.0, 0.0), (3.0, 0.0)], 1e-11);
}

#[test]
fn zeros_far_away_do_not_hide_the_near_ones() {
    let poles = [24.0, 50.0, 35.0, 10.0];
    for far in [1e4, -1e6, 1e8, -1e10] {
        // (s^2 + 2 s + 5) (s / far - 1)
        let [b0, b1, b2, b3] = [-5.0, 5.0 / far - 2.0, 2.0 / far - 1.0, 1.0 / far];
        let mut zeros = finite(&reflected_controller_form(&poles, &[b0, b1, b2, b3]));
        let place = zeros.iter().position(|zero| zero.re.abs() > 1e3).expect("the far one");
        let found = zeros.remove(place);
        assert!((found.re / far - 1.0).abs() < 1e-14 * far.abs(), "{found:?} is not {far}");
        assert_near(&zeros, &[(-1.0, -2.0), (-1.0, 2.0)], 1e-11);
    }
}

#[test]
fn a_long_chain_has_zeros_only_behind_its_output() {
    // x_1' = u - 2 x_1 + x_2, x_i' = x_(i-1) - 2 x_i + x_(i+1): the zeros of the path to x_5 are
    // the eigenvalues of the part behind x_5, -2 + 2 cos(k pi / 16), k = 1 to 15.
    let n: usize = 20;
    let a: Vec<f64> = (0..n * n)
        .map(|k| match (k / n).abs_diff(k % n) {
            0 => -2.0,
            1 => 1.0,
            _ => 0.0,
        })
        .collect();
    let unit = |at: usize| (0..n).map(|i| f64::from(u8::from(i == at))).collect::<Vec<_>>();
    let zeros = finite(&StateSpace::new(&a, &unit(0), &unit(4), n));
    let mut expected: Vec<_> = (1..=15)
        .map(|k| (-2.0 + 2.0 * (f64::from(k) * std::f64::consts::PI / 16.0).cos(), 0.0))
        .collect();
    expected.sort_by(|a, b| a.0.total_cmp(&b.0));
    assert_near(&zeros, &expected, 1e-9);
}

#[test]
fn zeros_of_two_inputs_and_two_outputs() {
    // Two paths side by side: (s - 1)/((s+2)(s+3)) and
    // 1/(s+4).
    let a = [-5.0, -6.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -4.0];
    let plant =
        StateSpace::new(&a, &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0], &[1.0, -1.0, 0.0, 0.0, 0.0, 1.0], 3);
    assert_near(&finite(&plant), &[(1.0, 0.0)], 1e-12);
}

#[test]
fn inputs_that_do_the_same_or_nothing_have_a_transfer_matrix_of_low_rank() {
    let twins =
        StateSpace::new(&[-1.0, 0.0, 0.0, -1.0], &[1.0, 1.0, 1.0, 1.0], &[1.0, 0.0, 0.0, 1.0], 2);
    assert_eq!(twins.transmission_zeros(), TransmissionZeros::Degenerate { rank: 1 });
    let unreached = StateSpace::new(&[-1.0, 0.0, 1.0, -1.0], &[0.0, 1.0], &[1.0, 0.0], 2);
    assert_eq!(unreached.transmission_zeros(), TransmissionZeros::Degenerate { rank: 0 });
}

#[test]
fn units_of_the_variables_do_not_change_zeros_and_ranks() {
    // The second state in units a millionth, time constants from 1 ms to 1000 s.
    let b = [1.0, 0.0];
    let plant = StateSpace::new(&[-1000.0, -1e-6 * 0.001, 1e6, -0.001], &b, &[0.0, 1.0], 2);
    let scaled = plant.scaled(&[1.0, 1e6, 1.0]);
    assert_near(&finite(&scaled), &[], 0.0);
    let gain = plant.static_gain().unwrap();
    // 1e6 / (1000 * 0.001 + 0.001)
    assert!((gain.singular_values[0] / (1e6 / 1.001) - 1.0).abs() < 1e-12, "{gain:?}");
}

#[test]
fn a_plant_that_integrates_has_no_static_gain() {
    let integrator = StateSpace::new(&[0.0, 1.0, 0.0, -2.0], &[0.0, 1.0], &[1.0, 0.0], 2);
    assert_eq!(integrator.static_gain(), None);
    // A friction of 2000 1/s beside one of 1e-4 1/s is no integrator.
    let stiff = StateSpace::new(&[-2000.0, 0.0, 1.0, -1e-4], &[1.0, 0.0], &[0.0, 1.0], 2);
    assert!((stiff.static_gain().unwrap().singular_values[0] - 5.0).abs() < 1e-9);
}

#[test]
fn the_tangent_of_a_plant_has_its_derivatives() {
    let plant = plant(&["x", "v"], &["u"], &["v", "u - x^3 - 0.5*v"]);
    let point = OperatingPoint { x: vec![1.0, 0.0], u: vec![1.0] };
    let tangent = StateSpace::tangent(&plant, &point, &[0]).unwrap();
    // s^2 + s/2 + 3
    let modes = tangent.eigenvalues();
    assert!(modes.iter().all(|m| (m.re + 0.25).abs() < 1e-12), "{modes:?}");
    assert!((modes[0].abs() - 3.0_f64.sqrt()).abs() < 1e-12);
    assert!((tangent.static_gain().unwrap().matrix[0] - 1.0 / 3.0).abs() < 1e-12);
    let scales = TimeScales::of(&modes);
    assert_eq!(scales.doubling_s, None);
    assert!((Growth::of(modes[0]) == Growth::Decays { time_constant_s: -1.0 / modes[0].re }));
    let nowhere = OperatingPoint { x: vec![f64::NAN, 0.0], u: vec![0.0] };
    assert!(StateSpace::tangent(&plant, &nowhere, &[0]).is_none());
}

#[test]
fn points_off_a_plane_have_none() {
    let samples = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0]].map(Vec::from);
    assert_eq!(common_plane(&samples, &[1.0, 1.0]), None);
}

/// However fast another mode is, a slow one is told from an integrator; and integrators in a row, seen in
/// mixed states, are known for what they are.
#[test]
fn slow_modes_and_integrators_are_told_apart() {
    for slow in [-1.0, 5.0] {
        let stiff = StateSpace::new(&[-1e8, 1e8, 0.0, slow], &[0.0, 1.0], &[0.0, 1.0], 2);
        let growth = stiff.eigenvalues().into_iter().map(Growth::of);
        let grows = growth.filter(|growth| matches!(growth, Growth::Grows { .. })).count();
        assert_eq!(grows, usize::from(slow > 0.0));
        assert!((TimeScales::of(&stiff.eigenvalues()).slowest.unwrap() - slow.abs()).abs() < 1e-6);
    }
    // A = T N T^-1 with N all integrators in a row but for one stable mode: T and its inverse.
    let t =
        [[1.0, 2.0, 0.5, 0.3], [0.2, 1.0, 0.7, -0.4], [-0.6, 0.1, 1.0, 0.9], [0.4, -0.8, 0.2, 1.0]];
    let t = faer::Mat::from_fn(4, 4, |i, j| t[i][j]);
    for integrators in [1, 2, 3] {
        let n = faer::Mat::from_fn(4, 4, |i, j| match (i, j) {
            (3, 3) => -2.0,
            (i, j) if j == i + 1 && j < integrators => 1.0,
            (i, j) if i == j && i >= integrators => -1.0 - i as f64,
            _ => 0.0,
        });
        let a = faer::linalg::solvers::Solve::solve(
            &t.transpose().partial_piv_lu(),
            (&t * n).transpose(),
        );
        let a: Vec<f64> = (0..16).map(|k| a[(k % 4, k / 4)]).collect();
        let modes = StateSpace::new(&a, &[1.0; 4], &[1.0; 4], 4).eigenvalues();
        let neutral = modes.iter().filter(|mode| Growth::of(**mode) == Growth::Neutral).count();
        assert_eq!(neutral, integrators, "{modes:?}");
    }
}

/// Entries of 1e-9 beside 1e9 are no rounding where states have units of 1e-9 and 1e9.
#[test]
fn modes_and_gains_do_not_depend_on_units() {
    let a = [-0.03, 0.01, 0.004, 0.02, -0.02, 0.005, 0.003, 0.01, -0.01];
    let (b, c) = ([0.0, 0.01, 0.0], [0.0, 1.0, 0.0]);
    let plain = StateSpace::new(&a, &b, &c, 3);
    let units = [1e-9, 1e9, 1.0];
    // The states of `plain` are those of this plant in its units.
    let a: Vec<f64> = (0..9).map(|at| a[at] * units[at / 3] / units[at % 3]).collect();
    let (b, c) = ([0, 1, 2].map(|i| b[i] * units[i]), [0, 1, 2].map(|k| c[k] / units[k]));
    let scaled = StateSpace::new(&a, &b, &c, 3);
    let modes = |plant: &StateSpace| {
        let mut modes: Vec<f64> = plant.eigenvalues().iter().map(|mode| mode.re).collect();
        modes.sort_by(f64::total_cmp);
        modes
    };
    let again = scaled.in_units(&units);
    let is_lost = |(found, expected): (&f64, f64)| (found - expected).abs() > 1e-6;
    assert!(modes(&scaled).iter().zip(modes(&plain)).any(is_lost), "{:?}", modes(&scaled));
    for (found, expected) in modes(&again).iter().zip(modes(&plain)) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
    let gain = |plant: &StateSpace| plant.static_gain().unwrap().matrix[0];
    assert!((gain(&again) / gain(&plain) - 1.0).abs() < 1e-9);
}
