use super::Totals;

#[test]
fn inputs_travel_in_widths_of_their_bounds() {
    let mut totals = Totals::default();
    for u in [[1.0, 1.0], [2.0, 0.5], [0.0, 0.5]] {
        totals.add_input(&u, &[4.0, 0.5]);
    }
    assert!((totals.input_travel - 1.75).abs() < 1e-15);
}
