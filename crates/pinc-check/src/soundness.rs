//! The soundness of an integrator in a box: one criterion for `pinc check` and `pinc choose`.

use crate::numbers::short;
use crate::proven::proven_error;
use crate::region;
use crate::work::{Metered, Work};
use pinc_analysis::{Complex, OperatingPoint, Region, StabilityFunction, StateSpace};
use pinc_config::Experiment;
use pinc_net::{Domain, DomainError, DomainTruth, RmsError, ValidationConfig};
use pinc_ode::{Dims, DynPlant, DynRhs, Integrator, Model};
use pinc_verify::StepModel;

/// Random points at which the stability of explicit methods is examined; fewer for many states.
const STABILITY_POINTS: usize = 200;

/// The root mean square error of one step over the box, in its widths, up to which an integrator
/// is sound.
const SOUND_RMS: f64 = 1e-2;

/// Points whose work says how many can be afforded.
const PILOT: usize = 32;

/// Integrators on the box in which a loop may go: the training domain, or else the controller's
/// bounds.
///
/// An integrator is *sound* there if both hold:
///
/// - at none of 200 random points of the box a mode of the plant that decays grows from substep to
///   substep (fewer points for more than 40 states; explicit methods only);
/// - the root mean square error of one step over the box is at most 1 % of its widths.
///
/// The errors equal the errors in `pinc run`: same quasi-random points, same truth. An expensive
/// plant has fewer points, at the cost of [`RmsError::uncertainty`].
pub struct IntegratorBox<'a> {
    plant: &'a dyn DynPlant,
    experiment: &'a Experiment,
    domain: Domain,
    /// The plant with the parameters that vary over the domain.
    family: Option<Box<dyn DynPlant>>,
    region_name: &'static str,
    region: Region,
    step_s: f64,
    modes: Vec<Vec<Complex>>,
    truth: Option<DomainTruth>,
    wanted: usize,
}

impl std::fmt::Debug for IntegratorBox<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("IntegratorBox").field("region", &self.region).finish_non_exhaustive()
    }
}

/// The objections to an integrator in a box.
#[derive(Clone, Debug, PartialEq)]
pub struct Soundness {
    /// At how many points of the box its substeps are unstable.
    pub unstable: usize,
    /// How many points were examined for that.
    pub examined: usize,
    /// The error of one step in widths of the box; `None` if there is no truth to compare with.
    pub error: Option<RmsError>,
    region_name: &'static str,
}

impl Soundness {
    /// Says in words why the integrator is unsound; `None` if it is sound.
    #[must_use]
    pub fn objection(&self) -> Option<String> {
        let Self { unstable, examined, region_name, error } = self;
        let is_unstable = *unstable > 0;
        let unstable = is_unstable.then(|| {
            format!("unstable at {unstable} of {examined} random points of {region_name}")
        });
        // Not a number is unsound too.
        let wrong = error.map(|error| error.rms).filter(|rms| !(..=SOUND_RMS).contains(rms));
        let wrong = wrong.map(|rms| match rms.is_finite() {
            true => format!("wrong by {} of the region's width in a step", short(rms)),
            false => "without a finite step somewhere in the region".to_owned(),
        });
        let both: Vec<String> = [unstable, wrong].into_iter().flatten().collect();
        (!both.is_empty()).then(|| both.join(" and "))
    }
}

impl<'a> IntegratorBox<'a> {
    /// The box of an experiment whose plant is `plant`; `None` if the config has neither a domain
    /// nor a loop, or no length of a step, or if the plant is a black box.
    #[must_use]
    pub fn of(plant: &'a dyn DynPlant, experiment: &'a Experiment) -> Option<Self> {
        Self::within(plant, experiment, &Work::with_limit(crate::work::SHARE))
    }

    /// The box, with a budget of work for the truth.
    pub(crate) fn within(
        plant: &'a dyn DynPlant,
        experiment: &'a Experiment,
        work: &Work,
    ) -> Option<Self> {
        if plant.black_box().is_some() {
            return None;
        }
        let step_s = experiment.sample_time_s()?;
        let (region, region_name) = region::of(experiment, plant.dims())?;
        let names = experiment.varying();
        let family = (!names.is_empty()).then(|| experiment.plant.family(&names));
        let domain = experiment.domain.clone().unwrap_or_else(|| domain_of(&region));
        let settings = experiment
            .validation
            .clone()
            .unwrap_or_else(|| ValidationConfig::new(step_s, domain.clone()));
        let wanted = settings.one_step_points;
        let metered = match &family {
            Some(family) => Metered::new(&**family, experiment, work),
            None => Metered::new(plant, experiment, work),
        };
        let seed = experiment.seed;
        let draw = |points: usize| {
            DomainTruth::draw(&metered, &domain, step_s, points, settings.tolerance, seed)
        };
        let before = work.done();
        let mut truth = Some(draw(PILOT.min(wanted)));
        let of_pilot = (work.done() - before).max(1);
        // The search for the worst point takes as much again.
        let affordable = work.left() / (2 * of_pilot) * PILOT as u64;
        if work.is_over() {
            truth = None;
        } else if affordable > PILOT as u64 && wanted > PILOT {
            let points = usize::try_from(affordable).map_or(wanted, |points| points.min(wanted));
            truth = Some(draw(points));
            if work.is_over() {
                // Some places take far more than the first ones: these have to do.
                work.allow_for_a_search();
                truth = Some(draw(PILOT));
            }
        }
        let truth = truth.filter(|truth| !truth.points().is_empty());
        let points = STABILITY_POINTS * crate::MANY_STATES / region.dims.nx.max(crate::MANY_STATES);
        let modes = region.points(seed).take(points);
        let modes = modes.filter_map(|point| modes_at(plant, &region, &point)).collect();
        Some(Self {
            plant,
            experiment,
            domain,
            family,
            region_name,
            region,
            step_s,
            modes,
            truth,
            wanted,
        })
    }

    /// Returns the name of the box.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.region_name
    }

    /// Whether an integrator with so many substeps is sound.
    #[must_use]
    pub fn soundness(&self, integrator: Integrator, substeps: usize) -> Soundness {
        let unstable = StabilityFunction::of(integrator).map_or(0, |stability| {
            let step_s = self.step_s / substeps as f64;
            self.modes.iter().filter(|modes| !stability.is_stable(modes, step_s)).count()
        });
        let (examined, region_name) = (self.modes.len(), self.region_name);
        Soundness { unstable, examined, error: self.error(integrator, substeps), region_name }
    }

    /// The error of one step of an integrator, in widths of the box.
    pub(crate) fn error(&self, integrator: Integrator, substeps: usize) -> Option<RmsError> {
        let mut model = self.model(integrator, substeps)?;
        self.truth.as_ref().map(|truth| truth.rms_error(&mut *model))
    }

    /// The errors of one step of an integrator, with the worst point that was found.
    pub(crate) fn worst(&mut self, integrator: Integrator, substeps: usize) -> Option<DomainError> {
        let mut model = self.model(integrator, substeps)?;
        self.truth.as_mut().map(|truth| truth.judge(&mut *model))
    }

    /// A proven bound of the error of one step, in widths of the box, if a
    /// [small proof](proven_error) gives one.
    #[must_use]
    pub fn proven(&self, integrator: Integrator, substeps: usize, threads: usize) -> Option<f64> {
        let model = StepModel::RungeKutta(integrator.tableau()?, substeps);
        proven_error(&self.experiment.plant, &self.domain, model, self.step_s, threads)
    }

    /// The least number of substeps with which an explicit method is stable at all points; `None`
    /// without a point, [`usize::MAX`] for none.
    pub(crate) fn stable_substeps(&self, stability: &StabilityFunction) -> Option<usize> {
        let needed = |modes: &Vec<Complex>| {
            stability.stable_substeps(modes, self.step_s).unwrap_or(usize::MAX)
        };
        self.modes.iter().map(needed).max()
    }

    /// How many points the errors are of, and how many `pinc run` has.
    pub(crate) fn points(&self) -> (usize, usize) {
        (
            self.truth.as_ref().map_or(0, |truth| truth.points().len() + truth.unsolved()),
            self.wanted,
        )
    }

    /// From how many of its points the plant cannot be integrated over a step.
    pub(crate) fn unsolved(&self) -> usize {
        self.truth.as_ref().map_or(0, DomainTruth::unsolved)
    }

    fn model(&self, integrator: Integrator, substeps: usize) -> Option<Box<dyn Model>> {
        let plant = self.family.as_deref().unwrap_or(self.plant);
        plant.model(integrator, self.step_s, substeps).ok()
    }
}

/// The eigenvalues of the plant at a point; `None` if its derivatives are not finite there.
pub(crate) fn modes_at(
    plant: &dyn DynRhs,
    region: &Region,
    point: &OperatingPoint,
) -> Option<Vec<Complex>> {
    let tangent = StateSpace::tangent(plant, point, &[])?;
    Some(tangent.in_units(&region.widths()).eigenvalues())
}

/// The region as a domain; a variable that does not vary has a width of 1 there.
fn domain_of(region: &Region) -> Domain {
    let Dims { nx, .. } = region.dims;
    let half = |i: usize| if region.high[i] > region.low[i] { 0.0 } else { 0.5 };
    let mut low: Vec<f64> = region.low.iter().enumerate().map(|(i, v)| v - half(i)).collect();
    let mut high: Vec<f64> = region.high.iter().enumerate().map(|(i, v)| v + half(i)).collect();
    let (input_low, input_high) = (low.split_off(nx), high.split_off(nx));
    Domain { state_low: low, state_high: high, input_low, input_high, parameters: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_integrator_is_wrong_from_a_hundredth_of_the_width_on() {
        let objection = |rms: f64| {
            let error = Some(RmsError { rms, uncertainty: 0.0 });
            let region_name = "the training domain";
            Soundness { unstable: 0, examined: 200, error, region_name }.objection()
        };
        assert_eq!(objection(0.0099), None);
        let wrong = objection(0.0102).unwrap();
        assert_eq!(wrong, "wrong by 0.0102 of the region's width in a step");
        assert!(objection(f64::NAN).is_some());
    }

    /// Where no more evaluations are allowed, the worst point is one that was integrated before.
    #[test]
    fn the_worst_error_is_one_of_a_true_step() {
        let text = "name = \"t\"\npreset = \"ours\"\nseed = 1\nplant = { van-der-pol = { mu = 1.0 } }\n\
            [model]\nhorizon_s = 0.5\nhidden_layers = 1\nneurons = 4\n[domain]\nstate_low = [-3.0, -3.0]\nstate_high = [3.0, 3.0]\n\
            input_low = [-1.0]\ninput_high = [1.0]\n";
        let plants = pinc_config::Plants::built_in();
        let experiment = Experiment::parse("t.toml".as_ref(), text, &[], &plants).unwrap();
        let (plant, work) = (experiment.plant.dyn_plant(), Work::with_limit(10_000_000));
        let mut of_box = IntegratorBox::within(&*plant, &experiment, &work).unwrap();
        work.spend(10_000_000);
        let found = of_box.worst(Integrator::Rk4, 1).unwrap();
        let mut end = found.worst.x.clone();
        let mut simulator = pinc_ode::Simulator::new(&*plant, 1e-12);
        simulator.integrate(&mut end, &found.worst.u, 0.5).unwrap();
        assert!((end[found.worst.state] - found.worst.truth).abs() < 1e-8, "{:?}", found.worst);
        assert!(found.max > 1e-6, "{:?}", found.worst);
    }

    /// A model is unsound if a step is unstable or wrong by more than a hundredth of the box, or has
    /// no finite end.
    #[test]
    fn an_objection_names_what_is_unsound() {
        let of = |unstable: usize, rms: Option<f64>| {
            let error = rms.map(|rms| RmsError { rms, uncertainty: 0.1 });
            Soundness { unstable, examined: 200, error, region_name: "the box" }.objection()
        };
        assert_eq!([of(0, None), of(0, Some(0.0099))], [None, None]);
        let unstable = "unstable at 3 of 200 random points of the box";
        assert_eq!(of(3, Some(1e-5)).unwrap(), unstable);
        let wrong = "wrong by 0.0125 of the region's width in a step";
        assert_eq!(of(0, Some(0.0125)).unwrap(), wrong);
        assert_eq!(of(3, Some(0.0125)).unwrap(), format!("{unstable} and {wrong}"));
        for none in [f64::NAN, f64::INFINITY] {
            let said = of(0, Some(none)).unwrap();
            assert_eq!(said, "without a finite step somewhere in the region");
        }
    }
}
