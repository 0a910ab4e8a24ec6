//! Numbers and times as a reader likes them, and text safe to put into HTML.

use std::fmt::Write as _;

/// A number that is not there.
pub const MISSING: &str = "–";

/// A number to `digits` significant digits: in positional notation where that is short, otherwise
/// as 3.20·10⁻⁶. Zero is 0; a value that is not finite is a dash.
pub fn significant(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return MISSING.to_owned();
    }
    if value.abs() < f64::MIN_POSITIVE {
        return "0".to_owned();
    }
    let rounded = format!("{value:.*e}", digits.saturating_sub(1));
    let (mantissa, exponent) = rounded.split_once('e').unwrap_or((&rounded, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if (-3..6).contains(&exponent) {
        let places = i32::try_from(digits).unwrap_or(17) - 1 - exponent;
        let places = usize::try_from(places).unwrap_or(0);
        return grouped(&format!("{value:.places$}"));
    }
    format!("{}·10{}", grouped(mantissa), superscript(exponent))
}

/// Like [`significant`], without zeros at the end of the fraction.
pub fn number(value: f64, digits: usize) -> String {
    let text = significant(value, digits);
    let (mantissa, power) = match text.split_once('·') {
        Some((mantissa, power)) => (mantissa, format!("·{power}")),
        None => (text.as_str(), String::new()),
    };
    let mantissa = match mantissa.contains('.') {
        true => mantissa.trim_end_matches('0').trim_end_matches('.'),
        false => mantissa,
    };
    format!("{mantissa}{power}")
}

/// A whole number, in groups of three digits.
pub fn count(value: usize) -> String {
    grouped(&value.to_string())
}

/// A duration in the unit that suits it, to three digits.
pub fn duration(seconds: f64) -> String {
    if !seconds.is_finite() {
        return MISSING.to_owned();
    }
    let size = seconds.abs();
    let (factor, unit) = match size {
        _ if size >= 7200.0 => (1.0 / 3600.0, "h"),
        _ if size >= 120.0 => (1.0 / 60.0, "min"),
        _ if size >= 1.0 => (1.0, "s"),
        _ if size >= 1e-3 => (1e3, "ms"),
        _ => (1e6, "µs"),
    };
    format!("{} {unit}", significant(seconds * factor, 3))
}

/// 10 to a power, as 10⁻³.
pub(crate) fn power_of_ten(exponent: i32) -> String {
    format!("10{}", superscript(exponent))
}

/// "a, b and c".
pub fn listed(items: &[String]) -> String {
    match items {
        [] => String::new(),
        [one] => one.clone(),
        [rest @ .., last] => format!("{} and {last}", rest.join(", ")),
    }
}

/// Text with the characters that mean something in HTML and XML replaced, and with spaces for those
/// that XML does not allow.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\n' | '\t' => out.push(c),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// Positional digits with a true minus sign, the whole part in groups of three from 10 000 on.
pub fn grouped(digits: &str) -> String {
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let (sign, whole) = match whole.strip_prefix('-') {
        Some(rest) => ("−", rest),
        None => ("", whole),
    };
    let mut out = sign.to_owned();
    for (i, c) in whole.chars().enumerate() {
        if i > 0 && whole.len() > 4 && (whole.len() - i).is_multiple_of(3) {
            out.push('\u{2009}');
        }
        out.push(c);
    }
    if !fraction.is_empty() {
        // Writing to a String cannot fail.
        let _ = write!(out, ".{fraction}");
    }
    out
}

fn superscript(exponent: i32) -> String {
    let raised = |c| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '4' => '⁴',
        '5' => '⁵',
        '6' => '⁶',
        '7' => '⁷',
        '8' => '⁸',
        '9' => '⁹',
        _ => '⁰',
    };
    exponent.to_string().chars().map(raised).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escaped_text_is_text_in_xml() {
        assert_eq!(escape("<a & \"b\">"), "&lt;a &amp; &quot;b&quot;&gt;");
        assert_eq!(escape("a\u{0}\u{1b}[1m\u{85}\u{ffff}\r\n\tb"), "a  [1m   \n\tb");
    }

    #[test]
    fn numbers_read_well() {
        assert_eq!(number(113.574, 6), "113.574");
        assert_eq!(number(0.14106, 6), "0.14106");
        assert_eq!(number(3.2e-6, 3), "3.2·10⁻⁶");
        assert_eq!(number(-0.5, 3), "−0.5");
        assert_eq!(number(123_456.0, 6), "123\u{2009}456");
        assert_eq!(number(0.0, 3), "0");
        assert_eq!(number(9.9996e5, 3), "1·10⁶");
        assert_eq!(number(f64::NAN, 3), MISSING);
        assert_eq!(significant(531.27, 6), "531.270");
        assert_eq!(significant(-2e-9, 2), "−2.0·10⁻⁹");
        assert_eq!(number(f64::INFINITY, 3), MISSING);
    }

    #[test]
    fn durations_choose_their_unit() {
        assert_eq!(duration(5.6e-6), "5.60 µs");
        assert_eq!(duration(0.0123), "12.3 ms");
        assert_eq!(duration(17.0), "17.0 s");
        assert_eq!(duration(35460.0), "9.85 h");
        // Minutes from two of them on, hours from two of them on.
        assert_eq!([119.0, 120.0].map(duration), ["119 s", "2.00 min"]);
        assert_eq!([7190.0, 7200.0].map(duration), ["120 min", "2.00 h"]);
        assert_eq!([0.99, 9.9e-4].map(duration), ["990 ms", "990 µs"]);
        assert_eq!([1.0, 1e-3].map(duration), ["1.00 s", "1.00 ms"]);
    }

    #[test]
    fn lists_end_with_and() {
        let items = ["a", "b", "c"].map(str::to_owned);
        assert_eq!(listed(&items), "a, b and c");
        assert_eq!(listed(&items[..1]), "a");
    }
}
