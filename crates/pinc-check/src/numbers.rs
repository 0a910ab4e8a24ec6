//! Numbers and times as text.

/// Names with their values, as "h1 = 9.16, h2 = 14.2".
pub(crate) fn named<'n>(names: impl Iterator<Item = &'n str>, values: &[f64]) -> String {
    let pairs = names.zip(values).map(|(name, value)| format!("{name} = {}", short(*value)));
    pairs.collect::<Vec<_>>().join(", ")
}

/// A number with five digits.
pub(crate) fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        size if (1e-3..1e5).contains(&size) => {
            let text = format!("{value:.5}");
            let mut text = text[..text.len().min(if value < 0.0 { 8 } else { 7 })].to_owned();
            if text.contains('.') {
                text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
            }
            text
        }
        _ => format!("{value:.3e}"),
    }
}

/// A number with its unit.
pub(crate) fn with_unit(value: f64, unit: &str) -> String {
    format!("{} {unit}", short(value)).trim_end().to_owned()
}

/// The least and the largest of some values.
pub(crate) fn ends(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

/// Two numbers with as many digits as tell them apart.
pub(crate) fn apart(one: f64, other: f64) -> (String, String) {
    for digits in 4..17 {
        let shown = [one, other].map(|v| format!("{v:.digits$e}").parse().unwrap_or(v));
        let difference: f64 = shown[0] - shown[1];
        let real = one - other;
        // The difference is right to a tenth of itself.
        if (difference - real).abs() <= 0.1 * real.abs() {
            return (shown[0].to_string(), shown[1].to_string());
        }
    }
    (one.to_string(), other.to_string())
}

/// A rate, or a part of one.
pub(crate) fn rate(value: f64) -> String {
    if value == 0.0 || (1e-2..1e5).contains(&value.abs()) {
        format!("{value:.4}")
    } else {
        format!("{value:.3e}")
    }
}
