//! What FMUs refuse: calls out of order, steps that cannot be, and plants that are too stiff.

use super::controller::{equations, oscillator_case};
use super::fmu::{driven, driven_files};
use super::net::nets;
use pinc_export::{
    FmiVersion, GeneratedFile, Name, Origin, RungeKuttaModel, net_to_fmu, plant_to_fmu,
};
use pinc_expr::PlantEquations;
use pinc_ode::{Integrator, Variable};

const OK: f64 = 0.0;
const DISCARD: f64 = 2.0;
const ERROR: f64 = 3.0;

/// Calls an instance in all orders; writes the statuses, then what was read, and whether each failure
/// was logged in the name of the instance, in a text that needs no formatting.
const MODES: &str = r#"
#include "ctl_fmu.c"
#include <stdio.h>
static int failed = 0, told = 0;
static void said(fmi2ComponentEnvironment e, fmi2String i, fmi2Status s, fmi2String c, fmi2String m, ...)
{
    told += (strcmp(i, "one of two") == 0) & (strchr(m, '%') == 0);
}
static void show(fmi2Status status)
{
    failed += status != fmi2OK;
    printf("%d\n", (int)status);
}
static fmi2Component c;
static void set(fmi2ValueReference place, double value)
{
    show(fmi2SetReal(c, &place, 1, &value));
}
static double get(void)
{
    const fmi2ValueReference u = 0;
    double value = 77.0;
    show(fmi2GetReal(c, &u, 1, &value));
    return value;
}
int main(void)
{
    const double impossible[5] = {NAN, -0.5, 0.0, INFINITY, 1e300};
    fmi2CallbackFunctions callbacks = {said, calloc, free, 0, 0};
    double u[6], last;
    int i;
    c = fmi2Instantiate("one of two", fmi2CoSimulation, CTL_GUID, "", &callbacks, 0, 0);
    get();
    show(fmi2DoStep(c, 0.0, 0.5, 1));
    show(fmi2ExitInitializationMode(c));
    show(fmi2EnterInitializationMode(c));
    show(fmi2Terminate(c));
    show(fmi2SetupExperiment(c, 0, 0.0, NAN, 0, 0.0));
    show(fmi2SetupExperiment(c, 0, 0.0, 1.0, 1, 0.0));
    show(fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0));
    show(fmi2EnterInitializationMode(c));
    show(fmi2EnterInitializationMode(c));
    show(fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0));
    show(fmi2DoStep(c, 0.0, 0.5, 1));
    u[0] = get();
    set(5, 0.5);
    u[1] = get();
    show(fmi2ExitInitializationMode(c));
    u[2] = get();
    for (i = 0; i < 5; i++) {
        show(fmi2DoStep(c, 0.0, impossible[i], 1));
    }
    show(fmi2DoStep(c, NAN, 0.5, 1));
    show(fmi2DoStep(c, 7.0, 0.5, 1));
    show(fmi2DoStep(c, 0.0, 0.7, 1));
    u[3] = get();
    show(fmi2DoStep(c, 0.0, 0.5, 1));
    show(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &last));
    show(fmi2DoStep(c, 0.0, 0.5, 1));
    set(5, 0.1);
    set(0, 0.1);
    set(999, 0.1);
    set(1, 0.1);
    u[4] = get();
    show(fmi2Terminate(c));
    show(fmi2Terminate(c));
    show(fmi2DoStep(c, 0.5, 0.5, 1));
    set(1, 0.2);
    u[5] = get();
    show(fmi2Reset(c));
    get();
    for (i = 0; i < 6; i++) {
        printf("%.17g\n", u[i]);
    }
    printf("%.17g\n%d\n", last, failed - told);
    /* Logging is switched off, a category that there is not on, and the one that there is. */
    for (i = 0; i < 3; i++) {
        const fmi2String categories[2] = {"events", "error"};
        const int before = told;
        fmi2SetDebugLogging(c, i > 0, (size_t)i, categories);
        fmi2DoStep(c, 0.0, 0.5, 1);
        printf("%d\n", told - before);
    }
    fmi2FreeInstance(c);
    return 0;
}
"#;

#[test]
fn calls_out_of_order_and_impossible_steps_are_refused_and_change_nothing() {
    let found = driven(&oscillator_case(), MODES);
    let (statuses, read) = found.split_at(found.len() - 11);
    let expected = [
        // Before the set-up, and set-ups.
        &[ERROR; 5][..],
        &[ERROR, ERROR, OK],
        // The initialization, in which outputs follow what is set.
        &[OK, ERROR, ERROR, ERROR, OK, OK, OK, OK, OK],
        // Steps: impossible ones, a mismatch, one that passes a sample.
        &[ERROR; 7],
        &[DISCARD, OK, OK, OK, ERROR],
        // A fixed parameter, an output, nothing, an input.
        &[ERROR, ERROR, ERROR, OK, OK],
        // The end, and a new beginning.
        &[OK, ERROR, ERROR, ERROR, OK, OK, ERROR],
    ]
    .concat();
    assert_eq!(statuses, expected);
    let [before, set, run, kept, next, end, ..] = read else { panic!("{read:?}") };
    assert!((before - set).abs() > 1e-3, "{read:?}");
    for (a, b) in [(set, run), (run, kept), (next, end)] {
        assert!(a.total_cmp(b).is_eq(), "{read:?}");
    }
    assert_eq!(read[6..], [0.5, 0.0, 0.0, 0.0, 1.0]);
}

/// Of the net: a step under an input that is none, and the same step again.
const NET: &str = r#"
#include "net_fmu.c"
#include <stdio.h>
int main(void)
{
    const fmi2CallbackFunctions callbacks = {0, calloc, free, 0, 0};
    const fmi2ValueReference x[2] = {0, 1}, u = 2;
    double values[2], inputs[2] = {NAN, 0.3}, t = 0.0;
    int i;
    fmi2Component c = fmi2Instantiate("a", fmi2CoSimulation, NET_GUID, "", &callbacks, 0, 0);
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
    fmi2EnterInitializationMode(c);
    fmi2ExitInitializationMode(c);
    for (i = 0; i < 2; i++) {
        fmi2SetReal(c, &u, 1, &inputs[i]);
        printf("%d\n", (int)fmi2DoStep(c, t, 0.5, 1));
        fmi2GetReal(c, x, 2, values);
        printf("%.17g\n%.17g\n", values[0], values[1]);
    }
    inputs[0] = NAN;
    fmi2Reset(c);
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
    fmi2EnterInitializationMode(c);
    { const fmi2ValueReference start = 3; fmi2SetReal(c, &start, 1, inputs); }
    printf("%d\n", (int)fmi2ExitInitializationMode(c));
    fmi2FreeInstance(c);
    return 0;
}
"#;

#[test]
fn a_net_that_has_no_value_stays_where_it_is() {
    let [net, ..] = nets();
    let name = Name::new("net").unwrap();
    let files = net_to_fmu(&net, &name, &Origin::of_net(&net, "0", "0"), FmiVersion::Two).unwrap();
    let found = driven_files(files, "net_fmu.c", NET);
    let middle: Vec<f64> = net.domain().ends().map(|(a, b)| f64::midpoint(a, b)).collect();
    assert_eq!(found[..3], [DISCARD, middle[0], middle[1]]);
    let next = net.evaluate(0.5, &middle[..2], &[0.3], &[]);
    assert_eq!(found[3..4], [OK]);
    assert!(found[4..6].iter().zip(&next).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    assert_eq!(found[6..], [ERROR]);
}

/// The units of a net are those of the plant that it was trained on; one without units has none.
#[test]
fn a_net_has_the_units_of_its_plant() {
    let [unitless, _, tanks] = nets();
    for version in [FmiVersion::Two, FmiVersion::Three] {
        let description = |net| {
            let (name, origin) = (Name::new("net").unwrap(), Origin::of_net(net, "0", "0"));
            let files = net_to_fmu(net, &name, &origin, version).unwrap();
            String::from_utf8(files[0].bytes.clone()).unwrap()
        };
        let xml = description(&tanks);
        let defined = "<UnitDefinitions>\n    <Unit name=\"V\"/>\n    <Unit name=\"cm\"/>\n";
        assert!(xml.contains(defined), "{xml}");
        // Four states, their starts, and two inputs.
        let count = |unit: &str| xml.matches(&format!(" unit=\"{unit}\"")).count();
        assert_eq!([count("cm"), count("V")], [8, 2], "{xml}");
        assert!(!description(&unitless).contains("Unit"), "{}", description(&unitless));
    }
}

/// A mode of -k 1/s beside a slow one, which follows the input u.
fn stiff() -> PlantEquations {
    equations(
        r#"{"states": [{"name": "x"}, {"name": "y"}], "inputs": [{"name": "u"}, {"name": "k"}],
            "derivatives": {"x": "-k*(x - y)", "y": "-y + u"}}"#,
    )
}

fn plant(equations: &PlantEquations) -> RungeKuttaModel<'_> {
    RungeKuttaModel {
        equations,
        parameters: &[],
        method: Integrator::Rk4,
        sample_time_s: 0.1,
        substeps: 1,
    }
}

fn stiff_fmu(version: FmiVersion) -> Vec<GeneratedFile> {
    let variables = |names: [&'static str; 2]| names.map(|name| Variable::new(name, "")).to_vec();
    let origin = Origin {
        version: "0".to_owned(),
        hash: "00".to_owned(),
        states: variables(["x", "y"]),
        inputs: variables(["u", "k"]),
        outputs: Vec::new(),
        proven: None,
    };
    let (name, equations) = (Name::new("stiff").unwrap(), stiff());
    let start = [&[0.1, 0.0][..], &[1.0, 3e3]];
    plant_to_fmu(plant(&equations), start, &name, &origin, version).unwrap()
}

/// Steps with k from mild to far too stiff, under an input that is none, and then goes on.
const STIFF: &str = r#"
#include "stiff_fmu.c"
#include <stdio.h>
int main(void)
{
    const fmi3ValueReference x[2] = {1, 2}, set[2] = {5, 6};
    const double inputs[6][2] = {{1, 3e3}, {1, 1e5}, {1, 1e9}, {NAN, 1}, {1, 1e5}, {1, 10}};
    const double lengths[6] = {0.1, 0.1, 0.1, 0.1, 0.05, 0.25};
    double values[2], t = 0.0, last;
    bool event, terminate, early;
    int i;
    fmi3Instance c =
        fmi3InstantiateCoSimulation("a", STIFF_GUID, "", 0, 0, 0, 0, 0, 0, 0, 0, 0);
    if (fmi3DoStep(c, t, 0.1, 1, &event, &terminate, &early, &last) != fmi3Error ||
        fmi3EnterInitializationMode(c, 0, 0.0, NAN, 0, 0.0) != fmi3Error) {
        return 1;
    }
    fmi3EnterInitializationMode(c, 0, 0.0, t, 0, 0.0);
    fmi3ExitInitializationMode(c);
    for (i = 0; i < 6; i++) {
        fmi3SetFloat64(c, set, 2, inputs[i], 2);
        printf("%d\n", (int)fmi3DoStep(c, t, lengths[i], 1, &event, &terminate, &early, &last));
        fmi3GetFloat64(c, x, 2, values, 2);
        printf("%.17g\n%.17g\n%.17g\n", last, values[0], values[1]);
        t = last;
    }
    if (fmi3DoStep(c, t, INFINITY, 1, &event, &terminate, &early, &last) != fmi3Error ||
        fmi3DoStep(c, t, 1e300, 1, &event, &terminate, &early, &last) != fmi3Error ||
        fmi3SetFloat64(c, (const fmi3ValueReference[1]){7}, 1, values, 1) != fmi3Error ||
        fmi3SetFloat64(c, (const fmi3ValueReference[1]){0}, 1, values, 1) != fmi3Error) {
        return 1;
    }
    fmi3FreeInstance(c);
    return 0;
}
"#;

/// The state by its formula: x' = -k (x - y), y' = -y + 1.
fn exact([x, y]: [f64; 2], k: f64, t: f64) -> [f64; 2] {
    let gain = (y - 1.0) * k / (k - 1.0);
    let next = 1.0 + (y - 1.0) * (-t).exp();
    [1.0 + gain * (-t).exp() + (x - 1.0 - gain) * (-k * t).exp(), next]
}

#[test]
fn a_stiff_plant_is_integrated_or_refused() {
    let found = driven_files(stiff_fmu(FmiVersion::Three), "stiff_fmu.c", STIFF);
    let mut state = [0.1, 0.0];
    let mut t = 0.0;
    let steps: [(Option<f64>, f64); 6] = [
        (Some(3e3), 0.1),
        (Some(1e5), 0.1),
        (None, 0.1),
        (None, 0.1),
        (Some(1e5), 0.05),
        (Some(10.0), 0.25),
    ];
    assert_eq!(found.len(), 24);
    for (found, (k, length)) in found.chunks(4).zip(steps) {
        if let Some(k) = k {
            state = exact(state, k, length);
            t += length;
        }
        assert_eq!(found[..1], [if k.is_some() { OK } else { DISCARD }], "{found:?}");
        assert!((found[1] - t).abs() < 1e-12, "{found:?}");
        assert!(
            found[2..].iter().zip(state).all(|(a, b)| (a - b).abs() < 1e-4),
            "{found:?} {state:?}"
        );
    }
}

#[test]
fn what_the_fmu_of_a_plant_cannot_integrate_is_known() {
    let equations = stiff();
    let is_integrable = |k: f64| plant(&equations).is_integrable([&[0.0; 2], &[0.0, k]]).unwrap();
    assert_eq!([3e3, 1e5, 1e9].map(is_integrable), [true, true, false]);
}
