use super::*;
use crate::judge::tests::score;
use std::convert::Infallible;

pub(crate) const SPEC: &str = r#"
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
    /// How many are tried before the time is up.
    most: usize,
    /// In how many rounds they are measured before it is.
    rounds: usize,
}

impl<F: Fn(Candidate) -> Option<(f64, f64)>> Loops for Rules<F> {
    type Error = Infallible;

    fn run(&mut self, candidate: Candidate, purpose: Purpose) -> Result<Option<Tried>, Infallible> {
        let (repetitions, round) = match purpose {
            Purpose::Quality if self.asked.len() >= self.most => return Ok(None),
            Purpose::Quality => (1, 0),
            Purpose::Time { round, .. } if round > self.rounds => return Ok(None),
            Purpose::Time { repetitions, round } => (repetitions, round),
        };
        let again = if round == 0 { String::new() } else { format!(" again {round}") };
        self.asked.push(format!("{candidate}{again}"));
        // The second measurement finds the machine idle.
        let share = if round == 2 { 0.5 } else { 1.0 };
        let result = (self.rule)(candidate).map(|(iae, us)| score(iae, share * us, 1.0 / us));
        let result = result.ok_or_else(|| "NaN".to_owned());
        let place = format!("{candidate}-{round}");
        Ok(Some(Tried { candidate, net: None, repetitions, place, result }))
    }
}

fn order(
    most: usize,
    rule: impl Fn(Candidate) -> Option<(f64, f64)>,
) -> (Vec<String>, SearchResult) {
    order_of(2, most, rule)
}

fn order_of(
    states: usize,
    most: usize,
    rule: impl Fn(Candidate) -> Option<(f64, f64)>,
) -> (Vec<String>, SearchResult) {
    let control: ControlSpec = toml::from_str(SPEC).unwrap();
    let sources = &[TrainingTarget::Integrator, TrainingTarget::Physics];
    let search = Search { control: &control, sources, states, within: 0.01, has_equation: true };
    // Where time is short, it is so to the end.
    let mut loops = Rules { rule, asked: Vec::new(), most, rounds: if most < 99 { 2 } else { 99 } };
    let Ok(found) = search.run(&mut loops);
    (loops.asked, found)
}

fn us(substeps: usize) -> f64 {
    1.0 + substeps as f64
}

#[test]
fn the_best_guesses_come_first() {
    // RK4 is good from 2 substeps on, RK5 with 1; a net only if it is distilled and large.
    let (asked, found) = order(99, |candidate| match candidate {
        Candidate::BlackBox => None,
        Candidate::Integrator { integrator: Integrator::Rk4, substeps } => {
            Some((if substeps < 2 { 120.0 } else { 100.0 }, us(substeps)))
        }
        Candidate::Integrator { substeps, .. } => Some((100.0, 2.0 * us(substeps))),
        Candidate::Net { shape, source, .. } => {
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
    ];
    assert_eq!(asked[..expected.len()], expected);
    assert!(!found.is_out_of_time);
    // The best, and what could be as good, in turns; the least time of each counts.
    let finalists = ["RK4 x2", "RK5 x1", "distilled 2x24", "RK4 x4", "RK5 x2"];
    let rounds =
        (1..=ROUNDS).flat_map(|round| finalists.map(|name| format!("{name} again {round}")));
    assert_eq!(asked[expected.len()..], rounds.collect::<Vec<_>>());
    let again: Vec<_> = found.tried.iter().filter(|tried| tried.repetitions > 1).collect();
    // As often as makes 20 ms of 100 steps of 5, 3, 6, 4 and 4 us.
    let repetitions: Vec<_> = again.iter().map(|tried| tried.repetitions).collect();
    assert_eq!(repetitions, [40, 67, 34, 50, 50]);
    assert!(again.iter().all(|tried| tried.place == format!("{}-2", tried.candidate)));
}

#[test]
fn nets_of_many_states_have_one_layer_first() {
    let (asked, _) = order_of(20, 99, |candidate| match candidate {
        Candidate::BlackBox => None,
        Candidate::Integrator { .. } => Some((100.0, 5.0)),
        Candidate::Net { .. } => Some((100.0, 1.0)),
    });
    assert!(asked.contains(&"distilled 1x24".to_owned()), "{asked:?}");
    assert!(!asked.iter().any(|asked| asked.contains(" 2x")), "{asked:?}");
    let first = |states: usize| {
        let (asked, _) = order_of(states, 99, |_| Some((100.0, 5.0)));
        asked.into_iter().find(|name| name.starts_with("distilled")).unwrap()
    };
    assert_eq!([9, 10].map(first), ["distilled 2x16", "distilled 1x24"]);
}

/// The method for stiff plants is worth a try where RK4 needs eight substeps or more.
#[test]
fn few_substeps_of_rk4_are_a_reason_against_the_method_for_stiff_plants() {
    let least = |least: usize| {
        order(99, move |candidate| match candidate {
            Candidate::Integrator { integrator: Integrator::Rk4, substeps } => {
                Some((if substeps < least { 120.0 } else { 100.0 }, us(substeps)))
            }
            _ => Some((150.0, 1.5)),
        })
    };
    let is_stiff = |name: &String| name.starts_with("Rosenbrock");
    let (asked, found) = least(7);
    assert!(!asked.iter().any(is_stiff), "{asked:?}");
    let reason = "Rosenbrock: RK4 is good with 7 substeps, fewer than 8";
    assert!(found.untried.iter().any(|of| of == reason), "{:?}", found.untried);
    let (asked, found) = least(8);
    assert!(asked.iter().any(is_stiff), "{asked:?}");
    assert!(!found.untried.iter().any(|of| of.starts_with("Ros")), "{:?}", found.untried);
}

/// The repetitions of the config are shared by the rounds, rounded up: 100 by 15.
#[test]
fn all_rounds_together_have_the_repetitions_of_the_config() {
    let text = SPEC.replace("repetitions = 10", "repetitions = 100");
    let control: ControlSpec = toml::from_str(&text).unwrap();
    let search =
        Search { control: &control, sources: &[], states: 2, within: 0.01, has_equation: true };
    // 100 steps of 1 ms are enough for a time.
    let rule = |_| Some((100.0, 1000.0));
    let mut loops = Rules { rule, asked: Vec::new(), most: 99, rounds: 99 };
    let Ok(found) = search.run(&mut loops);
    let again = found.tried.iter().filter(|tried| tried.place.ends_with("-2"));
    let repetitions: Vec<usize> = again.map(|tried| tried.repetitions).collect();
    assert!(!repetitions.is_empty() && repetitions.iter().all(|n| *n == 7), "{repetitions:?}");
}

/// Nets trained on the equation are searched from the smallest distilled one on that is good.
#[test]
fn the_second_source_begins_where_the_first_one_ended() {
    let from = |least: usize| {
        let (asked, _) = order(99, move |candidate| match candidate {
            Candidate::Net { shape, .. } => {
                Some((if shape.layers * shape.neurons < least { 150.0 } else { 100.0 }, 1.5))
            }
            _ => Some((100.0, 2.0)),
        });
        asked.into_iter().find(|name| name.starts_with("PINC")).unwrap()
    };
    assert_eq!([0, 30, 40, 60].map(from), ["PINC 2x8", "PINC 2x16", "PINC 2x24", "PINC 3x24"]);
}

#[test]
fn a_stiff_plant_has_the_method_for_stiff_plants_tried() {
    let (asked, _) = order(99, |candidate| match candidate {
        Candidate::BlackBox => None,
        Candidate::Integrator { integrator: Integrator::Rosenbrock, .. } => Some((100.0, 9.0)),
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
fn a_small_net_that_fails_keeps_no_larger_one_from_being_tried() {
    // Failing steps take long, as the solver goes on to its last iteration.
    let control: ControlSpec = toml::from_str(SPEC).unwrap();
    let sources = &[TrainingTarget::Integrator];
    let search =
        Search { control: &control, sources, states: 20, within: 0.01, has_equation: true };
    let mut loops = Rules {
        rule: |candidate| match candidate {
            Candidate::BlackBox => None,
            Candidate::Integrator { .. } => Some((100.0, 5.0)),
            Candidate::Net { shape: Shape { neurons: 48, layers: 2 }, .. } => Some((100.0, 4.0)),
            Candidate::Net { .. } => Some((f64::NAN, 400.0)),
        },
        asked: Vec::new(),
        most: 99,
        rounds: 1,
    };
    let Ok(found) = search.run(&mut loops);
    assert!(loops.asked.contains(&"distilled 2x48".to_owned()), "{:?}", loops.asked);
    let nets = found.tried.iter().filter(|tried| matches!(tried.candidate, Candidate::Net { .. }));
    assert_eq!(nets.count(), 4);
    assert!(found.untried.iter().any(|of| of.starts_with("distilled 1x16: ")), "{found:?}");
}

#[test]
fn what_is_not_tried_is_reported_with_the_reason() {
    // Good from 2x24 on, which takes more than twice as long as RK4.
    let (_, found) = order(99, |candidate| match candidate {
        Candidate::BlackBox => None,
        Candidate::Integrator { integrator: Integrator::Rk4, .. } => Some((100.0, 2.0)),
        Candidate::Integrator { .. } => Some((100.0, 3.0)),
        Candidate::Net { .. } => Some((150.0, 4.5)),
    });
    let said = found.untried.join("\n");
    for part in [
        "Rosenbrock: RK4 is good with 1 substeps, fewer than 8",
        "distilled 2x24, distilled 3x24, distilled 4x32: the control step with distilled 2x16 takes \
         4.5 us",
        "PINC 2x24, PINC 3x24, PINC 4x32: ",
    ] {
        assert!(said.contains(part), "no `{part}` in {said}");
    }
    // At most twice as long is within reach: 4 us of 2 us.
    let (asked, _) = order(99, |candidate| match candidate {
        Candidate::BlackBox => None,
        Candidate::Integrator { .. } => Some((100.0, 2.0)),
        Candidate::Net { .. } => Some((150.0, 3.9)),
    });
    assert!(asked.contains(&"distilled 4x32".to_owned()), "{asked:?}");
    let (_, found) = order(6, |_| Some((100.0, 5.0)));
    assert!(found.untried.iter().any(|of| of.ends_with("the time was up")), "{:?}", found.untried);
}

/// The sizes of a source that was searched to its end have a reason of their own.
#[test]
fn no_model_is_said_twice_not_to_have_been_tried() {
    // Seven loops of integrators, and a good net in the eighth.
    let (asked, found) = order(8, |_| Some((100.0, 2.0)));
    let said = found.untried.join("; ");
    assert!(asked.contains(&"distilled 2x8".to_owned()) && found.is_out_of_time, "{asked:?}");
    for name in ["distilled 2x24", "PINC 2x16"] {
        assert_eq!(said.matches(name).count(), 1, "{name}: {said}");
    }
}

#[test]
fn a_net_that_is_nearly_good_is_trained_longer() {
    let (asked, _) = order(99, |candidate| match candidate {
        Candidate::BlackBox => None,
        Candidate::Integrator { .. } => Some((100.0, 5.0)),
        Candidate::Net { shape: Shape { layers: 2, neurons: 16 }, longer, .. } => {
            Some((if longer { 100.5 } else { 101.5 }, 2.0))
        }
        Candidate::Net { .. } => Some((150.0, 1.0)),
    });
    let nets: Vec<_> = asked.iter().filter(|asked| asked.starts_with("distilled")).collect();
    let expected = ["distilled 2x16", "distilled 2x16 longer", "distilled 2x8"];
    assert_eq!(nets[..3], expected, "{asked:?}");
    assert!(asked.contains(&"distilled 2x16 longer again 3".to_owned()), "{asked:?}");
}

#[test]
fn nothing_is_tried_after_the_time_is_up() {
    let (asked, found) = order(3, |_| Some((100.0, 5.0)));
    assert_eq!(asked[..3], ["RK4 x4", "RK4 x8", "RK4 x2"]);
    // All are as good; each is measured in as many rounds as there was time for.
    let finalists = ["RK4 x4", "RK4 x8", "RK4 x2"];
    let rounds = (1..=2).flat_map(|round| finalists.map(|name| format!("{name} again {round}")));
    assert_eq!(asked[3..], rounds.collect::<Vec<_>>());
    assert!(found.is_out_of_time);
    assert!(found.tried.iter().all(|tried| tried.place.ends_with("-2")));
    // Without any loop that stands there is nothing to compare with.
    let (asked, found) = order(99, |_| None);
    assert!(asked.iter().all(|asked| asked.starts_with('R')), "{asked:?}");
    assert_eq!(found.tried.len(), 12);
}

#[test]
fn a_plant_without_an_equation_is_compared_with_nets_only() {
    let control: ControlSpec = toml::from_str(SPEC).unwrap();
    let sources = &[TrainingTarget::Integrator];
    let search =
        Search { control: &control, sources, states: 2, within: 0.01, has_equation: false };
    let rule = |candidate| match candidate {
        Candidate::Integrator { .. } => panic!("there is no equation"),
        Candidate::BlackBox => Some((100.0, 900.0)),
        Candidate::Net { shape, .. } => Some((if shape.neurons < 24 { 150.0 } else { 100.0 }, 5.0)),
    };
    let mut loops = Rules { rule, asked: Vec::new(), most: 99, rounds: 1 };
    let Ok(found) = search.run(&mut loops);
    let expected = ["black box", "distilled 2x16", "distilled 2x24"];
    assert_eq!(loops.asked[..3], expected, "{:?}", loops.asked);
    let advice = crate::Advice::of(&search, &found, &[]).unwrap();
    assert_eq!(advice.winner().candidate.to_string(), "distilled 2x24");
    let said = advice.sentences()[0].clone();
    let part = "the most exact model, black box, 100.000000";
    assert!(
        said.contains(part) && said.ends_with("; the black box itself takes 900.0 us."),
        "{said}"
    );
}
