//! The Jacobians of an FMU for model exchange, by its directional derivatives, beside the Jacobians
//! of its equation. The FMU is compiled here, by the C compiler of the machine.
#![cfg(target_os = "linux")]

use pinc_ad::Scalar;
use pinc_external::{Fmu, FmuKind, FmuPlant};
use pinc_ode::{Dims, Flow, LinearizationBuffer, Model, Plant, Rk4, Stages, Variable};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

const TWO: &str = r#"<fmiModelDescription fmiVersion="2.0" guid="g">
<ModelExchange modelIdentifier="osc" providesDirectionalDerivative="true"/>
<ModelVariables>
<ScalarVariable name="x1" valueReference="1" initial="exact"><Real start="0"/></ScalarVariable>
<ScalarVariable name="x2" valueReference="2" initial="exact"><Real start="0"/></ScalarVariable>
<ScalarVariable name="der(x1)" valueReference="3"><Real derivative="1"/></ScalarVariable>
<ScalarVariable name="der(x2)" valueReference="4"><Real derivative="2"/></ScalarVariable>
<ScalarVariable name="k" valueReference="5" causality="parameter"><Real start="1"/></ScalarVariable>
<ScalarVariable name="u" valueReference="6" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="y" valueReference="7" causality="output"><Real/></ScalarVariable>
</ModelVariables>
<ModelStructure><Derivatives><Unknown index="3"/><Unknown index="4"/></Derivatives></ModelStructure>
</fmiModelDescription>"#;

const THREE: &str = r#"<fmiModelDescription fmiVersion="3.0" instantiationToken="g">
<ModelExchange modelIdentifier="osc" providesDirectionalDerivatives="true"/>
<ModelVariables>
<Float64 name="x" valueReference="1" initial="exact" start="0 0"><Dimension start="2"/></Float64>
<Float64 name="der(x)" valueReference="3" derivative="1"><Dimension start="2"/></Float64>
<Float64 name="k" valueReference="5" causality="parameter" start="1"/>
<Float64 name="w" valueReference="6" causality="input" start="0 0"><Dimension start="2"/></Float64>
<Float64 name="y" valueReference="7" causality="output"/>
</ModelVariables>
<ModelStructure><ContinuousStateDerivative valueReference="3"/></ModelStructure>
</fmiModelDescription>"#;

const CALCULATED: &str = "\"x1\" valueReference=\"1\" initial=\"calculated\"";

/// The oscillator with both of its inputs.
#[derive(Clone, Debug)]
struct Oscillator;

impl Plant for Oscillator {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("x1", ""), Variable::new("x2", "")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 2] = [Variable::new("k", ""), Variable::new("u", "")];
        &INPUTS
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = x[1];
        dx[1] = u[0] * (-(x[0] * x[0]) + 1.0) * x[1] - x[0] + u[1];
    }
}

/// The oscillator as an FMU, in `dir`.
fn fmu(dir: &Path, version: u32, description: &str) -> PathBuf {
    compiled("oscillator.c", dir, version, description)
}

/// The oscillator as an FMU with one interface, from the description of one for model exchange.
fn fmu_of(kind: FmuKind, dir: &Path, version: u32, description: &str) -> PathBuf {
    match kind {
        FmuKind::ModelExchange => fmu(dir, version, description),
        FmuKind::CoSimulation => {
            fmu(dir, version, &description.replace("<ModelExchange", "<CoSimulation"))
        }
    }
}

/// The file `source` of the tests as an FMU, in `dir`.
fn compiled(source: &str, dir: &Path, version: u32, description: &str) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(source);
    let binary = dir.join("osc.so");
    let mut cc = Command::new("cc");
    cc.args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC"]);
    cc.arg(format!("-DFMI_VERSION={version}")).arg(source).arg("-o").arg(&binary);
    assert!(cc.status().unwrap().success(), "cc");
    let folder = match version {
        2 => "linux64".to_owned(),
        _ => format!("{}-linux", std::env::consts::ARCH),
    };
    let binary = std::fs::read(binary).unwrap();
    let name = format!("binaries/{folder}/osc.so");
    archived(dir, &[("modelDescription.xml", description.as_bytes()), (&name, &binary)])
}

/// An FMU of these files, in `dir`.
fn archived(dir: &Path, files: &[(&str, &[u8])]) -> PathBuf {
    let path = dir.join("osc.fmu");
    std::fs::write(&path, stored(files)).unwrap();
    path
}

/// A ZIP file with these entries as they are; its checksums are 0, which nothing here looks at.
fn stored(files: &[(&str, &[u8])]) -> Vec<u8> {
    let (mut all, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in files {
        let size = u32::try_from(content.len()).unwrap().to_le_bytes();
        let length = u16::try_from(name.len()).unwrap().to_le_bytes();
        // Version, flags, method, time, date, checksum; the sizes; the lengths of name and extra.
        let common = [&[0; 14][..], &size, &size, &length, &[0; 2]].concat();
        let offset = u32::try_from(all.len()).unwrap().to_le_bytes();
        directory.extend([b"PK\x01\x02\0\0", &common[..], &[0; 10], &offset].concat());
        directory.extend(name.as_bytes());
        all.extend([b"PK\x03\x04", &common[..], name.as_bytes(), content].concat());
    }
    let count = u16::try_from(files.len()).unwrap().to_le_bytes();
    let [size, offset] =
        [directory.len(), all.len()].map(|n| u32::try_from(n).unwrap().to_le_bytes());
    all.extend(directory);
    all.extend([b"PK\x05\x06", &[0; 4][..], &count, &count, &size, &offset, &[0; 2]].concat());
    all
}

fn plant(states: [&str; 2], input: &str) -> FmuPlant {
    let states = states.map(str::to_owned).to_vec();
    FmuPlant {
        kind: Some(FmuKind::ModelExchange),
        starts: states.clone(),
        states,
        inputs: vec![input.to_owned()],
        outputs: Vec::new(),
        parameters: Vec::new(),
        start_s: 0.0,
        directional_derivatives: true,
        time_limit: Duration::from_secs(60),
    }
}

/// Points of both states and the one input.
const X: [f64; 6] = [0.8, 0.0, -1.5, 2.0, 0.3, -0.7];
const U: [f64; 3] = [0.5, -1.0, 0.2];

/// Compares the FMU's steps and Jacobians with the equation's; `input` is the place of the plant's
/// input there, and `order` the order of its states.
fn compare(fmu: &Fmu, input: usize, order: [usize; 2]) {
    let dims = Dims::new(2, 1);
    let mut found = LinearizationBuffer::new(dims, 3);
    fmu.linearize(Stages { x: &X, u: &U, p: &[] }, 0.45, found.as_mut()).unwrap().unwrap();
    let mut ends = X;
    fmu.advance(&mut ends, &U, 0.45).unwrap();
    let mut truth = Rk4::new(Oscillator, 0.45, 400);
    let near = |a: f64, b: f64| assert!((a - b).abs() < 2e-9, "{a} {b}");
    for k in 0..3 {
        let mut u = [1.0, 0.0];
        u[input] = U[k];
        let x = order.map(|i| X[2 * k + i]);
        let mut expected = LinearizationBuffer::new(Dims::new(2, 2), 1);
        truth.linearize(Stages { x: &x, u: &u, p: &[] }, expected.as_mut());
        for i in 0..2 {
            let row = order[i];
            near(found.next[2 * k + i], expected.next[row]);
            // The Jacobian belongs to the step that is taken.
            assert_eq!(ends[2 * k + i].to_bits(), found.next[2 * k + i].to_bits());
            near(found.b[2 * k + i], expected.b[2 * row + input]);
            for (j, column) in order.iter().enumerate() {
                near(found.a[4 * k + 2 * i + j], expected.a[2 * row + column]);
            }
        }
    }
}

#[test]
fn jacobians_by_directional_derivatives_match_the_equation() {
    for (version, description, [first, second], force) in
        [(2, TWO, ["x1", "x2"], "u"), (3, THREE, ["x[1]", "x[2]"], "w[2]")]
    {
        let dir = tempfile::tempdir().unwrap();
        let path = fmu(dir.path(), version, description);
        for (states, order) in [([first, second], [0, 1]), ([second, first], [1, 0])] {
            // A parameter, whose derivatives come from the initialization, and an input.
            for (name, input) in [("k", 0), (force, 1)] {
                compare(&Fmu::open(&path, &plant(states, name)).unwrap(), input, order);
            }
        }
    }
}

/// A parameter and an input, in either order.
#[test]
fn each_input_has_a_column_of_its_own_in_the_jacobian() {
    for (version, description, states, force) in
        [(2, TWO, ["x1", "x2"], "u"), (3, THREE, ["x[1]", "x[2]"], "w[2]")]
    {
        let dir = tempfile::tempdir().unwrap();
        let path = fmu(dir.path(), version, description);
        let (x, [k, u]) = (&X[..2], [1.5, 0.2]);
        let mut expected = LinearizationBuffer::new(Dims::new(2, 2), 1);
        let at = Stages { x, u: &[k, u], p: &[] };
        Rk4::new(Oscillator, 0.45, 400).linearize(at, expected.as_mut());
        for (names, values, columns) in
            [(["k", force], [k, u], [0, 1]), ([force, "k"], [u, k], [1, 0])]
        {
            let inputs = names.map(str::to_owned).to_vec();
            let fmu = Fmu::open(&path, &FmuPlant { inputs, ..plant(states, force) }).unwrap();
            let mut found = LinearizationBuffer::new(Dims::new(2, 2), 1);
            let at = Stages { x, u: &values, p: &[] };
            fmu.linearize(at, 0.45, found.as_mut()).unwrap().unwrap();
            for i in 0..2 {
                for (j, column) in columns.iter().enumerate() {
                    let (found, expected) = (found.b[2 * i + j], expected.b[2 * i + column]);
                    assert!(
                        (found - expected).abs() < 2e-9,
                        "{version} {names:?}: {found} {expected}"
                    );
                }
            }
        }
    }
}

/// By both interfaces: what depends on time does so from the start time, and a parameter is not what
/// the FMU has by itself.
#[test]
fn a_step_begins_at_its_start_time_with_the_parameters_given() {
    for (version, description, states, force) in
        [(2, TWO, ["x1", "x2"], "u"), (3, THREE, ["x[1]", "x[2]"], "w[2]")]
    {
        for kind in [FmuKind::ModelExchange, FmuKind::CoSimulation] {
            let dir = tempfile::tempdir().unwrap();
            let path = fmu_of(kind, dir.path(), version, description);
            let parameters = vec![("k".to_owned(), 2.5)];
            for start_s in [0.0, 0.375] {
                let (kind, parameters) = (Some(kind), parameters.clone());
                let given = FmuPlant { kind, parameters, start_s, ..plant(states, force) };
                let fmu = Fmu::open(&path, &given).unwrap();
                let (mut found, mut truth) = (X, Rk4::new(Oscillator, 0.45, 400));
                fmu.advance(&mut found, &U, 0.45).unwrap();
                for (k, found) in found.chunks(2).enumerate() {
                    let mut expected = [0.0; 2];
                    // The FMU adds the time at which it begins to its force.
                    let u = [2.5, U[k] + start_s];
                    truth.step(&X[2 * k..2 * k + 2], &u, &[], &mut expected);
                    for (a, b) in found.iter().zip(expected) {
                        assert!((a - b).abs() < 2e-9, "{version} {kind:?} {k}: {a} {b}");
                    }
                }
            }
        }
    }
}

/// By both interfaces: an output that depends on the state and the input, and a state.
#[test]
fn outputs_are_read_in_a_state_under_an_input() {
    for (version, description, states, force) in
        [(2, TWO, ["x1", "x2"], "u"), (3, THREE, ["x[1]", "x[2]"], "w[2]")]
    {
        for kind in [FmuKind::ModelExchange, FmuKind::CoSimulation] {
            let dir = tempfile::tempdir().unwrap();
            let path = fmu_of(kind, dir.path(), version, description);
            let outputs = ["y", states[1]].map(str::to_owned).to_vec();
            let given = FmuPlant { kind: Some(kind), outputs, ..plant(states, force) };
            let fmu = Fmu::open(&path, &given).unwrap();
            let mut y = [0.0; 6];
            // A step between does not matter.
            fmu.outputs(&X, &U, &mut y).unwrap();
            fmu.advance(&mut X.clone(), &U, 0.45).unwrap();
            fmu.outputs(&X, &U, &mut y).unwrap();
            for (k, y) in y.chunks(2).enumerate() {
                let exact = [X[2 * k] * X[2 * k + 1] + 2.0 * U[k], X[2 * k + 1]];
                for (found, exact) in y.iter().zip(exact) {
                    assert!((found - exact).abs() < 1e-14, "{version} {kind:?}: {found} {exact}");
                }
            }
        }
    }
}

#[test]
fn missing_or_unwanted_derivatives_are_not_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let path = fmu(dir.path(), 2, TWO);
    let at = Stages { x: &X[..2], u: &U[..1], p: &[] };
    let mut out = LinearizationBuffer::new(Dims::new(2, 1), 1);
    let unwanted = FmuPlant { directional_derivatives: false, ..plant(["x1", "x2"], "u") };
    let unwanted = Fmu::open(&path, &unwanted).unwrap();
    assert!(unwanted.linearize(at, 0.1, out.as_mut()).is_none());
    let silent = TWO.replace(" providesDirectionalDerivative=\"true\"", "");
    let path = fmu(dir.path(), 2, &silent);
    let silent = Fmu::open(&path, &plant(["x1", "x2"], "u")).unwrap();
    assert!(silent.linearize(at, 0.1, out.as_mut()).is_none());
}

#[test]
fn derivatives_that_fail_are_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = fmu(dir.path(), 2, TWO);
    let fmu = Fmu::open(&path, &plant(["x1", "x2"], "u")).unwrap();
    let mut out = LinearizationBuffer::new(Dims::new(2, 1), 1);
    let at = Stages { x: &[9.5, 0.0], u: &[0.0], p: &[] };
    let error = fmu.linearize(at, 0.01, out.as_mut()).unwrap().unwrap_err().to_string();
    assert!(error.contains("directional derivative failed"), "{error}");
    assert!(fmu.advance(&mut [9.5, 0.0], &[0.0], 0.01).is_ok());
}

const LAG: &str = r#"<fmiModelDescription fmiVersion="2.0" guid="g">
<CoSimulation modelIdentifier="osc"/>
<ModelVariables>
<ScalarVariable name="x" valueReference="1"><Real start="0"/></ScalarVariable>
<ScalarVariable name="u" valueReference="2" causality="input"><Real start="0"/></ScalarVariable>
</ModelVariables>
</fmiModelDescription>"#;

fn lag(time_limit: Duration) -> FmuPlant {
    let (states, inputs) = (vec!["x".to_owned()], vec!["u".to_owned()]);
    let kind = Some(FmuKind::CoSimulation);
    FmuPlant { kind, starts: states.clone(), states, inputs, time_limit, ..plant(["", ""], "") }
}

#[test]
fn an_interface_that_there_is_not_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = archived(dir.path(), &[("modelDescription.xml", LAG.as_bytes())]);
    let asked = FmuPlant { kind: Some(FmuKind::ModelExchange), ..lag(Duration::from_secs(1)) };
    let error = Fmu::open(&path, &asked).unwrap_err();
    assert!(error.problem.contains("it has not the interface"), "{error}");
}

/// One variable cannot be two quantities, nor be set twice, nor at all where the FMU calculates it; the
/// error names the part of the plant.
#[test]
fn variables_that_are_named_for_the_wrong_part_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = archived(dir.path(), &[("modelDescription.xml", TWO.as_bytes())]);
    let calculated = TWO.replace("\"x1\" valueReference=\"1\" initial=\"exact\"", CALCULATED);
    let other = tempfile::tempdir().unwrap();
    let calculated = archived(other.path(), &[("modelDescription.xml", calculated.as_bytes())]);
    let osc = || plant(["x1", "x2"], "u");
    let with = |name: &str| FmuPlant { parameters: vec![(name.to_owned(), 1.0)], ..osc() };
    let starts = vec!["x2".to_owned(); 2];
    for (path, plant, key, problem) in [
        (&path, plant(["x1", "x1"], "u"), "variables", "`x1` is two"),
        (&path, plant(["x1", "x2"], "x2"), "variables", "`x2` is two"),
        (&path, plant(["x1", "x3"], "u"), "variables", "named `x3`"),
        (&path, FmuPlant { starts, ..osc() }, "start_variables", "`x2` is set already"),
        (&path, with("u"), "parameters.u", "`u` is set already"),
        (&path, with("x1"), "parameters.x1", "`x1` is set already"),
        (&path, with("mu"), "parameters.mu", "named `mu`"),
        (&calculated, osc(), "start_variables", "`x1` is calculated"),
    ] {
        let error = Fmu::open(path, &plant).unwrap_err();
        assert!(error.key == key && error.problem.contains(problem), "{key}: {error:?}");
    }
    assert!(Fmu::open(&path, &with("k")).is_ok());
}

#[test]
fn a_step_that_does_not_end_is_an_error_and_so_are_those_after_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = compiled("lag.c", dir.path(), 2, LAG);
    let fmu = Fmu::open(&path, &lag(Duration::from_millis(300))).unwrap();
    let mut x = [1.0, 0.5];
    fmu.advance(&mut x, &[0.0, 1.0], 0.2).unwrap();
    let decay = (-0.2_f64).exp();
    assert!((x[0] - decay).abs() < 1e-15 && (x[1] - (1.0 - 0.5 * decay)).abs() < 1e-15, "{x:?}");
    for hangs in [5.5, 1.0] {
        let error = fmu.advance(&mut [1.0, hangs], &[0.0; 2], 0.2).unwrap_err().to_string();
        assert!(error.contains("did not end a step within 0.3 s (time_limit_s)"), "{error}");
    }
}

#[test]
fn an_fmu_that_names_files_elsewhere_or_unpacks_to_too_much_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |files: &[(&str, &[u8])]| {
        Fmu::open(&archived(dir.path(), files), &lag(Duration::from_secs(60))).unwrap_err()
    };
    for name in ["../osc", "", "a/b", "..", ".osc", "a\\b"] {
        let description = LAG.replace("\"osc\"", &format!("\"{name}\""));
        let error = refused(&[("modelDescription.xml", description.as_bytes())]);
        let expected = format!("modelIdentifier {name:?} given, expected a C identifier");
        assert!(error.problem.contains(&expected), "{error}");
    }
    // Entries that say to be of 1.1 GiB each.
    let claimed = |count: usize| {
        let names = ["modelDescription.xml", "resources/a"];
        let mut bytes = stored(&names.map(|name| (name, LAG.as_bytes()))[..count]);
        let entries: Vec<usize> =
            (0..bytes.len() - 4).filter(|&at| bytes[at..].starts_with(b"PK\x01\x02")).collect();
        assert_eq!(entries.len(), count);
        for at in entries {
            bytes[at + 24..at + 28].copy_from_slice(&1_181_116_006_u32.to_le_bytes());
        }
        let path = dir.path().join("claims.fmu");
        std::fs::write(&path, bytes).unwrap();
        Fmu::open(&path, &lag(Duration::from_secs(60)))
    };
    assert!(claimed(1).is_ok());
    let error = claimed(2).unwrap_err();
    assert!(error.problem.contains("it unpacks to more than 2048 MiB"), "{error}");
}

#[test]
fn the_loaders_own_words_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let files: [(&str, &[u8]); 2] =
        [("modelDescription.xml", LAG.as_bytes()), ("binaries/linux64/osc.so", &[7; 4096])];
    let path = archived(dir.path(), &files);
    let fmu = Fmu::open(&path, &lag(Duration::from_secs(60))).unwrap();
    let error = fmu.advance(&mut [1.0], &[0.0], 0.2).unwrap_err().to_string();
    assert!(error.contains("osc.so: invalid ELF header"), "{error}");
}
