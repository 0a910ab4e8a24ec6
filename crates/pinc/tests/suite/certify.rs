//! `pinc certify`: errors and bounds at points, the bracket of a domain, refusals.

use crate::common::{outcome, pinc, repository};
use pinc::ode::{Dopri5, Model, Rk4};
use pinc::plants::VanDerPol;
use pinc_record::CertificateMetrics;
use std::fs;
use std::path::Path;

/// The oscillator's config in a smaller box.
fn arguments(dir: &Path, more: &[&str]) -> Vec<String> {
    let config = repository("configs/smoke/van-der-pol.toml").display().to_string();
    let out = dir.join("out").display().to_string();
    let fixed = ["--quiet", "certify", &config, "--only", "rk4", "--out", &out];
    let set = ["--set", "domain.state_low=[-1.0, -1.0]", "--set", "domain.state_high=[1.0, 1.0]"];
    fixed.iter().chain(&set).chain(more).map(|text| (*text).to_owned()).collect()
}

/// The rows of `certify.csv` by numbers.
fn rows(dir: &Path) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(dir.join("out/certify.csv")).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("x1,x2,u,x1_err,x1_bound,x2_err,x2_bound"));
    lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect()
}

#[test]
fn a_step_is_certified_at_points_and_over_the_domain() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("in.csv");
    fs::write(&data, "t,u,x2,x1\n0,0.5,0.25,-0.75\n").unwrap();
    let data = data.display().to_string();
    let more = ["--points", "600", "--domain", "--data", &data];
    let done = outcome(&mut pinc(&arguments(dir.path(), &more)));
    assert_eq!(done.code, Some(0), "{done:?}");
    let rows = rows(dir.path());
    assert_eq!(rows.len(), 601);
    assert_eq!(rows[600][..3], [-0.75, 0.25, 0.5]);
    let (mut model, mut truth) =
        (Rk4::new(VanDerPol::default(), 0.5, 4), Dopri5::new(VanDerPol::default(), 1e-13));
    let text = fs::read_to_string(dir.path().join("out/config.toml")).unwrap();
    let config: toml::Table = text.parse().unwrap();
    if let Some(substeps) = config["control"]["rk4_substeps"].as_integer() {
        model = Rk4::new(VanDerPol::default(), 0.5, usize::try_from(substeps).unwrap());
    }
    for row in rows.iter().step_by(20) {
        let (x, u) = (&row[..2], &row[2..3]);
        let (mut next, mut exact) = ([0.0; 2], [x[0], x[1]]);
        model.step(x, u, &[], &mut next);
        truth.integrate(&mut exact, u, 0.5).unwrap();
        for i in 0..2 {
            let (error, bound) = (row[3 + 2 * i], row[4 + 2 * i]);
            let expected = next[i] - exact[i];
            assert!((error - expected).abs() < 0.02 * expected.abs() + 1e-11, "{row:?}");
            assert!(bound >= error.abs() && bound <= 1.03 * error.abs() + 1e-12, "{row:?}");
        }
    }
    let found = CertificateMetrics::read(&dir.path().join("out")).unwrap().unwrap();
    assert_eq!((found.points, found.unproven_points, found.refused), (601, 0, None));
    let domain = found.domain.unwrap();
    assert!(domain.complete && domain.unproven_volume == 0.0);
    for (i, state) in ["x1", "x2"].into_iter().enumerate() {
        let (proven, most) = (domain.proven[state], domain.found[state]);
        assert!(most <= proven && proven <= 1.1001 * most, "{state}: {most} {proven}");
        let mut errors: Vec<f64> = rows[..600].iter().map(|row| row[3 + 2 * i].abs()).collect();
        errors.sort_by(f64::total_cmp);
        assert!(errors[599] <= most, "{state}");
        // Of 600 values the sixth largest is about the 0.99 quantile; its upper bound is larger.
        let quantile = found.quantiles["0.99"][state].unwrap();
        assert!(quantile > errors[593] && quantile <= 1.03 * errors[599], "{state}");
    }
    // The search is over: to resume it changes nothing.
    let again =
        outcome(&mut pinc(&arguments(dir.path(), &["--points", "0", "--domain", "--resume"])));
    assert_eq!(again.code, Some(0), "{again:?}");
    let resumed = CertificateMetrics::read(&dir.path().join("out")).unwrap().unwrap();
    assert_eq!(resumed.domain.unwrap().boxes, domain.boxes);
}

#[test]
fn too_many_points_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    outcome(&mut pinc(&arguments(dir.path(), &["--points", "1000001"])))
        .assert_refused(&["1000001 points given, expected 1000000 at most"]);
}

/// A search that is cut short says the errors at points, where they are larger than its own.
#[test]
fn the_errors_found_include_the_points() {
    let dir = tempfile::tempdir().unwrap();
    let more = ["--points", "400", "--domain", "--budget-s", "1e-6"];
    let done = outcome(&mut pinc(&arguments(dir.path(), &more)));
    assert_eq!(done.code, Some(0), "{done:?}");
    let found = CertificateMetrics::read(&dir.path().join("out")).unwrap().unwrap();
    let domain = found.domain.unwrap();
    let said = domain.to_string();
    match domain.unproven_volume {
        1.0 => assert!(domain.proven.is_empty() && said.contains("x1: nothing proven"), "{said}"),
        _ => assert!(said.contains("where anything is proven, found"), "{said}"),
    }
    let rows = rows(dir.path());
    for (i, state) in ["x1", "x2"].into_iter().enumerate() {
        let errors = rows.iter().map(|row| row[3 + 2 * i].abs());
        let largest = errors.fold(0.0, f64::max);
        assert!(domain.found[state] >= largest, "{domain:?} {largest}");
    }
}

/// The points of `--run` are the rows of the trace of the run's loop with this model.
#[test]
fn the_loop_of_a_run_is_certified() {
    let dir = tempfile::tempdir().unwrap();
    let run = dir.path().join("run").display().to_string();
    let config = repository("configs/smoke/van-der-pol.toml").display().to_string();
    let control = ["--quiet", "control", &config, "--only", "rk4", "--out", &run];
    assert_eq!(outcome(&mut pinc(&control)).code, Some(0));
    let done = outcome(&mut pinc(&arguments(dir.path(), &["--run", &run])));
    assert_eq!(done.code, Some(0), "{done:?}");
    let trace = fs::read_to_string(dir.path().join("run/control.csv")).unwrap();
    let mut lines = trace.lines();
    assert!(lines.next().unwrap().starts_with("t,x1,x2,u,"), "{trace}");
    let trace: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
    let rows = rows(dir.path());
    assert!(rows.len() == trace.len() && rows.len() > 50, "{}", rows.len());
    for (row, sample) in rows.iter().zip(&trace) {
        assert_eq!(row[..3], sample[1..4]);
        assert!(row[4] >= row[3].abs() && row[6] >= row[5].abs(), "{row:?}");
    }
    let found = CertificateMetrics::read(&dir.path().join("out")).unwrap().unwrap();
    assert_eq!((found.points, found.unproven_points), (rows.len(), 0));
    // Rows of a trace are no sample of the domain.
    assert_eq!(found.quantiles["0.5"]["x1"], None);
    let missing = arguments(dir.path(), &["--run", "absent"]);
    outcome(&mut pinc(&missing)).assert_refused(&["absent", "control.csv"]);
}

#[test]
fn what_cannot_be_certified_is_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |config: &str, more: &[&str], parts: &[&str]| {
        let out = dir.path().join(config).display().to_string();
        let config = repository(config).display().to_string();
        let fixed = ["certify", &config, "--out", &out];
        outcome(&mut pinc(&[&fixed[..], more].concat())).assert_refused(parts);
    };
    let rod = "configs/distributed/rod.toml";
    let domain = ["--only", "rk4", "--domain", "--points", "0"];
    refused(rod, &domain, &["21 variables", "7 at most"]);
    let oscillator = "configs/smoke/van-der-pol.toml";
    refused(oscillator, &[], &["`certify`", "--model FILE"]);
    refused(oscillator, &["--only", "rosenbrock"], &["`rosenbrock`", "`rk4`"]);
    refused("configs/smoke/rk4-only.toml", &["--only", "rk4"], &["[domain]", "`certify`"]);
    let data = dir.path().join("in.csv");
    fs::write(&data, "x1,u\n0.0,0.0\n").unwrap();
    let data = data.display().to_string();
    let more = ["--only", "rk4", "--data", &data];
    refused(oscillator, &more, &["in.csv:1", "`x2` is missing"]);
    fs::write(&data, "x1,x2,u\n").unwrap();
    refused(oscillator, &more, &["in.csv:1", "a header without rows"]);
    let net = ["--only", "rk4", "--model", "none.safetensors"];
    refused(oscillator, &net, &["`pinc certify`", "no model is a net: \"rk4\""]);
    refused(
        oscillator,
        &["--only", "rk4", "--points", "-1"],
        &["'--points <N>'", "-1 is not in 0.."],
    );
}
