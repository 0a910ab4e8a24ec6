use super::Recorded;

/// Behind one row that is left out the errors are 0 and 3, and 4 where there is a measurement.
#[test]
fn errors_on_held_out_data_are_root_mean_squares() {
    let y = vec![9.0, 9.0, 2.0, f64::NAN, 4.0, 12.0];
    let of = Recorded { name: String::new(), u: vec![], y, t: vec![], channels: 2 };
    let found = of.held_out(&["a", "b"].map(str::to_owned), 1, &[0.0, 0.0, 2.0, 5.0, 1.0, 8.0]);
    assert!((found.rms["a"] - 4.5_f64.sqrt()).abs() < 1e-12, "{found:?}");
    assert!((found.rms["b"] - 4.0).abs() < 1e-12, "{found:?}");
}
