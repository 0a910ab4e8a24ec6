//! Times of a closed loop: which step begins at them, and that one does.

use crate::common::parse;

/// A loop of 60 steps of 0.05 s, with everything that begins at some time.
const LOOP: &str = r#"
name = "times"
preset = "ours"
seed = 1

[plant.expression]
states = ["x"]
inputs = ["u"]
parameters = { a = 1.0 }
derivatives = { x = "u - a*x" }

[control]
models = ["rk4"]
step_s = 0.05
duration_s = 3.0
initial_state = [0.0]
controlled = ["x"]
q = [1.0]
r = [1.0]
input_low = [-1.0]
input_high = [1.0]
references = [{ start_s = 0.0, value = [0.0] }, { start_s = 1.05, value = [1.0] }]
loads = [{ start_s = 0.0, end_s = 0.15, rates = { x = 1.0 } }]
plant_schedule = [{ start_s = 0.3, values = { a = 2.0 } }]
"#;

/// The rate of x at rest in each plant of the loop, and its slope, with the step from which on they
/// hold.
fn plants(sets: &[&str]) -> Vec<(usize, f64, f64)> {
    let experiment = parse(LOOP, sets).unwrap();
    let rate = |plant: &dyn pinc_ode::DynRhs, x: f64| {
        let mut rate = [f64::NAN];
        plant.rhs(&[x], &[0.0], &[], &mut rate);
        rate[0]
    };
    let plants = experiment.plants_in_the_loop(0.05);
    let of = |of: &pinc_config::PlantInTheLoop| {
        let at_rest = rate(&*of.plant, 0.0);
        (of.from_step, at_rest, rate(&*of.plant, 1.0) - at_rest)
    };
    plants.iter().map(of).collect()
}

#[test]
fn what_is_scheduled_acts_from_the_step_that_begins_then() {
    assert_eq!(plants(&[]), [(0, 1.0, -1.0), (3, 0.0, -1.0), (6, 0.0, -2.0)]);
    // A load that begins one step later leaves step 0 alone.
    let later = ["control.loads.0.start_s=0.05"];
    assert_eq!(plants(&later), [(0, 0.0, -1.0), (1, 1.0, -1.0), (3, 0.0, -1.0), (6, 0.0, -2.0)]);
    let both = ["control.plant_schedule.0.start_s=0.05"];
    assert_eq!(plants(&both), [(0, 1.0, -1.0), (1, 1.0, -2.0), (3, 0.0, -2.0)]);
}

/// A delay as long as the loop leaves no step in which a chosen input acts.
#[test]
fn a_delay_is_shorter_than_the_loop() {
    assert!(parse(LOOP, &["control.delay_steps=59"]).is_ok());
    let error = parse(LOOP, &["control.delay_steps=60"]).unwrap_err();
    for part in ["`control.delay_steps`", "60 given", "at most 59"] {
        assert!(error.contains(part), "no {part} in {error}");
    }
}

#[test]
fn a_time_between_two_steps_is_refused_with_the_nearest_ones() {
    let schedule = "control.parameter_schedule=[{ start_s = 0.33, values = {} }]";
    for (set, key, found, nearest) in [
        ("control.references.1.start_s=1.02", "references[1].start_s", "1.02", "1 or 1.05"),
        ("control.loads.0.start_s=0.01", "loads[0].start_s", "0.01", "0 or 0.05"),
        ("control.loads.0.end_s=0.17", "loads[0].end_s", "0.17", "0.15 or 0.2"),
        (
            "control.plant_schedule.0.start_s=0.34",
            "plant_schedule[0].start_s",
            "0.34",
            "0.3 or 0.35",
        ),
        (schedule, "parameter_schedule[0].start_s", "0.33", "0.3 or 0.35"),
        ("control.duration_s=3.01", "duration_s", "3.01", "3 or 3.05"),
        ("control.duration_s=0.01", "duration_s", "0.01", "0.05"),
    ] {
        let refused = parse(LOOP, &[set]).unwrap_err();
        let expected = format!(
            "`control.{key}`: {found} given, expected a whole number of steps of T = 0.05 s: \
             {nearest}"
        );
        assert!(refused.ends_with(&expected), "{refused}");
    }
    // Rounding is no offence: 21*0.05 is not 1.05.
    for time in ["1.05", "1.0500000000000003", "1.0499999999999998"] {
        parse(LOOP, &[&format!("control.references.1.start_s={time}")]).unwrap();
    }
}

/// The step of a net may be known only with its file.
#[test]
fn without_a_step_length_times_are_checked_once_it_is_known() {
    let text = LOOP.replace("models = [\"rk4\"]", "models = [\"pinc\"]");
    let text = text.replace("step_s = 0.05\n", "");
    let experiment = parse(&text, &[]).unwrap();
    experiment.check_step_marks(0.05).unwrap();
    let (key, problem) = experiment.check_step_marks(0.1).unwrap_err();
    assert_eq!(key, "control.references[1].start_s");
    assert!(problem.to_string().contains("1 or 1.1"), "{problem}");
}
