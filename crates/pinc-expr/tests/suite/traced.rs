//! Plants in Rust as graphs: what is recorded computes what is compiled.

use pinc_ad::{ImplicitEquations, Scalar, solve_implicit};
use pinc_expr::{ExpressionProblem, Instruction, PlantEquations, TermRole, into_dyn};
use pinc_ode::{DynPlant, DynRhs, Integrator, LinearizationBuffer, Plant, Stages, Variable};
use pinc_plants::{
    AcetoneColumn, AcetoneStill, FourTanks, HydraulicServo, OneTank, SingleTrackCar, TwoLinkArm,
    VanDerPol,
};

/// Numbers in [0, 1), the same in every run (a linear congruential generator).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn numbers(&mut self, ranges: &[[f64; 2]]) -> Vec<f64> {
        ranges.iter().map(|[low, high]| low + (high - low) * self.unit()).collect()
    }

    /// Numbers of either sign, from 1e-6 to 1e6, evenly in the logarithm.
    fn of_all_scales(&mut self, count: usize) -> Vec<f64> {
        let mut number = || {
            let size = 10_f64.powf(12.0 * self.unit() - 6.0);
            if self.unit() < 0.5 { -size } else { size }
        };
        (0..count).map(|_| number()).collect()
    }
}

/// Asserts that two lists of numbers agree to `tolerance` of the largest; where one has a number
/// that is not finite, so must the other.
fn assert_close(found: &[f64], expected: &[f64], tolerance: f64, at: &[f64]) {
    assert_eq!(found.len(), expected.len());
    let finite = |v: &&f64| v.is_finite();
    let size = expected.iter().filter(finite).fold(0.0_f64, |m, v| m.max(v.abs()));
    for (found, expected) in found.iter().zip(expected) {
        let agree = (found - expected).abs() <= tolerance * size;
        assert!(agree || !expected.is_finite(), "{found} {expected} at {at:?}");
    }
}

/// The recorded right-hand side has the bits of the compiled one.
fn same_bits<P: Plant + Copy>(plant: P, points: impl Iterator<Item = Vec<f64>>) {
    let recorded = PlantEquations::traced(plant).compile_with(&[]).expect("it can be recorded");
    let dims = Plant::dims(&plant);
    assert_eq!(Plant::dims(&recorded), dims);
    for at in points {
        let (x, u) = at.split_at(dims.nx);
        let (mut found, mut expected) = (vec![0.0; dims.nx], vec![0.0; dims.nx]);
        Plant::rhs(&recorded, x, u, &[], &mut found);
        Plant::rhs(&plant, x, u, &[], &mut expected);
        for (found, expected) in found.iter().zip(&expected) {
            // The sign of 0 does not matter for an empty sum.
            let bits = |v: &f64| (v + 0.0).to_bits();
            let agree = bits(found) == bits(expected) || (found.is_nan() && expected.is_nan());
            assert!(agree, "{found} {expected} at {at:?}");
        }
    }
}

/// The Jacobian of the graph has the derivatives of dual numbers, row by row to 1e-12 of the
/// largest entry.
fn same_jacobian<P: Plant + Copy>(plant: P, points: impl Iterator<Item = Vec<f64>>) {
    let recorded = PlantEquations::traced(plant).compile_with(&[]).expect("it can be recorded");
    let (sparse, dims) = (recorded.into_dyn(), Plant::dims(&plant));
    for at in points {
        let (x, u) = at.split_at(dims.nx);
        let found = sparse.jacobian(x, u, &[]);
        let expected = DynRhs::jacobian(&plant, x, u, &[]);
        let width = dims.nx + dims.nu;
        for (found, expected) in found.chunks(width).zip(expected.chunks(width)) {
            assert_close(found, expected, 1e-12, &at);
        }
    }
}

fn of_all_scales(seed: u64, count: usize) -> impl Iterator<Item = Vec<f64>> {
    let mut random = Random(seed);
    (0..500).map(move |_| random.of_all_scales(count))
}

#[test]
fn a_recorded_servo_is_the_compiled_one() {
    same_bits(HydraulicServo::default(), of_all_scales(1, 5));
    same_jacobian(HydraulicServo::default(), of_all_scales(2, 5));
}

#[test]
fn recorded_plants_are_the_compiled_ones() {
    same_bits(VanDerPol { mu: 0.7 }, of_all_scales(3, 3));
    same_jacobian(VanDerPol { mu: 0.7 }, of_all_scales(4, 3));
    same_bits(FourTanks::antonelo(), of_all_scales(5, 6));
    same_jacobian(FourTanks::antonelo(), of_all_scales(6, 6));
    same_bits(OneTank::default(), of_all_scales(7, 2));
    same_jacobian(OneTank::default(), of_all_scales(8, 2));
    same_bits(TwoLinkArm::default(), of_all_scales(9, 6));
    same_bits(SingleTrackCar::default(), of_all_scales(10, 6));
    // Where terms do not cancel, so that 1e-12 is what rounding leaves.
    let mut random = Random(11);
    let arm = [[-3.0, 3.0], [-3.0, 3.0], [-5.0, 5.0], [-5.0, 5.0], [-9.0, 9.0], [-9.0, 9.0]];
    same_jacobian(TwoLinkArm::default(), (0..300).map(move |_| random.numbers(&arm)));
    let mut random = Random(12);
    let car =
        [[2.0, 40.0], [-10.0, 10.0], [-2.0, 2.0], [-0.9, 2.0], [-0.5, 0.5], [-2000.0, 3000.0]];
    same_jacobian(SingleTrackCar::default(), (0..300).map(move |_| random.numbers(&car)));
}

/// Where an equation is solved inside, the recorded one has an algebraic variable: values and
/// derivatives agree to what both are solved to.
fn agrees_inside<P: Plant + Copy>(plant: P, ranges: &[[f64; 2]]) {
    let recorded = PlantEquations::traced(plant).compile_with(&[]).expect("it can be recorded");
    let sparse = recorded.into_dyn();
    let dims = Plant::dims(&plant);
    let mut random = Random(7);
    for _ in 0..200 {
        let at = random.numbers(ranges);
        let (x, u) = at.split_at(dims.nx);
        let (mut found, mut expected) = (vec![0.0; dims.nx], vec![0.0; dims.nx]);
        sparse.rhs(x, u, &[], &mut found);
        Plant::rhs(&plant, x, u, &[], &mut expected);
        assert_close(&found, &expected, 1e-12, &at);
        let found = sparse.jacobian(x, u, &[]);
        assert_close(&found, &DynRhs::jacobian(&plant, x, u, &[]), 1e-11, &at);
    }
}

#[test]
fn recorded_boiling_points_are_the_compiled_ones() {
    let fraction = [0.02, 0.45];
    agrees_inside(AcetoneStill::default(), &[fraction, fraction, [1.0, 6.0], [50.0, 200.0]]);
    let x = [fraction; 6];
    let ranges = [&x[..], &[[1.0, 4.0], [50.0, 200.0]]].concat();
    agrees_inside(AcetoneColumn::default(), &ranges);
}

/// The derivatives of the Rosenbrock step of a plant agree with central differences of the step.
fn rosenbrock_is_differentiated(plant: &dyn DynPlant, at: &[f64], sample_time_s: f64) {
    let dims = plant.dims();
    let mut model = plant.model(Integrator::Rosenbrock, sample_time_s, 2).unwrap();
    let (x, u) = at.split_at(dims.nx);
    let mut found = LinearizationBuffer::new(dims, 1);
    model.linearize(Stages { x, u, p: &[] }, found.as_mut());
    let mut next = vec![0.0; dims.nx];
    model.step(x, u, &[], &mut next);
    assert_close(&found.next, &next, 1e-14, at);
    for j in 0..at.len() {
        let step = 1e-6 * (1.0 + at[j].abs());
        let mut ends = [vec![0.0; dims.nx], vec![0.0; dims.nx]];
        for (end, sign) in ends.iter_mut().zip([1.0, -1.0]) {
            let mut moved = at.to_vec();
            moved[j] += sign * step;
            let (x, u) = moved.split_at(dims.nx);
            model.step(x, u, &[], end);
        }
        let [up, down] = ends;
        for (i, (up, down)) in up.iter().zip(down).enumerate() {
            let expected = (up - down) / (2.0 * step);
            let found = match j.checked_sub(dims.nx) {
                None => found.a[i * dims.nx + j],
                Some(input) => found.b[i * dims.nu + input],
            };
            // Differences are wrong by 1e-12 of a third derivative, of 1e5 at most here, and by
            // 1e-10 of the state.
            let tolerance = 1e-7 * (1.0 + expected.abs());
            assert!((found - expected).abs() < tolerance, "{i} {j}: {found} {expected}");
        }
    }
}

#[test]
fn rosenbrock_steps_of_rust_plants_have_their_derivatives() {
    rosenbrock_is_differentiated(
        &*HydraulicServo::default().into_dyn(),
        &[0.0, 0.1, 2.0, 0.3, 0.5],
        5e-3,
    );
    rosenbrock_is_differentiated(&*VanDerPol::default().into_dyn(), &[1.2, -0.4, 0.5], 0.5);
    rosenbrock_is_differentiated(
        &*AcetoneStill::default().into_dyn(),
        &[0.1, 0.2, 3.0, 120.0],
        20.0,
    );
    let at = [0.1, 0.6, 0.3, 0.3, 0.6, 0.1, 2.0, 120.0];
    rosenbrock_is_differentiated(&*AcetoneColumn::default().into_dyn(), &at, 20.0);
}

/// x' = u - z, where z^3 + z = x is solved inside.
#[derive(Clone, Copy, Debug)]
struct Cubic;

impl ImplicitEquations<1, 1> for Cubic {
    #[inline(always)]
    fn residuals<S: Scalar>(&self, [x]: &[S; 1], [z]: &[S; 1], [g]: &mut [S; 1]) {
        *g = *z * *z * *z + *z - *x;
    }
}

/// x' = u - sqrt(x), by Heron's iteration, as long as it takes.
#[derive(Clone, Copy, Debug)]
struct Heron;

impl Plant for Cubic {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 1] = [Variable::new("x", "")];
        &STATES
    }
    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "")];
        &INPUTS
    }
    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let start = [x[0].plain() * 0.5];
        dx[0] = u[0] - solve_implicit(self, &[x[0]], start, &[[-10.0, 10.0]])[0];
    }
}

impl Plant for Heron {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 1] = [Variable::new("x", "")];
        &STATES
    }
    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "")];
        &INPUTS
    }
    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let mut root = x[0].constant(1.0);
        while !((root * root - x[0]).abs() - 1e-12).all_nonpositive() {
            root = (root + x[0] / root) * 0.5;
        }
        dx[0] = u[0] - root;
    }
}

/// With z^3 + z = x: z = 1 at x = 2, where dz/dx = 1/(3 z^2 + 1) = 1/4.
#[test]
fn equations_inside_become_algebraic_variables() {
    let recorded = PlantEquations::traced(Cubic).compile_with(&[]).expect("it is declared");
    let sparse = recorded.into_dyn();
    let mut dx = [0.0];
    sparse.rhs(&[2.0], &[3.0], &[], &mut dx);
    assert!((dx[0] - 2.0).abs() < 1e-14, "{dx:?}");
    let jacobian = sparse.jacobian(&[2.0], &[3.0], &[]);
    assert!(
        (jacobian[0] + 0.25).abs() < 1e-14 && (jacobian[1] - 1.0).abs() < 1e-15,
        "{jacobian:?}"
    );
    rosenbrock_is_differentiated(&*into_dyn(Cubic), &[2.0, 3.0], 0.7);
}

/// Another value of a constant holds in the compiled plant as in the recorded one.
#[test]
fn a_constant_is_another_in_both_forms() {
    let equations = PlantEquations::traced(VanDerPol { mu: 1.0 }).with_parameters([("mu", 3.0)]);
    for plant in [equations.to_dyn().unwrap(), equations.compile_with(&[]).unwrap().into_dyn()] {
        let mut dx = [0.0; 2];
        plant.rhs(&[0.5, 2.0], &[0.25], &[], &mut dx);
        assert!((dx[0] - 2.0).abs() < 1e-15 && (dx[1] - 4.25).abs() < 1e-14, "{dx:?}");
    }
}

#[test]
fn an_iteration_of_its_own_is_refused_by_name() {
    let error = PlantEquations::traced(Heron).compile_with(&[]).unwrap_err();
    assert_eq!(error.problem, ExpressionProblem::Iterates);
    // A search for a root has no fixed number of steps to list; the still's has.
    let error = PlantEquations::traced(Cubic).listing(&[]).unwrap_err();
    assert_eq!(error.problem, ExpressionProblem::NotListed);
    let still = PlantEquations::traced(AcetoneStill::default()).listing(&[]).expect("it is listed");
    let exponentials = |i: &&Instruction| matches!(i, Instruction::Function(f, _) if *f == pinc_expr::Function::Exp);
    assert!(still.instructions.iter().filter(exponentials).count() > 9);
}

/// A method compiled for the equation needs no graph; at x = u^2 the plant rests.
#[test]
fn an_integrator_that_needs_the_graph_says_why_there_is_none() {
    let heron = into_dyn(Heron);
    let refused = heron.model(Integrator::Rosenbrock, 0.1, 1).err().unwrap().to_string();
    let parts = ["the integrator `rosenbrock` cannot be made", "rhs", "by `solve_implicit`"];
    assert!(parts.iter().all(|part| refused.contains(part)), "{refused}");
    let mut next = [0.0];
    heron.model(Integrator::Rk4, 0.1, 4).unwrap().step(&[4.0], &[2.0], &[], &mut next);
    assert!((next[0] - 4.0).abs() < 1e-12, "{next:?}");
}

/// A select is one of the graph's values, and where it switches is known.
#[test]
fn a_select_is_recorded() {
    let terms = PlantEquations::traced(OneTank::default()).critical_terms().unwrap();
    let found: Vec<_> = terms.list().iter().map(|term| (term.role, &*term.text)).collect();
    let root = "1962*(0 where h <= 0, else h)";
    assert_eq!(found, [(TermRole::Switch, "h"), (TermRole::Radicand, root)]);
    let listing = PlantEquations::traced(OneTank::default()).listing(&[]).unwrap();
    assert!(listing.instructions.iter().any(|i| matches!(i, Instruction::Where(..))));
}
