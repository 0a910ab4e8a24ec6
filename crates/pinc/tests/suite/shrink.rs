//! `pinc shrink`: a small net in place of a controller, judged in closed loops.

use crate::common::{outcome, pinc, repository};
use std::fs;

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
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("driver,loops,iae,broken,newly_broken,kept"));
    let rows: Vec<(&str, Vec<f64>)> = lines
        .map(|line| {
            let (driver, numbers) = line.split_once(',').unwrap();
            (driver, numbers.split(',').map(|number| number.parse().unwrap()).collect())
        })
        .collect();
    let [("controller", controller), ("net", net), ("checked", checked)] = &rows[..] else {
        panic!("{table}")
    };
    for driver in [controller, net, checked] {
        assert_eq!((driver.len(), driver[0]), (5, 6.0), "{table}");
    }
    // The net alone decides always; the check keeps not all that such a net plans.
    assert_eq!((controller[4], net[4]), (1.0, 1.0), "{table}");
    assert!(checked[4] > 0.0 && checked[4] < 1.0, "{table}");
    for (name, driver) in [("controller", controller), ("net", net), ("net, checked", checked)] {
        let line = said.stdout.lines().find(|line| line.starts_with(&format!("{name:<15} ")));
        let words = line.unwrap_or_else(|| panic!("{name} in {said:?}"));
        let percent =
            format!(" {:.3} % of the controller's IAE", 100.0 * driver[1] / controller[1]);
        let broken = format!("broken in {} loops, {} of them", driver[2], driver[3]);
        assert!(words.contains(&percent) && words.contains(&broken), "{words}: {driver:?}");
    }
    let kept = format!("the check keeps {:.1} % of the net's plans", 100.0 * checked[4]);
    assert!(said.stdout.contains(&kept), "{said:?}");
    let policy = |ending| out.join(format!("smoke_van_der_pol_policy.{ending}")).exists();
    assert!(policy("h") && policy("c"));
}
