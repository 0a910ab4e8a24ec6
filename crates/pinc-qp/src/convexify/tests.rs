use super::*;

/// Two states, two inputs of which the second is held for two stages, three stages.
fn program(curvature: f64) -> Qp {
    let dims = OcpDims { n_controls: 2, ..OcpDims::new(2, 2, 3) };
    let mut qp = Qp::new(dims, vec![0.0; 12], [1.0, 0.2, 0.2, 0.5].repeat(2)).with_end_cost();
    let numbers = |count: usize, shift: f64| -> Vec<f64> {
        (0..count).map(|i| (1.7 * f64::from(u32::try_from(i).unwrap()) + shift).sin()).collect()
    };
    (qp.a, qp.b, qp.s, qp.s_before) =
        (numbers(12, 0.3), numbers(12, 1.1), numbers(12, 2.0), numbers(12, 0.7));
    // Indefinite by itself.
    qp.q = [-0.8, 0.3, 0.3, 1.5].repeat(3);
    qp.t = [curvature, 0.4, 0.4, curvature].repeat(2);
    qp.gradient = numbers(10, 0.1);
    qp
}

/// d'H d of the step in which the inputs move by `u`.
fn curvature(qp: &Qp, u: &[f64]) -> f64 {
    let form = |h: &[f64], a: &[f64], b: &[f64]| -> f64 {
        let rows = h.chunks_exact(b.len()).zip(a);
        rows.map(|(row, a)| a * row.iter().zip(b).map(|(h, b)| h * b).sum::<f64>()).sum()
    };
    let (mut x, mut sum) = (vec![0.0; 2], 0.0);
    for j in 0..3 {
        let now = &u[2 * j.min(1)..2 * j.min(1) + 2];
        let next: Vec<f64> = (0..2)
            .map(|i| {
                let (a, b) = (&qp.a(j)[2 * i..2 * i + 2], &qp.b[4 * j + 2 * i..4 * j + 2 * i + 2]);
                a[0] * x[0] + a[1] * x[1] + b[0] * now[0] + b[1] * now[1]
            })
            .collect();
        x = next;
        let after = &u[2 * (j + 1).min(1)..2 * (j + 1).min(1) + 2];
        sum += form(qp.q(j + 1), &x, &x);
        sum += 2.0 * form(qp.s(j + 1).unwrap(), after, &x);
        sum += 2.0 * form(qp.s_before(j + 1).unwrap(), now, &x);
    }
    let (first, last) = (&u[..2], &u[2..]);
    let moved = [last[0] - first[0], last[1] - first[1]];
    sum + form(qp.t(0).unwrap(), first, first)
        + form(qp.t(1).unwrap(), last, last)
        + form(qp.r(0), first, first)
        + form(qp.r(1), &moved, &moved)
}

/// The least curvature along the eigenvectors of the Hessian in the inputs.
fn least(qp: &Qp) -> f64 {
    let unit = |i: usize, k: usize| {
        let mut u = [0.0; 4];
        (u[i], u[k]) = (1.0, 1.0);
        curvature(qp, &u)
    };
    let mut matrix = vec![0.0; 16];
    for i in 0..4 {
        for k in 0..4 {
            let both = if i == k { 2.0 * unit(i, i) } else { unit(i, k) - unit(i, i) - unit(k, k) };
            matrix[4 * i + k] = 0.5 * both;
        }
    }
    let mut vectors = vec![0.0; 16];
    diagonalize(&mut matrix, &mut vectors, 4);
    (0..4).map(|i| matrix[5 * i]).fold(f64::INFINITY, f64::min)
}

#[test]
fn a_program_with_one_minimum_is_left_as_it_is() {
    let mut qp = program(9.0);
    let t = qp.t.clone();
    assert!(least(&qp) > 0.1, "{}", least(&qp));
    assert!(!Convexifier::new(qp.dims).apply(&mut qp, None, Convexity::default()));
    assert_eq!(qp.t, t);
}

/// Whether the program is changed is whether its Hessian in the inputs has a negative
/// eigenvalue, which it has no more afterwards.
#[test]
fn negative_curvature_is_found_and_dropped() {
    let mut changed = 0;
    for step in -20..40 {
        let mut qp = program(0.25 * f64::from(step));
        let before = least(&qp);
        let dropped = Convexifier::new(qp.dims).apply(&mut qp, None, Convexity::default());
        assert_eq!(dropped, before < 0.0, "{step}: {before}");
        assert!(least(&qp) > 0.0, "{step}: {}", least(&qp));
        changed += usize::from(dropped);
    }
    assert!((10..50).contains(&changed), "{changed}");
}

/// What is kept by an active bound does not count.
#[test]
fn active_bounds_hide_curvature() {
    let mut qp = program(9.0);
    qp.t[0] = -40.0;
    let mut multipliers = Multipliers::new(qp.dims);
    assert!(Convexifier::new(qp.dims).finds_descent(&mut qp.clone(), &multipliers));
    multipliers.bounds[6] = -0.5;
    (qp.bounds.low[6], qp.bounds.penalty[6]) = (-0.1, 0.5);
    // A violated bound keeps nothing.
    assert!(Convexifier::new(qp.dims).finds_descent(&mut qp.clone(), &multipliers));
    qp.bounds.penalty[6] = 0.6;
    assert!(!Convexifier::new(qp.dims).finds_descent(&mut qp.clone(), &multipliers));
}

/// The solution of a program whose rows of each kind are active stays what it is, and the program
/// becomes convex without a change of other curvature.
#[test]
fn active_rows_are_held_where_they_are() {
    for kind in 0..4 {
        let mut qp = program(9.0);
        let dims = OcpDims { inequalities: 1, ..qp.dims };
        qp = Qp { dims, rows: Limits::none(3), rows_x: vec![0.0; 6], rows_u: vec![0.0; 6], ..qp };
        let mut multipliers = Multipliers::new(dims);
        // The first input moves by 0.3.
        match kind {
            0 => {
                (qp.bounds.high[6], multipliers.bounds[6]) = (0.3, 2.0);
            }
            1 => {
                (qp.increments.low[0], multipliers.increments[0]) = (0.3, -2.0);
            }
            2 => {
                // A state that only this input moves.
                (qp.a, qp.b) = (vec![0.0; 12], vec![0.0; 12]);
                qp.b[0] = 1.0;
                (qp.bounds.high[0], multipliers.bounds[0]) = (0.3, 2.0);
            }
            _ => {
                // 2 u + x of the next stage.
                (qp.a, qp.b) = (vec![0.0; 12], vec![0.0; 12]);
                (qp.rows_x[0], qp.rows_u[0], qp.rows_u[1]) = (1.0, 0.0, 0.0);
                qp.b[0] = 2.0;
                (qp.rows.high[0], multipliers.rows[0]) = (0.6, 2.0);
            }
        }
        let moved = |qp: &Qp, d: f64| {
            let x = qp.b[0] * d;
            let rest = qp.q[0] * x * x + qp.t[0] * d * d + qp.r[0] * d * d;
            0.5 * rest + qp.gradient[6] * d + qp.gradient[0] * x
        };
        qp.t[0] = -40.0;
        let before = qp.clone();
        assert!(Convexifier::new(dims).apply(&mut before.clone(), None, Convexity::default()));
        assert!(
            !Convexifier::new(dims).apply(&mut qp, Some(&multipliers), Convexity::default()),
            "{kind}"
        );
        let change = |d: f64| moved(&qp, d) - moved(&before, d);
        // rho (d - 0.3)^2 / 2 but for a constant: least at 0.3.
        let [least, below, above] = [0.3, 0.2, 0.4].map(change);
        assert!(below > least + 10.0 && above > least + 10.0, "{kind}: {below} {least} {above}");
        assert!((above - below).abs() < 1e-9 * above.abs().max(1e6), "{kind}");
    }
}

/// rho (u2 - u1 - 0.3)^2 / 2 with rho = 9, the largest entry.
#[test]
fn an_increment_is_held_between_its_two_inputs() {
    let (mut qp, before) = (program(9.0), program(9.0).gradient);
    let mut multipliers = Multipliers::new(qp.dims);
    (qp.increments.low[2], multipliers.increments[2]) = (0.3, -2.0);
    hold(&mut qp, &multipliers, 1.0);
    for (i, (after, before)) in qp.gradient.iter().zip(before).enumerate() {
        let expected = [(6, 2.7), (8, -2.7)].into_iter().find(|(place, _)| *place == i);
        assert!((after - before - expected.map_or(0.0, |of| of.1)).abs() < 1e-12, "{i}");
    }
}

#[test]
fn eigenvalues_match_a_known_matrix() {
    // Q diag(3, -1, 0.5) Q' with rotations Q.
    let (mut matrix, mut vectors) =
        (vec![3.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.5], vec![0.0; 9]);
    rotate(&mut matrix, &mut vectors, 3, [0, 2], [0.8, 0.6]);
    rotate(&mut matrix, &mut vectors, 3, [1, 2], [0.28, 0.96]);
    diagonalize(&mut matrix, &mut vectors, 3);
    let mut values = [matrix[0], matrix[4], matrix[8]];
    values.sort_by(f64::total_cmp);
    for (found, expected) in values.iter().zip([-1.0, 0.5, 3.0]) {
        assert!((found - expected).abs() < 1e-14, "{found} {expected}");
    }
}

/// Dynamics that magnify what is changed at one stage, over many stages.
fn unstable() -> Qp {
    let mut dims = program(0.0).dims;
    (dims.nx, dims.nu, dims.horizon, dims.n_controls) = (2, 1, 100, 100);
    let mut qp = Qp::new(dims, [0.3, 0.4, 0.4, -0.3].repeat(100), vec![1.0; 100]).with_end_cost();
    (qp.a, qp.b) = ([1.5, 0.1, 0.0, 0.9].repeat(100), [1.0, 0.5].repeat(100));
    (qp.s, qp.s_before) = (vec![0.2; 200], vec![-0.1; 200]);
    qp.t = vec![-0.05; 100];
    qp
}

/// The second state may be in a unit that is 1024 times smaller, if its weight says so.
#[test]
fn a_shift_means_the_same_in_other_units() {
    // How much of the old unit the new one is.
    const UNITS: [f64; 2] = [1.0, 1.0 / 1024.0];
    let both = |at: usize| [UNITS[at / 2 % 2], UNITS[at % 2]];
    let plain = unstable();
    let mut scaled = plain.clone();
    for (at, a) in scaled.a.iter_mut().enumerate() {
        let [row, column] = both(at);
        *a *= column / row;
    }
    scaled.q.iter_mut().enumerate().for_each(|(at, q)| *q *= both(at)[0] * both(at)[1]);
    scaled.b.iter_mut().zip(UNITS.iter().cycle()).for_each(|(b, unit)| *b /= unit);
    for products in [&mut scaled.s, &mut scaled.s_before] {
        products.iter_mut().zip(UNITS.iter().cycle()).for_each(|(s, unit)| *s *= unit);
    }
    scaled.shift_weights = UNITS.map(|unit| unit * unit).to_vec();
    for by in [Convexity::default(), Convexity { damping: 1e-3, shifts: true }] {
        let (mut found, mut expected) = (scaled.clone(), plain.clone());
        assert!(Convexifier::new(plain.dims).apply(&mut expected, None, by));
        assert!(Convexifier::new(plain.dims).apply(&mut found, None, by));
        assert!(expected.t.iter().zip(&plain.t).all(|(t, before)| t > before));
        assert_eq!(found.t, expected.t);
        for (at, (q, expected)) in found.q.iter().zip(&expected.q).enumerate() {
            assert_eq!(q.to_bits(), (expected * both(at)[0] * both(at)[1]).to_bits());
        }
    }
}

#[test]
fn the_shift_is_as_large_as_it_must_be_and_no_larger() {
    let mut qp = unstable();
    let dims = qp.dims;
    let (before, mut convexifier) = (qp.clone(), Convexifier::new(dims));
    assert!(convexifier.apply(&mut qp, None, Convexity::default()));
    let shift = qp.t[0] - before.t[0];
    assert!((0.05..5.0).contains(&shift), "{shift}");
    let mut expected = before.clone();
    shift_hessian(&mut expected, shift);
    for (found, expected) in [(&qp.q, &expected.q), (&qp.t, &expected.t), (&qp.s, &expected.s)] {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }
    let mut less = before.clone();
    shift_hessian(&mut less, shift / (1.01 * GROWTH));
    assert!(convexifier.recur(&mut less, true));

    // Damped by as much, it is convex from the beginning.
    let mut damped = before.clone();
    let damping = shift / largest_entry(&damped);
    assert!(!convexifier.apply(&mut damped, None, Convexity { damping, shifts: false }));
    assert!((damped.t[0] - qp.t[0]).abs() < 1e-12);

    // Where little is missing, T alone changes.
    let mut short = before.clone();
    short.a.fill(0.0);
    short.t.fill(-5.0);
    let q = short.q.clone();
    assert!(convexifier.apply(&mut short, None, Convexity::default()));
    assert_eq!(short.q, q);
    assert!(short.t.iter().any(|t| *t > -5.0));

    // Or else all diagonals by as much, by choice.
    (short.a, short.t) = (vec![0.0; 400], vec![-5.0; 100]);
    let by = Convexity { damping: 0.0, shifts: true };
    assert!(convexifier.apply(&mut short, None, by));
    let shift = short.t[0] + 5.0;
    assert!(short.t.iter().all(|t| (t - short.t[0]).abs() < 1e-12), "{:?}", short.t);
    assert!(shift > 1.0 && (short.q[0] - before.q[0] - shift).abs() < 1e-12, "{shift}");
    assert!(!convexifier.recur(&mut short, true));
}
