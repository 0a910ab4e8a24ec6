//! CasADi, ONNX and FMI forms of a net, against the library.

use super::compile::Sources;
use super::net::nets;
use pinc_export::{
    FmiVersion, GeneratedFile, Name, Origin, Precision, net_to_casadi, net_to_fmu, net_to_onnx,
};
use pinc_net::{FoldedNet, PincModel, PincNet};
use pinc_ode::{Linearization, Model, Stages};

fn name() -> Name {
    Name::new("net").unwrap()
}

fn origin(net: &PincNet) -> Origin {
    Origin::of_net(net, "0", "00ff")
}

/// Calls the functions as CasADi does, with null pointers for what is not asked.
const CASADI_DRIVER: &str = r#"
#include "net_casadi.c"
#include <stdio.h>
static void show(const double *from, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        printf("%.17g\n", from[i]);
    }
}
int main(void)
{
    double x[NET_NX], u[NET_NU], y[NET_NX], a[NET_NX * NET_NX], b[NET_NX * NET_NU];
    double xx[NET_NX * NET_NX * NET_NX], xu[NET_NX * NET_NX * NET_NU];
    double ux[NET_NX * NET_NU * NET_NX], uu[NET_NX * NET_NU * NET_NU];
    const double *arg[5];
    double *res[6] = {0, 0, 0, 0, 0, 0};
    int i;
    for (;;) {
        for (i = 0; i < NET_NX + NET_NU; i++) {
            if (scanf("%lf", (i < NET_NX) ? &x[i] : &u[i - NET_NX]) != 1) {
                return 0;
            }
        }
        arg[0] = x;
        arg[1] = u;
        arg[2] = arg[3] = arg[4] = 0;
        res[0] = y;
        net(arg, res, 0, 0, 0);
        show(y, NET_NX);
        res[0] = a;
        res[1] = b;
        jac_net(arg, res, 0, 0, 0);
        show(a, NET_NX * NET_NX);
        show(b, NET_NX * NET_NU);
        res[0] = xx;
        res[1] = xu;
        res[3] = ux;
        res[4] = uu;
        jac_jac_net(arg, res, 0, 0, 0);
        show(xx, NET_NX * NET_NX * NET_NX);
        show(xu, NET_NX * NET_NX * NET_NU);
        show(ux, NET_NX * NET_NU * NET_NX);
        show(uu, NET_NX * NET_NU * NET_NU);
        res[3] = res[4] = 0;
        jac_jac_net(arg, res, 0, 0, 0);
    }
}
"#;

/// next, and the columns of the Jacobians by x and u, one after the other.
fn linearized(model: &mut PincModel, point: &[f64]) -> [Vec<f64>; 2] {
    let dims = model.dims();
    let (x, u) = point.split_at(dims.nx);
    let (mut next, mut a, mut b) =
        (vec![0.0; dims.nx], vec![0.0; dims.nx * dims.nx], vec![0.0; dims.nx * dims.nu]);
    let out = Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] };
    model.linearize(Stages { x, u, p: &[] }, out);
    let columns = |matrix: &[f64], width: usize| -> Vec<f64> {
        (0..width).flat_map(|k| matrix.iter().skip(k).step_by(width).copied()).collect()
    };
    [next, [columns(&a, dims.nx), columns(&b, dims.nu)].concat()]
}

#[test]
fn casadis_functions_have_exact_first_and_second_derivatives() {
    for net in nets() {
        let files = net_to_casadi(&net, &name(), &origin(&net)).unwrap();
        let sources = Sources::included(&files);
        let mut model = PincModel::new(&net).unwrap();
        let dims = model.dims();
        let width = dims.nx + dims.nu;
        let mut input = Vec::new();
        for i in 0..10 {
            for (v, (low, high)) in net.domain().ends().enumerate() {
                let part = (f64::from(i) * [0.31, 0.47, 0.73, 0.11, 0.57, 0.83][v]).fract();
                input.push(low + part * (high - low));
            }
        }
        let found = sources.drive(CASADI_DRIVER, &[], &input);
        let length = dims.nx * (1 + width + width * width);
        assert_eq!(found.len(), 10 * length);
        for (point, found) in input.chunks(width).zip(found.chunks(length)) {
            let [next, jacobian] = linearized(&mut model, point);
            let (values, second) = found.split_at(dims.nx * (1 + width));
            for (found, expected) in values.iter().zip(next.iter().chain(&jacobian)) {
                assert!((found - expected).abs() <= 1e-12 * (1.0 + expected.abs()));
            }
            // Differences of the library's Jacobian: blocks xx, xu, ux, uu.
            let block = dims.nx * dims.nx;
            let starts =
                [0, block * dims.nx, block * width, block * width + dims.nx * dims.nu * dims.nx];
            for q in 0..width {
                let mut shifted = |h: f64| {
                    let mut point = point.to_vec();
                    point[q] += h;
                    let [_, jacobian] = linearized(&mut model, &point);
                    jacobian
                };
                let h = 1e-5;
                let (up, down) = (shifted(h), shifted(-h));
                for (at, (up, down)) in up.iter().zip(&down).enumerate() {
                    let expected = (up - down) / (2.0 * h);
                    let (of_u, by_u) = (usize::from(at >= block), usize::from(q >= dims.nx));
                    let rows = [block, dims.nx * dims.nu][of_u];
                    let place = starts[2 * of_u + by_u]
                        + [q, q.wrapping_sub(dims.nx)][by_u] * rows
                        + [at, at.wrapping_sub(block)][of_u];
                    let off = (second[place] - expected).abs();
                    assert!(off < 1e-6 * (1.0 + expected.abs()), "{} {expected}", second[place]);
                }
            }
        }
    }
}

/// The numbers are the net's, in both precisions; the names are the names of states and inputs.
#[test]
fn an_onnx_file_has_the_folded_weights() {
    let [net, ..] = nets();
    let folded = FoldedNet::new(&net).unwrap();
    let contains = |bytes: &[u8], part: &[u8]| bytes.windows(part.len()).any(|w| w == part);
    let file = |precision| net_to_onnx(&net, &name(), &origin(&net), precision).unwrap();
    let (single, double) = (file(Precision::Single), file(Precision::Double));
    assert_eq!(single.path, "net.onnx");
    for layer in &folded.layers {
        let bytes: Vec<u8> = layer.bias.iter().flat_map(|b| b.to_le_bytes()).collect();
        assert!(contains(&double.bytes, &bytes) && !contains(&single.bytes, &bytes));
        #[expect(clippy::cast_possible_truncation, reason = "single precision")]
        let bytes: Vec<u8> = layer.bias.iter().flat_map(|b| (*b as f32).to_le_bytes()).collect();
        assert!(contains(&single.bytes, &bytes));
    }
    for text in ["x_next", "Concat", "Tanh", "x1, x2", "batch", "00ff"] {
        assert!(contains(&single.bytes, text.as_bytes()), "{text}");
    }
    // What 32 bits take from the states, of some units, is a few epsilons of these.
    let text = String::from_utf8_lossy(&single.bytes).into_owned();
    let start = text.find("rounding").unwrap();
    let list = text[start..].split(['[', ']']).nth(1).unwrap();
    let off: Vec<f64> = list.split(", ").map(|off| off.parse().unwrap()).collect();
    assert!(off.len() == 2 && off.iter().all(|off| (1e-8..1e-5).contains(off)), "{off:?}");
    assert!(!contains(&double.bytes, b"rounding"));
    let proven = Origin { proven: Some("proven".to_owned()), ..origin(&net) };
    let file = |precision| net_to_onnx(&net, &name(), &proven, precision).unwrap();
    let words = b"proven; in 64 bits";
    assert!(contains(&file(Precision::Single).bytes, words));
    assert!(!contains(&file(Precision::Double).bytes, words));
}

/// Steps an FMU from a start, with an input and a step's length per line, and writes the states.
const FMU_DRIVER: &str = r#"
#include "net_fmu.c"
#include <stdio.h>
#include <stdlib.h>
static void quiet(fmi2ComponentEnvironment e, fmi2String i, fmi2Status s, fmi2String c, fmi2String m, ...)
{
    (void)e;
    (void)i;
    (void)s;
    (void)c;
    (void)m;
}
int main(void)
{
    fmi2CallbackFunctions callbacks = {quiet, calloc, free, 0, 0};
    fmi2ValueReference vr[2 * NET_NX + NET_NU];
    fmi2Real values[2 * NET_NX + NET_NU], h;
    fmi2FMUstate state = 0;
    double t = 0.0;
    int i;
    fmi2Component c = fmi2Instantiate("a", fmi2CoSimulation, "wrong", "", &callbacks, 0, 0);
    if (c != 0) {
        return 1;
    }
    c = fmi2Instantiate("a", fmi2CoSimulation, NET_GUID, "", &callbacks, 0, 0);
    for (i = 0; i < 2 * NET_NX + NET_NU; i++) {
        vr[i] = (fmi2ValueReference)i;
    }
    for (i = 0; i < NET_NX; i++) {
        if (scanf("%lf", &values[i]) != 1) {
            return 1;
        }
    }
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
    fmi2SetReal(c, vr + NET_NX + NET_NU, NET_NX, values);
    fmi2EnterInitializationMode(c);
    fmi2ExitInitializationMode(c);
    for (;;) {
        for (i = 0; i < NET_NU; i++) {
            if (scanf("%lf", &values[i]) != 1) {
                fmi2FreeFMUstate(c, &state);
                fmi2FreeInstance(c);
                return 0;
            }
        }
        if (scanf("%lf", &h) != 1) {
            return 1;
        }
        fmi2SetReal(c, vr + NET_NX, NET_NU, values);
        /* There and back, and there again. */
        fmi2GetFMUstate(c, &state);
        fmi2DoStep(c, t, h, 1);
        fmi2SetFMUstate(c, state);
        if (fmi2DoStep(c, t, h, 1) != fmi2OK) {
            return 1;
        }
        t += h;
        fmi2GetReal(c, vr, NET_NX, values);
        for (i = 0; i < NET_NX; i++) {
            printf("%.17g\n", values[i]);
        }
    }
}
"#;

/// Whole steps and parts of them, and an input that changes within a step.
#[test]
fn an_fmu_chains_the_net_as_a_free_run_does() {
    let [net, ..] = nets();
    let files = net_to_fmu(&net, &name(), &origin(&net), FmiVersion::Two).unwrap();
    assert_eq!(files[0].path, "modelDescription.xml");
    let xml = String::from_utf8(files[0].bytes.clone()).unwrap();
    // Of the net's hash, and of the description: no other unit of the same hash has it.
    let guid = |xml: &str| xml.split_once('{').unwrap().1.split_once('}').unwrap().0.to_owned();
    assert!(guid(&xml).starts_with("00ff0000-0000-0000-") && !xml.contains('@'), "{xml}");
    let three = net_to_fmu(&net, &name(), &origin(&net), FmiVersion::Three).unwrap();
    assert_ne!(guid(&xml), guid(std::str::from_utf8(&three[0].bytes).unwrap()));
    let flat = |file: GeneratedFile| GeneratedFile {
        path: file.path.trim_start_matches("sources/").to_owned(),
        ..file
    };
    let files: Vec<_> = files.into_iter().map(flat).collect();
    let without = ["-Wno-unused-parameter"];
    let given = [0.5, -0.2, 0.3, 0.5, 0.3, 0.2, 0.3, 0.3, -0.6, 0.25, 0.4, 0.5];
    let found = Sources::with_included(&files, "net_fmu.c").drive(FMU_DRIVER, &without, &given);
    let mut x = given[..2].to_vec();
    let mut expected = Vec::new();
    // Marks at 0.5 and 1; at 1.25 the input changes, from where on the next step is whole.
    for (u, t, chained) in [
        (0.3, 0.5, true),
        (0.3, 0.2, false),
        (0.3, 0.5, true),
        (-0.6, 0.25, true),
        (0.4, 0.5, true),
    ] {
        let next = net.evaluate(t, &x, &[u], &[]);
        expected.extend_from_slice(&next);
        if chained {
            x = next;
        }
    }
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
}
