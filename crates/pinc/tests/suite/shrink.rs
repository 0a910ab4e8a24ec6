//! `pinc shrink`: a small net in place of a controller, judged in closed loops.

use crate::common::{outcome, pinc, repository};
use crate::ways::Served;
use pinc_config::ModelKind;
use std::fs;
use std::path::Path;

/// The smoke config's loop, and a net that is trained for a moment.
#[test]
fn the_table_and_the_summary_have_the_numbers_of_each_driver() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let sizes = ["--samples", "300", "--iterations", "20", "--neurons", "6", "--loops", "6"];
    let mut command = pinc(&["shrink", "--only", "rk4"]);
    command.args(sizes).arg("--out").arg(&out);
    let said = outcome(command.arg(repository("configs/smoke/van-der-pol.toml")));
    assert_eq!(said.code, Some(0), "{said:?}");
    let table = fs::read_to_string(out.join("shrink.csv")).unwrap();
    let provenance = fs::read_to_string(out.join("provenance.json")).unwrap();
    assert!(provenance.contains("\"shrink\""), "{provenance}");
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("driver,loops,iae,broken,newly_broken,kept,optimized"));
    let rows: Vec<(&str, Vec<f64>)> = lines
        .map(|line| {
            let (driver, numbers) = line.split_once(',').unwrap();
            (driver, numbers.split(',').map(|number| number.parse().unwrap()).collect())
        })
        .collect();
    let [("controller", controller), ("net", net), ("checked", checked), ("backed", backed)] =
        &rows[..]
    else {
        panic!("{table}")
    };
    for driver in [controller, net, checked, backed] {
        assert_eq!((driver.len(), driver[0]), (6, 6.0), "{table}");
    }
    // The net alone decides always; the check keeps not all that such a net plans.
    assert_eq!((controller[5], net[4]), (1.0, 1.0), "{table}");
    assert_eq!((checked[5], backed[3]), (0.0, 0.0), "{table}");
    assert!(checked[4] > 0.0 && checked[4] < 1.0, "{table}");
    for (name, driver) in [
        ("controller", controller),
        ("net", net),
        ("net, checked", checked),
        ("net, backed", backed),
    ] {
        let line = said.stdout.lines().find(|line| line.starts_with(&format!("{name:<15} ")));
        let words = line.unwrap_or_else(|| panic!("{name} in {said:?}"));
        let percent =
            format!(" {:.3} % of the controller's IAE", 100.0 * driver[1] / controller[1]);
        let broken = format!("broken in {} loops, {} of them", driver[2], driver[3]);
        assert!(words.contains(&percent) && words.contains(&broken), "{words}: {driver:?}");
    }
    let kept = format!("the check keeps {:.1} % of the net's plans;", 100.0 * checked[4]);
    assert!(said.stdout.contains(&kept), "{said:?}");
    let policy = |ending| out.join(format!("smoke_van_der_pol_policy.{ending}")).exists();
    assert!(policy("h") && policy("c"));
    // Its directory is that of this config.
    let mut command = pinc(&["shrink", "--only", "rk4", "--set", "control.r=[2.0]"]);
    command.args(sizes).arg("--out").arg(&out);
    let other = outcome(command.arg(repository("configs/smoke/van-der-pol.toml")));
    other.assert_refused(&["another config"]);
    assert_eq!(fs::read_to_string(out.join("shrink.csv")).unwrap(), table);
    the_loop_of_the_net_is_beside_the_controllers(dir.path(), &out.join("policy.json"));
    // A file that cannot be written is an error, and no property of the controller.
    fs::remove_file(out.join("smoke_van_der_pol_mpc.c")).unwrap();
    fs::create_dir(out.join("smoke_van_der_pol_mpc.c")).unwrap();
    let mut command = pinc(&["shrink", "--only", "rk4"]);
    command.args(sizes).arg("--out").arg(&out);
    let said = outcome(command.arg(repository("configs/smoke/van-der-pol.toml")));
    assert_eq!(said.code, Some(2), "{said:?}");
    assert!(said.stderr.contains("smoke_van_der_pol_mpc.c: cannot be written"), "{said:?}");
}

/// `pinc control` runs it by the name "policy", with the model that it was trained with.
fn the_loop_of_the_net_is_beside_the_controllers(dir: &Path, policy: &Path) {
    let control = |to: &str, models: &str, file: &str| {
        let mut command = pinc(&["control", "--only", "policy", "--out"]);
        let policy = format!("control.policy=\"{file}\"");
        let config = repository("configs/smoke/van-der-pol.toml");
        let models = format!("control.models={models}");
        command.arg(dir.join(to)).args(["--set", &models, "--set", &policy]).arg(config);
        command
    };
    let file = policy.display().to_string();
    let metrics = |dir: &Path| {
        let metrics = fs::read_to_string(dir.join("metrics.json")).unwrap();
        serde_json::from_str::<serde_json::Value>(&metrics).unwrap()["control"][0].clone()
    };
    let said = outcome(&mut control("loop", "[\"rk4\", \"policy\"]", &file));
    assert_eq!(said.code, Some(0), "{said:?}");
    let found = metrics(&dir.join("loop"));
    assert_eq!(found["model"], "policy");
    let status = found["status"].as_object().unwrap();
    assert!(status.keys().all(|status| status == "kept" || status == "replaced"), "{status:?}");
    assert!(status.contains_key("kept"), "{status:?}");
    let html = fs::read_to_string(dir.join("loop/report.html")).unwrap();
    assert!(html.contains("steps without an optimization"), "what a policy does does not converge");
    let models = ["--set", "control.models=[\"rk4\", \"policy\"]", "--set"];
    let of_file = format!("control.policy=\"{file}\"");
    let sets = [&models[..], &[&of_file]].concat();
    let config = repository("configs/smoke/van-der-pol.toml");
    let mut served = Served::of(&config, ModelKind::Policy, &sets);
    let described = served.ask(&serde_json::json!({ "command": "describe" }));
    let digest = pinc_config::sha256(fs::read(policy).unwrap());
    assert_eq!(described["model_sha256"], digest.as_str(), "{described}");
    served.end();
    // Plans that are kept have no KKT residual.
    let row = said.stdout.lines().find(|line| line.trim_start().starts_with("policy"));
    let row = row.unwrap_or_else(|| panic!("{said:?}"));
    assert_eq!(row.split_whitespace().nth(7), Some("-"), "{said:?}");
    let refused = outcome(&mut control("refused", "[\"rk5\", \"policy\"]", &file));
    refused.assert_refused(&[&file, "\"model\":\"rk4\"", "expected one for", "\"model\":\"rk5\""]);
    for set in ["control.r=[7.0]", "control.n1=2", "control.weights_profile=\"cumulative\""] {
        let mut other = control("other", "[\"rk4\", \"policy\"]", &file);
        let refused = outcome(other.args(["--set", set]));
        refused.assert_refused(&["a net for", "expected one for"]);
    }
    let refused = outcome(&mut control("refused", "[\"policy\"]", &file));
    refused.assert_refused(&["control.models", "another model too"]);
    let damaged = fs::read_to_string(policy).unwrap().replace("\"widths\":[", "\"widths\":[1,");
    let other = dir.join("damaged.json");
    fs::write(&other, damaged).unwrap();
    let other = other.display().to_string();
    let refused = outcome(&mut control("damaged", "[\"rk4\", \"policy\"]", &other));
    refused.assert_refused(&[&other, "a net from 5 to", "finite numbers expected"]);
    // Nothing is left that would stand in the way of a better config.
    for left in ["refused", "damaged"] {
        assert!(!dir.join(left).exists(), "{left}");
    }
    let mut exported = pinc(&["export", "--to", "fmu", "--only", "policy", "--set"]);
    let sets = ["control.models=[\"rk4\", \"policy\"]", "--set"];
    exported.args(sets).arg(format!("control.policy=\"{file}\""));
    let refused = outcome(exported.arg(repository("configs/smoke/van-der-pol.toml")));
    refused.assert_refused(&["no control.policy", "`pinc shrink` writes"]);
}
