//! The integrators on the box: their errors by substeps, which a net has to beat, and whether the
//! loop's integrators are sound.

use crate::soundness::IntegratorBox;
use crate::{Finding, Subject, Work, left_out};
use pinc_analysis::StabilityFunction;
use pinc_config::ControlSpec;
use pinc_net::RmsError;
use pinc_ode::Integrator;

/// The numbers of substeps that are shown.
const SHOWN: [usize; 5] = [1, 2, 4, 8, 16];

/// Where the search for a number of substeps ends.
const MOST: usize = 1024;

/// The errors asked for, in widths of the region.
const WANTED: [f64; 2] = [1e-4, 1e-6];

/// An uncertainty that is worth a word.
const UNCERTAIN: f64 = 0.05;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let work = &subject.evidence.work;
    let Some(mut of_box) = IntegratorBox::within(subject.models, subject.experiment, work) else {
        return Vec::new();
    };
    let mut findings = Vec::new();
    let (points, wanted) = of_box.points();
    let missing = of_box.unsolved();
    if missing > 0 && !work.is_over() {
        let what = format!(
            "the plant breaks off within T from {missing} of {points} points of {}",
            subject.region_name
        );
        findings.push(
            Finding::warning("domain", what)
                .because(
                    "there the equation has no solution over a step, so that no net can learn one",
                )
                .change("a smaller domain or a shorter T"),
        );
    }
    let mut enough = None;
    if of_box.error(Integrator::Rk4, 1).is_some() {
        let shown = SHOWN.map(|n| format!("{n}: {}", with_uncertainty(&of_box, n)));
        let fewer = match points < wanted {
            true => format!(" ({points} points, where a run takes {wanted})"),
            false => String::new(),
        };
        findings.push(Finding::fact(
            "",
            format!(
                "sampled rms error of one step of RK4 over {}, in its widths, by substeps: {}{fewer}",
                subject.region_name,
                shown.join(", ")
            ),
        ));
        let (fact, found) = needed(subject, &of_box);
        (enough, findings) = (found, [findings, vec![fact]].concat());
    }
    findings.extend(integrators(subject, &mut of_box, enough));
    findings.extend(proof(subject, &of_box, work));
    if work.is_over() {
        findings.push(left_out("more points for the integrators' errors"));
    }
    findings
}

/// The work of a small proof, in units of about 10 ns.
const PROOF: u64 = 100_000_000;

/// Substeps of RK4 where there is no loop.
const SUBSTEPS: usize = 4;

/// What is proven of a step of the loop's first explicit integrator, or of RK4 if there is no loop.
fn proof(subject: &Subject<'_>, of_box: &IntegratorBox<'_>, work: &Work) -> Option<Finding> {
    if work.left() <= PROOF {
        return None;
    }
    work.spend(PROOF);
    let loops = subject.experiment.control.as_ref();
    let (integrator, substeps) = loops.map_or(Some((Integrator::Rk4, SUBSTEPS)), explicit)?;
    let bound = of_box.proven(integrator, substeps, 1)?;
    let what = format!(
        "one step of {} x{substeps} is proven to be wrong by at most {bound:.1e}, in widths, \
         anywhere in {}",
        integrator.title(),
        subject.region_name
    );
    Some(Finding::fact("", what))
}

/// The first explicit integrator of a loop, and its substeps.
fn explicit(control: &ControlSpec) -> Option<(Integrator, usize)> {
    let mut integrators = control.models.iter().filter_map(|kind| kind.integrator());
    let integrator = integrators.find(|integrator| integrator.tableau().is_some())?;
    Some((integrator, control.own_substeps(integrator)))
}

/// An error, with its uncertainty where there are fewer points than a run has.
fn with_uncertainty(of_box: &IntegratorBox<'_>, substeps: usize) -> String {
    let (points, wanted) = of_box.points();
    let Some(RmsError { rms, uncertainty }) = of_box.error(Integrator::Rk4, substeps) else {
        return "-".to_owned();
    };
    if points < wanted && uncertainty > UNCERTAIN {
        return format!("{rms:.1e} (+-{:.0} %)", 100.0 * uncertainty);
    }
    format!("{rms:.1e}")
}

/// The substeps that two errors need, and those for the larger one.
fn needed(subject: &Subject<'_>, of_box: &IntegratorBox<'_>) -> (Finding, Option<usize>) {
    let (points, _) = of_box.points();
    let work = |n: usize| 4 * n as u64 * points as u64 * subject.units;
    let counts = std::iter::successors(Some(1), |n| (n * 2 <= MOST).then_some(n * 2));
    let counts: Vec<usize> = counts.take_while(|n| *n <= 16 || work(*n) <= MODEL_WORK).collect();
    let rms = |n: usize| of_box.error(Integrator::Rk4, n).map_or(f64::NAN, |error| error.rms);
    let mut found = [None; 2];
    for &n in &counts {
        let error = rms(n);
        for (found, wanted) in found.iter_mut().zip(WANTED) {
            if found.is_none() && error <= wanted {
                *found = Some(n);
            }
        }
        if found.iter().all(Option::is_some) {
            break;
        }
    }
    let most = counts.last().copied().unwrap_or(1);
    let text = WANTED.iter().zip(&found).map(|(wanted, n)| match n {
        Some(n) => format!("{wanted:.0e} of the region's width with {n} substeps"),
        None => format!("more than {wanted:.0e} of the region's width with {most} substeps"),
    });
    let fact = format!(
        "T = {}: RK4 has an rms error of {}",
        subject.time(subject.step_s()),
        text.collect::<Vec<_>>().join(", ")
    );
    (Finding::fact("", fact), found[0])
}

/// Units of work that the steps of one model may take.
const MODEL_WORK: u64 = 200_000_000;

/// Whether the integrators of the loop are sound, and where the first of them is worst.
fn integrators(
    subject: &Subject<'_>,
    of_box: &mut IntegratorBox<'_>,
    enough: Option<usize>,
) -> Vec<Finding> {
    let Some(control) = &subject.experiment.control else { return Vec::new() };
    let mut findings = Vec::new();
    for integrator in control.models.iter().filter_map(|kind| kind.integrator()) {
        let key = ControlSpec::substeps_key(integrator);
        let substeps = control.own_substeps(integrator);
        let soundness = of_box.soundness(integrator, substeps);
        let stability = StabilityFunction::of(integrator);
        let stable = stability.and_then(|stability| of_box.stable_substeps(&stability));
        let (name, place) = (integrator.title(), format!("control.{key}"));
        if let Some(stable) = stable {
            let count = match stable {
                usize::MAX => "more than a million".to_owned(),
                stable => stable.to_string(),
            };
            let what = format!(
                "{name} is stable at {} random points of {} with {count} substeps",
                soundness.examined, subject.region_name
            );
            findings.push(Finding::fact(&place, what));
        }
        if let Some(objection) = soundness.objection() {
            let enough = enough.filter(|_| integrator == Integrator::Rk4);
            let change = match (stable, enough) {
                (Some(usize::MAX), _) => "a shorter T, or the model rosenbrock".to_owned(),
                (Some(stable), Some(enough)) => format!("{key} = {}", stable.max(enough)),
                (stable, None) if integrator == Integrator::Rk4 => {
                    let least = stable.unwrap_or(0).max(substeps + 1).max(MOST + 1);
                    format!("{key} = {least} or more")
                }
                (Some(stable), None) if soundness.unstable > 0 => format!("{key} = {stable}"),
                (Some(_), None) | (None, _) => format!("more than {substeps} {key}"),
            };
            findings.push(
                Finding::warning(place, format!("with {substeps} substeps {name} is {objection}"))
                    .because(
                        "as a model in the controller it misleads wherever the loop comes near \
                         such a point, and a comparison with it says nothing about the net",
                    )
                    .change(change),
            );
        }
    }
    findings.extend(worst(subject, of_box));
    findings
}

/// Where the first integrator of the loop is worst.
fn worst(subject: &Subject<'_>, of_box: &mut IntegratorBox<'_>) -> Option<Finding> {
    let (integrator, substeps) = explicit(subject.experiment.control.as_ref()?)?;
    let found = of_box.worst(integrator, substeps)?;
    let at = format!("{}; {}", subject.state(&found.worst.x), subject.input(&found.worst.u));
    let what = format!(
        "the largest error of one step of {} x{substeps} that a search found is {:.1e} of the \
         range of {}, at {at}",
        integrator.title(),
        found.max,
        subject.state_name(found.worst.state)
    );
    Some(Finding::fact("", what))
}
