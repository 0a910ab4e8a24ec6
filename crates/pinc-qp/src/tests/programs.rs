//! Random programs.

use super::{Dense, dot};
use crate::{Limits, OcpDims, Qp, Tree};
use proptest::collection::vec;
use proptest::prelude::*;

fn shapes() -> impl Strategy<Value = OcpDims> {
    (1..=3_usize, 1..=2_usize, 1..=6_usize, 0..=1_usize, 0..=1_usize, 0..=1_usize).prop_flat_map(
        |(states, inputs, stages, inequalities, equalities, feedthrough)| {
            (1..=stages, 1..=stages).prop_map(move |(n_controls, n1)| OcpDims {
                n_controls,
                n1,
                inequalities,
                equalities: equalities.min(inputs - 1),
                feedthrough,
                ..OcpDims::new(states, inputs, stages)
            })
        },
    )
}

/// How a row's limits lie about a value: the kind of row, a width, a penalty.
type Spread = (u8, f64, f64);

fn spreads(count: usize) -> impl Strategy<Value = Vec<Spread>> {
    vec((0..8_u8, 0.0..2.0_f64, 0.01..5.0_f64), count)
}

fn spread(limits: &mut Limits, i: usize, value: f64, (kind, width, penalty): Spread) {
    let (below, above) = match kind {
        0 => (0.0, width),
        1 => (width, 0.0),
        2 => (width, f64::INFINITY),
        3 => (f64::INFINITY, width),
        4 | 5 => (width, width),
        _ => (f64::INFINITY, f64::INFINITY),
    };
    (limits.low[i], limits.high[i]) = (value - below, value + above);
    if width < 0.5 {
        limits.penalty[i] = penalty;
    }
}

/// Programs with a feasible point, about which the limits lie. Where `coarse`, most numbers are
/// quarters.
pub(crate) fn programs(coarse: bool) -> impl Strategy<Value = Qp> {
    shapes().prop_flat_map(move |dims| programs_of(dims, coarse))
}

/// Trees of two or three branches, over one or two depths.
fn tree_shapes() -> impl Strategy<Value = OcpDims> {
    (shapes(), 2..=3_usize, 1..=2_usize, 1..=3_usize, 0..=2_usize, 0..=2_usize).prop_map(
        |(dims, branches, depths, free, held, first)| {
            let tree = Tree::new(branches, depths).unwrap();
            let control = depths + free;
            OcpDims {
                tree,
                horizon: tree.first_node(control + held + 1) - 1,
                n_controls: tree.first_node(control),
                n1: tree.first_node(1 + first.min(control + held - 1)),
                ..dims
            }
        },
    )
}

/// Programs on trees; half of them with S and T, and half of these with E.
pub(super) fn trees(coarse: bool) -> BoxedStrategy<Qp> {
    let plain = tree_shapes().prop_flat_map(move |dims| programs_of(dims, coarse)).boxed();
    prop_oneof![plain.clone(), with_stage_costs(plain)].boxed()
}

fn programs_of(dims: OcpDims, coarse: bool) -> impl Strategy<Value = Qp> {
    let (n, m) = (dims.nx, dims.nu);
    let number = if coarse {
        (-8..=8_i32).prop_map(|quarter| f64::from(quarter) / 4.0).boxed()
    } else {
        (-2.0..2.0_f64).boxed()
    };
    let numbers = move |count: usize| vec(number.clone(), count);
    let matrices = (
        numbers(dims.horizon * n * n),
        numbers(dims.horizon * n * m),
        numbers(dims.all_states()),
        numbers(dims.all_rows() * n),
        numbers(dims.all_rows() * m),
        numbers(dims.horizon * n * n),
        numbers(dims.n_controls * m * m),
    );
    let rows = dims.unknowns() + dims.all_inputs() + dims.all_rows();
    let rest = (numbers(dims.unknowns()), numbers(dims.all_inputs()), spreads(rows));
    (matrices, rest).prop_map(move |((a, b, c, rows_x, rows_u, q, r), (g, middle, spreads))| {
        let squares = |factors: &[f64], size: usize, least: f64| -> Vec<f64> {
            let blocks = factors.chunks_exact(size * size);
            let entry = |f: &[f64], i: usize, k: usize| {
                let product = dot(&f[i * size..(i + 1) * size], &f[k * size..(k + 1) * size]);
                product + if i == k { least } else { 0.0 }
            };
            let square = |f: &[f64]| -> Vec<f64> {
                let f = f.to_vec();
                (0..size * size).map(|at| entry(&f, at / size, at % size)).collect()
            };
            blocks.flat_map(square).collect()
        };
        let mut qp = Qp::new(dims, squares(&q, n, 0.0), squares(&r, m, 0.5));
        qp.a = a.iter().map(|a| a / 2.0).collect();
        (qp.b, qp.c, qp.rows_x, qp.rows_u) = (b, c, rows_x, rows_u);
        qp.gradient = g.iter().map(|g| 4.0 * g).collect();
        set_limits(&mut qp, &middle, &spreads);
        qp
    })
}

/// Limits about the point that the inputs `middle` lead to.
fn set_limits(qp: &mut Qp, middle: &[f64], spreads: &[Spread]) {
    let dims = qp.dims;
    let (n, m) = (dims.nx, dims.nu);
    let mut d = vec![0.0; dims.unknowns()];
    d[dims.all_states()..].copy_from_slice(middle);
    for j in 0..dims.horizon {
        for k in 0..n {
            let origin = dims.origin(j);
            let state = origin.checked_sub(1).map(|before| before * n..(before + 1) * n);
            let before = state.map_or(vec![0.0; n], |state| d[state].to_vec());
            let u = dims.all_states() + dims.acting(origin) * m;
            d[j * n + k] = qp.c[j * n + k]
                + dot(&qp.a(j)[k * n..(k + 1) * n], &before)
                + dot(&qp.b(j)[k * m..(k + 1) * m], &d[u..u + m]);
        }
    }
    let values: Vec<f64> = Dense::new(qp).rows.iter().map(|(row, _)| dot(row, &d)).collect();
    let (bounds, rest) = values.split_at(dims.unknowns());
    let (increments, rows) = rest.split_at(dims.all_inputs());
    let mut spreads = spreads.iter();
    for (limits, values) in
        [(&mut qp.bounds, bounds), (&mut qp.increments, increments), (&mut qp.rows, rows)]
    {
        for ((i, &value), &how) in values.iter().enumerate().zip(&mut spreads) {
            spread(limits, i, value, how);
        }
    }
    for j in dims.constrained() {
        for (at, row) in dims.stage_rows(j).enumerate().take(dims.general()) {
            let equality = at >= dims.inequalities;
            qp.rows.low[row] = if equality { rows[row] } else { f64::NEG_INFINITY };
            qp.rows.high[row] = if equality { rows[row] } else { qp.rows.high[row] };
        }
    }
}

/// The program with the states and inputs of a stage, and the cost, counted in units so many times
/// smaller, one for each.
pub(super) fn counted(qp: &Qp, x: &[f64], u: &[f64], cost: f64) -> Qp {
    let mut qp = qp.clone();
    let states = qp.dims.all_states();
    // Scales blocks of rows in units `of` and columns in units `by`.
    let blocks = |values: &mut [f64], of: &[f64], by: &[f64]| {
        for (row, &of) in values.chunks_exact_mut(by.len()).zip(of.iter().cycle()) {
            row.iter_mut().zip(by).for_each(|(value, by)| *value *= of / by);
        }
    };
    let times = |values: &mut [f64], factors: &[f64]| {
        values.iter_mut().zip(factors.iter().cycle()).for_each(|(value, f)| *value *= f);
    };
    let per = |units: &[f64]| -> Vec<f64> { units.iter().map(|unit| cost / unit).collect() };
    let (cost_x, cost_u) = (per(x), per(u));
    blocks(&mut qp.q, &cost_x, x);
    blocks(&mut qp.s, &cost_u, x);
    blocks(&mut qp.s_before, &cost_u, x);
    blocks(&mut qp.r, &cost_u, u);
    blocks(&mut qp.t, &cost_u, u);
    blocks(&mut qp.a, x, x);
    blocks(&mut qp.b, x, u);
    blocks(&mut qp.rows_x, &[1.0], x);
    blocks(&mut qp.rows_u, &[1.0], u);
    times(&mut qp.c, x);
    times(&mut qp.gradient[..states], &cost_x);
    times(&mut qp.gradient[states..], &cost_u);
    for side in [&mut qp.bounds.low, &mut qp.bounds.high] {
        times(&mut side[..states], x);
        times(&mut side[states..], u);
    }
    times(&mut qp.bounds.penalty[..states], &cost_x);
    times(&mut qp.bounds.penalty[states..], &cost_u);
    for side in [&mut qp.increments.low, &mut qp.increments.high] {
        times(side, u);
    }
    times(&mut qp.increments.penalty, &cost_u);
    times(&mut qp.rows.penalty, &[cost]);
    qp
}

/// F'F of factors F, one after the other: squares of this size.
fn squares(factors: &[f64], size: usize) -> Vec<Vec<f64>> {
    let square = |f: &[f64]| {
        let entry = |at: usize| {
            let (i, k) = (at / size, at % size);
            (0..size).map(|l| f[l * size + i] * f[l * size + k]).sum()
        };
        (0..size * size).map(entry).collect()
    };
    factors.chunks_exact(size * size).map(square).collect()
}

/// Programs with S and T: a positive semidefinite square of (x, u) at each stage. Half of them have
/// E too: another square of each state and the input before.
pub(super) fn stage_costs(coarse: bool) -> impl Strategy<Value = Qp> {
    with_stage_costs(programs(coarse))
}

fn with_stage_costs(plain: impl Strategy<Value = Qp>) -> impl Strategy<Value = Qp> {
    (plain, any::<bool>()).prop_flat_map(|(qp, ends)| {
        let OcpDims { nx, nu, horizon, .. } = qp.dims;
        let width = nx + nu;
        let count = if ends { 2 * horizon } else { horizon };
        vec(-1.5..1.5_f64, count * width * width).prop_map(move |factors| {
            let mut qp =
                if ends { qp.clone().with_end_cost() } else { qp.clone().with_stage_cost() };
            for (at, square) in squares(&factors, width).iter().enumerate() {
                let (j, before) = (at % horizon, at / horizon);
                let node = if before > 0 { qp.dims.origin(j) } else { j + 1 };
                let acting = qp.dims.acting(node);
                let s = if before > 0 { &mut qp.s_before } else { &mut qp.s };
                for (row, line) in square.chunks_exact(width).enumerate() {
                    let (by_x, by_u) = line.split_at(nx);
                    let (to, from) = match row.checked_sub(nx) {
                        None => (&mut qp.q[(j * nx + row) * nx..], by_x),
                        Some(k) => {
                            s[(j * nu + k) * nx..][..nx].copy_from_slice(by_x);
                            (&mut qp.t[(acting * nu + k) * nu..], by_u)
                        }
                    };
                    to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
                }
            }
            qp
        })
    })
}

/// Programs with W.
pub(super) fn coupled(coarse: bool) -> impl Strategy<Value = Qp> {
    programs(coarse).prop_flat_map(|qp| {
        let inputs = qp.dims.all_inputs();
        vec(-1.5..1.5_f64, inputs * inputs).prop_map(move |factors| {
            let w = squares(&factors, inputs).concat();
            Qp { w, ..qp.clone() }
        })
    })
}

/// The program without weights of its own on the inputs, each of which has bounds.
pub(super) fn unweighted(mut qp: Qp) -> Qp {
    let first = qp.dims.all_states();
    qp.r.fill(0.0);
    for (i, value) in qp.bounds.low[first..].iter_mut().enumerate() {
        let high = &mut qp.bounds.high[first + i];
        *value = value.max(-10.0);
        *high = high.min(10.0);
        qp.bounds.penalty[first + i] = f64::INFINITY;
    }
    qp
}
