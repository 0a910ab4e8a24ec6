//! A net in C.

use crate::error::finite;
use crate::error_c::{NetError, without_estimate};
use crate::golden::{self, CASES, Golden};
use crate::open::Open;
use crate::origin::{Origin, domain};
use crate::template::{Template, array, array_with, constant, numbers, table};
use crate::{ExportError, GeneratedFile, Name};
use pinc_expr::PlantEquations;
use pinc_net::{FoldedNet, PincModel, PincNet, TrainingTarget};
use std::fmt::Write as _;

/// What a number of the C code may differ by from the library's, in double and in float, relative to its size
/// plus half the width of its domain.
const TOLERANCES: [f64; 2] = [1e-12, 1e-4];

/// By how much more rounding in double may be off than that in float, which is measured, says.
const MARGIN: f64 = 32.0;

/// The net as C99: step and Jacobians, self-test with golden vectors, build file and a page that
/// says how to use them.
///
/// A net distilled from an integrator knows t = T only; others get a function of t besides. With the
/// equation that the net stands for, `estimated`, there is a function for the estimated error of a
/// step.
///
/// # Errors
///
/// [`ExportError::Net`] for a conventional PINN, which is no model; [`ExportError::Family`];
/// [`ExportError::Equations`] for equations that cannot be listed.
pub fn net_to_c(
    net: &PincNet,
    estimated: Option<&PlantEquations>,
    name: &Name,
    origin: &Origin,
) -> Result<Vec<GeneratedFile>, ExportError> {
    check_member(net)?;
    let estimate = estimated.map(|equations| NetError { net, equations, open: Open::default() });
    let has_path = estimate.is_some() && has_time(net);
    let mut files = net_core((net, has_path), Open::default(), name, origin)?;
    let mut t = places(net, Open::default(), name, origin)?;
    match estimate {
        Some(estimate) => {
            files.extend(estimate.core(name, origin)?);
            estimate.set_selftest(&mut t, ESTIMATE_CALL)?;
        }
        None => without_estimate(&mut t),
    }
    let sources = sources(&files);
    files.push(selftest(net, &mut t)?);
    t.set("SOURCES", sources);
    files.push(t.named("CMakeLists.txt", include_str!("../templates/net_cmake.txt")));
    files.push(t.named("Makefile", include_str!("../templates/makefile.txt")));
    net_page(net, origin, &mut t);
    files.push(t.named("README.md", include_str!("../templates/net_readme.md")));
    Ok(files)
}

/// What the self-test does with how far estimates are off, in parts of what is allowed.
const ESTIMATE_CALL: &str = "    worst = pinc_larger(worst, pinc_error_off() * PINC_TOLERANCE);\n";

/// The sources among `files`, as arguments of a compiler.
pub(crate) fn sources(files: &[GeneratedFile]) -> String {
    let sources = files.iter().map(|file| &*file.path);
    let sources = sources.filter(|path| path.ends_with(".c") && !path.ends_with("_selftest.c"));
    sources.collect::<Vec<_>>().join(" ")
}

/// Header and source of the net, with the parameters that `open` names behind the inputs; with its
/// path and the path's derivative by the time if asked for.
pub(crate) fn net_core(
    (net, has_path): (&PincNet, bool),
    open: Open<'_>,
    name: &Name,
    origin: &Origin,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let t = places(net, open, name, origin)?;
    let parts = |at: &'static str, path: &'static str| {
        let path = if has_path { path } else { "" };
        if has_time(net) { format!("{at}{path}") } else { String::new() }
    };
    let mut header = t.clone();
    header.set(
        "AT",
        parts(include_str!("../templates/net_at.h"), include_str!("../templates/net_path.h")),
    );
    let mut source = t;
    source.set(
        "AT",
        parts(include_str!("../templates/net_at.c"), include_str!("../templates/net_path.c")),
    );
    Ok(vec![
        header.file("net.h", include_str!("../templates/net.h")),
        source.file("net.c", include_str!("../templates/net.c")),
    ])
}

/// The domain as a list of a page.
pub(crate) fn net_page(net: &PincNet, origin: &Origin, t: &mut Template) {
    let markdown: String = domain(net, origin).iter().map(|row| format!("- {row}\n")).collect();
    t.set("DOMAIN", markdown.trim_end());
}

/// An error if the net is of a family of plants.
pub(crate) fn check_member(net: &PincNet) -> Result<(), ExportError> {
    let names: Vec<_> = net.parameter_names().collect();
    if names.is_empty() { Ok(()) } else { Err(ExportError::Family(names.join(", "))) }
}

/// Whether the net is meaningful between t = 0 and t = T.
pub(crate) fn has_time(net: &PincNet) -> bool {
    net.source() != TrainingTarget::Integrator
}

/// The derivative of a state by the time.
const AT_RATE: &str = "(out[i] + (t * slope[i])) / PINC_N(PINC_SAMPLE_TIME_S)";

pub(crate) fn places(
    net: &PincNet,
    open: Open<'_>,
    name: &Name,
    origin: &Origin,
) -> Result<Template, ExportError> {
    let (nx, nu) = (origin.states.len(), origin.inputs.len());
    let folded = folded(net, open)?;
    let widths = folded.layers.iter().map(|layer| layer.bias.len());
    let adds = folded.adds_initial_state;
    let pick = |yes: &'static str, no: &'static str| if adds { yes } else { no };
    let at = match adds {
        true => "x[i] + ((t / PINC_N(PINC_SAMPLE_TIME_S)) * out[i])",
        false => "out[i]",
    };
    let mut t = Template::new(name);
    t.set("BANNER", origin.banner("A net as the model of a plant.", Some(net)))
        .set("REAL", include_str!("../templates/real.h"))
        .set("ARITHMETIC", include_str!("../templates/arithmetic.c"))
        .set("NX", nx)
        .set("NU", nu)
        .set("T", format!("{:?}", net.sample_time_s()))
        .set("WIDEST", widths.chain([nx + nu + open.count()]).max().unwrap_or(1))
        .set("LAYERS", folded.layers.len())
        .set("TABLES", layer_tables(&folded))
        .set("PLUS_X", pick("x[i] + ", ""))
        .set("PLUS_C", pick("x[c] + ", ""))
        .set("PLUS_I", pick(" + ((i == k) ? PINC_N(1) : PINC_N(0))", ""))
        .set("FIRST", folded.time.len())
        .set("TIME", numbers(&folded.time))
        .set("AT_VALUE", at)
        .set("AT_RATE", if adds { AT_RATE } else { "slope[i]" })
        .set("CASES", CASES)
        .set("STATES", origin.state_list())
        .set("INPUTS", origin.input_list())
        .set("MODEL", "net");
    open.set(&mut t);
    t.set(
        "DESCRIPTION",
        "The model of a plant in discrete time, x[k+1] = F(x[k], u[k]), with its Jacobians.",
    );
    let middle = |ends: Vec<(f64, f64)>| {
        let middles = ends.iter().map(|(low, high)| format!("{:?}", f64::midpoint(*low, *high)));
        middles.collect::<Vec<_>>().join(", ")
    };
    let ends: Vec<_> = net.domain().ends().collect();
    t.set("X", middle(ends[..nx].to_vec())).set("U", middle(ends[nx..].to_vec()));
    Ok(t)
}

/// The layers of the net, with the parameters that are no arguments in its biases.
pub(crate) fn folded(net: &PincNet, open: Open<'_>) -> Result<FoldedNet, ExportError> {
    let mut folded = FoldedNet::new(net)?;
    let dims = net.dims();
    open.fold(&mut folded, dims.nx + dims.nu);
    for (l, layer) in folded.layers.iter().enumerate() {
        let what = format!("layer {} of the net, with its normalization,", l + 1);
        finite(what, layer.weights.iter().flatten().chain(&layer.bias))?;
    }
    finite("the first layer of the net, by time,", &folded.time)?;
    Ok(folded)
}

/// How a layer is described by its tables.
const LAYER: &str = "\
#if PINC_VECTOR_BYTES > 0
#define PINC_LAYER(l, inputs, outputs) \\
    {pinc_weights_##l, pinc_transposed_##l, pinc_bias_##l, inputs, outputs}
#else
#define PINC_LAYER(l, inputs, outputs) {pinc_weights_##l, pinc_bias_##l, inputs, outputs}
#endif
";

fn layer_tables(folded: &FoldedNet) -> String {
    let mut text = String::new();
    let mut list = String::new();
    let slack = |name: String, values: &[f64]| array_with(&name, values, " + PINC_SLACK");
    for (l, layer) in folded.layers.iter().enumerate() {
        let (inputs, outputs) = (layer.weights[0].len(), layer.bias.len());
        let column = |k: usize| layer.weights.iter().map(move |row| row[k]);
        let transposed: Vec<f64> = (0..inputs).flat_map(column).collect();
        text += &slack(format!("weights_{l}"), &layer.weights.concat());
        text += "#if PINC_VECTOR_BYTES > 0\n";
        text += &slack(format!("transposed_{l}"), &transposed);
        text += "#endif\n";
        text += &slack(format!("bias_{l}"), &layer.bias);
        let _ = writeln!(list, "    PINC_LAYER({l}, {inputs}, {outputs}),");
    }
    text + &format!("\n{LAYER}static const pinc_layer pinc_layers[PINC_LAYERS] = {{\n{list}}};\n")
}

fn selftest(net: &PincNet, t: &mut Template) -> Result<GeneratedFile, ExportError> {
    let ends: Vec<_> = net.domain().ends().collect();
    let golden = Golden::of(&mut PincModel::new(net)?, &[], &ends);
    let Golden { next, a, b, .. } = &golden;
    finite("the net's step in its domain", next.iter().chain(a).chain(b).flatten())?;
    let widths = half_widths(&ends);
    let rounding = single_rounding(&folded(net, Open::default())?, &ends);
    let rounding = rounding.iter().zip(&widths).map(|(off, width)| off / width).fold(0.0, f64::max);
    let in_double = MARGIN * rounding * f64::EPSILON / f64::from(f32::EPSILON);
    t.set("DOUBLE", constant(TOLERANCES[0].max(in_double))).set("FLOAT", constant(TOLERANCES[1]));
    let mut tables = golden_tables(&golden) + &array("width", &widths);
    if has_time(net) {
        let half = 0.5 * net.sample_time_s();
        let points = golden.x.iter().zip(&golden.u);
        let rows: Vec<_> = points.map(|(x, u)| net.evaluate(half, x, u, &[])).collect();
        tables += &table("half", &rows);
    }
    t.set("TABLES", tables);
    t.set("AT", if has_time(net) { include_str!("../templates/net_selftest_at.c") } else { "" });
    Ok(t.file("selftest.c", include_str!("../templates/net_selftest.c")))
}

/// The golden vectors as tables.
/// Half the widths of a domain, states first; 1 where it has none.
fn half_widths(ends: &[(f64, f64)]) -> Vec<f64> {
    let widths = ends.iter().map(|(low, high)| 0.5 * (high - low));
    widths.map(|width| if width > 0.0 { width } else { 1.0 }).collect()
}

/// By how much each state is off after a step in single precision, at most over points of the domain.
#[expect(clippy::cast_possible_truncation, reason = "single precision is what is asked about")]
pub(crate) fn single_rounding(folded: &FoldedNet, ends: &[(f64, f64)]) -> Vec<f64> {
    let single = |v: f64| f64::from(v as f32);
    let mut worst = Vec::new();
    for point in golden::points(ends) {
        let point: Vec<f64> = point.into_iter().map(single).collect();
        let found = step(folded, &point, single);
        worst.resize(found.len(), 0.0_f64);
        for ((worst, found), exact) in worst.iter_mut().zip(found).zip(step(folded, &point, |v| v))
        {
            *worst = worst.max((found - exact).abs());
        }
    }
    worst
}

/// The state after T, where every number is rounded.
fn step(folded: &FoldedNet, point: &[f64], round: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut values = point.to_vec();
    for (l, layer) in folded.layers.iter().enumerate() {
        let row = |(weights, bias): (&Vec<f64>, &f64)| {
            let terms = weights.iter().zip(&values);
            terms.fold(round(*bias), |sum, (w, v)| round(sum + round(round(*w) * v)))
        };
        values = layer.weights.iter().zip(&layer.bias).map(row).collect();
        if l + 1 < folded.layers.len() {
            values.iter_mut().for_each(|value| *value = round(value.tanh()));
        }
    }
    if folded.adds_initial_state {
        values.iter_mut().zip(point).for_each(|(value, x)| *value = round(*value + x));
    }
    values
}

pub(crate) fn golden_tables(golden: &Golden) -> String {
    let Golden { x, u, next, a, b } = golden;
    let parts = [("x", x), ("u", u), ("next", next), ("a", a), ("b", b)];
    parts.into_iter().map(|(name, rows)| table(name, rows)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_net::PlainLayer;

    /// Rounding is what the same layers give in numbers of 32 bits.
    #[test]
    #[expect(clippy::cast_possible_truncation, reason = "single precision is what is asked about")]
    fn rounding_is_that_of_single_precision() {
        let layer = |w: f64, b: f64| PlainLayer { weights: vec![vec![w, 0.3]], bias: vec![b] };
        let last = PlainLayer { weights: vec![vec![1.7]], bias: vec![300.1] };
        let layers = vec![layer(0.7, 0.1), last];
        let folded = FoldedNet { layers, time: Vec::new(), adds_initial_state: true };
        let ends = [(0.1, 2.3), (-1.0, 0.9)];
        let off = golden::points(&ends).into_iter().map(|point| {
            let (x, u) = (point[0] as f32, point[1] as f32);
            let hidden = f64::from(0.1_f32 + 0.7 * x + 0.3 * u).tanh() as f32;
            let found = (300.1_f32 + 1.7 * hidden) + x;
            let (x, u) = (f64::from(x), f64::from(u));
            (f64::from(found) - (300.1 + 1.7 * (0.1 + 0.7 * x + 0.3 * u).tanh() + x)).abs()
        });
        let (found, expected) = (single_rounding(&folded, &ends), off.fold(0.0, f64::max));
        assert!((found[0] / expected - 1.0).abs() < 1e-6, "{found:?} {expected:e}");
    }
}
