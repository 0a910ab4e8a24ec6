//! One budget of work for an examination, counted in evaluations of the plant and not in seconds,
//! so that the same config gives the same findings on every machine.

use pinc_ad::simd::Isa;
use pinc_config::{Experiment, PlantSpec};
use pinc_ode::{AnyVectorRhs, BlackBox, DynRhs, Signature};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The budget of a whole check, in units of about 10 ns.
pub(crate) const TOTAL: u64 = 1_200_000_000;

/// What one of its examinations may do.
pub(crate) const SHARE: u64 = 400_000_000;

/// What each may do however much those before it did.
const LEAST: u64 = 2_000_000;

/// Units that an evaluation of an equation takes for each state: of one that is compiled, of one that
/// is compiled and solved for boiling points, of text that is solved for algebraic variables, and of one
/// that another program has.
const COMPILED: u64 = 3;
const BOILING: u64 = 12;
const ALGEBRAIC: u64 = 400;
const EXTERNAL: u64 = 1000;

/// Work that is counted, and its limit. Copies count together.
#[derive(Clone, Debug)]
pub struct Work(Arc<Counters>);

#[derive(Debug)]
struct Counters {
    done: AtomicU64,
    limit: AtomicU64,
}

impl Work {
    /// No work done, and so much allowed, in units of about 10 ns.
    #[must_use]
    pub fn with_limit(limit: u64) -> Self {
        Self(Arc::new(Counters { done: AtomicU64::new(0), limit: AtomicU64::new(limit) }))
    }

    /// The budget of a whole check.
    #[must_use]
    pub fn of_a_check() -> Self {
        Self::with_limit(TOTAL)
    }

    /// Returns the work done, in units.
    #[must_use]
    pub fn done(&self) -> u64 {
        self.0.done.load(Ordering::Relaxed)
    }

    /// Returns the work left, in units.
    #[must_use]
    pub fn left(&self) -> u64 {
        self.0.limit.load(Ordering::Relaxed).saturating_sub(self.done())
    }

    /// Whether more was asked for than is allowed.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.left() == 0
    }

    /// Counts `units`; gives whether they are within the limit.
    pub fn spend(&self, units: u64) -> bool {
        self.0.done.fetch_add(units, Ordering::Relaxed);
        !self.is_over()
    }

    /// Allows one part of a check its share from here on, or what the parts before it have left.
    pub fn begin(&self) {
        let done = self.done();
        let share = TOTAL.saturating_sub(done).clamp(LEAST, SHARE);
        let limit = done.saturating_add(share);
        self.0.limit.store(limit, Ordering::Relaxed);
    }

    /// Room for a few points after the budget was used up by rare ones.
    pub(crate) fn allow_for_a_search(&self) {
        let limit = self.done().saturating_add(SHARE / 4);
        self.0.limit.store(limit, Ordering::Relaxed);
    }
}

/// A plant whose evaluations are counted. Beyond the limit its rates are NaN, so that whatever asks
/// for them comes to an end.
#[derive(Clone, Debug)]
pub struct Metered {
    plant: Arc<dyn DynRhs>,
    work: Work,
    /// Units of an evaluation.
    units: u64,
}

impl Metered {
    /// The plant of `experiment`, with its evaluations counted in `work`.
    #[must_use]
    pub fn new(plant: &dyn DynRhs, experiment: &Experiment, work: &Work) -> Self {
        let states = plant.dims().nx as u64;
        let of_states = |each: u64| each * states;
        let units = match &experiment.plant {
            // An instruction takes about 10 ns.
            PlantSpec::Expression(equations) => equations
                .listing(&[])
                .map_or_else(|_| of_states(ALGEBRAIC), |list| list.instructions.len() as u64),
            other if other.is_black_box() => of_states(EXTERNAL),
            PlantSpec::AcetoneStill(_) | PlantSpec::AcetoneColumn(_) => of_states(BOILING),
            _ => of_states(COMPILED),
        };
        let units = units.max(1);
        Self { plant: plant.to_shared(), work: work.clone(), units }
    }

    /// The units that an evaluation takes.
    #[must_use]
    pub fn units(&self) -> u64 {
        self.units
    }
}

impl DynRhs for Metered {
    fn signature(&self) -> Signature<'_> {
        self.plant.signature()
    }

    fn rhs(&self, x: &[f64], u: &[f64], p: &[f64], dx: &mut [f64]) {
        if self.work.spend(self.units) {
            self.plant.rhs(x, u, p, dx);
        } else {
            dx.fill(f64::NAN);
        }
    }

    fn output(&self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        self.plant.output(x, u, p, y);
    }

    fn explain(&self, x: &[f64], u: &[f64], p: &[f64]) -> Option<String> {
        self.plant.explain(x, u, p)
    }

    fn jacobian(&self, x: &[f64], u: &[f64], p: &[f64]) -> Vec<f64> {
        let columns = x.len() + u.len() + p.len();
        // Several derivatives are computed at a time.
        match self.work.spend(self.units.saturating_mul(1 + columns as u64 / 2)) {
            true => self.plant.jacobian(x, u, p),
            false => vec![f64::NAN; x.len() * columns],
        }
    }

    fn vectorized(&self, isa: Isa) -> AnyVectorRhs {
        self.plant.vectorized(isa)
    }

    fn to_shared(&self) -> Arc<dyn DynRhs> {
        Arc::new(self.clone())
    }

    fn black_box(&self) -> Option<&BlackBox> {
        self.plant.black_box()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_config::Plants;
    use pinc_ode::Simulator;

    fn oscillator() -> Experiment {
        let text =
            "name = \"t\"\npreset = \"ours\"\nseed = 1\nplant = { van-der-pol = { mu = 1.0 } }\n";
        Experiment::parse("t.toml".as_ref(), text, &[], &Plants::built_in()).unwrap()
    }

    /// Two states of three units each; a Jacobian of three columns counts twice.
    #[test]
    fn evaluations_are_counted_and_end_at_the_limit() {
        let experiment = oscillator();
        let plant = experiment.plant.dyn_plant();
        let work = Work::with_limit(25);
        let metered = Metered::new(&*plant, &experiment, &work);
        let mut dx = [0.0; 2];
        metered.rhs(&[1.0, 0.0], &[0.5], &[], &mut dx);
        assert_eq!((dx, work.done(), work.left()), ([0.0, -0.5], 6, 19));
        assert_eq!(metered.jacobian(&[1.0, 0.0], &[0.5], &[]).len(), 6);
        assert_eq!(work.done(), 18);
        metered.to_shared().rhs(&[1.0, 0.0], &[0.5], &[], &mut dx);
        assert_eq!((work.done(), work.is_over()), (24, false));
        metered.rhs(&[1.0, 0.0], &[0.5], &[], &mut dx);
        assert!(work.is_over() && dx.iter().all(|v| v.is_nan()), "{dx:?}");
        assert!(metered.jacobian(&[1.0, 0.0], &[0.5], &[]).iter().all(|v| v.is_nan()));
    }

    #[test]
    fn an_integration_without_end_ends() {
        let experiment = oscillator();
        let plant = experiment.plant.dyn_plant();
        let work = Work::with_limit(60_000);
        let metered = Metered::new(&*plant, &experiment, &work);
        let mut x = [1.0, 0.0];
        assert!(Simulator::new(&metered, 1e-12).integrate(&mut x, &[0.5], 1e9).is_err());
        assert!(work.is_over() && work.done() < 70_000, "{}", work.done());
    }

    #[test]
    fn the_parts_of_a_check_share_what_it_may_do() {
        let work = Work::of_a_check();
        work.begin();
        assert_eq!(work.left(), SHARE);
        work.spend(TOTAL - SHARE / 2);
        assert!(work.is_over());
        work.begin();
        assert_eq!(work.left(), SHARE / 2);
        work.spend(SHARE);
        work.begin();
        assert_eq!(work.left(), LEAST);
    }
}
