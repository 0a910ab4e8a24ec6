//! Results that count again.

use pinc_ode::{Memory, Recent};

/// Two stages, whose results of two numbers depend on a small and on a large number.
fn recent() -> Recent {
    Recent::new(2, 2, 2)
}

fn set_place(recent: &mut Recent, small: f64, large: f64) {
    recent.set_place([(small, 1e-3), (large, 10.0)].into_iter());
}

#[test]
fn a_result_counts_near_its_place_only() {
    let mut recent = recent();
    set_place(&mut recent, 1.0, 5e4);
    assert_eq!(recent.find(0, None), None);
    recent.keep(0, &[7.0, 8.0], false);
    for (small, large, is_near) in [
        (1.0, 5e4, true),
        (1.0009, 49_991.0, true),
        (1.002, 5e4, false),
        (1.0, 50_011.0, false),
        (f64::NAN, 5e4, false),
        (1.0, f64::INFINITY, false),
    ] {
        set_place(&mut recent, small, large);
        let expected = is_near.then_some([7.0, 8.0]);
        assert_eq!(recent.find(0, None), expected.as_ref().map(|result| &result[..]), "{small}");
        assert_eq!(recent.find(1, None), None, "another stage");
    }
    recent.forget();
    set_place(&mut recent, 1.0, 5e4);
    assert_eq!(recent.find(0, None), None);
}

#[test]
fn a_result_moves_to_the_stage_before_if_it_may() {
    for moves in [true, false] {
        let mut recent = recent();
        set_place(&mut recent, 1.0, 0.0);
        recent.keep(1, &[7.0, 8.0], moves);
        assert_eq!(recent.find(0, Some(1)).is_some(), moves);
        // From now on it is the stage's own.
        set_place(&mut recent, 3.0, 0.0);
        recent.keep(1, &[9.0, 9.0], moves);
        set_place(&mut recent, 1.0, 0.0);
        assert_eq!(recent.find(0, None).map(<[f64]>::to_vec), moves.then(|| vec![7.0, 8.0]));
    }
}

#[test]
fn results_are_saved_and_restored() {
    for known in [true, false] {
        let mut first = recent();
        set_place(&mut first, 1.0, 0.0);
        if known {
            first.keep(1, &[7.0, 8.0], true);
        }
        let mut numbers = Vec::new();
        first.remember(&mut Memory::save(&mut numbers));
        assert_eq!(numbers.len(), if known { 1 + 4 + 4 + 2 } else { 1 });
        let mut second = recent();
        set_place(&mut second, 1.0, 0.0);
        second.keep(0, &[1.0, 1.0], true);
        let mut memory = Memory::restore(&numbers);
        second.remember(&mut memory);
        assert!(memory.is_complete());
        set_place(&mut second, 1.0, 0.0);
        assert_eq!(second.find(0, None), None);
        assert_eq!(second.find(0, Some(1)).is_some(), known);
    }
}
