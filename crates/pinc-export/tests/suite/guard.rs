//! Controllers that watch the estimated error of their net, in C and in the library.

use super::controller::{Case, Source, compare, mild, oscillator, oscillator_case};
use super::net::{distilled, nets};
use pinc_estimate::{Augmentation, Compensated, Disturbance, Measured};
use pinc_export::{
    ErrorGuard, ErrorResponse, Estimation, FmiVersion, RungeKuttaModel, controller_to_fmu,
};
use pinc_mpc::{Judge, Nmpc, NmpcBuilder, NmpcProblem};
use pinc_net::PincModel;
use pinc_ode::Integrator;
use pinc_verify::ErrorEstimate;

/// A guard, and what it does in a step that is beyond its tolerances.
pub(crate) struct Guarded {
    tolerance: Vec<f64>,
    response: Response,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Response {
    Count,
    Integrator(Integrator),
    Correct,
}

/// Substeps of the integrator that repeats steps.
const SUBSTEPS: usize = 3;

impl Guarded {
    pub(crate) fn exported<'a>(&'a self, case: &'a Case) -> ErrorGuard<'a> {
        let response = match self.response {
            Response::Count => ErrorResponse::Count,
            Response::Integrator(method) => ErrorResponse::Integrator(RungeKuttaModel {
                equations: case.outputs_of.as_ref().unwrap(),
                parameters: &[],
                method,
                sample_time_s: case.sample_time_s,
                substeps: SUBSTEPS,
            }),
            Response::Correct => ErrorResponse::Correct,
        };
        ErrorGuard { tolerance: &self.tolerance, response }
    }

    /// The controller of the library, with the guard.
    pub(crate) fn watch(&self, builder: NmpcBuilder, case: &Case) -> NmpcBuilder {
        let Source::Net(net) = &case.source else { panic!("a guard watches a net") };
        let plant = case.outputs_of.as_ref().unwrap().compile_with(&[]).unwrap().into_dyn();
        let judge = ByEstimate {
            estimate: ErrorEstimate::new(net, &*plant).unwrap(),
            tolerance: self.tolerance.clone(),
            error: vec![0.0; plant.dims().nx],
            corrects: self.response == Response::Correct,
        };
        let problem = case.problem.clone();
        let substitute = match self.response {
            Response::Count => None,
            Response::Integrator(method) => {
                let model = plant.model(method, case.sample_time_s, SUBSTEPS).unwrap();
                Some(Nmpc::new(problem, model, case.config).unwrap())
            }
            Response::Correct => {
                let states = plant.dims().nx;
                let augmentation = Augmentation {
                    disturbance: Disturbance::States((0..states).collect()),
                    ..Augmentation::measured(Measured::states(0..states))
                };
                let model = Box::new(PincModel::new(net).unwrap());
                let model = Compensated::new(model, augmentation).unwrap();
                let problem = NmpcProblem { parameters: vec![0.0; states], ..problem };
                Some(Nmpc::new(problem, Box::new(model), case.config).unwrap())
            }
        };
        builder.guard(Box::new(judge), substitute)
    }
}

impl Case {
    /// The controller of the library, before its first step.
    pub(crate) fn library(&self, estimator: Option<Estimation<'_>>) -> Nmpc {
        let mut model = self.model();
        if let Some(estimation) = estimator {
            model = Box::new(Compensated::new(model, estimation.augmentation.clone()).unwrap());
        }
        let mut builder = Nmpc::builder(self.problem.clone()).config(self.config).model(model);
        if let Some(guard) = &self.guard {
            builder = guard.watch(builder, self);
        }
        let mut nmpc = builder.build().unwrap();
        if let Some(u) = &self.begin.initial_input {
            nmpc.reset_input(u).unwrap();
        }
        nmpc
    }
}

#[derive(Debug)]
struct ByEstimate {
    estimate: ErrorEstimate,
    tolerance: Vec<f64>,
    error: Vec<f64>,
    corrects: bool,
}

impl Judge for ByEstimate {
    fn trusts(&mut self, x: &[f64], u: &[f64], p: &[f64]) -> bool {
        self.estimate.write(x, u, p, &mut self.error);
        self.error.iter().zip(&self.tolerance).all(|(error, most)| error.abs() <= *most)
    }

    fn substitute_parameters(&self, _: &[f64], substitute: &mut [f64]) {
        if self.corrects {
            substitute.iter_mut().zip(&self.error).for_each(|(to, error)| *to = -error);
        }
    }
}

/// The oscillator with a net that has learnt nothing, within the tolerance in a part of its domain.
fn case(response: Response, is_distilled: bool) -> Case {
    let [net, ..] = nets();
    let net = mild(if is_distilled { distilled(&net) } else { net });
    Case {
        source: Source::Net(Box::new(net)),
        outputs_of: Some(oscillator()),
        guard: Some(Guarded { tolerance: vec![f64::INFINITY, 0.3], response }),
        ..oscillator_case()
    }
}

const RESPONSES: [Response; 3] =
    [Response::Count, Response::Integrator(Integrator::Rk5), Response::Correct];

/// Inputs, statuses and trust, with a delay too: steps are repeated from where they began. A
/// distilled net is judged by an integrator beside the one that repeats steps.
#[test]
fn guarded_controllers_take_the_librarys_steps() {
    for (i, response) in RESPONSES.into_iter().enumerate() {
        for (delay, is_distilled) in [(0, false), (2, false), (0, true)] {
            let mut case = case(response, is_distilled);
            case.problem.delay = delay;
            let seen = compare(&case, 250, 40 + i as u64);
            assert!(seen.iter().sum::<usize>() > 200, "{response:?}: {seen:?}");
        }
    }
}

#[test]
fn the_guards_code_is_portable_and_its_self_test_passes() {
    for response in RESPONSES {
        let sources = case(response, false).sources();
        assert!(sources.assert_portable("ctl").contains("20 steps"));
    }
    case(RESPONSES[1], true).sources().selftest("ctl", &[]);
}

/// The FMU says what the guard found.
#[test]
fn a_guarded_fmu_has_the_trust_as_an_output() {
    let case = case(Response::Count, false);
    let files = case
        .export_by(None, |controller, name, origin| {
            controller_to_fmu((controller, case.library(None)), name, origin, FmiVersion::Two)
        })
        .unwrap();
    let text = |path: &str| {
        let file = files.iter().find(|file| file.path == path).unwrap();
        String::from_utf8(file.bytes.clone()).unwrap()
    };
    let description = text("modelDescription.xml");
    assert!(description.contains(r#"<Item name="doubted" value="2"/>"#), "{description}");
    assert!(description.contains(r#"name="trust""#), "{description}");
    assert!(text("sources/ctl_fmu.c").contains("s->status[1] = (int)s->after.trust;"));
}
