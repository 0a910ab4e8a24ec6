//! The tape: what is recorded, what is not, and reuse.

#![expect(clippy::float_cmp, reason = "the results are exact in binary")]

use pinc_ad::{Scalar, Tape};

#[test]
fn shared_values_collect_all_their_uses() {
    // y = (x + x) x = 2 x^2, y' = 4x, and every operand is used twice.
    let tape = Tape::new();
    let x = tape.variable(3.0);
    let y = (x + x) * x;
    assert_eq!(y.value(), 18.0);
    assert_eq!(tape.gradient(y, &[x]), [12.0]);
}

#[test]
fn output_that_is_an_input() {
    let tape = Tape::new();
    let (x, y) = (tape.variable(2.0), tape.variable(3.0));
    assert_eq!(tape.gradient(x, &[x, y]), [1.0, 0.0]);
    assert_eq!(tape.gradient(x, &[y, x, x]), [0.0, 1.0, 1.0]);
}

#[test]
fn output_that_is_constant() {
    let tape = Tape::new();
    let x = tape.variable(2.0);
    assert_eq!(tape.gradient(x.constant(5.0), &[x]), [0.0]);
    // A constant among the inputs influences nothing either.
    let c = x.constant(5.0);
    assert_eq!(tape.gradient(x * c, &[x, c]), [5.0, 0.0]);
}

/// The `Debug` form lists the nodes; there is no other way to see them, nor need for one.
fn nodes(tape: &Tape) -> usize {
    format!("{tape:?}").matches("Node {").count()
}

#[test]
fn constants_take_no_node() {
    let tape = Tape::new();
    let x = tape.variable(2.0);
    let before = nodes(&tape);
    assert_eq!(before, 1);
    let c = x.constant(4.0);
    let folded = (c * c + 1.0 - c / 2.0).sqrt().tanh() + c.mul_add(c, -c);
    let folded = c.where_nonpositive(folded, folded * 2.0);
    // 2 (tanh(sqrt(16 + 1 - 2)) + 16 - 4): the value is kept all the same.
    let expected = 2.0 * (15f64.sqrt().tanh() + 12.0);
    assert!((folded.value() - expected).abs() < 1e-14);
    assert_eq!(nodes(&tape), before);
    let _ = x * folded;
    assert_eq!(nodes(&tape), before + 1);
}

#[test]
fn cleared_tape_starts_anew() {
    let mut tape = Tape::new();
    for k in 1..4 {
        {
            let x = tape.variable(f64::from(k));
            let y = x * x * x;
            // 3 x^2
            assert_eq!(tape.gradient(y, &[x]), [3.0 * f64::from(k).powi(2)]);
            assert_eq!(nodes(&tape), 3);
        }
        tape.clear();
        assert_eq!(nodes(&tape), 0);
    }
}

#[test]
fn several_outputs_of_one_record() {
    let tape = Tape::new();
    let (x, y) = (tape.variable(2.0), tape.variable(3.0));
    let (product, quotient) = (x * y, x / y);
    let rows = [tape.gradient(product, &[x, y]), tape.gradient(quotient, &[x, y])];
    assert_eq!(rows[0], [3.0, 2.0]);
    // 1/y and -x/y^2, each rounded once or twice
    assert!((rows[1][0] - 1.0 / 3.0).abs() < 1e-16);
    assert!((rows[1][1] + 2.0 / 9.0).abs() < 1e-16);
}

#[test]
fn infinite_partial_of_what_is_used_stays() {
    let tape = Tape::new();
    let x = tape.variable(0.0);
    assert_eq!(tape.gradient(x.ln(), &[x]), [f64::INFINITY]);
}

/// Without the check, the index of a number on the one tape would be taken for one on the other.
#[test]
fn numbers_of_two_tapes_do_not_mix() {
    let (one, two) = (Tape::new(), Tape::new());
    let (x, y) = (one.variable(2.0), two.variable(3.0));
    let refused = |operation: &dyn Fn()| {
        let operation = std::panic::AssertUnwindSafe(operation);
        let panic = std::panic::catch_unwind(operation).expect_err("two tapes");
        assert_eq!(panic.downcast_ref(), Some(&"a number of another tape"));
    };
    refused(&|| _ = x + y);
    refused(&|| _ = x - y);
    refused(&|| _ = x * y);
    refused(&|| _ = x / y);
    refused(&|| _ = x.mul_add(x, y));
    refused(&|| _ = x.max(y));
    refused(&|| _ = x * y.constant(1.0));
    refused(&|| _ = x.constant(1.0) * y);
    refused(&|| _ = y.where_nonpositive(x, y));
    refused(&|| _ = y.where_nonpositive(y, x));
    refused(&|| _ = one.gradient(y, &[x]));
    refused(&|| _ = one.gradient(x, &[x, y]));
}
