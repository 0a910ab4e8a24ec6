//! Identification.

use super::*;
use crate::{BuiltInSpec, FourTanksParameters, FourTanksSpec, VanDerPolSpec};

fn values(of: &[(&str, f64)]) -> BTreeMap<String, f64> {
    of.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
}

#[test]
fn a_plant_takes_other_parameters_and_stays_what_it_is_where_it_can() {
    let tanks = PlantSpec::FourTanks(FourTanksSpec {
        parameters: FourTanksParameters::Antonelo,
        gamma: None,
        pump: None,
        constants: BTreeMap::new(),
    });
    let pumps = tanks.with_parameters(&values(&[("k2", 3.0), ("gamma1", 0.5)]));
    assert_eq!(pumps.name(), "four-tanks");
    let found = pumps.parameters();
    let old = tanks.parameters();
    let expected = [old["k1"], 3.0, 0.5, old["gamma2"]];
    let names = ["k1", "k2", "gamma1", "gamma2"];
    assert_eq!(names.map(|name| found[name].to_bits()), expected.map(f64::to_bits));
    let outlets = tanks.with_parameters(&values(&[("a1", 0.08), ("k1", 3.0)]));
    assert_eq!(outlets.name(), "four-tanks");
    let found = outlets.parameters();
    assert_eq!(found["a1"].to_bits(), 0.08f64.to_bits());
    assert_eq!(found["a2"].to_bits(), old["a2"].to_bits());
    assert_eq!(outlets.variables(), tanks.variables());
    let servo = PlantSpec::HydraulicServo(BuiltInSpec::default());
    let heavy = servo.with_parameters(&values(&[("mass", 1200.0)]));
    assert_eq!(heavy.parameters()["mass"].to_bits(), 1200.0f64.to_bits());
    assert_eq!(heavy.parameters()["area"].to_bits(), servo.parameters()["area"].to_bits());
    let oscillator = PlantSpec::VanDerPol(VanDerPolSpec { mu: 1.0 });
    let other = oscillator.with_parameters(&values(&[("mu", 0.7)]));
    assert_eq!(other, PlantSpec::VanDerPol(VanDerPolSpec { mu: 0.7 }));
    assert_eq!(tanks.with_parameters(&BTreeMap::new()), tanks);
}
