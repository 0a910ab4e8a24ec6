use super::*;

#[derive(Clone, Debug, PartialEq)]
struct Part {
    values: Vec<f64>,
    count: usize,
    flag: bool,
}

impl Part {
    fn remember(&mut self, memory: &mut Memory<'_>) {
        memory.numbers(&mut self.values);
        memory.count(&mut self.count, 9);
        memory.flag(&mut self.flag);
    }
}

#[test]
fn what_is_saved_is_restored_and_nothing_else() {
    let mut part = Part { values: vec![1.5, -2.0], count: 7, flag: true };
    let mut numbers = Vec::new();
    part.remember(&mut Memory::save(&mut numbers));
    assert_eq!(numbers, [1.5, -2.0, 7.0, 1.0]);
    let empty = Part { values: vec![0.0; 2], count: 0, flag: false };
    let restored = |numbers: &[f64]| {
        let (mut other, mut memory) = (empty.clone(), Memory::restore(numbers));
        other.remember(&mut memory);
        memory.is_complete().then_some(other)
    };
    assert_eq!(restored(&numbers), Some(part));
    for wrong in [
        &numbers[..3],
        &[1.5, -2.0, 7.0, 1.0, 0.0],
        &[1.5, -2.0, 7.5, 1.0],
        &[1.5, -2.0, 10.0, 1.0],
        &[1.5, -2.0, -1.0, 1.0],
        &[1.5, -2.0, f64::NAN, 1.0],
        &[1.5, -2.0, 7.0, 2.0],
    ] {
        assert_eq!(restored(wrong), None, "{wrong:?}");
    }
}
