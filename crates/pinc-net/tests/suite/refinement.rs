//! Trainings that are taken up again with points added to their samples.

use super::trainings::{broyden, finish, training, van_der_pol};
use pinc_net::{Ansatz, Points, StopReason, Trainer};
use pinc_ode::{DynRhs, Model};
use pinc_plants::VanDerPol;

/// Corners of the domain at several times.
fn corners() -> Points {
    let mut points = Points::new(DynRhs::dims(&VanDerPol::default()));
    for x in [[3.0, 3.0], [-3.0, 3.0], [3.0, -3.0], [-3.0, -3.0]] {
        for k in 0..64 {
            let t = 0.5 * f64::from(k % 8 + 1) / 8.0;
            points.push(t, &x, &[f64::from(k % 3) - 1.0], &[]);
        }
    }
    points
}

/// The error of a step from a corner.
fn error(trainer: &Trainer) -> f64 {
    let plant = VanDerPol::default();
    let mut model = pinc_net::PincModel::new(&trainer.net()).unwrap();
    let mut truth = pinc_ode::Dopri5::new(plant, 1e-10);
    let (mut next, mut exact) = ([0.0; 2], [3.0, 3.0]);
    model.step(&[3.0, 3.0], &[1.0], &[], &mut next);
    truth.integrate(&mut exact, &[1.0], 0.5).unwrap();
    (next[0] - exact[0]).hypot(next[1] - exact[1])
}

#[test]
fn added_points_bring_down_the_errors_near_them() {
    let begin = || van_der_pol(&training(vec![broyden(60)]), Ansatz::HardLinear, 1);
    let mut trainer = begin();
    let (records, _) = finish(&mut trainer);
    let (last, before) = (records.len(), error(&trainer));
    let selected = trainer.net();
    trainer.refine(&corners()).unwrap();
    assert_eq!(trainer.net(), selected, "it goes on from the net selected so far");
    // A resumed refinement is the same, bit for bit.
    for _ in 0..5 {
        trainer.step().unwrap();
    }
    let mut resumed = begin().resume(trainer.checkpoint().clone()).unwrap();
    let (records, reason) = finish(&mut trainer);
    assert_eq!(finish(&mut resumed).0, records);
    let done = usize::try_from(records.last().unwrap().iteration).unwrap() - last;
    assert!(done == 1000 || reason != StopReason::IterationsDone, "{done} {reason:?}");
    assert!(error(&trainer) < 0.2 * before, "{} {before}", error(&trainer));
    assert_eq!(trainer.net().mlp().parameters(), resumed.net().mlp().parameters());
}
