//! The built-in plants with their type erased. The equation of a plant is compiled into its
//! integrators and derivatives wherever a [`DynPlant`] is made of its type: here, once, and not in
//! each program that uses it.

use crate::{
    AcetoneColumn, AcetoneStill, FourTanks, HydraulicServo, OneTank, SingleTrackCar, TwoLinkArm,
    VanDerPol,
};
use pinc_ode::DynPlant;

impl VanDerPol {
    /// The plant with its type erased.
    #[must_use]
    #[inline(never)]
    pub fn into_dyn(self) -> Box<dyn DynPlant> {
        Box::new(self)
    }
}

impl OneTank {
    /// The plant with its type erased.
    #[must_use]
    #[inline(never)]
    pub fn into_dyn(self) -> Box<dyn DynPlant> {
        Box::new(self)
    }
}

impl FourTanks {
    /// The plant with its type erased.
    #[must_use]
    #[inline(never)]
    pub fn into_dyn(self) -> Box<dyn DynPlant> {
        Box::new(self)
    }
}

impl AcetoneStill {
    /// The plant with its type erased.
    #[must_use]
    #[inline(never)]
    pub fn into_dyn(self) -> Box<dyn DynPlant> {
        Box::new(self)
    }
}

impl AcetoneColumn {
    /// The plant with its type erased.
    #[must_use]
    #[inline(never)]
    pub fn into_dyn(self) -> Box<dyn DynPlant> {
        Box::new(self)
    }
}

impl HydraulicServo {
    /// The plant with its type erased.
    #[must_use]
    #[inline(never)]
    pub fn into_dyn(self) -> Box<dyn DynPlant> {
        Box::new(self)
    }
}

impl SingleTrackCar {
    /// The plant with its type erased.
    #[must_use]
    #[inline(never)]
    pub fn into_dyn(self) -> Box<dyn DynPlant> {
        Box::new(self)
    }
}

impl TwoLinkArm {
    /// The plant with its type erased.
    #[must_use]
    #[inline(never)]
    pub fn into_dyn(self) -> Box<dyn DynPlant> {
        Box::new(self)
    }
}
