//! The box that is examined.

use pinc_analysis::Region;
use pinc_config::{ControlSpec, Experiment};
use pinc_ode::Dims;

/// The box and what it is called: the training domain, or else the controller's bounds. A state
/// without bounds, or with such as may stand for none, has the range of the start and the
/// references, or 1 about the start. One with a bound on one side only has this for the other side,
/// and start and references beyond its bound are in the box as well, so that no lower end is above
/// an upper one.
pub(crate) fn of(experiment: &Experiment, dims: Dims) -> Option<(Region, &'static str)> {
    if let Some(domain) = &experiment.domain {
        let low = [&domain.state_low[..], &domain.input_low].concat();
        let high = [&domain.state_high[..], &domain.input_high].concat();
        return Some((Region::new(dims, low, high), "the training domain"));
    }
    let control = experiment.control.as_ref()?;
    let variables = experiment.plant.variables().state_names();
    let (mut low, mut high) = (control.initial_state.clone(), control.initial_state.clone());
    for reference in &control.references {
        for (name, &value) in control.controlled.iter().zip(&reference.value) {
            if let Some(i) = variables.iter().position(|state| state == name) {
                (low[i], high[i]) = (low[i].min(value), high[i].max(value));
            }
        }
    }
    let mut all_bounded = true;
    for (i, (low, high)) in low.iter_mut().zip(&mut high).enumerate() {
        let shown = low.abs().max(high.abs());
        let tells = |bound: &f64| bound.is_finite() && !ControlSpec::is_far(*bound, shown);
        let bound = |of: &Option<Vec<f64>>| Some(of.as_ref()?[i]).filter(tells);
        let bounds = [bound(&control.state_low), bound(&control.state_high)];
        all_bounded &= bounds.iter().all(Option::is_some);
        (*low, *high) = ends((*low, *high), bounds);
    }
    low.extend(&control.input_low);
    high.extend(&control.input_high);
    let name = match all_bounded {
        true => "the controller's bounds",
        false => "the box of start, references and bounds",
    };
    Some((Region::new(dims, low, high), name))
}

/// The ends for a state with start and references in a range, and with these bounds.
fn ends((from, to): (f64, f64), bounds: [Option<f64>; 2]) -> (f64, f64) {
    let (below, above) = if from < to { (from, to) } else { (from - 0.5, to + 0.5) };
    match bounds {
        [Some(low), Some(high)] => (low, high),
        [Some(low), None] => (low.min(from), above.max(low)),
        [None, Some(high)] => (below.min(high), high.max(to)),
        [None, None] => (below, above),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::evidence;
    use crate::{Severity, check};
    use pinc_config::Plants;

    /// A tank S with a start at 3, a reference of 2 and these bounds, which are TOML.
    fn tank(rate: &str, bounds: &str) -> Experiment {
        let text = format!(
            r#"
            name = "test"
            preset = "ours"
            seed = 1
            [plant.expression]
            states = ["S"]
            inputs = ["u"]
            derivatives = {{ S = "{rate}" }}
            [control]
            models = ["rk4"]
            step_s = 0.1
            duration_s = 1.0
            initial_state = [3.0]
            controlled = ["S"]
            q = [1.0]
            r = [1.0]
            input_low = [0.0]
            input_high = [1.0]
            references = [{{ start_s = 0.0, value = [2.0] }}]
            {bounds}
            "#
        );
        Experiment::parse("test.toml".as_ref(), &text, &[], &Plants::built_in()).unwrap()
    }

    #[test]
    fn start_references_and_a_bound_on_one_side_are_in_the_box() {
        let ends = |bounds: &str| {
            let (region, _) = of(&tank("u - 0.5*S", bounds), Dims::new(1, 1)).unwrap();
            (region.low[0], region.high[0])
        };
        for (bounds, expected) in [
            ("", (2.0, 3.0)),
            // Beyond both, between them and on the far side of both.
            ("state_high = [1.0]", (1.0, 3.0)),
            ("state_high = [2.5]", (2.0, 3.0)),
            ("state_high = [4.0]", (2.0, 4.0)),
            ("state_low = [4.0]", (2.0, 4.0)),
            ("state_low = [2.5]", (2.0, 3.0)),
            ("state_low = [1.0]", (1.0, 3.0)),
            ("state_low = [-inf]\nstate_high = [1.0]", (1.0, 3.0)),
            // Two bounds are the box, wherever the loop starts.
            ("state_low = [0.0]\nstate_high = [1.0]", (0.0, 1.0)),
            ("state_low = [0.0]\nstate_high = [4.0]", (0.0, 4.0)),
            // These may stand for none.
            ("state_low = [-1e6]\nstate_high = [1e6]", (2.0, 3.0)),
        ] {
            assert_eq!(ends(bounds), expected, "{bounds}");
        }
        // Start and reference are one value: 1 about it, up to the bound.
        assert_eq!(super::ends((3.0, 3.0), [None, Some(3.2)]), (2.5, 3.2));
        assert_eq!(super::ends((3.0, 3.0), [None, Some(1.0)]), (1.0, 3.0));
        assert_eq!(super::ends((3.0, 3.0), [Some(3.0), None]), (3.0, 3.5));
        assert_eq!(super::ends((3.0, 3.0), [Some(4.0), None]), (3.0, 4.0));
    }

    /// One substep of RK4 is exact enough for a rate of 0.5 1/s and steps of 0.1 s, in any box. The
    /// denominator of the other rate is 0 beyond the box, where it is looked for.
    #[test]
    fn a_start_beyond_a_bound_on_one_side_is_examined() {
        for rate in ["u - 0.5*S", "u - S/(0.5 + S)"] {
            let experiment = tank(rate, "state_high = [1.0]\nstate_softness = \"exact\"");
            let evidence = evidence(&|_| Err("no files".to_owned()));
            let found = check(&*experiment.plant.dyn_plant(), &experiment, &evidence);
            let grave: Vec<_> = found.iter().filter(|of| of.severity != Severity::Fact).collect();
            // The start is outside its bounds, and the reference is, where it cannot be held.
            assert_eq!(grave.len(), 3, "{grave:#?}");
            assert!(grave.iter().all(|of| of.what.contains("bounds")), "{grave:#?}");
            assert!(found.iter().all(|of| !of.what.contains("NaN")), "{found:#?}");
        }
    }
}
