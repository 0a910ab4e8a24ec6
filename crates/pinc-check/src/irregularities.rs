//! Poles, jumps and kinks of the equation in the region and a little beyond, and what to write
//! instead.

use crate::{Finding, Subject, rest, short};
use pinc_analysis::{Crossing, Irregularity, IrregularityKind, Survey, Term, Terms, crossings};
use pinc_config::PlantSpec;
use pinc_expr::{CriticalTerm, CriticalTerms, LoneTerm, TermRole};
use std::collections::BTreeSet;

/// How far beyond the region is looked, in its widths: predictions leave the box by a little.
const MARGIN: f64 = 0.15;

/// A rate this many times its usual size, beside a place where a denominator is 0, shows a pole.
const HUGE: f64 = 1e3;

/// How far beside, in widths.
const BESIDE: f64 = 1e-6;

/// How far beyond a place a term is looked at, of the way there from the middle, and random points.
const FURTHER: f64 = 0.01;
const POINTS: usize = 1000;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let seed = subject.experiment.seed;
    let survey = Survey::run(subject.plant, &subject.region, MARGIN, seed);
    let equations = subject.experiment.plant.equations();
    let terms = equations.and_then(|equations| equations.critical_terms().ok());
    let named = terms.as_ref().map_or_else(Vec::new, |terms| of_terms(subject, &survey, terms));
    let broken = |kind| matches!(kind, IrregularityKind::Pole | IrregularityKind::Undefined);
    let is_named = !named.is_empty();
    let mut findings = named;
    let mut seen: Vec<(IrregularityKind, String)> = Vec::new();
    let variables = subject.plant.states().iter().chain(subject.plant.inputs());
    let variables: Vec<String> = variables.map(|variable| pattern(&variable.name)).collect();
    for found in &survey.irregularities {
        let key = (found.kind, variables[found.variable].clone());
        if seen.contains(&key) || (broken(found.kind) && is_named) {
            continue;
        }
        // What is not finite in the box has been said where derivatives are examined.
        if found.kind == IrregularityKind::Undefined && found.is_inside {
            continue;
        }
        seen.push(key);
        findings.push(of_survey(subject, terms.as_ref(), found));
    }
    findings.extend(terms.as_ref().and_then(|terms| rest::examine(subject, terms)));
    findings
}

/// Where a place is, against the region.
fn whereabouts(subject: &Subject<'_>, is_inside: bool) -> String {
    if is_inside {
        format!("inside {}", subject.region_name)
    } else {
        format!("just outside {}", subject.region_name)
    }
}

/// An error inside the region, a warning beside it.
fn serious(is_inside: bool, place: String, what: String) -> Finding {
    if is_inside { Finding::error(place, what) } else { Finding::warning(place, what) }
}

/// The key of the equation in which a term stands, as far as the config has it.
pub(crate) fn key_of(subject: &Subject<'_>, term: &CriticalTerm) -> String {
    match &subject.experiment.plant {
        PlantSpec::Expression(_) => format!("plant.expression.{}", term.key),
        plant => format!("plant.{}", plant.name()),
    }
}

/// Poles and the ends of functions, from the terms of the equations.
fn of_terms(subject: &Subject<'_>, survey: &Survey, terms: &CriticalTerms) -> Vec<Finding> {
    let found = crossings(&Each(terms), &subject.region, MARGIN, subject.experiment.seed);
    let mut findings = Vec::new();
    let mut seen = BTreeSet::new();
    for (i, (term, crossing)) in terms.list().iter().zip(found.found).enumerate() {
        let Some(crossing) = crossing else { continue };
        // One element of an array is enough: the first.
        if !seen.insert((pattern(&term.key), pattern(&term.text))) {
            continue;
        }
        let function = match term.role {
            TermRole::Kink | TermRole::Jump | TermRole::Switch => continue,
            TermRole::Denominator if !is_pole(subject, survey, &crossing) => continue,
            TermRole::Denominator => format!("the denominator {}", term.text),
            TermRole::Radicand => format!("sqrt({})", term.text),
            TermRole::Logarithm => format!("log({})", term.text),
            TermRole::Base => format!("a power of {}", term.text),
        };
        let is_root = matches!(term.role, TermRole::Radicand | TermRole::Base);
        let problem = match term.role {
            TermRole::Denominator => format!("{function} is 0 at"),
            // What is defined on both sides may have a kink there, which the survey finds.
            _ if is_root && !becomes_negative(subject, &terms.alone(i), &crossing) => continue,
            _ => format!("{function} is not defined beyond"),
        };
        let place = key_of(subject, term);
        let where_it_is = whereabouts(subject, crossing.is_inside);
        let what = format!("{problem} {}, {where_it_is}", subject.at(&crossing.before));
        findings.push(
            serious(crossing.is_inside, place, what)
                .because(
                    "a net cannot follow a rate that grows without limit: it is wrong there \
                 and in a neighbourhood, which the loss hardly shows",
                )
                .change(instead(subject, terms, i, term, &crossing)),
        );
    }
    if found.left_out > 0 {
        let (count, all) = (found.left_out, terms.list().len());
        let what = format!("{count} of {all} divisors and arguments of functions not looked at");
        findings.push(Finding::fact("plant", format!("{what}: those before them took too long")));
    }
    findings
}

/// The terms of equations, of which each is computed by itself.
struct Each<'a>(&'a CriticalTerms);

impl Terms for Each<'_> {
    fn values(&self, at: &[f64]) -> Vec<f64> {
        self.0.values(at)
    }

    fn alone(&self, i: usize) -> Term<'_> {
        let term = self.0.alone(i);
        let (variables, operations) = (Some(term.variables().to_vec()), term.operations());
        Term { value: Box::new(move |at| term.value(at)), variables, operations }
    }
}

/// A text with all indices of elements of arrays alike.
fn pattern(text: &str) -> String {
    let mut pieces = text.split('[');
    let first = pieces.next().unwrap_or_default().to_owned();
    pieces.fold(first, |pattern, piece| {
        pattern + "[" + piece.trim_start_matches(|c: char| c.is_ascii_digit())
    })
}

/// Whether a term is negative beyond the place where it becomes 0, and not 0 from there on.
fn becomes_negative(subject: &Subject<'_>, term: &LoneTerm<'_>, crossing: &Crossing) -> bool {
    let (centre, behind) = (subject.region.centre().joined(), crossing.behind.joined());
    let further = centre.iter().zip(&behind).map(|(from, to)| to + FURTHER * (to - from)).collect();
    let wide = subject.region.enlarged(MARGIN);
    let random = wide.points(subject.experiment.seed).take(POINTS).map(|point| point.joined());
    std::iter::once(further).chain(random).any(|at: Vec<f64>| term.value(&at) < 0.0)
}

/// Whether the rates are huge beside the place, or not finite: a quotient may have a limit.
fn is_pole(subject: &Subject<'_>, survey: &Survey, crossing: &Crossing) -> bool {
    let place = crossing.before.joined();
    (0..place.len()).any(|k| {
        [-BESIDE, BESIDE].into_iter().any(|by| {
            let mut beside = place.clone();
            beside[k] += by * subject.region.width(k);
            let beside = subject.region.split(beside);
            let rates = subject.rhs(&beside.x, &beside.u);
            let mut pairs = rates.iter().zip(&survey.usual_rates);
            pairs.any(|(rate, usual)| {
                !rate.is_finite() || rate.abs() > HUGE * usual.max(f64::MIN_POSITIVE)
            })
        })
    })
}

/// What to write: a variable that is kept in the box, if that is enough, or else the term.
fn instead(
    subject: &Subject<'_>,
    terms: &CriticalTerms,
    i: usize,
    term: &CriticalTerm,
    crossing: &Crossing,
) -> String {
    let away = "keep [domain] away from there, or write the equation so that it is defined there";
    if !matches!(subject.experiment.plant, PlantSpec::Expression(_) | PlantSpec::Own(_)) {
        return "keep [domain] and the bounds away from there".to_owned();
    }
    let (before, behind) = (crossing.before.joined(), crossing.behind.joined());
    let region = &subject.region;
    let alone = terms.alone(i);
    let sign = alone.value(&region.centre().joined()).signum();
    let names = subject.plant.states().iter().chain(subject.plant.inputs());
    for (k, variable) in names.enumerate() {
        let (low, high) = (region.low[k], region.high[k]);
        let below = before[k] < low;
        if !below && before[k] <= high {
            continue;
        }
        // 0 is a physical limit more often than the end of a box is.
        let zero = (below && low > 0.0) || (!below && high < 0.0);
        let ends = [zero.then_some(0.0), Some(if below { low } else { high })];
        for end in ends.into_iter().flatten() {
            let mut guarded = behind.clone();
            guarded[k] = end;
            if alone.value(&guarded) * sign > 0.0 {
                let (name, function) = (&variable.name, if below { "max" } else { "min" });
                return format!("write {function}({name}, {}) for {name} in it", short(end));
            }
        }
    }
    match term.role {
        TermRole::Radicand | TermRole::Base => format!("write max({}, 0) there", term.text),
        TermRole::Logarithm => {
            format!("write max({}, 1e-6) there, or what is small in its unit", term.text)
        }
        TermRole::Denominator | TermRole::Kink | TermRole::Jump | TermRole::Switch => {
            away.to_owned()
        }
    }
}

fn of_survey(
    subject: &Subject<'_>,
    terms: Option<&CriticalTerms>,
    found: &Irregularity,
) -> Finding {
    let rate = format!("{}'", subject.plant.states()[found.state].name);
    let place = subject.at(&found.sides[0]);
    let where_it_is = whereabouts(subject, found.is_inside);
    let guard = "guard the division or the function by max or min, or keep [domain] and the \
     bounds away from it";
    let because = "a net cannot follow a rate that grows without limit: it is wrong there and in \
     a neighbourhood, which the loss hardly shows";
    let finding = |what| serious(found.is_inside, "plant".to_owned(), what);
    match found.kind {
        IrregularityKind::Pole => finding(format!("{rate} has a pole at {place}, {where_it_is}"))
            .because(because)
            .change(guard),
        IrregularityKind::Undefined => {
            finding(format!("{rate} is finite up to {place}, {where_it_is}, and not beyond"))
                .because("within a step the state may get there, and then there is no solution")
                .change(guard)
        }
        IrregularityKind::Jump => {
            let what = format!(
                "{rate} jumps at {place}{}",
                switch((subject, terms), found, TermRole::Jump)
            );
            Finding::warning("plant", what)
                .because(
                    "a net is smooth and rounds it off, and integrators lose their order \
                 there",
                )
                .change(
                    "write a steep smooth function, as tanh(x/width) for sign(x), with a \
                 width that matters to nobody",
                )
        }
        IrregularityKind::Kink => {
            let what = format!(
                "the derivative of {rate} jumps at {place}{}",
                switch((subject, terms), found, TermRole::Kink)
            );
            Finding::warning("plant", what)
                .because(
                    "a net is smooth and rounds it off: its error falls slowly with its size \
                 there",
                )
                .change(
                    "write a smooth function, as sqrt(x^2 + width^2) for abs(x), if the kink \
                 is not physical",
                )
        }
    }
}

/// The term that switches between the two sides, if the equations are known.
fn switch(
    (subject, terms): (&Subject<'_>, Option<&CriticalTerms>),
    found: &Irregularity,
    role: TermRole,
) -> String {
    let Some(terms) = terms else { return String::new() };
    let [one, other] = found.sides.each_ref().map(|side| terms.values(&side.joined()));
    let mut pairs = terms.list().iter().zip(one.iter().zip(&other));
    let switches = |of: TermRole| of == role || of == TermRole::Switch;
    let found = pairs.find(|(term, (a, b))| switches(term.role) && *a * *b <= 0.0);
    found.map_or_else(String::new, |(term, _)| {
        format!(" ({}: {} changes sign)", key_of(subject, term), term.text)
    })
}
