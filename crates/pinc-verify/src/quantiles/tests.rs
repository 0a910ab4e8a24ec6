use super::*;

/// Of 10 values the median is below the ninth with a probability of 1 - 11 / 1024.
#[test]
fn bounds_of_the_median_of_ten() {
    let values: Vec<f64> = (1..=10).rev().map(f64::from).collect();
    let bound = |confidence| quantile_bound(values.clone(), 0.5, confidence);
    assert_eq!(bound(0.989), Some(9.0));
    assert_eq!(bound(0.9895), Some(10.0));
    assert_eq!(bound(0.9999), None);
    assert_eq!(quantile_bound(vec![1.0, f64::INFINITY], 0.5, 0.6), None);
    assert_eq!(quantile_bound(Vec::new(), 0.5, 0.5), None);
    // With 459 values the largest is above the 0.99 quantile with 99 % confidence, with 458 it
    // is not known to be.
    let of = |n: u32| quantile_bound((0..n).map(f64::from).collect(), 0.99, 0.99);
    assert_eq!((of(458), of(459)), (None, Some(458.0)));
}
