//! The integrators that can serve as models of a plant.

use crate::Tableau;
use std::fmt;

/// An integrator with a fixed number of substeps per step, as [`DynPlant::model`] makes a model of
/// it.
///
/// [`DynPlant::model`]: crate::DynPlant::model
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Integrator {
    /// The classical Runge-Kutta method of order 4: [`Classical`](crate::Classical).
    Rk4,
    /// The Runge-Kutta method of order 5 of Dormand and Prince, with six stages:
    /// [`DormandPrince`](crate::DormandPrince).
    Rk5,
    /// The linearly implicit Rosenbrock method RODAS of order 4, for stiff plants:
    /// [`sparse_rosenbrock`](crate::sparse_rosenbrock).
    Rosenbrock,
}

/// How a method steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scheme {
    /// An explicit Runge-Kutta method with these coefficients.
    Explicit(Tableau),
    /// The Rosenbrock method RODAS, which solves linear systems with the Jacobian.
    LinearlyImplicit,
}

/// What is known of a method before it is applied to a plant.
struct Properties {
    name: &'static str,
    title: &'static str,
    order: u32,
    stages: usize,
    scheme: Scheme,
}

impl Integrator {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Rk4, Self::Rk5, Self::Rosenbrock];

    const fn properties(self) -> Properties {
        match self {
            Self::Rk4 => Properties {
                name: "rk4",
                title: "RK4",
                order: 4,
                stages: 4,
                scheme: Scheme::Explicit(Tableau::CLASSICAL),
            },
            Self::Rk5 => Properties {
                name: "rk5",
                title: "RK5",
                order: 5,
                stages: 6,
                scheme: Scheme::Explicit(Tableau::DORMAND_PRINCE),
            },
            Self::Rosenbrock => Properties {
                name: "rosenbrock",
                title: "Rosenbrock",
                order: 4,
                stages: 6,
                scheme: Scheme::LinearlyImplicit,
            },
        }
    }

    /// The name in configs and results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.properties().name
    }

    /// The name in reports.
    #[must_use]
    pub const fn title(self) -> &'static str {
        self.properties().title
    }

    /// The order of the error over a fixed time: it falls with h to this power.
    #[must_use]
    pub const fn order(self) -> u32 {
        self.properties().order
    }

    /// Evaluations of the right-hand side per substep.
    #[must_use]
    pub const fn stages(self) -> usize {
        self.properties().stages
    }

    /// How it steps.
    #[must_use]
    pub const fn scheme(self) -> Scheme {
        self.properties().scheme
    }

    /// The coefficients of an explicit Runge-Kutta method; `None` for other methods.
    #[must_use]
    pub const fn tableau(self) -> Option<Tableau> {
        match self.scheme() {
            Scheme::Explicit(tableau) => Some(tableau),
            Scheme::LinearlyImplicit => None,
        }
    }
}

impl fmt::Display for Integrator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
