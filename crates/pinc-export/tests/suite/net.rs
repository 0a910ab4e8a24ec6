//! A net in C against the library.

use super::compile::Sources;
use pinc_export::{
    ExportError, FmiVersion, GeneratedFile, Name, Origin, Precision, net_to_c, net_to_casadi,
    net_to_fmu, net_to_onnx,
};
use pinc_expr::PlantEquations;
use pinc_net::{Ansatz, Domain, NetConfig, NetError, PincModel, PincNet, Scenario};
use pinc_ode::{DynPlant, Linearization, Model, Stages};
use pinc_plants::{FourTanks, VanDerPol};
use pinc_verify::ErrorEstimate;
use serde_json::Value;

/// Reads states and inputs until the end, and writes step, linearization and inner state.
const DRIVER: &str = r#"
#include "net_net.h"
#include <stdio.h>
static int read(NET_REAL *to, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        double v;
        if (scanf("%lf", &v) != 1) {
            return 0;
        }
        to[i] = (NET_REAL)v;
    }
    return 1;
}
static void show(const NET_REAL *from, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        printf("%.17g\n", (double)from[i]);
    }
}
int main(void)
{
    NET_REAL x[NET_NX], u[NET_NU], y[NET_NX], a[NET_NX * NET_NX], b[NET_NX * NET_NU];
    while (read(x, NET_NX) && read(u, NET_NU)) {
        net_net_step(x, u, y);
        show(y, NET_NX);
        net_net_linearize(x, u, y, a, b);
        show(y, NET_NX);
        show(a, NET_NX * NET_NX);
        show(b, NET_NX * NET_NU);
        net_net_at((NET_REAL)0.3, x, u, y);
        show(y, NET_NX);
    }
    return 0;
}
"#;

/// Writes the largest relative error of tanh, its values at infinities and whether NaN gives NaN;
/// and by what points linearized together differ from single ones.
const INSIDE: &str = r#"
#include "net_net.c"
#include <math.h>
#include <stdio.h>
static NET_REAL tanh_of(NET_REAL v)
{
    NET_REAL z[NET_LANES] = {0};
    net_vector out;
    z[NET_LANES - 1] = v;
    out = net_tanh(*(const net_loose *)z);
    return ((const NET_REAL *)&out)[NET_LANES - 1];
}
static double apart(const NET_REAL *a, const NET_REAL *b, int count)
{
    double worst = 0.0;
    int i;
    for (i = 0; i < count; i++) {
        worst = fmax(worst, fabs((double)a[i] - (double)b[i]) / (1.0 + fabs((double)b[i])));
    }
    return worst;
}
int main(void)
{
    static NET_REAL x[NET_BATCH * NET_NX], u[NET_BATCH * NET_NU], y[NET_BATCH * NET_NX];
    static NET_REAL a[NET_BATCH * NET_NX * NET_NX], b[NET_BATCH * NET_NX * NET_NU];
    NET_REAL next[NET_NX], by_x[NET_NX * NET_NX], by_u[NET_NX * NET_NU];
    double worst = 0.0;
    int points;
    int i;
    for (i = 1; i < 60000; i++) {
        const NET_REAL v = (NET_REAL)((i % 2 == 0) ? (i * 4e-4) : -pow(0.999, i));
        worst = fmax(worst, fabs((double)tanh_of(v) / tanh((double)v) - 1.0));
    }
    printf("%.17g %.17g %.17g %d\n", worst, (double)tanh_of((NET_REAL)INFINITY),
           (double)tanh_of((NET_REAL)-INFINITY), isnan(tanh_of((NET_REAL)NAN)) ? 1 : 0);
    for (i = 0; i < NET_BATCH * NET_NX; i++) {
        x[i] = (NET_REAL)(0.3 * (i % 7) - 0.8);
    }
    for (i = 0; i < NET_BATCH * NET_NU; i++) {
        u[i] = (NET_REAL)(0.4 * (i % 5) - 0.7);
    }
    worst = 0.0;
    for (points = 1; points <= NET_BATCH; points++) {
        net_net_linearize_all(points, x, u, y, a, b);
        for (i = 0; i < points; i++) {
            net_net_linearize(x + i * NET_NX, u + i * NET_NU, next, by_x, by_u);
            worst = fmax(worst, apart(y + i * NET_NX, next, NET_NX));
            worst = fmax(worst, apart(a + i * NET_NX * NET_NX, by_x, NET_NX * NET_NX));
            worst = fmax(worst, apart(b + i * NET_NX * NET_NU, by_u, NET_NX * NET_NU));
        }
    }
    printf("%.17g\n", worst);
    return 0;
}
"#;

/// Without vectors, and with the longest that the machine has.
const VECTORS: [&str; 2] = ["-DNET_VECTOR_BYTES=0", "-march=native"];

fn net(plant: Box<dyn DynPlant>, domain: &Domain, layers: usize, ansatz: Ansatz) -> PincNet {
    let config = NetConfig { ansatz, ..NetConfig::new(0.5, layers, 13) };
    PincNet::new(&*plant, &config, domain, 3).unwrap()
}

fn oscillator() -> Domain {
    Domain::new([-3.0..=3.0, -4.35..=4.35], [-1.0..=1.0])
}

fn tanks() -> Domain {
    let level = || 1.0..=20.0;
    Domain::new([level(), level(), 0.5..=8.0, 0.5..=8.0], [0.0..=5.0, 0.0..=5.0])
}

pub(crate) fn nets() -> [PincNet; 3] {
    [
        net(VanDerPol::default().into_dyn(), &oscillator(), 4, Ansatz::HardLinear),
        net(VanDerPol::default().into_dyn(), &oscillator(), 1, Ansatz::Direct),
        net(FourTanks::antonelo().into_dyn(), &tanks(), 3, Ansatz::HardLinear),
    ]
}

fn sources(net: &PincNet) -> Sources {
    let name = Name::new("net").unwrap();
    Sources::new(&net_to_c(net, None, &name, &Origin::of_net(net, "0", "00")).unwrap())
}

/// Points in the domain, flat, and what the library makes of them.
fn expected(net: &PincNet) -> (Vec<f64>, Vec<f64>) {
    let mut model = PincModel::new(net).unwrap();
    let (nx, nu) = (model.dims().nx, model.dims().nu);
    let (mut given, mut all) = (Vec::new(), Vec::new());
    for i in 0..200 {
        let part = |v: usize| (f64::from(i) * (0.37 + 0.11 * [1.0, 2.1, 3.3, 4.7][v % 4])).fract();
        let ends = net.domain().ends().enumerate();
        let point: Vec<f64> = ends.map(|(v, (low, high))| low + part(v) * (high - low)).collect();
        let (x, u) = point.split_at(nx);
        let (mut next, mut a, mut b) = (vec![0.0; nx], vec![0.0; nx * nx], vec![0.0; nx * nu]);
        model.step(x, u, &[], &mut next);
        all.extend_from_slice(&next);
        let out = Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] };
        model.linearize(Stages { x, u, p: &[] }, out);
        for part in [&next, &a, &b] {
            all.extend_from_slice(part);
        }
        all.extend(net.evaluate(0.3, x, u, &[]));
        given.extend(point);
    }
    (given, all)
}

fn largest_difference(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let pairs = found.iter().zip(expected);
    pairs.map(|(f, e)| (f - e).abs() / (1.0 + e.abs())).fold(0.0, f64::max)
}

/// Weights that are finite by themselves but not with the normalization in them; a value that is too
/// large for 32 bits only; and outputs that overflow.
#[test]
fn a_net_that_overflows_is_refused() {
    let [net, ..] = nets();
    let name = Name::new("net").unwrap();
    let origin = Origin::of_net(&net, "0", "00");
    let scaled = |first: f64, last: f64| {
        let mut weights = net.mlp().parameters().to_vec();
        let count = weights.len();
        // The first weight of all is multiplied by what normalizes an input.
        weights[0] = first;
        weights[count - 1] = last;
        net.with_parameters(&weights)
    };
    let refused = |result: Result<Vec<GeneratedFile>, ExportError>, part: &str| match result {
        Err(ExportError::NotFinite { what }) => assert!(what.contains(part), "{what}"),
        other => panic!("{part}: {:?}", other.map(|files| files.len())),
    };
    let single = |net: &PincNet| net_to_onnx(net, &name, &origin, Precision::Single);
    let double = |net: &PincNet| net_to_onnx(net, &name, &origin, Precision::Double);
    for (first, last, part) in [(1.7e308, 0.0, "layer 1"), (0.1, 1.7e308, "layer 5")] {
        let large = scaled(first, last);
        refused(net_to_c(&large, None, &name, &origin), part);
        refused(net_to_fmu(&large, &name, &origin, FmiVersion::Three), part);
        refused(net_to_casadi(&large, &name, &origin), part);
        refused(double(&large).map(|file| vec![file]), part);
    }
    let large = scaled(0.1, 1e39);
    refused(single(&large).map(|file| vec![file]), "32 bits");
    assert!(double(&large).is_ok() && net_to_c(&large, None, &name, &origin).is_ok());
}

#[test]
fn c_computes_what_the_library_does() {
    for net in nets() {
        let sources = sources(&net);
        let (given, expected) = expected(&net);
        let found = sources.drive(DRIVER, &[], &given);
        let off = largest_difference(&found, &expected);
        assert!(off < 1e-12, "{off}");
        // Digits of a float, times some for the sums and layers.
        let found = sources.drive(DRIVER, &["-DNET_REAL=float"], &given);
        let off = largest_difference(&found, &expected);
        assert!(off < 2e-5 && off > 1e-9, "{off}");
    }
}

#[test]
fn vectors_of_any_length_compute_the_same() {
    let [net, ..] = nets();
    let name = Name::new("net").unwrap();
    let files = net_to_c(&net, None, &name, &Origin::of_net(&net, "0", "00")).unwrap();
    let inside = Sources::with_included(&files, "net_net.c");
    let whole = Sources::new(&files);
    let (given, expected) = expected(&net);
    for vectors in VECTORS {
        let found = whole.drive(DRIVER, &[vectors], &given);
        let off = largest_difference(&found, &expected);
        assert!(off < 1e-12, "{vectors}: {off}");
        for (real, epsilon) in [("double", f64::EPSILON), ("float", f64::from(f32::EPSILON))] {
            let real = format!("-DNET_REAL={real}");
            let [error, high, low, nan, apart] =
                inside.drive(INSIDE, &[vectors, &real], &[])[..].try_into().unwrap();
            assert!(error < 4.0 * epsilon, "{vectors} {real}: {error}");
            let ends = (high - 1.0).abs() + (low + 1.0).abs();
            assert!(ends < epsilon && nan > 0.5, "{vectors} {real}: {high} {low} {nan}");
            assert!(apart < 50.0 * epsilon, "{vectors} {real}: {apart}");
        }
    }
}

#[test]
fn the_self_test_passes_and_the_code_is_portable() {
    let [portable, others @ ..] = nets();
    let portable = sources(&portable);
    assert!(portable.assert_portable("net").contains("12 cases"));
    portable.selftest_in_float();
    for net in others {
        let sources = sources(&net);
        assert!(sources.selftest("net", &[]).contains("12 cases"));
        sources.selftest("net", &["-DNET_REAL=float"]);
    }
}

/// The self-test of another net fails.
#[test]
fn the_self_test_can_fail() {
    let [net, ..] = nets();
    let name = Name::new("net").unwrap();
    let origin = Origin::of_net(&net, "0", "00");
    let mut files = net_to_c(&net, None, &name, &origin).unwrap();
    let mut weights = net.mlp().parameters().to_vec();
    weights[20] += 1e-9;
    let other = net_to_c(&net.with_parameters(&weights), None, &name, &origin).unwrap();
    files[1] = other[1].clone();
    let failed = std::panic::catch_unwind(|| Sources::new(&files).selftest("net", &[]));
    assert!(failed.is_err());
}

/// Numbers are judged by the widths of their domains: right ones of mixed units pass in double, and wrong ones of
/// a small unit fail in single precision.
#[test]
fn the_self_test_counts_in_widths_of_the_domain() {
    let wide = Domain::new([0.0..=1e5, 0.0..=1e-9], [-1.0..=1.0]);
    let mixed = net(VanDerPol::default().into_dyn(), &wide, 2, Ansatz::Direct);
    assert!(sources(&mixed).selftest("net", &[]).contains("allowed 1.00e-12"));
    let small = Domain::new([0.0..=5e-6, 0.0..=5e-6], [-1.0..=1.0]);
    let net = net(VanDerPol::default().into_dyn(), &small, 2, Ansatz::Direct);
    let name = Name::new("net").unwrap();
    let origin = Origin::of_net(&net, "0", "00");
    let mut files = net_to_c(&net, None, &name, &origin).unwrap();
    let mut weights = net.mlp().parameters().to_vec();
    *weights.last_mut().unwrap() += 1.0;
    files[1] = net_to_c(&net.with_parameters(&weights), None, &name, &origin).unwrap()[1].clone();
    let single = ["-DNET_REAL=float"];
    let failed = std::panic::catch_unwind(|| Sources::new(&files).selftest("net", &single));
    assert!(failed.is_err());
}

const ERROR_DRIVER: &str = r#"
#include "net_error.h"
#include <stdio.h>
int main(void)
{
    NET_REAL x[NET_NX], u[NET_NU], error[NET_NX];
    for (;;) {
        int i;
        for (i = 0; i < NET_NX + NET_NU; i++) {
            double v;
            if (scanf("%lf", &v) != 1) {
                return 0;
            }
            (i < NET_NX ? x : u)[i < NET_NX ? i : i - NET_NX] = (NET_REAL)v;
        }
        net_error(x, u, error);
        for (i = 0; i < NET_NX; i++) {
            printf("%.17g\n", (double)error[i]);
        }
    }
}
"#;

/// The net as one that was trained on an integrator's steps.
pub(crate) fn distilled(net: &PincNet) -> PincNet {
    let bytes = net.to_bytes();
    let length = usize::try_from(u64::from_le_bytes(bytes[..8].try_into().unwrap())).unwrap();
    let mut header: Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
    let mut model: Value =
        serde_json::from_str(header["__metadata__"]["model"].as_str().unwrap()).unwrap();
    model["source"] = "integrator".into();
    header["__metadata__"]["model"] = model.to_string().into();
    let text = header.to_string();
    let mut all = (text.len() as u64).to_le_bytes().to_vec();
    all.extend(text.bytes().chain(bytes[8 + length..].iter().copied()));
    PincNet::from_bytes(&all).unwrap()
}

#[test]
fn c_estimates_errors_as_the_library_does() {
    let oscillator = |mu: f64| PlantEquations::traced(VanDerPol { mu });
    let [hard, direct, tanks] = nets();
    let of_tanks = PlantEquations::traced(FourTanks::antonelo());
    let cases = [
        (distilled(&hard), oscillator(1.0)),
        (hard, oscillator(1.0)),
        (direct, oscillator(1.0)),
        (tanks, of_tanks),
    ];
    for (net, equations) in &cases {
        let origin = Origin::of_net(net, "0", "00");
        let name = Name::new("net").unwrap();
        let files = net_to_c(net, Some(equations), &name, &origin).unwrap();
        let sources = Sources::new(&files);
        assert!(sources.assert_portable("net").contains("12 cases"));
        sources.selftest_in_float();
        let plant = equations.to_dyn().unwrap();
        let mut estimate = ErrorEstimate::new(net, &*plant).unwrap();
        let (given, _) = expected(net);
        let dims = net.dims();
        let found = sources.drive(ERROR_DRIVER, &[], &given);
        let points = given.chunks_exact(dims.nx + dims.nu);
        for (point, found) in points.zip(found.chunks_exact(dims.nx)) {
            let mut expected = vec![0.0; dims.nx];
            estimate.write(&point[..dims.nx], &point[dims.nx..], &[], &mut expected);
            let size = expected.iter().fold(0.0, |size: f64, e| size.max(e.abs()));
            for (found, expected) in found.iter().zip(&expected) {
                assert!((found - expected).abs() < 1e-9 * size, "{found} {expected} {size}");
            }
        }
        if dims.nx > 2 {
            continue;
        }
        // The estimate against another equation is another, which the self-test says.
        let other = net_to_c(net, Some(&oscillator(1.001)), &name, &origin).unwrap();
        let changed: Vec<GeneratedFile> = files
            .iter()
            .map(|file| {
                let is_estimate = ["_error.c", "_exact.c"].iter().any(|of| file.path.ends_with(of));
                let same = other.iter().find(|other| is_estimate && other.path == file.path);
                same.unwrap_or(file).clone()
            })
            .collect();
        let failed = std::panic::catch_unwind(|| Sources::new(&changed).selftest("net", &[]));
        assert!(failed.is_err());
    }
}

#[test]
fn a_net_of_one_scenario_is_refused() {
    let scenario = Scenario { initial_state: vec![1.0, 0.0], input: vec![0.0] };
    let config = NetConfig { time_only: Some(scenario), ..NetConfig::new(0.5, 1, 4) };
    let plant = VanDerPol::default().into_dyn();
    let net = PincNet::new(&*plant, &config, &oscillator(), 3).unwrap();
    let refused =
        net_to_c(&net, None, &Name::new("net").unwrap(), &Origin::of_net(&net, "0", "00"));
    assert!(matches!(refused, Err(ExportError::Net(NetError::OneScenario))));
}

/// The header says what an engineer needs to know, and no name ends a comment.
#[test]
fn the_header_states_names_domain_and_hash() {
    let [net, ..] = nets();
    let mut origin = Origin::of_net(&net, "1.2.3", "c0ffee");
    origin.states[0].unit = "m */".into();
    origin.proven = Some("proven: x1 1e-3 */".to_owned());
    let files = net_to_c(&net, None, &Name::new("osc").unwrap(), &origin).unwrap();
    let header = String::from_utf8(files[0].bytes.clone()).unwrap();
    assert_eq!(files[0].path, "osc_net.h");
    for part in [
        "pinc 1.2.3",
        "c0ffee",
        "x1 (m * /)",
        "x2 from -4.35 to 4.35",
        "OSC_NX 2",
        "proven: x1 1e-3 * /",
    ] {
        assert!(header.contains(part), "{part} in {header}");
    }
    let paths: Vec<_> = files.iter().map(|file| &*file.path).collect();
    let expected =
        ["osc_net.h", "osc_net.c", "osc_selftest.c", "CMakeLists.txt", "Makefile", "README.md"];
    assert_eq!(paths, expected);
    Sources::new(&files).make_test();
}
