//! All solvers on random programs: optimal by an independent assembly of the conditions of Karush,
//! Kuhn and Tucker, and the same inputs.

#[cfg(feature = "clarabel")]
use super::clarabel::ClarabelQp;
use super::condense::CondensedQp;
use super::riccati::RiccatiQp;
use super::{ChosenQp, Multipliers, OcpDims, Qp, QpError, QpMethod, QpSolver, QpStatus, QpStep};
pub(super) mod endings;
pub(crate) mod programs;

use programs::{counted, coupled, programs, stage_costs, trees, unweighted};
use proptest::collection::vec;
use proptest::prelude::*;

/// The rows of a program as one dense matrix over d, with their limits: low, high and penalty.
struct Dense {
    rows: Vec<(Vec<f64>, [f64; 3])>,
    dynamics: Vec<(Vec<f64>, f64)>,
}

impl Dense {
    fn new(qp: &Qp) -> Self {
        let dims = qp.dims;
        let (n, m) = (dims.nx, dims.nu);
        let zero = vec![0.0; dims.unknowns()];
        let mut rows = Vec::new();
        for (v, limits) in qp.bounds.iter().enumerate() {
            let mut row = zero.clone();
            row[v] = 1.0;
            rows.push((row, limits));
        }
        for (i, limits) in qp.increments.iter().enumerate() {
            let mut row = zero.clone();
            row[dims.all_states() + i] = 1.0;
            if i >= m {
                row[dims.all_states() + dims.origin(i / m - 1) * m + i % m] = -1.0;
            }
            rows.push((row, limits));
        }
        for (i, limits) in qp.rows.iter().enumerate() {
            let (j, at) = (dims.n1 + i / dims.rows(), i % dims.rows());
            // In the end, rows of outputs at the end and at the start of the interval before.
            let ends = dims.rows() - 2 * dims.feedthrough;
            let starts = ends + dims.feedthrough;
            let before = dims.origin(j - 1);
            let (state, input) = match at {
                at if at < ends => (j, j),
                at if at < starts => (j, before),
                _ => (before, before),
            };
            let mut row = zero.clone();
            if state > 0 {
                let columns = (state - 1) * n..state * n;
                row[columns].copy_from_slice(&qp.rows_x[i * n..(i + 1) * n]);
            }
            let u = dims.all_states() + held(dims, input) * m;
            row[u..u + m].copy_from_slice(&qp.rows_u[i * m..(i + 1) * m]);
            rows.push((row, limits));
        }
        let mut dynamics = Vec::new();
        for j in 0..dims.horizon {
            for k in 0..n {
                let mut row = zero.clone();
                row[j * n + k] = -1.0;
                let origin = dims.origin(j);
                if origin > 0 {
                    let columns = (origin - 1) * n..origin * n;
                    row[columns].copy_from_slice(&qp.a(j)[k * n..(k + 1) * n]);
                }
                let u = dims.all_states() + held(dims, origin) * m;
                row[u..u + m].copy_from_slice(&qp.b(j)[k * m..(k + 1) * m]);
                dynamics.push((row, qp.c[j * n + k]));
            }
        }
        Self { rows, dynamics }
    }
}

/// The node whose input acts at `node`: the last one towards the root that has one.
fn held(dims: OcpDims, mut node: usize) -> usize {
    while node >= dims.n_controls {
        node = dims.origin(node - 1);
    }
    node
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// H d + g
fn slope(qp: &Qp, d: &[f64]) -> Vec<f64> {
    let dims = qp.dims;
    let (n, m) = (dims.nx, dims.nu);
    let mut slope = qp.gradient.clone();
    for j in 1..=dims.horizon {
        for k in 0..n {
            slope[(j - 1) * n + k] += dot(&qp.q(j)[k * n..(k + 1) * n], &d[(j - 1) * n..j * n]);
        }
    }
    let u = |i: usize, k: usize| d[dims.all_states() + i * m + k];
    for i in 0..dims.n_controls {
        let before = i.checked_sub(1).map(|stage| dims.origin(stage));
        let moved = |k| u(i, k) - before.map_or(0.0, |before| u(before, k));
        let moved: Vec<f64> = (0..m).map(moved).collect();
        for k in 0..m {
            let force = dot(&qp.r(i)[k * m..(k + 1) * m], &moved);
            slope[dims.all_states() + i * m + k] += force;
            if let Some(before) = before {
                slope[dims.all_states() + before * m + k] -= force;
            }
        }
    }
    for j in 1..=dims.horizon {
        let x = (j - 1) * n;
        let products = [(j, &qp.s), (dims.origin(j - 1), &qp.s_before)];
        for (i, s) in products.into_iter().filter(|s| !s.1.is_empty()) {
            let i = held(dims, i);
            for (k, row) in s[x * m..(x + n) * m].chunks_exact(n).enumerate() {
                slope[dims.all_states() + i * m + k] += dot(row, &d[x..x + n]);
                for (l, entry) in row.iter().enumerate() {
                    slope[x + l] += entry * u(i, k);
                }
            }
        }
    }
    for (row, t) in qp.t.chunks_exact(m).enumerate() {
        let i = row / m;
        slope[dims.all_states() + row] += dot(t, &d[dims.all_states() + i * m..][..m]);
    }
    for (row, w) in qp.w.chunks_exact(dims.all_inputs()).enumerate() {
        slope[dims.all_states() + row] += dot(w, &d[dims.all_states()..]);
    }
    slope
}

/// The largest residual: stationarity relative to the multipliers, the rest absolute.
fn residual(qp: &Qp, step: &QpStep) -> f64 {
    let dense = Dense::new(qp);
    let parts = step.multipliers.parts();
    let mu = [parts[1], parts[2], parts[3]].concat();
    let mut slope = slope(qp, &step.d);
    let mut worst = 0.0_f64;
    for ((row, offset), lambda) in dense.dynamics.iter().zip(parts[0]) {
        worst = worst.max((dot(row, &step.d) + offset).abs());
        slope.iter_mut().zip(row).for_each(|(slope, entry)| *slope += lambda * entry);
    }
    for ((row, [low, high, penalty]), &mu) in dense.rows.iter().zip(&mu) {
        let value = dot(row, &step.d);
        let (below, above) = (low - value, value - high);
        // A violation needs a multiplier at its penalty, a multiplier a limit that is reached.
        worst =
            worst.max(below.min(penalty + mu)).max(above.min(penalty - mu)).max(mu.abs() - penalty);
        worst = worst.max(mu.min(-above)).max((-mu).min(-below));
        slope.iter_mut().zip(row).for_each(|(slope, entry)| *slope += mu * entry);
    }
    let size = parts.concat().iter().fold(1.0, |size: f64, mu| size.max(mu.abs()));
    slope.iter().fold(worst, |worst, slope| worst.max(slope.abs() / size))
}

/// Solves from `guess`; optimal to `tolerance`. Rejects the program if the solver gives up, which
/// says so.
fn solve(
    solver: &mut dyn QpSolver,
    qp: &Qp,
    guess: &QpStep,
    tolerance: f64,
) -> Result<QpStep, TestCaseError> {
    let mut step = guess.clone();
    let status = solver.solve(qp, &mut step, &mut || false);
    prop_assume!(status != QpStatus::Failed);
    prop_assert_eq!(status, QpStatus::Solved);
    let residual = residual(qp, &step);
    prop_assert!(residual < tolerance, "{:e}", residual);
    let Multipliers { bounds, increments, rows, .. } = &step.multipliers;
    for ((_, limits), multipliers) in qp.limits().into_iter().zip([bounds, increments, rows]) {
        for ([low, high, _], mu) in limits.iter().zip(multipliers) {
            let limit = if *mu > 0.0 { high } else { low };
            prop_assert!(*mu == 0.0 || limit.is_finite(), "{} of no limit", mu);
        }
    }
    Ok(step)
}

fn same_inputs(qp: &Qp, a: &QpStep, b: &QpStep, tolerance: f64) -> Result<(), TestCaseError> {
    let inputs = qp.dims.all_states()..;
    for (a, b) in a.d[inputs.clone()].iter().zip(&b.d[inputs]) {
        prop_assert!((a - b).abs() < tolerance * (1.0 + a.abs()), "{} {}", a, b);
    }
    Ok(())
}

/// The residual that an SQP iteration is to come down to.
const SHARP: f64 = 1e-8;

/// How far apart the inputs of two methods may be, whose residuals are below [`SHARP`]: by how much
/// depends on the program's condition. The worst random program known has 1.03e-7.
const APART: f64 = 3e-7;

/// The three methods agree, from any guess.
fn all_agree(qp: &Qp, signs: &[i8]) -> Result<(), TestCaseError> {
    let cold = QpStep::new(qp.dims);
    let mut arbitrary = cold.clone();
    let multipliers = arbitrary.multipliers.parts_mut().into_iter().skip(1).flatten();
    multipliers.zip(signs).for_each(|(mu, sign)| *mu = f64::from(*sign));

    let mut condensed = CondensedQp::new(qp);
    let exact = solve(&mut condensed, qp, &cold, SHARP)?;
    same_inputs(qp, &exact, &solve(&mut condensed, qp, &arbitrary, SHARP)?, APART)?;
    same_inputs(qp, &exact, &solve(&mut condensed, qp, &exact, SHARP)?, APART)?;
    prop_assert!(condensed.changes() <= 1);
    let mut fresh = CondensedQp::new(qp);
    same_inputs(qp, &exact, &solve(&mut fresh, qp, &exact, SHARP)?, APART)?;
    prop_assert!(fresh.changes() <= 1, "{}", fresh.changes());

    if !qp.w.is_empty() {
        return general_agrees(qp, &exact);
    }
    let mut riccati = RiccatiQp::new(qp);
    same_inputs(qp, &exact, &solve(&mut riccati, qp, &cold, SHARP)?, APART)?;
    same_inputs(qp, &exact, &solve(&mut riccati, qp, &arbitrary, SHARP)?, APART)?;
    same_inputs(qp, &exact, &solve(&mut riccati, qp, &exact, SHARP)?, APART)?;
    let mut riccati = RiccatiQp::new(qp).with_from_scratch(Some(condensed));
    same_inputs(qp, &exact, &solve(&mut riccati, qp, &cold, SHARP)?, APART)?;
    same_inputs(qp, &exact, &solve(&mut riccati, qp, &arbitrary, SHARP)?, APART)?;

    general_agrees(qp, &exact)
}

#[cfg(not(feature = "clarabel"))]
fn general_agrees(_qp: &Qp, _exact: &QpStep) -> Result<(), TestCaseError> {
    Ok(())
}

#[cfg(feature = "clarabel")]
fn general_agrees(qp: &Qp, exact: &QpStep) -> Result<(), TestCaseError> {
    // An interior point: where rows are active without force, products of 1e-10 leave distances of
    // 1e-5, and on few programs in a million (degenerate in several rows at once) residuals above
    // 1e-4.
    let mut clarabel = ClarabelQp::new(qp);
    same_inputs(qp, exact, &solve(&mut clarabel, qp, &QpStep::new(qp.dims), 1e-3)?, 1e-4)
}

/// So many cases, or as many as the variable `PROPTEST_CASES` says.
pub(super) fn cases(cases: u32) -> ProptestConfig {
    let default = ProptestConfig::default();
    let told = std::env::var_os("PROPTEST_CASES").is_some();
    let cases = if told { default.cases } else { cases };
    // Few programs may be given up.
    ProptestConfig { cases, max_global_rejects: (cases / 50).max(10), ..default }
}

proptest! {
    #![proptest_config(cases(1500))]

    #[test]
    fn the_methods_agree(qp in programs(false), signs in vec(-1..=1_i8, 60)) {
        all_agree(&qp, &signs)?;
    }

    #[test]
    fn the_methods_agree_on_degenerate_programs(
        qp in programs(true),
        signs in vec(-1..=1_i8, 60),
    ) {
        all_agree(&qp, &signs)?;
    }

    /// The solver is one that has seen another program, whose Q, S and T were others.
    #[test]
    fn the_methods_agree_on_stage_costs(
        qp in stage_costs(false),
        signs in vec(-1..=1_i8, 60),
    ) {
        all_agree(&qp, &signs)?;
        let mut other = qp.clone();
        for part in [&mut other.q, &mut other.s, &mut other.s_before, &mut other.t] {
            part.iter_mut().for_each(|entry| *entry *= 0.5);
        }
        let cold = QpStep::new(qp.dims);
        let mut methods: Vec<Box<dyn QpSolver>> =
            vec![Box::new(CondensedQp::new(&other)), Box::new(RiccatiQp::new(&other))];
        let exact = solve(methods[0].as_mut(), &qp, &cold, SHARP)?;
        for method in &mut methods {
            method.solve(&other, &mut cold.clone(), &mut || false);
            same_inputs(&qp, &exact, &solve(method.as_mut(), &qp, &cold, SHARP)?, APART)?;
        }
        #[cfg(feature = "clarabel")]
        {
            let without_end_cost = Qp { s_before: Vec::new(), ..other.clone() };
            for other in [other, without_end_cost] {
                let mut clarabel = ClarabelQp::new(&other);
                clarabel.solve(&other, &mut cold.clone(), &mut || false);
                same_inputs(&qp, &exact, &solve(&mut clarabel, &qp, &cold, 1e-3)?, 1e-4)?;
            }
        }
    }

    #[test]
    fn the_methods_agree_on_degenerate_stage_costs(
        qp in stage_costs(true),
        signs in vec(-1..=1_i8, 60),
    ) {
        all_agree(&qp, &signs)?;
    }

    #[test]
    fn the_methods_agree_on_weights_of_all_inputs(
        qp in coupled(false),
        signs in vec(-1..=1_i8, 60),
    ) {
        all_agree(&qp, &signs)?;
        prop_assert_eq!(
            ChosenQp::new(&qp, QpMethod::Riccati).unwrap_err(),
            QpError::NotStagewise
        );
        let mut step = QpStep::new(qp.dims);
        let status = ChosenQp::new(&qp, QpMethod::Auto).unwrap().solve(&qp, &mut step, &mut || false);
        prop_assert_eq!(status, QpStatus::Solved);
    }

    /// Without weights on increments: of several plans at the least cost each method finds one.
    #[test]
    fn singular_programs_are_solved(
        qp in prop_oneof![programs(false), programs(true), stage_costs(true)],
        signs in vec(-1..=1_i8, 60),
    ) {
        let qp = unweighted(qp);
        let cold = QpStep::new(qp.dims);
        let mut arbitrary = cold.clone();
        let multipliers = arbitrary.multipliers.parts_mut().into_iter().skip(1).flatten();
        multipliers.zip(&signs).for_each(|(mu, sign)| *mu = f64::from(*sign));
        let mut condensed = CondensedQp::new(&qp);
        let mut exact = cold.clone();
        prop_assert_eq!(condensed.solve(&qp, &mut exact, &mut || false), QpStatus::Solved);
        for guess in [&cold, &arbitrary, &exact] {
            let mut step = guess.clone();
            prop_assert_eq!(condensed.solve(&qp, &mut step, &mut || false), QpStatus::Solved);
            let residual = residual(&qp, &step);
            // Rows are met to 1e-7 of the numbers involved.
            prop_assert!(residual < 30.0 * SHARP, "{:e}", residual);
            solve(&mut RiccatiQp::new(&qp), &qp, guess, 10.0 * SHARP)?;
        }
    }

    /// A terminal weight far above all others: multipliers up to 1e7, of which the stage-wise
    /// method keeps all digits that matter. Their own rounding is up to 1e-9.
    #[test]
    fn a_heavy_terminal_weight_does_not_disturb_the_stage_wise_method(
        coarse in any::<bool>(),
        (mut qp, mut other) in (programs(false), programs(true)),
        signs in vec(-1..=1_i8, 60),
    ) {
        if coarse {
            std::mem::swap(&mut qp, &mut other);
        }
        let last = qp.q.len() - qp.dims.nx.pow(2);
        qp.q[last..].iter_mut().for_each(|weight| *weight *= 1e6);
        let mut guess = QpStep::new(qp.dims);
        let multipliers = guess.multipliers.parts_mut().into_iter().skip(1).flatten();
        multipliers.zip(&signs).for_each(|(mu, sign)| *mu = f64::from(*sign));
        let exact = solve(&mut CondensedQp::new(&qp), &qp, &guess, SHARP)?;
        let found = solve(&mut RiccatiQp::new(&qp), &qp, &guess, 10.0 * SHARP)?;
        same_inputs(&qp, &exact, &found, 1e-6)?;
    }

    /// Limits moved apart, so that rows contradict each other.
    #[test]
    fn the_methods_agree_on_what_is_infeasible(
        mut qp in programs(false),
        moves in vec(-1.0..1.0_f64, 60),
    ) {
        for limits in [&mut qp.bounds, &mut qp.increments] {
            for (i, by) in moves.iter().enumerate().take(limits.low.len()) {
                limits.low[i] += by;
                limits.high[i] += by;
            }
        }
        let cold = QpStep::new(qp.dims);
        let condensed = CondensedQp::new(&qp).solve(&qp, &mut cold.clone(), &mut || false);
        let riccati = RiccatiQp::new(&qp).solve(&qp, &mut cold.clone(), &mut || false);
        prop_assert_ne!(condensed, QpStatus::Failed);
        let feasible = condensed == QpStatus::Solved;
        prop_assert!((riccati == QpStatus::Solved) == feasible || riccati == QpStatus::Failed);
        #[cfg(feature = "clarabel")]
        {
            let other = ClarabelQp::new(&qp).solve(&qp, &mut cold.clone(), &mut || false);
            prop_assert!((other == QpStatus::Solved) == feasible || other == QpStatus::Failed);
            // What the stage-wise method gives up is judged by Clarabel.
            let mut chosen = ChosenQp::new(&qp, QpMethod::Riccati).unwrap();
            let chosen = chosen.solve(&qp, &mut cold.clone(), &mut || false);
            let given_up = chosen == QpStatus::Failed && other == QpStatus::Failed;
            prop_assert!((chosen == QpStatus::Solved) == feasible || given_up);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { max_global_rejects: 20, ..cases(300) })]

    /// Programs on trees, by their conditions of optimality, from any guess; and the same inputs as
    /// by Clarabel.
    #[test]
    fn trees_are_solved_stage_by_stage(
        qp in prop_oneof![trees(false), trees(true)],
        signs in vec(-1..=1_i8, 60),
    ) {
        let cold = QpStep::new(qp.dims);
        let mut arbitrary = cold.clone();
        let multipliers = arbitrary.multipliers.parts_mut().into_iter().skip(1).flatten();
        multipliers.zip(signs.iter().cycle()).for_each(|(mu, sign)| *mu = f64::from(*sign));
        let mut riccati = RiccatiQp::new(&qp);
        let exact = solve(&mut riccati, &qp, &cold, SHARP)?;
        same_inputs(&qp, &exact, &solve(&mut riccati, &qp, &arbitrary, SHARP)?, APART)?;
        same_inputs(&qp, &exact, &solve(&mut riccati, &qp, &exact, SHARP)?, APART)?;
        general_agrees(&qp, &exact)?;
        let refused = ChosenQp::new(&qp, QpMethod::Condensed).unwrap_err();
        prop_assert_eq!(refused, QpError::CondensedTree);
        let mut step = cold;
        let mut chosen = ChosenQp::new(&qp, QpMethod::Auto).unwrap();
        prop_assert_eq!(chosen.solve(&qp, &mut step, &mut || false), QpStatus::Solved);
        same_inputs(&qp, &exact, &step, APART)?;
    }
}

proptest! {
    // The stage-wise method gives up one or two in a hundred.
    #![proptest_config(ProptestConfig { max_global_rejects: 75, ..cases(1500) })]

    /// Each state and each input in a unit of its own, and the cost in another one: the same
    /// inputs. Except for the condensing method the caller chooses units in which states and inputs
    /// are alike, and for Clarabel also the unit of the cost.
    #[test]
    fn units_do_not_matter(
        qp in stage_costs(false),
        exponents in vec(-1.0..1.0_f64, 5),
        cost in -6.0..6.0_f64,
    ) {
        type Method = fn(&Qp) -> Box<dyn QpSolver>;
        let methods: [(Method, f64, f64); _] = [
            (|qp| Box::new(CondensedQp::new(qp)), 6.0, cost),
            (|qp| Box::new(RiccatiQp::new(qp)), 1.0, cost),
            #[cfg(feature = "clarabel")]
            (|qp| Box::new(ClarabelQp::new(qp)), 1.0, 0.0),
        ];
        let cold = QpStep::new(qp.dims);
        let exact = solve(&mut CondensedQp::new(&qp), &qp, &cold, SHARP)?;
        for (method, decades, cost) in methods {
            let units: Vec<f64> = exponents.iter().map(|e| 10_f64.powf(decades * e)).collect();
            let (x, u) = (&units[..qp.dims.nx], &units[3..][..qp.dims.nu]);
            let program = counted(&qp, x, u, 10_f64.powf(cost));
            let (mut method, mut step) = (method(&program), cold.clone());
            let status = method.solve(&program, &mut step, &mut || false);
            prop_assume!(status != QpStatus::Failed);
            prop_assert_eq!(status, QpStatus::Solved, "{:?}", method);
            let found = step.d[qp.dims.all_states()..].iter_mut();
            found.zip(u.iter().cycle()).for_each(|(d, unit)| *d /= unit);
            same_inputs(&qp, &exact, &step, 1e-4)?;
        }
    }
}

/// Along these horizons a disturbance would grow without control by 1e26, and rounding with it.
#[test]
fn long_horizons_of_unstable_plants_are_solved_stage_by_stage() {
    let dims = OcpDims::new(2, 1, 200);
    let weight = [2.0, 0.0, 0.0, 2.0].repeat(dims.horizon);
    let mut qp = Qp::new(dims, weight, vec![2.0; dims.n_controls]);
    qp.a = [1.3, 0.4, -0.4, 1.3].repeat(dims.horizon);
    qp.b = [0.1, 0.5].repeat(dims.horizon);
    let wave = |i: usize| f64::from(u8::try_from(i * i % 17).unwrap()) - 8.0;
    qp.gradient.iter_mut().enumerate().for_each(|(i, entry)| *entry = wave(i));
    qp.c.iter_mut().enumerate().for_each(|(i, entry)| *entry = 0.01 * wave(i + 3));
    for high in [f64::INFINITY, 1.5] {
        qp.bounds.high[dims.all_states()..].fill(high);
        let mut step = QpStep::new(dims);
        let status = RiccatiQp::new(&qp).solve(&qp, &mut step, &mut || false);
        assert_eq!(status, QpStatus::Solved);
        assert!(residual(&qp, &step) < SHARP);
    }
}
