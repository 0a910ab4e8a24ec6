//! Gradients through the prediction over a delay.

use pinc_mpc::Nmpc;
use pinc_ode::{Gradients, LinearizationBuffer, Stages};
use pinc_sensitivity::{Given, ProblemDerivative};

/// Carries the gradient of a step back from the state predicted for its delay,
///
/// ```text
/// x_0 = x,   x_{j+1} = F(x_j, u_before, p),   j < delay
/// ```
///
/// to the measured state x, to the input before, which is all that is under way, and to p.
pub(crate) fn add_prediction(
    nmpc: &mut Nmpc,
    [x, u_before]: [&[f64]; 2],
    gradient: &mut ProblemDerivative,
) {
    let (dims, delay) = (nmpc.model().dims(), nmpc.problem().delay);
    if delay == 0 {
        return;
    }
    let mut program = nmpc.program();
    let (model, p) = program.model(0);
    let mut states = vec![x.to_vec()];
    for j in 1..delay {
        let mut next = vec![0.0; dims.nx];
        model.step(&states[j - 1], u_before, p, &mut next);
        states.push(next);
    }
    let mut room = LinearizationBuffer::new(dims, 1);
    let (mut by_x, mut by_u, mut by_p) =
        (vec![0.0; dims.nx], vec![0.0; dims.nu], vec![0.0; dims.np]);
    for x in states.iter().rev() {
        let out = Gradients { x: &mut by_x, u: &mut by_u, p: &mut by_p };
        room.gradients(model, Stages { x, u: u_before, p }, gradient.get(Given::State), out);
        gradient.get_mut(Given::State).copy_from_slice(&by_x);
        for (given, by) in [(Given::AppliedInput, &by_u), (Given::Parameters, &by_p)] {
            gradient.get_mut(given).iter_mut().zip(by).for_each(|(sum, by)| *sum += by);
        }
    }
}
