//! Gradients through the prediction over a delay.

use pinc_mpc::Nmpc;
use pinc_ode::{Gradients, LinearizationBuffer, Stages};
use pinc_sensitivity::{Given, ProblemDerivative};

/// Carries the gradient of a step back from the state predicted for its delay,
///
/// ```text
/// x_0 = x,   x_{j+1} = F(x_j, u_j, p),   j < delay
/// ```
///
/// to the measured state x, to p and to the inputs under way, whose gradients it returns, `[delay, m]`
/// (without a delay that of the input before). `under_way` has all of them, or one for all.
pub(crate) fn add_prediction(
    nmpc: &mut Nmpc,
    [x, under_way]: [&[f64]; 2],
    gradient: &mut ProblemDerivative,
) -> Vec<f64> {
    let (dims, delay) = (nmpc.model().dims(), nmpc.problem().delay);
    let mut by_under_way = vec![0.0; delay.max(1) * dims.nu];
    let last = by_under_way.len() - dims.nu;
    by_under_way[last..].copy_from_slice(gradient.get(Given::AppliedInput));
    if delay == 0 {
        return by_under_way;
    }
    let u = |j: usize| &under_way[j * dims.nu % under_way.len()..][..dims.nu];
    let mut program = nmpc.program();
    let (model, p) = program.model(0);
    let mut states = vec![x.to_vec()];
    for j in 1..delay {
        let mut next = vec![0.0; dims.nx];
        model.step(&states[j - 1], u(j - 1), p, &mut next);
        states.push(next);
    }
    let mut room = LinearizationBuffer::new(dims, 1);
    let (mut by_x, mut by_u, mut by_p) =
        (vec![0.0; dims.nx], vec![0.0; dims.nu], vec![0.0; dims.np]);
    for (j, x) in states.iter().enumerate().rev() {
        let out = Gradients { x: &mut by_x, u: &mut by_u, p: &mut by_p };
        room.gradients(model, Stages { x, u: u(j), p }, gradient.get(Given::State), out);
        gradient.get_mut(Given::State).copy_from_slice(&by_x);
        add(&mut by_under_way[j * dims.nu..], &by_u);
        add(gradient.get_mut(Given::AppliedInput), &by_u);
        add(gradient.get_mut(Given::Parameters), &by_p);
    }
    by_under_way
}

fn add(sum: &mut [f64], terms: &[f64]) {
    sum.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
}
