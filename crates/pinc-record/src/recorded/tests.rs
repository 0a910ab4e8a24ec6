//! Recorded data.

use super::*;

/// Steps of 0.1 s of Unix times: a double has these to 2.4e-7 s only.
#[test]
fn times_are_whole_steps_apart_as_far_as_doubles_tell() {
    let row =
        |t: f64| RecordedRow { t, u: vec![0.0], known: Vec::new(), y: vec![1.0], truth: None };
    let filled = |times: &[f64], sample_time_s| {
        let rows: Vec<_> = (2..).zip(times.iter().map(|t| row(*t))).collect();
        RecordedSteps::filled("times.csv", &rows, sample_time_s)
    };
    let times = [1700000000.0, 1700000000.1, 1700000000.2, 1700000007.3, 1700000017.5];
    assert_eq!(filled(&times, 0.1).unwrap().t.len(), 176);
    // T as the shortest step in the data has it.
    assert_eq!(filled(&times, times[1] - times[0]).unwrap().t.len(), 176);
    for apart in
        [[1700000000.0, 1700000000.1002], [0.0, 0.100001], [0.0, 1e-9], [1.7e9, 1.7e9 + 0.04]]
    {
        assert!(filled(&apart, 0.1).is_err(), "{apart:?}");
    }
    assert!(filled(&[0.0, 0.4], 0.1).is_ok());
}

/// Between two rows 1.5 s apart are two steps of 0.5 s, in which the input stays and nothing is
/// measured.
#[test]
fn gaps_hold_the_input_and_have_no_measurement() {
    let row = |t: f64, u: f64, y: f64| {
        let (u, y) = (vec![u, -u], vec![y, 10.0 * y, 100.0 * y]);
        RecordedRow { t, u, known: Vec::new(), y, truth: None }
    };
    let rows = [(2, row(1.0, 3.0, 5.0)), (3, row(2.5, 4.0, 6.0)), (4, row(3.0, 5.0, 7.0))];
    let filled = RecordedSteps::filled("gaps.csv", &rows, 0.5).unwrap();
    assert_eq!(filled.t, [1.0, 1.5, 2.0, 2.5, 3.0]);
    assert_eq!(filled.u, [3.0, -3.0, 3.0, -3.0, 3.0, -3.0, 4.0, -4.0, 5.0, -5.0]);
    assert_eq!(filled.y.len(), 15);
    assert_eq!(
        (&filled.y[..3], &filled.y[9..12]),
        (&[5.0, 50.0, 500.0][..], &[6.0, 60.0, 600.0][..])
    );
    assert!(filled.y[3..9].iter().all(|y| y.is_nan()));
    assert_eq!((filled.y[12], &*filled.name), (7.0, "gaps.csv"));
    // A fault has the line of the later row.
    let (line, said) = RecordedSteps::filled("", &rows[..2], 1.0).unwrap_err();
    assert_eq!(line, 3);
    assert!(said.starts_with("column `t`: 2.5 s after 1 s given, expected a whole"), "{said}");
    let far = [(2, row(0.0, 1.0, 1.0)), (7, row(1.1e6, 1.0, 1.0))];
    assert_eq!(RecordedSteps::filled("", &far, 1.0).unwrap_err().0, 7);
    let back = [(2, row(1.0, 1.0, 1.0)), (3, row(0.0, 1.0, 1.0))];
    assert_eq!(RecordedSteps::filled("", &back, 1.0).unwrap_err().0, 3);
}

/// Columns are found by their names, in any order: the time, inputs, known parameters,
/// measurements with `y_` before them, and the states themselves if they are there.
#[test]
fn cells_are_read_by_the_names_of_their_columns() {
    let plant = pinc_config::Plants::built_in();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/one-tank.toml");
    let experiment = pinc_config::Experiment::load(path.as_ref(), &[], &plant).unwrap();
    let variables = Variables::of(&*experiment.plant.dyn_plant());
    let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
    let find = |header: &[&str]| {
        let header = StringRecord::from(header.to_vec());
        let known = (&names(&["k"])[..], &names(&["c"])[..]);
        RecordedColumns::find(&header, &variables, &names(&["h"]), known)
    };
    let columns = find(&["h", "y_h", "k", "u", "other", "t"]).unwrap();
    let cells = StringRecord::from(vec!["1.5", "2.5", "3.5", "4.5", "text", "5.5"]);
    let row = columns.read(&cells).unwrap();
    let expected = RecordedRow {
        t: 5.5,
        u: vec![4.5],
        known: vec![3.5],
        y: vec![2.5],
        truth: Some(vec![1.5]),
    };
    assert_eq!(row, expected);
    let row = columns.clone().without_truth().read(&cells).unwrap();
    assert_eq!(row, RecordedRow { truth: None, ..expected.clone() });
    // A measurement may be missing, an input or a known parameter not.
    for missing in ["", "NaN", "nan"] {
        let cells = StringRecord::from(vec!["1.5", missing, "3.5", "4.5", "", "5.5"]);
        assert!(columns.read(&cells).unwrap().y[0].is_nan(), "{missing}");
    }
    for (place, name) in [(2, "k"), (3, "u"), (5, "t"), (0, "h")] {
        let mut cells = vec!["1.5", "2.5", "3.5", "4.5", "", "5.5"];
        cells[place] = "";
        let said = columns.read(&StringRecord::from(cells)).unwrap_err();
        assert!(said.starts_with(&format!("column `{name}`: `` given")), "{said}");
    }
    let columns = find(&["t", "u", "k", "y_h"]).unwrap();
    let row = columns.read(&StringRecord::from(vec!["5.5", "4.5", "3.5", "2.5"])).unwrap();
    assert_eq!(row, RecordedRow { truth: None, ..expected });
    let said = find(&["t", "u", "y_h"]).unwrap_err();
    assert_eq!(said, "column `k` is missing; expected t,u,k,y_h");
    let said = find(&["t", "u", "k", "y_h", "c"]).unwrap_err();
    assert!(said.starts_with("column `c` is a parameter, which is constant here"), "{said}");
}
