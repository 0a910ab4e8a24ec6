//! Windows, segments and stretches of references.

use super::*;

#[test]
fn the_preview_ends_in_the_last_value() {
    let reference = Reference::new(vec![0.0, 1.0, 2.0, 3.0], 1).unwrap();
    let preview = |k, rows| {
        let mut window = vec![f64::NAN; rows];
        reference.preview(k, &mut window);
        window
    };
    assert_eq!(preview(0, 2), [0.0, 1.0]);
    assert_eq!(preview(2, 2), [2.0, 3.0]);
    assert_eq!(preview(3, 2), [3.0, 3.0]);
    assert_eq!(preview(1, 6), [1.0, 2.0, 3.0, 3.0, 3.0, 3.0]);
}

#[test]
fn a_preview_of_stages_has_the_values_at_their_ends() {
    let reference = Reference::new((0..20_i32).map(f64::from).collect(), 1).unwrap();
    let mut window = vec![0.0; 5];
    reference.preview_at(2, &[0.1, 0.2, 0.5, 0.85, 9.0], &mut window);
    assert_eq!(window, [2.0, 3.0, 6.0, 10.0, 19.0]);
}

#[test]
fn a_signal_is_sampled_at_the_beginning_of_steps() {
    let signal = PiecewiseConstant::new(vec![0.0, 1.0], vec![vec![5.0], vec![7.0]]).unwrap();
    let reference = Reference::sample(&signal, 4, 0.5).unwrap();
    assert_eq!(reference.values, [5.0, 5.0, 7.0, 7.0]);
    let early = Reference::sample(&signal, 1, 0.5).unwrap();
    assert_eq!((early.steps(), early.at(1), early.at(9)), (1, &[5.0][..], &[7.0][..]));
    assert_eq!(early.whole().segments(), [0..2, 2..3]);
    assert!(Reference::sample(&signal, 0, 0.5).is_err());
    for sample_time_s in [0.0, -0.5, f64::INFINITY] {
        assert!(Reference::sample(&signal, 4, sample_time_s).is_err(), "{sample_time_s}");
    }
    assert!(Reference::sample(&signal, 4, f64::NAN).is_err());
}

#[test]
fn segments_have_one_value_each() {
    let reference = Reference::new(vec![1.0, 0.0, 1.0, 0.0, 1.0, 2.0, 1.0, 0.0], 2).unwrap();
    assert_eq!(reference.segments(), [0..2, 2..3, 3..4]);
    assert_eq!(Reference::new(vec![1.0; 3], 1).unwrap().segments(), vec![0..3_usize; 1]);
}

#[test]
fn steps_in_which_a_value_moves_on_are_one_stretch() {
    let stretches = |values: &[f64]| Reference::new(values.to_vec(), 1).unwrap().stretches();
    // Held, then moving from step 2 on, then held from step 6 on; and moving to the end.
    assert_eq!(stretches(&[0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.0]), [0..2, 2..6, 6..8]);
    assert_eq!(stretches(&[0.0, 0.0, 1.0, 2.0, 3.0, 4.0]), [0..2, 2..6]);
    assert_eq!(stretches(&[0.0, 0.0, 1.0, 2.0]), [0..2, 2..3, 3..4]);
    assert_eq!(stretches(&[0.0, 1.0, 2.0, 3.0, 3.0]), [0..3, 3..5]);
    assert_eq!(stretches(&[0.0, 1.0, 1.0, 2.0]), [0..1, 1..3, 3..4]);
}

#[test]
fn values_that_are_no_reference_are_errors() {
    assert!(Reference::new(vec![], 1).is_err());
    assert!(Reference::new(vec![1.0], 0).is_err());
    assert_eq!(
        Reference::new(vec![1.0, 2.0, 3.0], 2).unwrap_err().to_string(),
        "the last row of the reference: 1 numbers, but 2 are expected"
    );
    assert_eq!(
        Reference::new(vec![1.0, f64::NAN], 1).unwrap_err().to_string(),
        "reference[1] is NaN, but must be finite"
    );
}
