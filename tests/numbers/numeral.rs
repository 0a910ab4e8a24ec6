//! Numerals in text: where they stand, what they are worth, and to how many digits.

use std::ops::Range;

/// A numeral in a text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Numeral {
    /// Its place in the text, with its sign.
    pub(crate) span: Range<usize>,
    /// Its value.
    pub(crate) value: f64,
    /// Digits behind the point.
    pub(crate) decimals: usize,
    /// The digits of its exponent, if it has one.
    pub(crate) exponent: Option<usize>,
}

impl Numeral {
    /// Half of what one unit of its last digit is worth, or of the last digit that `value` would be
    /// written with, which is worth less below a power of ten.
    pub(crate) fn half_unit(&self, value: f64) -> f64 {
        let power = match self.exponent {
            Some(_) => [self.value, value].into_iter().filter(|v| *v != 0.0).map(decade).min(),
            None => None,
        };
        let power = power.unwrap_or(0);
        let decimals = i32::try_from(self.decimals).expect("few digits");
        0.5 * 10f64.powi(power - decimals)
    }

    /// Another value written as this one is.
    pub(crate) fn written(&self, value: f64, text: &str) -> String {
        let sign = if text[self.span.clone()].starts_with('+') && value >= 0.0 { "+" } else { "" };
        let Some(digits) = self.exponent else { return format!("{sign}{value:.*}", self.decimals) };
        let plain = format!("{value:.*e}", self.decimals);
        let (mantissa, exponent) = plain.split_once('e').expect("an exponent");
        let exponent: i32 = exponent.parse().expect("a number");
        let minus = match (exponent < 0, text[self.span.clone()].contains("e+")) {
            (true, _) => "-",
            (false, true) => "+",
            (false, false) => "",
        };
        format!("{sign}{mantissa}e{minus}{:0digits$}", exponent.abs())
    }

    /// Whether results are written like this: with a point, with an exponent, or with a unit of
    /// time, memory or ratio behind it.
    pub(crate) fn is_result(&self, text: &str) -> bool {
        let behind = text[self.span.end..].trim_start();
        let units = ["%", "us", "ms", "ns", "µs", "times", "MB"];
        let unit = |unit: &str| {
            let rest = behind.strip_prefix(unit);
            rest.is_some_and(|rest| !rest.starts_with(char::is_alphanumeric))
        };
        self.decimals > 0 || self.exponent.is_some() || units.iter().any(|of| unit(of))
    }
}

/// The power of ten of a number's first digit.
fn decade(value: f64) -> i32 {
    let text = format!("{value:e}");
    text.split_once('e').and_then(|(_, power)| power.parse().ok()).expect("an exponent")
}

/// The numerals of a text. Digits in names (RK4, x1, 4x20) and in dates are none.
pub(crate) fn numerals(text: &str) -> Vec<Numeral> {
    let bytes = text.as_bytes();
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let Some(end) = word_end(bytes, at) else {
            at += 1;
            continue;
        };
        found.extend(numeral(text, at, end));
        at = end;
    }
    found
}

/// The end of what begins with a digit here, letters and points within it included.
fn word_end(bytes: &[u8], at: usize) -> Option<usize> {
    let within = |b: u8| b.is_ascii_alphanumeric() || matches!(b, b'_' | b'^') || !b.is_ascii();
    let joined = |k: usize| bytes[k] == b'.' && bytes.get(k + 1).is_some_and(u8::is_ascii_digit);
    let inside = at > 0 && (within(bytes[at - 1]) || joined(at - 1));
    if !bytes[at].is_ascii_digit() || inside {
        return None;
    }
    let signed = |k: usize| {
        matches!(bytes[k], b'-' | b'+')
            && matches!(bytes[k - 1], b'e')
            && bytes.get(k + 1).is_some_and(u8::is_ascii_digit)
    };
    let mut end = at;
    while end < bytes.len() && (within(bytes[end]) || joined(end) || (end > at && signed(end))) {
        end += 1;
    }
    // Groups of three digits.
    let group = |from: usize| {
        let digits = bytes.get(from + 1..from + 4)?;
        let closed = bytes.get(from + 4).is_none_or(|b| !within(*b) && *b != b'.');
        (bytes[from] == b' ' && closed && digits.iter().all(u8::is_ascii_digit)).then_some(from + 4)
    };
    let short = end - at <= 3 && bytes[at..end].iter().all(u8::is_ascii_digit);
    while short && end < bytes.len() {
        let Some(next) = group(end) else { break };
        end = next;
    }
    Some(end)
}

fn numeral(text: &str, start: usize, end: usize) -> Option<Numeral> {
    let bytes = text.as_bytes();
    let is_date = |at: usize| {
        bytes.get(at) == Some(&b'-') && bytes.get(at + 1).is_some_and(u8::is_ascii_digit)
    };
    let digits: String = text[start..end].chars().filter(|c| *c != ' ').collect();
    let value: f64 = digits.parse().ok()?;
    let in_word = |at: usize| bytes[at].is_ascii_alphanumeric() || bytes[at] == b'-';
    let sign = start.checked_sub(1).filter(|at| matches!(bytes[*at], b'-' | b'+'));
    let joined = sign.is_some_and(|at| at > 0 && in_word(at - 1));
    if joined || is_date(end) {
        return None;
    }
    let (mantissa, exponent) = match digits.split_once('e') {
        Some((mantissa, power)) => (mantissa, Some(power.trim_start_matches(['-', '+']).len())),
        None => (digits.as_str(), None),
    };
    let decimals = mantissa.split_once('.').map_or(0, |(_, behind)| behind.len());
    let negative = sign.is_some_and(|at| bytes[at] == b'-');
    let value = if negative { -value } else { value };
    Some(Numeral { span: sign.unwrap_or(start)..end, value, decimals, exponent })
}

/// How a published number must agree with what its command gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rule {
    /// To the printed digits on every machine.
    Digits,
    /// A result with a trained net: to the printed digits where the net is rounded as in the docs,
    /// elsewhere within 1 %.
    Net,
    /// An error of a trained net: likewise, elsewhere within a factor of 3.
    Error,
    /// The decimal logarithm of such an error: likewise, elsewhere within half a decade.
    Log,
}

impl Rule {
    /// Whether `printed` may stand for `value`.
    pub(crate) fn holds(self, printed: &Numeral, value: f64, rounds_alike: bool) -> bool {
        let digits = (printed.value - value).abs() <= printed.half_unit(value) * (1.0 + 1e-6);
        match self {
            Self::Digits => digits,
            _ if rounds_alike => digits,
            Self::Net => digits || (printed.value - value).abs() <= 0.01 * value.abs(),
            Self::Log => digits || (printed.value - value).abs() <= 0.5,
            Self::Error => digits || (1.0 / 3.0..=3.0).contains(&(printed.value / value)),
        }
    }

    /// A number near `value` that this rule does not let stand for it.
    pub(crate) fn wrong(self, printed: &Numeral, value: f64, rounds_alike: bool) -> f64 {
        let unit = 2.0 * printed.half_unit(printed.value);
        match self {
            Self::Net if !rounds_alike => printed.value.max(value) * 1.03 + unit,
            Self::Error if !rounds_alike => printed.value.max(value) * 10.0 + unit,
            Self::Log if !rounds_alike => printed.value.max(value) + 1.0,
            Self::Digits | Self::Net | Self::Error | Self::Log => printed.value + unit,
        }
    }
}

pub(crate) fn check_itself() {
    let shown = |text: &str| numerals(text).into_iter().map(|n| n.value).collect::<Vec<_>>();
    assert_eq!(
        shown("RK4 x1, 4x20, x2: 1.5e-07 and -3 %, 101 000 of 12"),
        [1.5e-7, -3.0, 101_000.0, 12.0]
    );
    assert_eq!(
        shown("2026-11-21, h1, 3.2033 +- 0.0129, +69.75 %, 0.3"),
        [3.2033, 0.0129, 69.75, 0.3]
    );
    let one = |text: &str| numerals(text).remove(0);
    assert!((one("1.5e-07").half_unit(1.5e-7) - 5e-9).abs() < 1e-20);
    assert!((one("283.23").half_unit(283.23) - 5e-3).abs() < 1e-15);
    assert_eq!(one("1.5e-07").written(2.345e-9, "1.5e-07"), "2.3e-09");
    assert_eq!(one("+1.50").written(2.0, "+1.50"), "+2.00");
    let exact = |printed: &str, value| Rule::Digits.holds(&one(printed), value, false);
    assert!(exact("283.23", 283.2349) && !exact("283.23", 283.2352) && !exact("283.23", -283.23));
    assert!(exact("1.0e-4", 9.96e-5) && !exact("1.0e-4", 9.94e-5) && exact("9.9e-5", 9.94e-5));
    let near = |rule: Rule, value, alike| rule.holds(&one("1.00"), value, alike);
    assert!(
        near(Rule::Net, 1.009, false)
            && !near(Rule::Net, 1.02, false)
            && !near(Rule::Net, 1.009, true)
    );
    assert!(
        near(Rule::Error, 2.9, false)
            && !near(Rule::Error, 3.1, false)
            && !near(Rule::Error, 1.1, true)
    );
}
