use super::*;
use crate::{BuiltInSpec, FourTanksParameters, FourTanksSpec, VanDerPolSpec};

/// A member of a family has the numbers of the plant with its parameters.
#[test]
fn members_of_families_have_the_numbers_of_the_plants() {
    let tanks = |pump, gamma| {
        let parameters = FourTanksParameters::JohanssonMinimum;
        let (gamma, pump) = (Some(gamma), Some(pump));
        let constants = BTreeMap::new();
        PlantSpec::FourTanks(FourTanksSpec { parameters, gamma, pump, constants })
    };
    let van_der_pol = |mu| PlantSpec::VanDerPol(VanDerPolSpec { mu });
    let other = |values: &[(&str, f64)]| {
        let constants = values.iter().map(|(name, value)| ((*name).to_owned(), *value));
        BuiltInSpec { constants: constants.collect() }
    };
    for (spec, other, varying) in [
        (van_der_pol(1.0), van_der_pol(0.6), &["mu"][..]),
        (
            tanks([3.33, 3.35], [0.7, 0.6]),
            tanks([3.0, 3.6], [0.5, 0.4]),
            &["k2", "gamma1", "k1", "gamma2"],
        ),
        (
            PlantSpec::OneTank(other(&[])),
            PlantSpec::OneTank(other(&[("k", 3.0), ("a", 0.08)])),
            &["k", "a"],
        ),
        (
            PlantSpec::HydraulicServo(other(&[("lag", 3e-3)])),
            PlantSpec::HydraulicServo(other(&[("lag", 3e-3), ("mass", 900.0), ("turn", 0.03)])),
            &["turn", "mass"],
        ),
        (
            PlantSpec::TwoLinkArm(other(&[])),
            PlantSpec::TwoLinkArm(other(&[("m2", 1.3), ("l1", 0.6)])),
            &["m2", "l1"],
        ),
    ] {
        let family = spec.family(varying);
        let p: Vec<f64> = varying.iter().map(|name| other.parameters()[*name]).collect();
        let plant = other.dyn_plant();
        assert_eq!(family.states(), plant.states());
        assert_eq!(family.inputs(), plant.inputs());
        let (nx, nu) = (plant.dims().nx, plant.dims().nu);
        for level in [-0.5, 0.0, 1.0, 13.0] {
            let (x, u) = (vec![level; nx], vec![0.3 * level; nu]);
            let (mut found, mut expected) = (vec![0.0; nx], vec![0.0; nx]);
            family.rhs(&x, &u, &p, &mut found);
            plant.rhs(&x, &u, &[], &mut expected);
            for (found, expected) in found.iter().zip(&expected) {
                let rounding = 1e-13 * (1.0 + expected.abs()).max(level.powi(3).abs());
                assert!((found - expected).abs() <= rounding, "{found} {expected}");
            }
        }
    }
}
