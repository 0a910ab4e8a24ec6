//! Tests of zooming.

use super::{STEMS, build, whole, write};
use std::fmt::Write as _;

#[test]
fn curves_can_be_zoomed_and_bring_the_licence_of_what_draws_them() {
    let html = build(whole().path()).unwrap();
    assert_eq!(html.matches("<script type=\"application/json\">").count(), STEMS.len());
    assert_eq!(html.matches("Permission is hereby granted").count(), 1);
    assert!(html.contains("Copyright (c) 2022 Leon Sorokin"));
    // Whatever names there are, no word of the data ends its element: the scripts are 5 with data
    // and 2 that run.
    assert_eq!(html.matches("</script>").count(), STEMS.len() + 2);
}

#[test]
fn a_hundred_thousand_rows_make_no_heavy_page() {
    let dir = whole();
    // All that is drawn is noise, which nothing compresses.
    let noise = |i: u32, of: f64| (f64::from(i) * of).sin() * (f64::from(i) * 0.37 * of).cos();
    for (model, of) in [("pinc", 12.9898), ("rk4", 78.233)] {
        let mut text = "t,a,b,c,u,a_ref,b_ref\n".to_owned();
        for i in 0..100_000 {
            let [a, b, c] = [1.0, 1.1, 1.3].map(|factor| noise(i, factor * of));
            let _ = writeln!(text, "{},{a},{b},{c},{a},1,0", f64::from(i) / 18.0);
        }
        write(&dir, &format!("control-{model}.csv"), &text);
    }
    let size = build(dir.path()).unwrap().len();
    assert!(size < 2_000_000, "{size} bytes");
}
