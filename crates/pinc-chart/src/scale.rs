//! One axis: its range, where a value lies on it, and its ticks.

use crate::text;

/// Values beyond this are no data that an axis should reach out for (and would overflow a span).
const LARGEST: f64 = 1e100;

/// The most decades that a logarithmic axis shows; what lies deeper is cut off at the bottom.
const MOST_DECADES: f64 = 14.0;

/// How an axis is divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Evenly.
    Linear,
    /// Evenly, from 0, in whole numbers.
    Count,
    /// By powers of ten. Values that are zero or negative have no place.
    Log,
}

/// An axis with its range.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    kind: Kind,
    /// The ends, as log10 on a logarithmic axis.
    low: f64,
    high: f64,
}

/// A tick at `fraction` of the axis; without a label it is a minor one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tick {
    pub fraction: f64,
    pub label: Option<String>,
}

impl Scale {
    /// An axis from exactly `low` to `high`; if these leave no room, room is made. `None` if an
    /// end has no place on it.
    pub(crate) fn exact(kind: Kind, low: f64, high: f64) -> Option<Self> {
        if !usable(kind, low) || !usable(kind, high) {
            return None;
        }
        let (low, high) = match kind {
            Kind::Log => (low.log10(), high.log10()),
            Kind::Linear | Kind::Count => (low, high),
        };
        let (low, high) = with_room(low, high);
        Some(Self { kind, low, high })
    }

    /// An axis that shows all `values` and a little more; `None` if none of them has a place on it.
    pub(crate) fn around(kind: Kind, values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.filter(|v| usable(kind, *v)).collect();
        values.sort_by(f64::total_cmp);
        let (&low, &high) = (values.first()?, values.last()?);
        let (low, high) = match kind {
            Kind::Linear => {
                let (low, high) = with_room(low, high);
                let margin = 0.04 * (high - low);
                (low - margin, high + margin)
            }
            Kind::Count => (0.0, high.max(1.0) * 1.08),
            Kind::Log => {
                // An error that crosses zero has dips as deep as one likes: the lowest half per
                // cent may be cut off.
                let typical = values[values.len() / 200].log10();
                let high = high.log10();
                let low = low.log10().max(typical - 0.5).max(high - MOST_DECADES);
                // A range of a factor of five has two ticks with labels at least.
                let decades = high - low;
                let margin = (0.04 * decades).max(0.1).max(0.5 * (0.7 - decades));
                (low - margin, high + margin)
            }
        };
        Some(Self { kind, low, high })
    }

    /// Where a value lies: 0 at the low end, 1 at the high end, beyond these outside. `None` for a
    /// value without a place.
    pub(crate) fn fraction(&self, value: f64) -> Option<f64> {
        let value = match self.kind {
            _ if !value.is_finite() => return None,
            Kind::Log if value <= 0.0 => return None,
            Kind::Log => value.log10(),
            Kind::Linear | Kind::Count => value,
        };
        Some((value - self.low) / (self.high - self.low))
    }

    /// The lowest and the highest value shown.
    pub(crate) fn range(&self) -> (f64, f64) {
        match self.kind {
            Kind::Log => (10f64.powf(self.low), 10f64.powf(self.high)),
            Kind::Linear | Kind::Count => (self.low, self.high),
        }
    }

    /// Round values along the axis, about `wanted` of them with labels.
    pub(crate) fn ticks(&self, wanted: usize) -> Vec<Tick> {
        match self.kind {
            Kind::Log => self.log_ticks(wanted),
            Kind::Linear | Kind::Count => self.linear_ticks(wanted),
        }
    }

    fn linear_ticks(&self, wanted: usize) -> Vec<Tick> {
        let mut step = nice((self.high - self.low) / wanted.max(1) as f64);
        if self.kind == Kind::Count {
            step = step.max(1.0);
        }
        let multiples = whole((self.low / step).ceil())..=whole((self.high / step).floor());
        let tick = |i: i64| {
            let value = i as f64 * step;
            Tick {
                fraction: (value - self.low) / (self.high - self.low),
                label: Some(label(value, step)),
            }
        };
        multiples.take(100).map(tick).collect()
    }

    fn log_ticks(&self, wanted: usize) -> Vec<Tick> {
        let decades = self.high - self.low;
        let every = whole((decades / wanted.max(1) as f64).ceil()).max(1);
        let mantissas: &[u8] = match decades {
            d if d < 2.0 && 3.0 * d <= 1.5 * wanted as f64 => &[1, 2, 5],
            _ => &[1],
        };
        let (low, high) = self.range();
        let plain = low >= 1e-3 && high <= 2e5;
        let mut ticks = Vec::new();
        for exponent in exponents(self.low.floor(), self.high.ceil()) {
            for mantissa in 1..=9u8 {
                let fraction =
                    (f64::from(exponent) + f64::from(mantissa).log10() - self.low) / decades;
                let labelled = mantissas.contains(&mantissa) && i64::from(exponent) % every == 0;
                let shown = (0.0..=1.0).contains(&fraction) && (labelled || decades < 10.0);
                if shown {
                    let label = labelled.then(|| log_label(mantissa, exponent, plain));
                    ticks.push(Tick { fraction, label });
                }
            }
        }
        ticks
    }
}

fn usable(kind: Kind, value: f64) -> bool {
    value.is_finite() && value.abs() < LARGEST && (kind != Kind::Log || value > 0.0)
}

/// Widens a range that is empty, or too narrow for ticks to be told apart.
fn with_room(low: f64, high: f64) -> (f64, f64) {
    let size = low.abs().max(high.abs());
    if high - low > 1e-9 * size {
        return (low, high);
    }
    let room = if size > 0.0 { 0.1 * size } else { 1.0 };
    (low - room, high + room)
}

/// The round step (1, 2 or 5 times a power of ten) nearest to `rough`, by ratio.
fn nice(rough: f64) -> f64 {
    let power = 10f64.powf(rough.log10().floor());
    let digit = rough / power;
    let rounded = match digit {
        d if d <= 1.4 => 1.0,
        d if d <= 3.2 => 2.0,
        d if d <= 7.1 => 5.0,
        _ => 10.0,
    };
    rounded * power
}

/// A linear tick's label, to the digits that the step needs.
fn label(value: f64, step: f64) -> String {
    let places = -(step.log10() + 1e-9).floor();
    if value.abs() >= 1e6 || places > 4.0 {
        let digits = value.abs().max(step).log10().floor() + places + 1.0;
        return text::significant(value, whole_size(digits));
    }
    text::grouped(&format!("{value:.*}", whole_size(places)))
}

fn log_label(mantissa: u8, exponent: i32, plain: bool) -> String {
    match (plain, mantissa) {
        (true, _) => text::number(f64::from(mantissa) * 10f64.powi(exponent), 1),
        (false, 1) => text::power_of_ten(exponent),
        (false, _) => format!("{mantissa}·{}", text::power_of_ten(exponent)),
    }
}

fn exponents(low: f64, high: f64) -> std::ops::RangeInclusive<i32> {
    let exponent = |value: f64| i32::try_from(whole(value)).unwrap_or(0);
    exponent(low)..=exponent(high)
}

#[expect(clippy::cast_possible_truncation, reason = "a cast of a number out of range saturates")]
fn whole(value: f64) -> i64 {
    value as i64
}

fn whole_size(value: f64) -> usize {
    usize::try_from(whole(value)).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: &Scale, wanted: usize) -> Vec<String> {
        let ticks = scale.ticks(wanted);
        ticks.into_iter().filter_map(|t| t.label).collect()
    }

    #[test]
    fn linear_ticks_are_round() {
        let scale = Scale::exact(Kind::Linear, 0.0, 60.0).unwrap();
        assert_eq!(labels(&scale, 6), ["0", "10", "20", "30", "40", "50", "60"]);
        let scale = Scale::exact(Kind::Linear, -1.0, 1.0).unwrap();
        assert_eq!(labels(&scale, 4), ["−1.0", "−0.5", "0.0", "0.5", "1.0"]);
        let scale = Scale::exact(Kind::Linear, 0.141_058_9, 0.141_060_9).unwrap();
        assert_eq!(labels(&scale, 4), ["0.1410590", "0.1410595", "0.1410600", "0.1410605"]);
        let scale = Scale::exact(Kind::Linear, 0.0, 20_000.0).unwrap();
        assert_eq!(labels(&scale, 2), ["0", "10\u{2009}000", "20\u{2009}000"]);
    }

    #[test]
    fn no_two_ticks_have_the_same_label() {
        let sizes = [1e-12, 3e-7, 2.5e-3, 0.07, 1.0, 45.0, 9.9e4, 3e8];
        for (low, size) in [-113.5, 0.0, 0.1410589, 7.0, 4321.0, 1e7]
            .into_iter()
            .flat_map(|low| sizes.map(|size| (low, size)))
        {
            for (kind, wanted) in
                [(Kind::Linear, 4), (Kind::Linear, 8), (Kind::Log, 4), (Kind::Log, 8)]
            {
                let Some(scale) = Scale::exact(kind, low, low + size) else { continue };
                let mut seen = labels(&scale, wanted);
                let count = seen.len();
                seen.sort();
                seen.dedup();
                assert_eq!(seen.len(), count, "{kind:?} from {low} over {size}: {seen:?}");
            }
        }
    }

    #[test]
    fn log_ticks_are_decades_or_one_two_five() {
        let scale = Scale::around(Kind::Log, [1e-6, 1.0].into_iter()).unwrap();
        assert_eq!(labels(&scale, 4), ["10⁻⁶", "10⁻⁴", "10⁻²", "10⁰"]);
        let scale = Scale::around(Kind::Log, [3.0, 12.0].into_iter()).unwrap();
        assert_eq!(labels(&scale, 4), ["5", "10"]);
        let scale = Scale::around(Kind::Log, [3.55e-8].into_iter()).unwrap();
        assert_eq!(labels(&scale, 4), ["2·10⁻⁸", "5·10⁻⁸"]);
    }

    #[test]
    fn values_without_a_place_are_named() {
        let values = [f64::NAN, -1.0, 0.0, f64::INFINITY, 1e-3, 1e-1];
        let scale = Scale::around(Kind::Log, values.into_iter()).unwrap();
        for value in &values[..4] {
            assert_eq!(scale.fraction(*value), None);
        }
        let inside = scale.fraction(1e-2).unwrap();
        assert!((inside - 0.5).abs() < 1e-12, "halfway between the ends");
        assert!(Scale::around(Kind::Log, [-1.0, 0.0].into_iter()).is_none());
        assert!(Scale::around(Kind::Linear, [f64::NAN].into_iter()).is_none());
    }

    #[test]
    fn a_constant_gets_room() {
        for value in [0.0, 5.0, -3e-9, 1e12] {
            let scale = Scale::around(Kind::Linear, [value, value].into_iter()).unwrap();
            let at = scale.fraction(value).unwrap();
            assert!((at - 0.5).abs() < 1e-6, "{value} lies at {at}");
            let ticks = scale.ticks(5).len();
            assert!((2..=12).contains(&ticks), "{value} has {ticks} ticks");
        }
    }

    #[test]
    fn a_dip_to_nothing_does_not_stretch_a_log_axis() {
        let values = (0..1000).map(|i| if i == 500 { 1e-300 } else { 1e-3 });
        let (low, _) = Scale::around(Kind::Log, values).unwrap().range();
        assert!(low > 1e-4, "the axis starts at {low}");
    }

    #[test]
    fn counts_start_at_zero_in_whole_steps() {
        let scale = Scale::around(Kind::Count, [2.0, 3.0].into_iter()).unwrap();
        assert_eq!(labels(&scale, 8), ["0", "1", "2", "3"]);
    }

    /// Only half a per cent of the values may lie below a logarithmic axis.
    #[test]
    fn a_logarithmic_axis_keeps_what_is_not_rare() {
        let values = |small: usize| {
            let small = std::iter::repeat_n(1e-3, small);
            small.chain((0..390).map(|i| 1.0 + f64::from(i) / 100.0))
        };
        let low = |small: usize| Scale::around(Kind::Log, values(small)).unwrap().range().0;
        assert!(low(10) < 1e-3, "{}", low(10));
        assert!(low(1) > 0.1, "{}", low(1));
    }

    /// Fourteen decades are as many as an axis has; values beyond 1e100 have no place.
    #[test]
    fn an_axis_has_fourteen_decades_at_most() {
        let (low, high) = Scale::around(Kind::Log, [1e-40, 1.0].into_iter()).unwrap().range();
        assert!((1e-15..1e-14).contains(&low) && (1.0..10.0).contains(&high), "{low} {high}");
        for kind in [Kind::Linear, Kind::Log] {
            assert!(Scale::exact(kind, 1.0, 1.1e100).is_none());
            assert!(Scale::exact(kind, 1.0, 0.9e100).is_some());
        }
        assert!(Scale::exact(Kind::Linear, -1.1e100, 1.0).is_none());
    }

    /// Fewer than ten decades have ticks for 2 to 9 as well, without labels: nine between decades.
    #[test]
    fn minor_ticks_are_between_decades() {
        let ticks = Scale::exact(Kind::Log, 1.0, 1e4).unwrap().ticks(4);
        assert_eq!(ticks.len(), 4 * 9 + 1);
        assert_eq!(ticks.iter().filter(|tick| tick.label.is_some()).count(), 5);
        let two = ticks[1].fraction;
        assert!((two - 0.25 * 2.0_f64.log10()).abs() < 1e-12 && ticks[1].label.is_none());
        let ticks = Scale::exact(Kind::Log, 1.0, 1e12).unwrap().ticks(4);
        assert!(ticks.iter().all(|tick| tick.label.is_some()), "{ticks:?}");
    }
}
