//! The order in which candidates are tried.

use crate::candidate::{Candidate, SHAPES, Shape};
use crate::judge::{Standard, Tried};
use crate::ladder::{self, Rung};
use pinc_config::{ControlSpec, ModelKind};
use pinc_net::TrainingTarget;

/// How many of the cheapest good models have their times measured as often as the config says.
const FINALISTS: usize = 3;

/// The place in [`SHAPES`] of the first net that is tried.
const FIRST_NET: usize = 1;

/// From so many substeps on, the method for stiff plants may be cheaper.
const STIFF: usize = 8;

/// A larger net is not tried where the last one's control step is this many times longer than that
/// of the cheapest good integrator.
const HOPELESS: f64 = 2.0;

/// The loops that candidates are tried in.
pub trait Loops {
    /// What keeps all candidates from being tried.
    type Error;

    /// What comes of the loop of a candidate, run so many times. If it is `limited`, there may be no
    /// time left for it: then there is nothing.
    ///
    /// # Errors
    ///
    /// If no candidate can be tried any more.
    fn run(
        &mut self,
        candidate: Candidate,
        repetitions: usize,
        limited: bool,
    ) -> Result<Option<Tried>, Self::Error>;
}

/// A search for the model of a loop.
#[derive(Clone, Debug)]
pub struct Search<'a> {
    /// The loop.
    pub control: &'a ControlSpec,
    /// What nets are trained on, the best guess first; nothing if none are tried.
    pub sources: &'a [TrainingTarget],
    /// How much more than the most exact model's an IAE may be, relative.
    pub within: f64,
}

/// What a search has found.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// All that was tried, in this order.
    pub tried: Vec<Tried>,
    /// Whether something was not tried for want of time.
    pub is_out_of_time: bool,
}

impl Found {
    /// Tries a candidate with its loop run once; gives whether that was done.
    fn attempt<L: Loops>(&mut self, loops: &mut L, candidate: Candidate) -> Result<bool, L::Error> {
        let Some(tried) = loops.run(candidate, 1, true)? else {
            self.is_out_of_time = true;
            return Ok(false);
        };
        self.tried.push(tried);
        Ok(true)
    }

    fn known(&self, candidate: Candidate) -> Option<&Tried> {
        self.tried.iter().find(|tried| tried.candidate == candidate)
    }
}

impl Search<'_> {
    /// Tries what is worth it.
    ///
    /// # Errors
    ///
    /// Those of `loops`.
    pub fn run<L: Loops>(&self, loops: &mut L) -> Result<Found, L::Error> {
        let mut found = Found::default();
        self.exact(&mut found, loops)?;
        if self.standard(&found.tried).is_some() {
            self.cheap(&mut found, loops)?;
            self.nets(&mut found, loops)?;
            self.finals(&mut found, loops)?;
        }
        Ok(found)
    }

    /// What models have to come up to, by what was tried; nothing if no integrator's loop stands.
    #[must_use]
    pub fn standard(&self, tried: &[Tried]) -> Option<Standard> {
        Standard::of(tried, self.control, self.within)
    }

    /// What was tried of an integrator, judged by what is the most exact one so far.
    fn rungs(&self, tried: &[Tried], of: ModelKind) -> Vec<Rung> {
        let standard = self.standard(tried);
        let rung = |tried: &Tried| match (tried.candidate, &tried.result) {
            (Candidate::Integrator { kind, substeps }, result) if kind == of => {
                let score = result.as_ref().ok();
                let stands = score.filter(|score| score.stands(self.control.max_failed_share));
                let good = score.zip(standard.as_ref()).is_some_and(|(s, to)| to.is_good(s));
                Some(Rung { substeps, iae: stands.map(|score| score.iae), good })
            }
            _ => None,
        };
        tried.iter().filter_map(rung).collect()
    }

    /// Tries the substeps that `next` says, until it says none or the time is up.
    fn climb<L: Loops>(
        &self,
        found: &mut Found,
        loops: &mut L,
        kind: ModelKind,
        next: impl Fn(&[Rung]) -> Option<usize>,
    ) -> Result<(), L::Error> {
        while let Some(substeps) = next(&self.rungs(&found.tried, kind)) {
            if !found.attempt(loops, Candidate::Integrator { kind, substeps })? {
                break;
            }
        }
        Ok(())
    }

    /// The substeps that the config has for an integrator.
    fn own_substeps(&self, kind: ModelKind) -> usize {
        self.control.substeps(kind, 1.0, 1.0)
    }

    /// A model that is so exact that a better one changes nothing.
    fn exact<L: Loops>(&self, found: &mut Found, loops: &mut L) -> Result<(), L::Error> {
        let tolerance = 0.1 * self.within;
        for kind in [ModelKind::Rk4, ModelKind::Rodas4] {
            let start = self.own_substeps(kind);
            self.climb(found, loops, kind, |tried| ladder::finer(start, tried, tolerance))?;
            if ladder::is_exact(&self.rungs(&found.tried, kind), tolerance) {
                break;
            }
        }
        Ok(())
    }

    /// The fewest substeps that are good, of each method.
    fn cheap<L: Loops>(&self, found: &mut Found, loops: &mut L) -> Result<(), L::Error> {
        for kind in [ModelKind::Rk4, ModelKind::Rk5, ModelKind::Rodas4] {
            let of_rk4 = self.rungs(&found.tried, ModelKind::Rk4);
            let fewest = of_rk4.iter().filter(|rung| rung.good).map(|rung| rung.substeps).min();
            if kind == ModelKind::Rodas4 && fewest.is_some_and(|fewest| fewest < STIFF) {
                continue;
            }
            let start = self.own_substeps(kind);
            self.climb(found, loops, kind, |tried| ladder::fewer(start, tried))?;
        }
        Ok(())
    }

    /// Nets from the first guess to the smallest that is good, of each source.
    fn nets<L: Loops>(&self, found: &mut Found, loops: &mut L) -> Result<(), L::Error> {
        let Some(standard) = self.standard(&found.tried) else { return Ok(()) };
        let cheapest = standard.ranking(&found.tried).first().map(|(_, score)| score.p50_us);
        let hopeless = cheapest.map_or(f64::INFINITY, |cheapest| HOPELESS * cheapest);
        let mut start = FIRST_NET;
        for &source in self.sources {
            let places = |found: &Found| places(&found.tried, &standard, source);
            while let Some(place) = ladder::size(start, SHAPES.len(), &places(found)) {
                let before = place.checked_sub(1).map(|place| SHAPES[place]);
                let smaller =
                    before.and_then(|shape| found.known(Candidate::Net { shape, source }));
                let smaller = smaller.and_then(|tried| tried.result.as_ref().ok());
                if smaller.is_some_and(|score| score.p50_us > hopeless) {
                    break;
                }
                if !found.attempt(loops, Candidate::Net { shape: SHAPES[place], source })? {
                    return Ok(());
                }
            }
            let good = places(found).into_iter().filter(|(_, good)| *good).map(|(place, _)| place);
            start = good.min().unwrap_or(FIRST_NET);
        }
        Ok(())
    }

    /// Measures the times of the best as often as the config says.
    fn finals<L: Loops>(&self, found: &mut Found, loops: &mut L) -> Result<(), L::Error> {
        let repetitions = self.control.repetitions;
        let Some(standard) = self.standard(&found.tried).filter(|_| repetitions > 1) else {
            return Ok(());
        };
        let best = standard.ranking(&found.tried).into_iter().take(FINALISTS);
        let best: Vec<Candidate> = best.map(|(tried, _)| tried.candidate).collect();
        for candidate in best {
            let again = loops.run(candidate, repetitions, false)?;
            let place = found.tried.iter().position(|tried| tried.candidate == candidate);
            if let (Some(again), Some(place)) = (again, place) {
                found.tried[place] = again;
            }
        }
        Ok(())
    }
}

/// The nets of a source that were tried, as places in [`SHAPES`], and whether they are good.
fn places(tried: &[Tried], standard: &Standard, source: TrainingTarget) -> Vec<(usize, bool)> {
    let place = |(place, &shape): (usize, &Shape)| {
        let candidate = Candidate::Net { shape, source };
        let tried = tried.iter().find(|tried| tried.candidate == candidate)?;
        Some((place, tried.result.as_ref().is_ok_and(|score| standard.is_good(score))))
    };
    SHAPES.iter().enumerate().filter_map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::tests::score;
    use std::convert::Infallible;

    const SPEC: &str = r#"
        models = ["rk4"]
        duration_s = 1.0
        initial_state = [0.0]
        controlled = ["x"]
        n1 = 1
        n2 = 5
        nu = 5
        q = [1.0]
        r = [1.0]
        weights_profile = "uniform"
        input_low = [-1.0]
        input_high = [1.0]
        rk4_substeps = 4
        rk5_substeps = 2
        rosenbrock_substeps = 4
        repetitions = 10
        plant_tolerance = 1e-9
        references = []
        sqp = {}
    "#;

    /// Loops whose IAE and time follow from the candidate by rules, and the order of what was asked.
    struct Rules<F> {
        rule: F,
        asked: Vec<String>,
        /// How many are run before the time is up.
        most: usize,
    }

    impl<F: Fn(Candidate) -> Option<(f64, f64)>> Loops for Rules<F> {
        type Error = Infallible;

        fn run(
            &mut self,
            candidate: Candidate,
            repetitions: usize,
            limited: bool,
        ) -> Result<Option<Tried>, Infallible> {
            if limited && self.asked.len() >= self.most {
                return Ok(None);
            }
            self.asked.push(format!("{candidate}{}", if limited { "" } else { " again" }));
            let result = (self.rule)(candidate).map(|(iae, us)| score(iae, us, 1.0 / us));
            let result = result.ok_or_else(|| "NaN".to_owned());
            Ok(Some(Tried { candidate, net: None, repetitions, result }))
        }
    }

    fn order(most: usize, rule: impl Fn(Candidate) -> Option<(f64, f64)>) -> (Vec<String>, Found) {
        let control: ControlSpec = toml::from_str(SPEC).unwrap();
        let sources = &[TrainingTarget::Integrator, TrainingTarget::Physics];
        let search = Search { control: &control, sources, within: 0.01 };
        let mut loops = Rules { rule, asked: Vec::new(), most };
        let Ok(found) = search.run(&mut loops);
        (loops.asked, found)
    }

    #[expect(clippy::cast_precision_loss, reason = "small numbers")]
    fn us(substeps: usize) -> f64 {
        1.0 + substeps as f64
    }

    #[test]
    fn the_best_guesses_come_first() {
        // RK4 is good from 2 substeps on, RK5 with 1; a net only if it is distilled and large.
        let (asked, found) = order(99, |candidate| match candidate {
            Candidate::Integrator { kind: ModelKind::Rk4, substeps } => {
                Some((if substeps < 2 { 120.0 } else { 100.0 }, us(substeps)))
            }
            Candidate::Integrator { substeps, .. } => Some((100.0, 2.0 * us(substeps))),
            Candidate::Net { shape, source } => {
                let good = source == TrainingTarget::Integrator && shape.neurons == 24;
                Some((if good { 100.0 } else { 150.0 }, 4.0))
            }
        });
        let expected = [
            "RK4 x4",
            "RK4 x8",
            "RK4 x2",
            "RK4 x1",
            "RK5 x2",
            "RK5 x1",
            "distilled 2x16",
            "distilled 2x24",
            "PINC 2x24",
            "PINC 3x24",
            "PINC 4x32",
            "RK4 x2 again",
            "RK5 x1 again",
            "distilled 2x24 again",
        ];
        assert_eq!(asked, expected);
        assert!(!found.is_out_of_time);
        assert_eq!(found.tried.iter().filter(|tried| tried.repetitions == 10).count(), 3);
    }

    #[test]
    fn a_stiff_plant_has_the_method_for_stiff_plants_tried() {
        let (asked, _) = order(99, |candidate| match candidate {
            Candidate::Integrator { kind: ModelKind::Rodas4, .. } => Some((100.0, 9.0)),
            Candidate::Integrator { .. } => None,
            Candidate::Net { .. } => Some((100.0, 30.0)),
        });
        let explicit = ["RK4 x4", "RK4 x8", "RK4 x16", "RK4 x32", "RK4 x64", "RK4 x128"];
        assert_eq!(asked[..6], explicit);
        assert_eq!(asked[6..8], ["Rosenbrock x4", "Rosenbrock x8"]);
        // Its own search comes after RK5's; a net of that size is hopeless, and no larger is tried.
        assert!(asked.contains(&"Rosenbrock x1".to_owned()), "{asked:?}");
        assert!(!asked.contains(&"distilled 2x24".to_owned()), "{asked:?}");
    }

    #[test]
    fn nothing_is_tried_after_the_time_is_up() {
        let (asked, found) = order(3, |_| Some((100.0, 5.0)));
        assert_eq!(asked[..3], ["RK4 x4", "RK4 x8", "RK4 x2"]);
        assert!(asked[3..].iter().all(|asked| asked.ends_with("again")), "{asked:?}");
        assert!(found.is_out_of_time);
        // Without any loop that stands there is nothing to compare with.
        let (asked, found) = order(99, |_| None);
        assert!(asked.iter().all(|asked| asked.starts_with('R')), "{asked:?}");
        assert_eq!(found.tried.len(), 12);
    }
}
