//! Checks that the algebraic equations have one root all over the region.

use crate::numbers::ends;
use crate::{Finding, Subject, named, short};
use pinc_analysis::OperatingPoint;
use pinc_config::PlantSpec;
use pinc_expr::{AlgebraicEquations, AlgebraicRoot};

/// Random points of the region; the special ones come on top.
const POINTS: usize = 1000;

/// At so many of them other roots are looked for.
const WITH_SEARCH: usize = 50;

/// Places in the boxes from which they are: points of low discrepancy, and the corners.
const STARTS: u32 = 16;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let PlantSpec::Expression(equations) = &subject.experiment.plant else { return Vec::new() };
    let Ok(Some(equations)) = equations.algebraic_equations() else { return Vec::new() };
    let mut points = subject.region.special_points();
    points.extend(subject.region.points(subject.experiment.seed).take(POINTS));
    // Where there is no root, the examination of values and derivatives says so.
    let solved = points.into_iter().filter_map(|point| {
        let root = equations.solve(&point.joined()).ok()?;
        Some((point, root))
    });
    let solved = solved.collect();
    let roots = Roots { subject, equations, solved };
    [roots.ranges(), roots.singular(), roots.several()].into_iter().flatten().collect()
}

/// The equations with their roots at points of the region.
struct Roots<'a> {
    subject: &'a Subject<'a>,
    equations: AlgebraicEquations,
    solved: Vec<(OperatingPoint, AlgebraicRoot)>,
}

impl Roots<'_> {
    /// What the unknowns are in the region.
    fn ranges(&self) -> Option<Finding> {
        self.solved.first()?;
        let range = |(i, name): (usize, &String)| {
            let (low, high) = ends(self.solved.iter().map(|(_, root)| root.values[i]));
            format!("{name} from {} to {}", short(low), short(high))
        };
        let ranges: Vec<_> = self.equations.names().iter().enumerate().map(range).collect();
        let (name, ranges) = (self.subject.region_name, ranges.join(", "));
        Some(Finding::fact("", format!("algebraic variables in {name}: {ranges}")))
    }

    /// Two points between which dg/dz is singular or the root jumps: its determinant has two signs.
    fn singular(&self) -> Option<Finding> {
        let (first, root) = self.solved.first()?;
        let differs = |(_, other): &&(OperatingPoint, AlgebraicRoot)| other.signs != root.signs;
        let (second, other) = self.solved.iter().find(differs)?;
        let mut pairs = root.signs.iter().zip(&other.signs).zip(self.equations.systems());
        let (_, system) = pairs.find(|((a, b), _)| a.total_cmp(b).is_ne())?;
        let [one, other] = [first, second].map(|point| self.subject.at(point));
        let what = format!(
            "the derivative of {system} by its unknowns is singular somewhere between {one} and \
             {other}: its determinant changes sign"
        );
        let finding = Finding::error(format!("plant.expression.{system}"), what).because(
            "there the equations do not determine the algebraic variables (the index is not 1): the \
             root ends or jumps to another, and no model is accurate beside it",
        );
        Some(finding.change(
            "choose box and start of the unknowns so that one root is followed all over [domain], or \
             keep [domain] away from where it ends",
        ))
    }

    /// A point with two roots in the box.
    fn several(&self) -> Option<Finding> {
        let count = self.equations.names().len();
        let starts: Vec<Vec<f64>> = (1..=STARTS).map(|k| place_in_box(k, count)).collect();
        for (point, root) in self.solved.iter().take(WITH_SEARCH) {
            let Some(other) = self.equations.another_root(&point.joined(), &starts) else {
                continue;
            };
            let names = other.iter().map(|(name, _)| name.as_str());
            let other_values: Vec<f64> = other.iter().map(|(_, value)| *value).collect();
            let taken: Vec<f64> = other
                .iter()
                .filter_map(|(name, _)| {
                    self.equations.names().iter().position(|known| known == name)
                })
                .map(|i| root.values[i])
                .collect();
            let what = format!(
                "several roots at {}: {}, which the plant takes, and {}",
                self.subject.at(point),
                named(names.clone(), &taken),
                named(names.clone(), &other_values),
            );
            let keys: Vec<_> = names.map(|name| format!("algebraic.{name}")).collect();
            let finding = Finding::warning(format!("plant.expression.{}", keys.join(", ")), what);
            return Some(
                finding
                    .because(
                        "which root the search finds depends on where it starts; at another point it \
                         may be another one, and the plant jumps",
                    )
                    .change("narrow the box (low, high) so that it has the physical root alone"),
            );
        }
        None
    }
}

/// The k-th of some points that fill the boxes evenly (Kronecker's sequence with the roots of
/// whole numbers that are no squares).
fn place_in_box(k: u32, count: usize) -> Vec<f64> {
    let primes = [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0].into_iter().cycle();
    primes.take(count).map(|prime| (f64::from(k) * prime.sqrt()).fract()).collect()
}
