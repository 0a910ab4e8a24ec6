//! Controllers with their estimators as FMUs.

use super::compile::Sources;
use super::controller::tanks_case;
use super::feedback::{Parts, library, number_of, tanks, with_outputs_and_pump};
use super::start::number;
use pinc_estimate::{Compensated, Disturbance};
use pinc_export::{
    Controller, Estimation, Filter, FmiVersion, GeneratedFile, Name, Origin, controller_to_fmu,
};
use pinc_mpc::Nmpc;

/// Sets measurements of the tanks' lower levels at every sample, and reads both statuses: first
/// what all versions have in common, then what differs.
const FMU_DRIVER: &str = r#"
#include "ctl_fmu.c"
#include <stdio.h>
#include <stdlib.h>
@PARTS@
int main(void)
{
    double values[4] = {0.0, 0.0, 9.5, 9.2};
    int ended[2];
    int k;
    begin();
    for (k = 0; k < 6; k++) {
        values[0] = (k == 3) ? 65535.0 : ((k == 4) ? (double)NAN : 9.0);
        values[1] = (k == 4) ? (double)NAN : 9.0;
        if (set(values) != 0 || get(ended) != 0 || step(CTL_SAMPLE_TIME_S * (double)k) != 0) {
            return 1;
        }
        printf("%d\n%d\n", ended[0], ended[1]);
    }
    return 0;
}
"#;

const FMI2_PARTS: &str = r#"
static fmi2Component c;
static void begin(void)
{
    fmi2CallbackFunctions callbacks = {0, calloc, free, 0, 0};
    c = fmi2Instantiate("a", fmi2CoSimulation, CTL_GUID, "", &callbacks, 0, 0);
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
    fmi2EnterInitializationMode(c);
    fmi2ExitInitializationMode(c);
}
static int set(const double *values)
{
    const fmi2ValueReference vr[4] = {6, 7, 8, 9};
    return fmi2SetReal(c, vr, 4, values) != fmi2OK;
}
static int get(int *ended)
{
    const fmi2ValueReference vr[3] = {0, 1, 2};
    return fmi2GetInteger(c, vr, 2, ended) != fmi2OK || fmi2GetInteger(c, vr + 2, 1, ended) == fmi2OK;
}
static int step(double t)
{
    return fmi2DoStep(c, t, CTL_SAMPLE_TIME_S, 1) != fmi2OK;
}
"#;

const FMI3_PARTS: &str = r#"
static fmi3Instance c;
static void begin(void)
{
    c = fmi3InstantiateCoSimulation("a", CTL_GUID, "", false, false, false, false, 0, 0, 0, 0, 0);
    fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0);
    fmi3ExitInitializationMode(c);
}
static int set(const double *values)
{
    const fmi3ValueReference vr[4] = {7, 8, 9, 10};
    return fmi3SetFloat64(c, vr, 4, values, 4) != fmi3OK;
}
static int get(int *ended)
{
    const fmi3ValueReference vr[4] = {29, 30, 28, 31};
    int64_t words[2];
    int64_t other;
    if (fmi3GetInt64(c, vr, 2, words, 2) != fmi3OK) {
        return 1;
    }
    ended[0] = (int)words[0];
    ended[1] = (int)words[1];
    return fmi3GetInt64(c, vr + 2, 1, &other, 1) == fmi3OK ||
           fmi3GetInt64(c, vr + 3, 1, &other, 1) == fmi3OK;
}
static int step(double t)
{
    bool event;
    bool terminate;
    bool early;
    double last;
    return fmi3DoStep(c, t, CTL_SAMPLE_TIME_S, true, &event, &terminate, &early, &last) != fmi3OK;
}
"#;

/// The statuses of controller and estimator in the library for what the driver measures.
fn statuses_for_the_driver((case, augmentation, tuning): &Parts) -> Vec<(f64, String)> {
    let mut estimator = library(Filter::Extended, case, augmentation, tuning);
    let model = Compensated::new(case.model(), augmentation.clone()).unwrap();
    let mut nmpc = Nmpc::new(case.problem.clone(), Box::new(model), case.config).unwrap();
    let (mut x, mut unknowns) = (vec![0.0; 4], case.problem.parameters.clone());
    let step = |k: usize| {
        let y = match k {
            3 => [65535.0, 9.0],
            4 => [f64::NAN; 2],
            _ => [9.0; 2],
        };
        let status = estimator.correct(&y).status;
        augmentation.read(estimator.estimate(), &mut x, &mut unknowns);
        nmpc.set_parameters(&unknowns).unwrap();
        let rows = [9.5, 9.2].repeat(case.problem.horizon);
        let step = nmpc.step(&x, &rows).unwrap();
        estimator.predict(step.u);
        (number(step.status), status.to_string())
    };
    (0..6).map(step).collect()
}

/// In both versions an FMU says what the gate rejected.
#[test]
fn an_fmu_has_the_status_of_its_estimator() {
    let parts = tanks(Disturbance::Input, 0);
    let expected = statuses_for_the_driver(&parts);
    let words: Vec<&str> = expected.iter().map(|(_, status)| status.as_str()).collect();
    assert_eq!(words[..5], ["updated", "updated", "updated", "rejected", "nothing-measured"]);
    let (case, augmentation, tuning) = &parts;
    for (version, driver) in [(FmiVersion::Two, FMI2_PARTS), (FmiVersion::Three, FMI3_PARTS)] {
        let estimation = Estimation { filter: Filter::Extended, augmentation, tuning };
        let export = |controller: &Controller<'_>, name: &Name, origin: &Origin| {
            controller_to_fmu((controller, case.library(Some(estimation))), name, origin, version)
        };
        let files = case.export_by(Some(estimation), export).unwrap();
        let xml = String::from_utf8(files[0].bytes.clone()).unwrap();
        // Both are outputs that depend on what is measured and on the references, at the start on all
        // parameters too: the inputs before it, weights and bounds.
        let at_start = (7..=28).map(|v| v.to_string()).collect::<Vec<_>>().join(" ");
        match version {
            FmiVersion::Two => {
                for index in [29, 30] {
                    let unknown =
                        |on: &str| format!("<Unknown index=\"{index}\" dependencies=\"{on}\"/>");
                    assert!(xml.contains(&unknown("7 8 9 10")), "{xml}");
                    assert!(xml.contains(&unknown(&at_start)), "{xml}");
                }
            }
            FmiVersion::Three => {
                for reference in [29, 30] {
                    let output = |on: &str| {
                        format!("valueReference=\"{reference}\" dependencies=\"{on}\"/>")
                    };
                    assert!(xml.contains(&output("7 8 9 10")), "{xml}");
                    assert!(xml.contains(&output(&at_start)), "{xml}");
                }
            }
        }
        // The words of the header, with its numbers.
        for (word, number) in [
            ("converged", 0),
            ("iteration-limit", 1),
            ("deadline", 2),
            ("not-initialized", 7),
            ("updated", 0),
            ("nothing-measured", 1),
            ("reading-rejected", 6),
            ("reacquired", 7),
        ] {
            let item = format!("<Item name=\"{word}\" value=\"{number}\"/>");
            assert!(xml.contains(&item), "{word}: {xml}");
        }
        for status in ["status", "estimator_status"] {
            let of_type = format!("declaredType=\"pinc.{status}\"");
            assert_eq!(xml.matches(&of_type).count(), 1, "{xml}");
        }
        let sources =
            Sources::with_included(&files.into_iter().map(flat).collect::<Vec<_>>(), "ctl_fmu.c");
        let options = ["-Wno-unused-parameter"];
        let found = sources.drive(&FMU_DRIVER.replace("@PARTS@", driver), &options, &[]);
        assert_eq!(found.len(), 12);
        for (found, (status, word)) in found.chunks(2).zip(&expected) {
            assert!(found[0].total_cmp(status).is_eq(), "{found:?} {status}");
            assert!(found[1].total_cmp(&number_of(word)).is_eq(), "{found:?} {word}");
        }
        // A controller without an estimator has no such variable.
        let in_volts = |controller: &Controller<'_>, name: &Name, origin: &Origin| {
            let mut origin = origin.clone();
            origin.inputs.iter_mut().for_each(|pump| pump.unit = "V".into());
            controller_to_fmu((controller, tanks_case().library(None)), name, &origin, version)
        };
        let mut plain = tanks_case().export_by(None, in_volts).unwrap();
        let xml = String::from_utf8(plain.swap_remove(0).bytes).unwrap();
        assert!(xml.contains("\"status\"") && !xml.contains("estimator_status"), "{xml}");
        // The pumps have unit, bounds and size; so have their tunable bounds, which also have a start.
        let attributes = "unit=\"V\" min=\"0.0\" max=\"5.0\" nominal=\"5.0\"/>";
        assert_eq!(xml.matches(attributes).count(), 2, "{xml}");
        for name in ["\"u0\"", "\"x3\"", "\"x1_ref\"", "\"u1_start\""] {
            assert!(xml.contains(&format!("name={name} valueReference")), "{name}: {xml}");
        }
    }
}

/// A file of an FMU without its folder.
fn flat(file: GeneratedFile) -> GeneratedFile {
    GeneratedFile { path: file.path.trim_start_matches("sources/").to_owned(), ..file }
}

/// In both versions measured outputs are inputs of the FMU, and estimates are outputs.
#[test]
fn an_fmu_of_a_controller_with_its_estimator_compiles() {
    let (case, augmentation, tuning) = with_outputs_and_pump(Disturbance::Output);
    for version in [FmiVersion::Two, FmiVersion::Three] {
        let estimation =
            Estimation { filter: Filter::Extended, augmentation: &augmentation, tuning: &tuning };
        let export = |controller: &Controller<'_>, name: &Name, origin: &Origin| {
            controller_to_fmu((controller, case.library(Some(estimation))), name, origin, version)
        };
        let files = case.export_by(Some(estimation), export).unwrap();
        let xml = String::from_utf8(files[0].bytes.clone()).unwrap();
        assert!(xml.contains("name=\"y1\"") && xml.contains("name=\"x1_estimate\""), "{xml}");
        // The total of the initial state under the initial input: h1 + 0.7 h2 + 0.05 k1 u1 =
        // 9.5 + 0.7 * 9.5 + 0.05 * 3.33 * 3.
        assert!(xml.contains("16.6495\""), "{xml}");
        let sources = Sources::new(&files.into_iter().map(flat).collect::<Vec<_>>());
        sources.assert_compiles();
    }
}
