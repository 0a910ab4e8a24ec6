//! Poles, jumps and kinks in and around a box.

use super::{chemostat, plant, region};
use pinc_analysis::{
    IrregularityKind, OperatingPoint, Region, Survey, Term, Terms, beyond_knee, crossings,
};
use pinc_expr::TermRole;
use pinc_ode::{Dims, DynRhs};
use pinc_plants::{FourTanks, VanDerPol};

fn kinds(plant: &dyn DynRhs, region: &Region) -> Vec<(IrregularityKind, usize, usize, bool)> {
    let found = Survey::run(plant, region, 0.15, 1).irregularities;
    found.iter().map(|i| (i.kind, i.state, i.variable, i.is_inside)).collect()
}

fn chemostat_region(low: f64) -> Region {
    region(2, &[2.0, low, 0.0], &[6.0, 3.0, 0.38])
}

#[test]
fn the_pole_of_a_chemostat_just_outside_the_box() {
    let equations = chemostat("0.4*S/(0.1 + S)");
    let plant = equations.compile().unwrap();
    let found = kinds(&plant, &chemostat_region(0.0));
    assert!(found.contains(&(IrregularityKind::Pole, 0, 1, false)), "{found:?}");
    assert!(found.contains(&(IrregularityKind::Pole, 1, 1, false)), "{found:?}");
    let found = kinds(&plant, &chemostat_region(-1.0));
    assert!(found.contains(&(IrregularityKind::Pole, 1, 1, true)), "{found:?}");
    // By its terms.
    let terms = equations.critical_terms().unwrap();
    assert_eq!(terms.list().len(), 1);
    assert_eq!((terms.list()[0].role, &*terms.list()[0].text), (TermRole::Denominator, "S + 0.1"));
    assert_eq!(terms.list()[0].key, "derivatives.X");
    let found = crossings(&|at: &[f64]| terms.values(at), &chemostat_region(0.0), 0.15, 1).found;
    let crossing = found[0].as_ref().unwrap();
    assert!((crossing.behind.x[1] + 0.1).abs() < 1e-9 && !crossing.is_inside, "{crossing:?}");
}

#[test]
fn a_guarded_chemostat_is_quiet() {
    let equations = chemostat("0.4*max(S, 0)/(0.1 + max(S, 0))");
    assert_eq!(kinds(&equations.compile().unwrap(), &chemostat_region(0.0)), []);
    let terms = equations.critical_terms().unwrap();
    let found = crossings(&|at: &[f64]| terms.values(at), &chemostat_region(0.0), 0.15, 1).found;
    for (term, crossing) in terms.list().iter().zip(&found) {
        assert!(term.role == TermRole::Kink || crossing.is_none(), "{term:?} {crossing:?}");
    }
}

#[test]
fn a_root_that_is_left() {
    let text = equations_of_root();
    let plant = text.compile().unwrap();
    let region = region(1, &[0.1, 0.0], &[2.0, 1.0]);
    assert_eq!(kinds(&plant, &region), [(IrregularityKind::Undefined, 0, 0, false)]);
    let terms = text.critical_terms().unwrap();
    let found = crossings(&|at: &[f64]| terms.values(at), &region, 0.15, 1).found;
    assert_eq!(terms.list()[0].role, TermRole::Radicand);
    assert!((found[0].as_ref().unwrap().behind.x[0]).abs() < 1e-9, "{found:?}");
}

fn equations_of_root() -> pinc_expr::Equations {
    super::equations(&["h"], &["u"], &["u - sqrt(h)"])
}

#[test]
fn jumps_and_kinks_in_the_box_are_found_and_smooth_terms_and_ends_are_not() {
    let region = region(2, &[-1.0, -3.0, -1.0], &[2.0, 3.0, 1.0]);
    let on = |force: &str| kinds(&plant(&["x", "v"], &["u"], &["v", force]), &region);
    assert_eq!(on("u - x - sign(v - 0.3)"), [(IrregularityKind::Jump, 1, 1, true)]);
    assert_eq!(on("u - x - abs(v)"), [(IrregularityKind::Kink, 1, 1, true)]);
    assert_eq!(on("u - x - 0.5*max(x - 1, 0)*10"), [(IrregularityKind::Kink, 1, 0, true)]);
    for smooth in
        ["u - x - v*abs(v)", "u - x - tanh(v/0.01)", "u - x + max(x, -1)", "u - sin(5*x) - v^5"]
    {
        assert_eq!(on(smooth), [], "{smooth}");
    }
    // A pole of one sign, and one that is none.
    assert_eq!(on("u + 1/(x - 0.3)^2")[0], (IrregularityKind::Pole, 1, 0, true));
    assert_eq!(on("u + x^2/x"), []);
}

#[test]
fn built_in_plants_are_quiet() {
    let van_der_pol = region(2, &[-3.0, -4.35, -1.0], &[3.0, 4.35, 1.0]);
    assert_eq!(kinds(&VanDerPol::default(), &van_der_pol), []);
    let low = [vec![0.05; 4], vec![0.0; 2]].concat();
    let high = [vec![22.0; 4], vec![5.0; 2]].concat();
    let tanks = Region::new(Dims::new(4, 2), low, high);
    assert_eq!(kinds(&FourTanks::antonelo(), &tanks), []);
}

#[test]
fn a_term_without_a_change_of_sign_is_followed_to_its_zero() {
    let region = region(2, &[-1.0, -1.0, 0.0], &[1.0, 1.0, 1.0]);
    let terms = |at: &[f64]| {
        let (x, y) = (at[0] - 0.37, at[1] + 0.62);
        vec![x * x + y * y, x * x + y * y + 0.01]
    };
    let found = crossings(&terms, &region, 0.1, 1).found;
    let zero = found[0].as_ref().unwrap();
    assert!((zero.behind.x[0] - 0.37).abs() < 1e-4 && zero.is_inside, "{zero:?}");
    assert_eq!(found[1], None);
}

/// Terms `1 + u_i`, `x + c_i`, of which each is computed alone; counts the operations.
struct Counted {
    count: usize,
    operations: std::cell::Cell<usize>,
}

impl Terms for Counted {
    fn values(&self, at: &[f64]) -> Vec<f64> {
        self.operations.set(self.operations.get() + self.count);
        (0..self.count).map(|i| self.value(i, at)).collect()
    }

    fn alone(&self, i: usize) -> Term<'_> {
        let value = move |at: &[f64]| {
            self.operations.set(self.operations.get() + 1);
            self.value(i, at)
        };
        Term { value: Box::new(value), variables: Some(vec![i % 2]), operations: 1 }
    }
}

impl Counted {
    fn value(&self, i: usize, at: &[f64]) -> f64 {
        at[i % 2] + 1.5 * (i as f64) / (self.count as f64)
    }
}

/// The work grows as the number of terms, and what is found is what is found of all together.
#[test]
fn the_work_for_crossings_is_proportional_to_the_number_of_terms() {
    let region = region(1, &[-1.0, -1.0], &[1.0, 1.0]);
    let work = |count: usize| {
        let terms = Counted { count, operations: std::cell::Cell::new(0) };
        let found = crossings(&terms, &region, 0.1, 1);
        let work = terms.operations.get();
        let all = |at: &[f64]| terms.values(at);
        if count < 100 {
            assert_eq!(found, crossings(&all, &region, 0.1, 1));
        }
        assert_eq!(found.left_out, 0);
        work
    };
    let (few, many) = (work(50), work(1000));
    assert!(many < 21 * few && few < 50 * 8000, "{few} {many}");
}

/// With terms that take very long the last ones are left out, and it is said how many.
#[test]
fn very_long_terms_are_left_out() {
    struct Long;
    impl Terms for Long {
        fn values(&self, at: &[f64]) -> Vec<f64> {
            vec![at[0]; 3]
        }
        fn alone(&self, _: usize) -> Term<'_> {
            let value = |at: &[f64]| at[0];
            Term { value: Box::new(value), variables: None, operations: 1 << 28 }
        }
    }
    let found = crossings(&Long, &region(1, &[-1.0, -1.0], &[1.0, 1.0]), 0.1, 1);
    assert_eq!(found.found.iter().map(Option::is_some).collect::<Vec<_>>(), [true, false, false]);
    assert_eq!(found.left_out, 2);
}

/// A slope that changes from -1 to -101 around v = 0, where it is -51: on one side the plant is slower,
/// on the other faster, and both are a twentieth of the region away.
#[test]
fn a_plant_that_is_slower_on_one_side_only_has_no_knee() {
    let region = region(1, &[-5.0, -9.0], &[5.0, 9.0]);
    let rest = OperatingPoint { x: vec![0.0], u: vec![0.0] };
    let one_sided = plant(&["v"], &["u"], &["u - 51*v + 50*sqrt(v^2 + 1e-6)"]);
    assert_eq!(beyond_knee(&one_sided, &rest, &region), None);
    // Steep within a hundredth, by a factor that is not enough, and by one that is.
    for (steep, is_knee) in [(0.039, false), (0.041, true)] {
        let friction = plant(&["v"], &["u"], &[&format!("u - v - {steep}*tanh(v/0.01)")]);
        assert_eq!(beyond_knee(&friction, &rest, &region).is_some(), is_knee, "{steep}");
    }
}

#[test]
fn a_jump_counts_by_the_usual_rate_of_its_own_state() {
    let plant = plant(&["x", "y"], &["u"], &["1000*(u - x)", "sign(y - 0.3) - y"]);
    let found = kinds(&plant, &region(2, &[-1.0, -1.0, -1.0], &[1.0, 1.0, 1.0]));
    assert_eq!(found, [(IrregularityKind::Jump, 1, 1, true)]);
}
