//! Sums and products whose bounds are met to rounding: every bound must be rounded upward.

use super::{Numbers, exact, zero};
use crate::basis::Basis;
use crate::flow::{FlowArithmetic, at_the_end, defect};
use crate::function::Smooth;
use crate::growth::Growth;
use crate::interval::Interval;
use crate::kernel::LANES;
use crate::points::PointError;
use crate::polynomial::{Cuts, Polynomial};
use crate::problem::{BoxError, StepError, box_error};
use crate::rounding::{UNIT, to_f64};
use crate::taylor::{Arithmetic, Taylor};
use num_rational::BigRational;
use pinc_ad::simd::Isa;
use pinc_expr::PlantEquations;
use pinc_ode::Tableau;
use pinc_plants::OneTank;
use std::slice::from_ref;

fn over(variables: usize, degree: usize) -> Arithmetic {
    Arithmetic::new(Basis::of_space(variables, degree), degree, Isa::detect())
}

/// The same polynomial in all boxes.
fn model(over: &Arithmetic, coefficients: &[f64], remainder: f64) -> Taylor {
    let mut model = over.constant([0.0; LANES]);
    for (to, from) in model.coefficients.iter_mut().zip(coefficients) {
        *to = [*from; LANES];
    }
    model.with_remainder([remainder; LANES])
}

fn sum(all: &[f64]) -> BigRational {
    all.iter().fold(zero(), |sum, one| sum + exact(*one))
}

/// The value where all variables are 1.
fn corner(of: &Taylor) -> BigRational {
    of.coefficients.iter().fold(zero(), |sum, one| sum + exact(one[3]))
}

/// Coefficients that are small beside the remainders leave nothing that could hide a rounding of
/// these.
#[test]
fn remainders_of_products_and_sums_are_rounded_upward() {
    let over = over(2, 2);
    let count = over.basis.len();
    let mut numbers = Numbers::new();
    for _ in 0..200 {
        let [a, b] = [0, 1].map(|_| {
            let coefficients = numbers.many(count, 0.0, 1e-6);
            model(&over, &coefficients, numbers.between(1.0, 10.0))
        });
        let (ra, rb) = (exact(a.remainder[3]), exact(b.remainder[3]));
        let product = over.mul(&a, &b);
        let most = (corner(&a) + &ra) * (corner(&b) + &rb);
        assert!(most - corner(&product) <= exact(product.remainder[3]), "{a:?} {b:?}");
        let factors = [numbers.between(0.0, 3.0), numbers.between(0.0, 3.0)];
        let number = numbers.between(0.0, 1e-6);
        let found = over.combine(&[&a, &b], &factors, number);
        let most = (corner(&a) + ra) * exact(factors[0])
            + (corner(&b) + rb) * exact(factors[1])
            + exact(number);
        assert!(most - corner(&found) <= exact(found.remainder[3]), "{a:?} {b:?}");
        // A number beside which the polynomial is small, and the other way round.
        for (of, number) in [(0.1, 1e6), (1e6, 0.1)] {
            let a = model(&over, &numbers.many(count, 0.0, of), 0.0);
            let number = numbers.between(0.5, 1.0) * number;
            let found = over.offset(&a, number);
            let off = corner(&a) + exact(number) - corner(&found);
            let off = if off < zero() { -off } else { off };
            assert!(off <= exact(found.remainder[3]), "{a:?} {number}");
        }
    }
}

/// To 1 numbers are added that are each a little less than what would change it: every addition loses
/// nearly u, the most there is to lose, so that bounds must grow with the number of terms.
#[test]
fn long_sums_may_lose_something_in_every_term() {
    let (lost, most) = (0.98 * UNIT, 20);
    let over = over(1, most);
    let mut coefficients = vec![lost; most + 1];
    coefficients[0] = 1.0;
    let (a, b) = (model(&over, &coefficients, 0.0), model(&over, &vec![1.0; most + 1], 0.0));
    let product = over.mul(&a, &b);
    // Coefficient k has k such terms; as many are beyond the degree.
    let count = exact(to_f64(most * (most + 1) / 2));
    let kept = exact(to_f64(most + 1)) + exact(lost) * &count;
    let beyond = exact(lost) * count;
    assert!(kept - corner(&product) + beyond <= exact(product.remainder[3]), "{product:?}");
    let small = model(&over, &[lost], 0.0);
    let sum = over.combine(&[&small; 50], &[1.0; 50], 1.0);
    let wanted = exact(1.0) + exact(lost) * exact(50.0);
    assert!(wanted - corner(&sum) <= exact(sum.remainder[3]), "{sum:?}");
    // On the upper half of x each x^n adds its part to the constant.
    let cuts = Cuts::new(&over.basis);
    let mut scale = 1.0;
    for coefficient in &mut coefficients[1..] {
        scale *= 2.0;
        *coefficient *= scale;
    }
    let half = cuts.half(&Polynomial { coefficients, rounding: 0.0 }, 0, 1.0);
    let wanted = exact(1.0) + exact(lost) * exact(to_f64(most));
    assert!(wanted - exact(half.coefficients[0]) <= exact(half.rounding), "{half:?}");
    // So does each power of the time at the end of a step.
    let space = Basis::of_space(0, 0);
    let flows = FlowArithmetic::new(space.clone(), 12, Isa::detect());
    let full = Arithmetic::new(space.with_time(12), 12, Isa::detect());
    let mut coefficients = vec![lost; 13];
    coefficients[0] = 1.0;
    let (end, rounding) = at_the_end(&flows, &model(&full, &coefficients, 0.0));
    let wanted = exact(1.0) + exact(lost) * exact(12.0);
    assert!(wanted - exact(end[0][3]) <= exact(rounding[3]), "{end:?} {rounding:?}");
}

/// Polynomials whose coefficients are not negative have their largest value where all variables are
/// 1.
#[test]
fn ranges_are_rounded_outward() {
    let over = over(3, 3);
    let cuts = Cuts::new(&over.basis);
    let count = over.basis.len();
    let mut numbers = Numbers::new();
    let mut rootless = 0;
    for k in 0..400 {
        let mut coefficients = numbers.many(count, 0.0, 1.0);
        coefficients[0] = if k % 2 == 0 { 0.0 } else { 1e7 * numbers.share() };
        let radius = sum(&coefficients[1..]);
        let middle = exact(coefficients[0]);
        let found = model(&over, &coefficients, 0.0).ranges()[3];
        assert!(exact(found.high) >= &middle + &radius, "{coefficients:?}");
        assert!(exact(found.low) <= &middle - &radius, "{coefficients:?}");
        // What rounding may have changed counts on both sides.
        let rounding = if k % 3 == 0 { 0.5 } else { 0.0 };
        let of = Polynomial { coefficients: coefficients.clone(), rounding };
        let bound = cuts.bound(&of, f64::INFINITY);
        assert!(exact(bound.most) >= &middle + &radius + exact(rounding));
        assert!(exact(bound.least) <= &middle + exact(1e-9));
        // The same below 0.
        let negative =
            Polynomial { coefficients: coefficients.iter().map(|c| -c).collect(), rounding };
        let bound = cuts.bound(&negative, f64::INFINITY);
        assert!(exact(bound.most) >= &middle + &radius + exact(rounding));
        // A root needs a range above 0: a middle just below the radius is not enough, even if it is
        // above what rounding makes of that.
        let mut below = coefficients;
        below[0] = below[1..].iter().sum::<f64>() * (1.0 - 1e-14);
        while exact(below[0].next_up()) < radius {
            below[0] = below[0].next_up();
        }
        let root = over.compose(Smooth::Sqrt, &model(&over, &below, 0.0));
        rootless += usize::from(root.remainder[3].is_infinite());
    }
    assert_eq!(rootless, 400);
}

#[test]
fn what_rounding_did_before_is_kept_when_a_box_is_cut() {
    let basis = Basis::of_space(2, 3);
    let cuts = Cuts::new(&basis);
    let mut numbers = Numbers::new();
    for _ in 0..100 {
        let coefficients = numbers.many(basis.len(), 5e-4, 1e-3);
        let of = Polynomial { coefficients, rounding: 0.25 };
        let half = cuts.half(&of, 0, 1.0);
        // At the corner the halves and the whole are the same, exactly.
        let off = sum(&half.coefficients) - sum(&of.coefficients);
        let off = if off < zero() { -off } else { off };
        assert!(exact(half.rounding) >= exact(0.25) + off);
    }
    let mut coefficients = vec![0.0; basis.len()];
    coefficients[0] = 0.5;
    let of = Polynomial { coefficients, rounding: 0.0625 };
    assert!(cuts.bound(&of, 1.0).least <= 0.4375);
}

#[test]
fn differences_of_models_know_their_rounding() {
    let tank = PlantEquations::traced(OneTank::default());
    let model_of = crate::StepModel::RungeKutta(Tableau::CLASSICAL, 1);
    let step = StepError::new(&tank, &[], 1, model_of, 1.0).unwrap();
    let enclosing = step.enclosing(2, 2);
    let over = over(2, 2);
    let mut numbers = Numbers::new();
    for (first, second) in [(1.0, 1e-6), (1e-6, 1.0), (1.0, 1.0)] {
        for _ in 0..50 {
            let a = model(&over, &numbers.many(over.basis.len(), -first, first), 0.0);
            let b = model(&over, &numbers.many(over.basis.len(), -second, second), 0.0);
            let found = box_error(&enclosing, 3, from_ref(&a), from_ref(&b));
            let [polynomial] = &found.polynomials[..] else { panic!("one state") };
            let pairs = a.coefficients.iter().zip(&b.coefficients);
            let off = pairs.zip(&polynomial.coefficients).fold(zero(), |sum, ((a, b), c)| {
                let off = exact(a[3]) - exact(b[3]) - exact(*c);
                sum + if off < zero() { -off } else { off }
            });
            assert!(off <= exact(polynomial.rounding), "{found:?}");
            assert!(polynomial.rounding < 1e-14);
        }
    }
}

#[test]
fn points_bound_their_errors_from_both_sides() {
    let mut numbers = Numbers::new();
    for _ in 0..200 {
        let [e, map, flow, rounding] = [0, 1, 2, 3].map(|_| numbers.share());
        let found = BoxError {
            polynomials: vec![Polynomial { coefficients: vec![e], rounding }],
            of_map: vec![map],
            of_flow: vec![flow],
            drives: [vec![0.0], vec![0.0]],
            obstacle: None,
        };
        let missing = PointError::of(&found).uncertainty[0];
        assert!(exact(missing) >= sum(&[map, flow, rounding]));
        let point = PointError { error: vec![-e], uncertainty: vec![1e-3 * map] };
        let (size, missing) = (exact(e), exact(1e-3 * map));
        assert!(exact(point.bound()[0]) >= &size + &missing);
        let least = size - missing;
        assert!(exact(point.least()[0]) <= if least < zero() { zero() } else { least });
    }
    let unknown = BoxError {
        polynomials: vec![Polynomial { coefficients: vec![f64::NAN], rounding: 0.0 }],
        of_map: vec![0.0],
        of_flow: vec![0.0],
        drives: [vec![0.0], vec![0.0]],
        obstacle: None,
    };
    let point = PointError::of(&unknown);
    assert!(point.uncertainty[0].is_infinite() && point.bound()[0].is_infinite());
}

/// Without the flow's own terms, what is left of a step's end and of its defect is met exactly.
#[test]
fn ends_and_defects_of_flows_are_rounded_upward() {
    let isa = Isa::detect();
    let space = Basis::of_space(1, 2);
    let flows = FlowArithmetic::new(space.clone(), 4, isa);
    let full = Arithmetic::new(space.with_time(4), 2, isa);
    let mut numbers = Numbers::new();
    let ratio = |numbers: &mut Numbers| 10.0_f64.powf(numbers.between(-3.0, 3.0));
    for _ in 0..200 {
        let path: Vec<f64> = numbers
            .many(full.basis.len(), 0.5, 1.0)
            .iter()
            .map(|c| c * ratio(&mut numbers))
            .collect();
        let path = model(&full, &path, 0.0);
        let (end, rounding) = at_the_end(&flows, &path);
        let found = end.iter().fold(zero(), |sum, one| sum + exact(one[3]));
        let off = corner(&path) - found;
        assert!((if off < zero() { -off } else { off }) <= exact(rounding[3]));
        let h = numbers.between(0.1, 1.0);
        let nothing = model(&full, &[], 0.0);
        let rate = model(&full, &[], numbers.between(1.0, 2.0));
        let found = defect(&full, &nothing, &rate, h)[3];
        assert!(exact(found) >= exact(h) * exact(rate.remainder[3]), "{found}");
        // Of a rate alone, or a slope alone, the defect is all.
        let rate = model(&full, &[0.0, numbers.share(), numbers.share()], 0.0);
        let most = corner(&rate) * exact(h);
        assert!(exact(defect(&full, &nothing, &rate, h)[3]) >= most);
        let slope = full.basis.of_order(3).start;
        let mut path = nothing.clone();
        path.coefficients[slope] = [numbers.share(); LANES];
        assert!(exact(defect(&full, &path, &nothing, h)[3]) >= exact(path.coefficients[slope][3]));
    }
}

/// A chain in which each state drives the one before it with a slope of one half: the last state
/// reaches the first by way of the term of order 15 alone, which the series leaves out.
#[test]
fn terms_that_the_exponential_leaves_out_are_in_it() {
    let n = 16;
    let half = |place: usize| if place % n == place / n + 1 { 0.5 } else { 0.0 };
    let jacobian: Vec<Interval> = (0..n * n).map(|place| Interval::point(half(place))).collect();
    let growth = Growth::new(&jacobian, n, 1.0).unwrap();
    let mut start = vec![0.0; n];
    start[n - 1] = 1.0;
    let [end, before] = growth.propagate(&start, &vec![0.0; n]);
    let exact = (1..n).fold(1.0, |term, k| term * 0.5 / to_f64(k));
    assert!(end[0] >= exact && before[0] >= exact, "{end:?} {exact}");
    assert!(end[0] < 1e-15);
}

/// Where nothing grows, errors are what they were, and a defect adds its integral.
#[test]
fn errors_are_rounded_upward_along_a_flow() {
    let mut numbers = Numbers::new();
    for _ in 0..100 {
        let still = Growth::new(&[Interval::point(0.0)], 1, 1.0).unwrap();
        let (start, added) = (numbers.share() / 3.0, numbers.share() / 7.0);
        let [end, before] = still.propagate(&[start], &[added]);
        let most = exact(start) + exact(added);
        assert!(exact(end[0]) >= most && exact(before[0]) >= most);
        // A slope of either sign off the diagonal counts by its size.
        let by = numbers.between(0.0, 1.0);
        for (low, high) in [(-by, 0.5 * by), (-0.5 * by, by)] {
            let zero = Interval::point(0.0);
            let matrix = [zero, Interval { low, high }, zero, zero];
            let growth = Growth::new(&matrix, 2, 1.0).unwrap();
            let [end, _] = growth.propagate(&[0.0, start], &[0.0, 0.0]);
            assert!(exact(end[0]) >= exact(by) * exact(start));
        }
    }
    // A product that underflows is still no less than it should be: e^0.3 > 1.34.
    let growth = Growth::new(&[Interval::point(0.3)], 1, 1.0).unwrap();
    let [end, before] = growth.propagate(&[5e-324], &[0.0]);
    let least = exact(5e-324) * exact(1.34);
    assert!(exact(end[0]) >= least && exact(before[0]) >= least, "{end:?}");
    // What overflows is not known, even where the product with e^-c would not.
    let matrix = [-900.0, 0.0, 0.0, 0.0].map(Interval::point);
    assert!(Growth::new(&matrix, 2, 1.0).is_none());
    let matrix = [0.0, f64::NAN, 0.0, 0.0].map(Interval::point);
    assert!(Growth::new(&matrix, 2, 1.0).is_none());
    assert!(Growth::new(&[Interval::point(1e300)], 1, 1.0).is_none());
    assert!(Growth::new(&[Interval::point(1e6)], 1, 1.0).is_none());
}
