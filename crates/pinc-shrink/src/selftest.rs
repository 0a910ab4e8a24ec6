//! Golden decisions, with which a self-test in C compares a net and its check.

use crate::Policy;
use crate::c::Tables;
use crate::check::{Checked, Rating, TOLERANCE};
use pinc_export::Controller;
use pinc_mpc::Nmpc;

/// How many decisions there are.
const STEPS: usize = 20;

/// Costs and violations that are apart by less than this part of their size may change places by rounding
/// in single precision.
const APART: f64 = 1e-3;

/// What the net and its check decide along a closed loop with the model, from the controller's initial
/// state on, as tables of C: the state, the values to follow, the input applied last, the plan before,
/// the net's plan, the plan taken; and which that is, or -1 where rounding decides.
pub(crate) fn golden(policy: &Policy, nmpc: &mut Nmpc, controller: &Controller<'_>) -> String {
    let mut rows: [Vec<f64>; 6] = Default::default();
    let (mut policy, mut checked) = (policy.clone(), Checked::of(policy.clone(), nmpc));
    let (m, steps) = (nmpc.model().dims().nu, STEPS.min(controller.reference.steps()));
    let mut x = controller.initial_state.to_vec();
    let mut u = controller.initial_input.map_or_else(|| vec![0.0; m], <[f64]>::to_vec);
    let mut plan = u.repeat(controller.problem.control_horizon);
    let mut taken = Vec::new();
    for k in 0..steps {
        let reference = controller.reference.at(k);
        policy.limits.project(&u, &mut plan);
        let (before, mut own) = (plan.clone(), plan.clone());
        policy.plan(&x, reference, &u, &mut own);
        let at = [&x[..], reference, &u];
        let (number, best) = checked.decide(&mut nmpc.program(), at, &mut plan);
        let ratings = checked.ratings(&mut nmpc.program(), at, &before);
        let breaks = if best.violation > TOLERANCE { ratings.len() } else { 0 };
        let decided = (number + breaks).to_string();
        taken.push(if is_clear(&ratings, number) { decided } else { "-1".to_owned() });
        for (row, values) in rows.iter_mut().zip([&x, reference, &u, &before, &own, &plan]) {
            row.extend(values);
        }
        let mut next = vec![0.0; x.len()];
        let mut program = nmpc.program();
        let (model, p) = program.model(0);
        model.step(&x, &plan[..m], p, &mut next);
        x = next;
        u.copy_from_slice(&plan[..m]);
        plan.copy_within(m.., 0);
    }
    let mut tables = Tables::default();
    tables.count("PINC_POLICY_CASES", steps);
    let names = ["x", "reference", "u", "before", "net", "plan"];
    for (name, row) in names.into_iter().zip(rows) {
        let texts: Vec<String> = row.iter().map(|value| format!("{value:e}")).collect();
        tables.table(("double", &format!("pinc_golden_{name}"), ""), &texts);
    }
    tables.table(("int", "pinc_golden_taken", ""), &taken);
    tables.text
}

/// Whether rounding leaves the plan of this number the best.
fn is_clear(ratings: &[Rating], best: usize) -> bool {
    let apart = |a: f64, b: f64| (a - b).abs() > APART * (a.abs() + b.abs());
    let [limit, near] = [0.1, 10.0].map(|part| part * TOLERANCE);
    let is_away = |of: &Rating| !(limit..near).contains(&of.violation);
    let loses = |(k, of): (usize, &Rating)| {
        let [own, others] = [&ratings[best], of].map(|of| of.violation.max(TOLERANCE));
        let kept = own <= TOLERANCE && others <= TOLERANCE;
        k == best || if kept { apart(ratings[best].cost, of.cost) } else { apart(own, others) }
    };
    ratings.iter().all(is_away) && ratings.iter().enumerate().all(loses)
}
