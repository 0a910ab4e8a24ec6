//! Diagnoses of faulty data and poor fits.

use crate::support::{noise, oscillator, plant, problem, simulated, steps};
use pinc_identify::{
    Diagnosis, FitStatus, Identified, IdentifyError, InitialState, Prior, Problem, Recording, Side,
    identify,
};
use pinc_ode::{ArgumentError, DynPlant, Integrator};

/// One tank: inflow k u through a valve gamma; the second valve does nothing.
fn tank() -> Box<dyn DynPlant> {
    plant(
        &[("h", "(k*gamma*u - a*sqrt(max(h, 0)*1962))/A + 0*idle")],
        &["u"],
        &[("A", 28.0), ("a", 0.07), ("gamma", 0.6), ("idle", 1.0), ("k", 3.3)],
        &["a", "k", "gamma", "idle"],
    )
}

const TRUTH: [f64; 4] = [0.07, 3.3, 0.6, 1.0];
const STARTS: [(f64, f64, f64); 4] =
    [(0.06, 0.01, 0.2), (3.0, 0.5, 9.0), (0.5, 0.1, 1.0), (2.0, 0.0, 5.0)];

/// The tank's level under steps of the inflow, with noise.
fn data(rows: usize) -> (Vec<f64>, Vec<f64>) {
    let u = steps(11, rows, 12, (1.0, 4.0));
    let x = simulated(&mut *tank().model(Integrator::Rk4, 10.0, 4).unwrap(), &[8.0], &u, &TRUTH);
    let y = x.iter().zip(noise(4, 0.05, rows)).map(|(x, noise)| x + noise).collect();
    (u, y)
}

/// With these parameters unknown, by their places, and the others at their true values.
fn with(unknown: &[usize]) -> Problem {
    let free = InitialState::Free(vec![8.0]);
    let mut all = problem(&*tank(), &[0], Some(0.05), &STARTS, free);
    all.parameters = TRUTH.to_vec();
    all.unknown = unknown.iter().map(|&i| all.unknown[i].clone()).collect();
    all
}

fn fit(problem: &Problem, u: &[f64], y: &[f64]) -> Identified {
    let mut model = tank().model(Integrator::Rk4, 10.0, 4).unwrap();
    identify(&mut *model, problem, &[Recording { name: "tank", before: None, u, y }]).unwrap()
}

fn words(found: &Identified) -> String {
    found.findings.iter().map(|finding| format!("{finding}\n")).collect()
}

#[test]
fn good_data_have_no_findings() {
    let (u, y) = data(150);
    let found = fit(&with(&[0, 1]), &u, &y);
    assert_eq!(found.findings, []);
    assert_eq!(found.status, FitStatus::Converged);
}

#[test]
fn a_parameter_without_influence_is_named_and_stays() {
    let (u, y) = data(150);
    let found = fit(&with(&[0, 1, 3]), &u, &y);
    assert_eq!(found.findings, [Diagnosis::NoInfluence { name: "idle".to_owned() }]);
    assert_eq!(found.parameters[2].half_width, None);
    assert!((found.parameters[2].value - 2.0).abs() < 1e-12);
    assert!(words(&found).contains("idle cannot be identified: nothing measured depends on it"));
    // The others do not suffer.
    let alone = fit(&with(&[0, 1]), &u, &y);
    for (a, b) in alone.parameters.iter().zip(&found.parameters) {
        assert!((a.value - b.value).abs() < 1e-6 * a.value);
        assert!((a.half_width.unwrap() / b.half_width.unwrap() - 1.0).abs() < 1e-4);
    }
    // What is not fitted takes no degree of freedom.
    assert_eq!(found.degrees_of_freedom, alone.degrees_of_freedom);
}

/// What the data do not say is known as well as before them: it is at the mean of its prior, with
/// the prior's standard deviation, times the residuals' and a quantile of Student's distribution.
#[test]
fn a_prior_stands_in_for_data() {
    let (u, y) = data(150);
    let mut known = with(&[0, 1, 3]);
    known.unknown[2].prior = Some(Prior { mean: 2.5, sd: 0.3 });
    let found = fit(&known, &u, &y);
    assert_eq!(found.findings, []);
    let idle = &found.parameters[2];
    assert!((idle.value - 2.5).abs() < 1e-6, "{}", idle.value);
    let residuals = (2.0 * found.cost / found.degrees_of_freedom as f64).sqrt();
    let quantile = idle.half_width.unwrap() / (0.3 * residuals);
    // Of 147 degrees of freedom: 1.976.
    assert!((quantile - 1.976).abs() < 2e-3, "{quantile} of {}", found.degrees_of_freedom);
}

/// Only the product of k and gamma counts.
#[test]
fn a_pair_that_cannot_be_told_apart_is_named_with_its_direction() {
    let (u, y) = data(150);
    let found = fit(&with(&[0, 1, 2]), &u, &y);
    let [Diagnosis::Undetermined { direction }] = &found.findings[..] else {
        panic!("{}", words(&found));
    };
    let names: Vec<_> = direction.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["k", "gamma"]);
    assert!((direction[0].1 - 1.0).abs() < 1e-6 && (direction[1].1 + 1.0).abs() < 1e-6);
    let text = words(&found);
    assert!(
        text.contains("k, gamma cannot be identified together: k by +1.00 %, gamma by -1.00 %")
    );
    let alone = Diagnosis::Undetermined { direction: vec![("k".to_owned(), 1.0)] };
    let expected = "k cannot be identified: k by +1.00 % changes nothing measured; fix it, or vary the \
        inputs more";
    assert_eq!(alone.to_string(), expected);
    // What is determined is so, and the product too.
    assert!(found.parameters[0].half_width.is_some());
    assert_eq!((found.parameters[1].half_width, found.parameters[2].half_width), (None, None));
    let product = found.parameters[1].value * found.parameters[2].value;
    assert!((product - 3.3 * 0.6).abs() < 0.05, "{product}");
}

#[test]
fn data_of_another_plant_do_not_fit() {
    let u = steps(11, 200, 12, (1.0, 4.0));
    // Two tanks in a row, and a leak.
    let mut other = plant(
        &[("h", "(1.98*g - 0.2*h)/28"), ("g", "(u - g)/lag")],
        &["u"],
        &[("lag", 60.0)],
        &["lag"],
    )
    .model(Integrator::Rk4, 10.0, 4)
    .unwrap();
    let x = simulated(&mut *other, &[8.0, 2.0], &u, &[60.0]);
    let y: Vec<f64> =
        x.chunks(2).map(|x| x[0]).zip(noise(4, 0.05, 200)).map(|(x, e)| x + e).collect();
    let found = fit(&with(&[0, 1]), &u, &y);
    let text = words(&found);
    assert!(text.contains("data of another plant"), "{text}");
    assert!(text.contains("not white"), "{text}");
    // The data without a known noise.
    let mut unknown = with(&[0, 1]);
    unknown.channels[0].sd = None;
    let text = words(&fit(&unknown, &u, &y));
    assert!(text.contains("not white"), "{text}");
}

/// Rows that are steps apart have neighbours all the same: a slow inflow that the equations lack is
/// found in residuals and in their size, and white residuals stay white.
#[test]
fn residuals_with_gaps_between_them_are_examined() {
    let row = |k: u32| f64::from(k);
    let u: Vec<f64> = (0..600).map(row).map(|k| 2.5 + (k / 40.0).sin()).collect();
    let slow: Vec<f64> = u.iter().zip(0..).map(|(u, k)| u + 0.5 * (row(k) / 90.0).cos()).collect();
    let mut model = tank().model(Integrator::Rk4, 10.0, 4).unwrap();
    let mut measured = |u: &[f64]| -> Vec<f64> {
        let x = simulated(&mut *model, &[8.0], u, &TRUTH);
        x.iter().zip(noise(4, 0.05, 600)).map(|(x, noise)| x + noise).collect()
    };
    let (good, poor) = (measured(&u), measured(&slow));
    let every_second = |k: usize| k.is_multiple_of(2);
    let irregular = |k: usize| k.is_multiple_of(7) || k % 4 == 1;
    for (kept, even) in [(&every_second as &dyn Fn(usize) -> bool, true), (&irregular, false)] {
        let sparse = |y: &[f64]| -> Vec<f64> {
            y.iter().enumerate().map(|(k, y)| if kept(k) { *y } else { f64::NAN }).collect()
        };
        let found = fit(&with(&[0, 1]), &u, &sparse(&good));
        let text = words(&found);
        assert!(!text.contains("not white") && !text.contains("residuals, "), "{text}");
        // The correlation of what is left of the rows that there are.
        let y = sparse(&poor);
        let mut unknown = with(&[0, 1]);
        unknown.channels[0].sd = None;
        let found = fit(&unknown, &u, &y);
        let left = y.iter().zip(&found.fitted[0]).map(|(y, fitted)| y - fitted);
        let left: Vec<f64> = left.filter(|of| !of.is_nan()).collect();
        let squares: f64 = left.iter().map(|of| of * of).sum();
        let own = left.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / squares;
        let correlation = found.channels[0].correlation;
        assert!(own > 0.8 && (correlation - own).abs() < 1e-12, "{correlation} {own}");
        let text = words(&found);
        assert!(text.contains("the residuals are not white"), "{text}");
        // The noise of 0.05 as the rows have it, to a share of the signal that bends between them.
        let misfit = found.findings.iter().find_map(|finding| match finding {
            Diagnosis::Misfit { noise, given: false, .. } => Some(*noise),
            _ => None,
        });
        let noise = misfit.expect(&text);
        assert!((0.04..0.1).contains(&noise), "{noise}");
        if even {
            // A value beside the mean of its neighbours has 1 + 1/4 + 1/4 variances of the noise.
            let given: Vec<f64> = y.iter().copied().filter(|y| !y.is_nan()).collect();
            let off = given.windows(3).map(|of| (of[1] - 0.5 * (of[0] + of[2])).powi(2));
            let expected = (off.sum::<f64>() / (1.5 * (given.len() - 2) as f64)).sqrt();
            assert!((noise - expected).abs() < 1e-9, "{noise} {expected}");
        }
    }
}

#[test]
fn units_that_are_wrong_by_a_thousand_are_suspected() {
    let (u, y) = data(150);
    let millimetres: Vec<f64> = y.iter().map(|y| 1000.0 * y).collect();
    let text = words(&fit(&with(&[0, 1]), &u, &millimetres));
    assert!(
        text.contains("h: the measurements are about 1e3 times what the model gives"),
        "{text}"
    );
    let millivolts: Vec<f64> = u.iter().map(|u| 1000.0 * u).collect();
    let found = fit(&with(&[0, 1]), &millivolts, &y);
    let text = words(&found);
    assert!(text.contains("u: the data would fit far better with 1e-3 times"), "{text}");
    // Without bounds that say no, a factor in k makes good for it: that is said too.
    let mut wide = with(&[0, 1]);
    wide.unknown[1].low = 0.0;
    let found = fit(&wide, &millivolts, &y);
    let is_far = |found: &Identified| {
        found.findings.iter().any(|f| matches!(f, Diagnosis::Far { name, .. } if name == "k"))
    };
    assert!(is_far(&found), "{}", words(&found));
    // Whoever says beforehand that k may be there is not told that it is far from its start.
    wide.unknown[1].prior = Some(Prior { mean: 3.3e-3, sd: 1e-3 });
    let found = fit(&wide, &millivolts, &y);
    assert!(!is_far(&found), "{}", words(&found));
    assert!(found.parameters[1].value < 0.01, "{}", found.parameters[1].value);
}

#[test]
fn a_bound_that_is_hit_is_named_and_has_no_interval() {
    let (u, y) = data(150);
    let mut tight = with(&[0, 1]);
    tight.unknown[1].high = 3.1;
    let found = fit(&tight, &u, &y);
    let k = &found.parameters[1];
    assert_eq!((k.value, k.half_width, k.at_bound), (3.1, None, Some(Side::High)));
    let bound = Diagnosis::AtBound { name: "k".to_owned(), side: Side::High, value: 3.1 };
    assert!(found.findings.contains(&bound), "{}", words(&found));
    assert!(found.parameters[0].half_width.is_some());
    // One unknown less than there are.
    assert_eq!(found.degrees_of_freedom, 148);
    // The minimum on the bound: with k fixed there the other one is the same.
    let mut fixed = with(&[0]);
    fixed.parameters[1] = 3.1;
    let fixed = fit(&fixed, &u, &y);
    assert!((fixed.parameters[0].value - found.parameters[0].value).abs() < 1e-8);
    assert!((fixed.cost - found.cost).abs() < 1e-9 * fixed.cost);
}

#[test]
fn a_channel_without_values_is_named() {
    let plant = oscillator();
    let mut model = plant.model(Integrator::Rk4, 0.1, 2).unwrap();
    let u = steps(7, 100, 15, (-1.0, 1.0));
    let x = simulated(&mut *model, &[1.0, 0.0], &u, &[0.8, 1.3]);
    let y: Vec<f64> = x.chunks(2).flat_map(|x| [x[0], f64::NAN]).collect();
    let free = InitialState::Free(vec![1.0, 0.0]);
    let problem = problem(&*plant, &[0, 1], None, &[(0.5, 0.0, 5.0), (1.0, 0.1, 9.0)], free);
    let recording = Recording { name: "oscillator", before: None, u: &u, y: &y };
    let found = identify(&mut *model, &problem, &[recording]).unwrap();
    assert_eq!(found.findings, [Diagnosis::NeverMeasured { name: "x2".to_owned() }]);
    // Without noise the truth comes out to rounding.
    assert!((found.parameters[0].value - 0.8).abs() < 1e-9);
    assert!((found.parameters[1].value - 1.3).abs() < 1e-9);
}

#[test]
fn data_that_cannot_be_used_are_errors() {
    let (u, y) = data(20);
    let problem = with(&[0, 1]);
    let mut model = tank().model(Integrator::Rk4, 10.0, 4).unwrap();
    let mut error = |problem: &Problem, u: &[f64], y: &[f64]| {
        identify(&mut *model, problem, &[Recording { name: "tank", before: None, u, y }])
            .unwrap_err()
    };
    let short = IdentifyError::TooShort { recording: 0, rows: 0 };
    assert_eq!(error(&problem, &[], &[]), short);
    assert_eq!(short.to_string(), "recording 1: 0 rows, but at least 2 are needed");
    let few = IdentifyError::TooFewMeasurements { measurements: 3, unknowns: 3 };
    assert_eq!(error(&problem, &u[..3], &y[..3]), few);
    let missing = [f64::NAN; 20];
    let none = IdentifyError::TooFewMeasurements { measurements: 0, unknowns: 3 };
    assert_eq!(error(&problem, &u, &missing), none);
    let mut bad = u.clone();
    bad[3] = f64::NAN;
    let argument = error(&problem, &bad, &y);
    assert!(matches!(argument, IdentifyError::Argument(ArgumentError::Number { index: 3, .. })));
    let mut nothing = with(&[]);
    nothing.initial_state = InitialState::Fixed(vec![8.0]);
    assert_eq!(error(&nothing, &u, &y), IdentifyError::NothingUnknown);
    let mut outside = with(&[0]);
    outside.unknown[0].initial = 7.0;
    assert!(matches!(error(&outside, &u, &y), IdentifyError::OutsideBounds { .. }));
    assert!(identify(&mut *model, &problem, &[]).is_err());
}
