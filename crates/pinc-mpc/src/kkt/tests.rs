use super::*;
use pinc_qp::OcpDims;

/// One state and one input, and all numbers 0.
fn program() -> Qp {
    Qp::new(OcpDims::new(1, 1, 1), vec![0.0], vec![0.0])
}

/// With a state that is outside a hard bound by 0.5, and the multiplier of the input's bounds.
#[test]
fn each_residual_is_what_it_says() {
    for [low, high] in [[-1.0, -0.5], [0.5, 1.0]] {
        let mut qp = program();
        (qp.gradient, qp.c) = (vec![2.0, -3.0], vec![-0.25]);
        (qp.bounds.low, qp.bounds.high) = (vec![low, -2.0], vec![high, 4.0]);
        let mut at = Solution::new(qp.dims);
        let mut residual = |mu: f64| {
            at.multipliers.bounds[1] = mu;
            let r = KktResidual::new(&qp, &at, &mut [0.0; 2]);
            (vec![r.stationarity, r.dynamics, r.bounds, r.complementarity], r.max())
        };
        assert_eq!(residual(0.0), (vec![3.0, 0.25, 0.5, 0.0], 3.0), "{low}");
        assert_eq!(residual(1.5), (vec![2.0, 0.25, 0.5, 6.0], 6.0), "{low}");
        assert_eq!(residual(-1.5), (vec![4.5, 0.25, 0.5, 3.0], 4.5), "{low}");
        // The mean of the four multipliers is twice the largest that counts as ordinary.
        assert_eq!(residual(800.0), (vec![398.5, 0.25, 0.5, 1600.0], 1600.0), "{low}");
    }
    assert!(KktResidual::unknown().max().is_infinite());
}

/// min over x of nothing, one soft bound that is violated by 0.5: the multiplier must be the
/// price.
#[test]
fn a_violated_soft_bound_wants_its_price() {
    let mut qp = program();
    let dims = qp.dims;
    (qp.bounds.high[0], qp.bounds.penalty[0]) = (-0.5, 3.0);
    let mut at = Solution::new(dims);
    let mut residual = |mu: f64| {
        at.multipliers.bounds[0] = mu;
        at.multipliers.dynamics[0] = mu;
        KktResidual::new(&qp, &at, &mut [0.0; 2])
    };
    assert!((residual(1.0).complementarity - 0.5 * 2.0).abs() < 1e-15);
    assert!(residual(3.0).max() < 1e-15);
    assert!((residual(3.25).stationarity - 0.25).abs() < 1e-15);
    assert!(residual(3.0).bounds < 1e-15);
}

#[test]
fn a_nan_is_not_lost() {
    assert!(largest(&[1.0, f64::NAN, 2.0]).is_infinite());
    assert!((largest(&[1.0, -3.0, 2.0]) - 3.0).abs() < 1e-15);
}
