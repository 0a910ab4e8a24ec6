//! The models that the suite runs on.

use crate::user_models::{Disturbed, Leaky};
use pinc_estimate::{Augmentation, Augmented, Compensated, Disturbance, Measured};
use pinc_expr::{AlgebraicVariable, Equations, OutputExpression};
use pinc_net::{Ansatz, Domain, NetConfig, PincModel, PincNet};
use pinc_ode::{DynPlant, DynRhs, Integrator, Model, Variable};
use pinc_plants::{FourTanks, OneTank, VanDerPol};

/// A model under test, and the box of states, inputs and parameters to try it in.
pub(crate) struct Candidate {
    pub(crate) name: &'static str,
    build: Box<dyn Fn() -> Box<dyn Model>>,
    state: Vec<[f64; 2]>,
    input: Vec<[f64; 2]>,
    parameter: Vec<[f64; 2]>,
}

impl Candidate {
    fn new<const N: usize, const M: usize>(
        name: &'static str,
        (state, input): ([[f64; 2]; N], [[f64; 2]; M]),
        build: impl Fn() -> Box<dyn Model> + 'static,
    ) -> Self {
        let (state, input) = (state.to_vec(), input.to_vec());
        Self { name, build: Box::new(build), state, input, parameter: Vec::new() }
    }

    fn with_parameters<const P: usize>(self, parameter: [[f64; 2]; P]) -> Self {
        Self { parameter: parameter.to_vec(), ..self }
    }

    pub(crate) fn build(&self) -> Box<dyn Model> {
        (self.build)()
    }

    /// The ranges of all variables: states, inputs, parameters.
    pub(crate) fn ranges(&self) -> Vec<[f64; 2]> {
        [&self.state[..], &self.input, &self.parameter].concat()
    }
}

const OSCILLATOR: ([[f64; 2]; 2], [[f64; 2]; 1]) = ([[-3.0, 3.0]; 2], [[-1.0, 1.0]]);
const TANKS: ([[f64; 2]; 4], [[f64; 2]; 2]) = ([[2.0, 20.0]; 4], [[0.0, 5.0]; 2]);

/// Every model there is.
pub(crate) fn candidates() -> Vec<Candidate> {
    let oscillator = || VanDerPol::default().into_dyn();
    let tanks = || FourTanks::antonelo().into_dyn();
    let mut all = vec![
        Candidate::new("RK4, Van der Pol", OSCILLATOR, move || {
            oscillator().model(Integrator::Rk4, 0.5, 4).unwrap()
        }),
        Candidate::new("RK5, Van der Pol", OSCILLATOR, move || {
            oscillator().model(Integrator::Rk5, 0.5, 2).unwrap()
        }),
        Candidate::new("Rosenbrock, Van der Pol", OSCILLATOR, move || {
            oscillator().model(Integrator::Rosenbrock, 0.5, 4).unwrap()
        }),
        Candidate::new("RK4, four tanks", TANKS, move || {
            tanks().model(Integrator::Rk4, 10.0, 4).unwrap()
        }),
        Candidate::new("RK5, four tanks", TANKS, move || {
            tanks().model(Integrator::Rk5, 10.0, 2).unwrap()
        }),
        Candidate::new("Rosenbrock, four tanks", TANKS, move || {
            tanks().model(Integrator::Rosenbrock, 10.0, 4).unwrap()
        }),
        Candidate::new("RK4, one tank", ([[2.0, 20.0]], [[0.5, 4.5]]), || {
            OneTank::default().into_dyn().model(Integrator::Rk4, 10.0, 4).unwrap()
        }),
        Candidate::new("net, Van der Pol", OSCILLATOR, || net(&VanDerPol::default(), false)),
        Candidate::new("hard net, Van der Pol", OSCILLATOR, || net(&VanDerPol::default(), true)),
        Candidate::new("net, four tanks", ([[-3.0, 3.0]; 4], [[-1.0, 1.0]; 2]), || {
            net(&FourTanks::antonelo(), false)
        }),
        Candidate::new("hard net, four tanks", ([[-3.0, 3.0]; 4], [[-1.0, 1.0]; 2]), || {
            net(&FourTanks::antonelo(), true)
        }),
        Candidate::new("a user's", ([[-3.0, 3.0]], [[-1.0, 1.0]]), || Box::new(Leaky))
            .with_parameters([[0.5, 1.5]]),
        Candidate::new("disturbed tanks", TANKS, move || {
            Box::new(Disturbed::new(tanks().model(Integrator::Rk4, 10.0, 4).unwrap()))
        })
        .with_parameters([[-0.1, 0.1]; 2]),
    ];
    all.extend(texts());
    all.extend(disturbed());
    all
}

/// Models of estimators and of the controllers that use them.
fn disturbed() -> Vec<Candidate> {
    let tanks = || FourTanks::antonelo().into_dyn().model(Integrator::Rk4, 10.0, 4).unwrap();
    let with = |disturbance| Augmentation {
        disturbance,
        ..Augmentation::measured(Measured::states([0, 1]))
    };
    let augmented = move |disturbance: Disturbance| -> Box<dyn Model> {
        Box::new(Augmented::new(tanks(), with(disturbance)).expect("it suits the tanks"))
    };
    let compensated = move |disturbance: Disturbance| -> Box<dyn Model> {
        Box::new(Compensated::new(tanks(), with(disturbance)).expect("it suits the tanks"))
    };
    let (level, offset) = ([2.0, 20.0], [-0.1, 0.1]);
    let (x, z) = ([level; 4], [level, level, level, level, offset, offset]);
    let u = [[0.0, 5.0]; 2];
    let unknown = ([[0.1, 2.0], [0.1, 2.0], offset, [0.5, 1.5]], [[0.0, 1.0]]);
    vec![
        Candidate::new("tanks and a leak", (z, u), move || {
            augmented(Disturbance::States(vec![2, 0]))
        }),
        Candidate::new("tanks and pumps", (z, u), move || augmented(Disturbance::Input)),
        Candidate::new("tanks and sensors", (z, u), move || augmented(Disturbance::Output)),
        Candidate::new("tanks with a leak", (x, u), move || {
            compensated(Disturbance::States(vec![2, 0]))
        })
        .with_parameters([offset; 2]),
        Candidate::new("tanks with pumps", (x, u), move || compensated(Disturbance::Input))
            .with_parameters([offset; 2]),
        Candidate::new("tanks with sensors", (x, u), move || compensated(Disturbance::Output))
            .with_parameters([offset; 2]),
        Candidate::new("reactor of unknown rate", unknown, || {
            let unknown = Augmentation {
                disturbance: Disturbance::Input,
                parameters: vec![0.5, 1.0],
                estimated: vec![1],
                ..Augmentation::measured(vec![Measured::Output(1), Measured::State(1)])
            };
            let reactor = plant_of(&["k2", "k1"], &REACTOR).model(Integrator::Rk4, 0.5, 2).unwrap();
            Box::new(Augmented::new(reactor, unknown).expect("it suits the reactor"))
        }),
    ]
}

/// Integrators of text plants: with parameters and outputs, of all sizes, in units far apart.
fn texts() -> Vec<Candidate> {
    // Columns of the Jacobians: 3 go through the lanes, 4 are in one vector, 12 in two.
    let decay = ([[-2.0, 2.0]], [[-1.0, 1.0]]);
    let reactor = ([[0.1, 2.0]; 2], [[0.0, 1.0]]);
    let chain = ([[0.1, 2.0]; 7], [[0.0, 1.0]; 2]);
    // A concentration in mol/m^3 beside a number of particles.
    let units = ([[1e-6, 2e-6], [1e6, 3e6]], [[1e-7, 1e-6]]);
    let mut all = vec![
        Candidate::new("RK4, decay", decay, || {
            plant_of(&["k"], &DECAY).model(Integrator::Rk4, 0.5, 2).unwrap()
        })
        .with_parameters([[0.1, 3.0]]),
        Candidate::new("RK4, chain", chain, || {
            chain_plant(&["k1", "k2", "g"]).model(Integrator::Rk4, 0.2, 2).unwrap()
        })
        .with_parameters([[0.1, 2.0], [0.1, 2.0], [0.5, 1.5]]),
        Candidate::new("Rosenbrock, chain", chain, || {
            chain_plant(&["g", "k1"]).model(Integrator::Rosenbrock, 0.2, 2).unwrap()
        })
        .with_parameters([[0.5, 1.5], [0.1, 2.0]]),
        Candidate::new("RK5, units", units, || {
            plant_of(&[], &UNITS).model(Integrator::Rk5, 1.0, 2).unwrap()
        }),
        Candidate::new("Rosenbrock, units", units, || {
            plant_of(&["k"], &UNITS).model(Integrator::Rosenbrock, 1.0, 2).unwrap()
        })
        .with_parameters([[1e-7, 2e-7]]),
        Candidate::new("disturbed reactor", reactor, || {
            Box::new(Disturbed::new(
                plant_of(&["k1"], &REACTOR).model(Integrator::Rk4, 0.5, 2).unwrap(),
            ))
        })
        .with_parameters([[0.5, 2.0], [-0.1, 0.1]]),
    ];
    // Columns in several blocks, of which each reaches some of the rows.
    all.push(
        Candidate::new("RK4, rod", ([[0.1, 2.0]; 30], [[0.0, 1.0]]), || {
            rod(30).model(Integrator::Rk4, 0.2, 3).unwrap()
        })
        .with_parameters([[0.5, 2.0]]),
    );
    all.push(
        Candidate::new("RK5, rod", ([[0.1, 2.0]; 30], [[0.0, 1.0]]), || {
            rod(30).model(Integrator::Rk5, 0.2, 1).unwrap()
        })
        .with_parameters([[0.5, 2.0]]),
    );
    type Build = fn(&dyn DynPlant) -> Box<dyn Model>;
    let methods: [(&str, &str, Build); 3] = [
        ("RK4, reactor", "RK4, vessels", |plant| plant.model(Integrator::Rk4, 0.5, 2).unwrap()),
        ("RK5, reactor", "RK5, vessels", |plant| plant.model(Integrator::Rk5, 0.5, 2).unwrap()),
        ("Rosenbrock, reactor", "Rosenbrock, vessels", |plant| {
            plant.model(Integrator::Rosenbrock, 0.5, 2).unwrap()
        }),
    ];
    for (name, algebraic, method) in methods {
        let build = move || method(&*plant_of(&["k2", "k1"], &REACTOR));
        all.push(Candidate::new(name, reactor, build).with_parameters([[0.1, 1.0], [0.5, 2.0]]));
        let build = move || method(&*vessels());
        all.push(Candidate::new(algebraic, reactor, build).with_parameters([[0.5, 2.0]]));
    }
    all
}

/// A plant as pairs of names and values or texts.
struct Text {
    inputs: &'static [&'static str],
    parameters: &'static [(&'static str, f64)],
    derivatives: &'static [(&'static str, &'static str)],
    outputs: &'static [(&'static str, &'static str)],
}

const DECAY: Text = Text {
    inputs: &["u"],
    parameters: &[("k", 1.0)],
    derivatives: &[("x", "u - k*x - 0.1*x^3")],
    outputs: &[],
};

/// A reaction of second order with a by-product; the pressure is measured.
const REACTOR: Text = Text {
    inputs: &["feed"],
    parameters: &[("k1", 1.0), ("k2", 0.5), ("R", 0.3)],
    derivatives: &[("a", "feed - k1*a^2"), ("b", "k1*a^2 - k2*b")],
    outputs: &[("pressure", "R*(a + b)"), ("rate", "k1*a^2 + 0.1*feed"), ("sum", "a + b")],
};

const UNITS: Text = Text {
    inputs: &["feed"],
    parameters: &[("k", 1.5e-7)],
    derivatives: &[("c", "feed - k*n*c"), ("n", "1e12*feed - 0.1*n + 1e17*c^2")],
    outputs: &[("product", "c*n"), ("share", "n/(n + 1e12*c)")],
};

fn plant_of(varying: &[&str], text: &Text) -> Box<dyn DynPlant> {
    equations(text).compile_with(varying).expect("valid equations").into_dyn()
}

fn equations(text: &Text) -> Equations {
    let texts = |pairs: &[(&str, &str)]| {
        pairs.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect()
    };
    let output = |&(name, expression): &(&str, &str)| {
        let (expression, unit) = (expression.to_owned(), String::new());
        (name.to_owned(), OutputExpression { expression, unit })
    };
    Equations {
        states: text.derivatives.iter().map(|(name, _)| Variable::new(name, "")).collect(),
        inputs: text.inputs.iter().map(|name| Variable::new(name, "")).collect(),
        parameters: text.parameters.iter().map(|&(name, v)| (name.to_owned(), v)).collect(),
        derivatives: texts(text.derivatives),
        outputs: text.outputs.iter().map(output).collect(),
        ..Equations::default()
    }
}

/// Two vessels with a pump and a pipe between them. The pressure at its junction and the flows on
/// both sides are algebraic variables that depend on one another, a level one by itself.
fn vessels() -> Box<dyn DynPlant> {
    let unknown = |(name, equation): (&str, &str)| {
        let equation = equation.to_owned();
        let (start, low, high, unit) = (None, -10.0, 20.0, String::new());
        (name.to_owned(), AlgebraicVariable { equation, start, low, high, unit })
    };
    let text = Text {
        inputs: &["feed"],
        parameters: &[("k", 1.0)],
        derivatives: &[("a", "feed - qa - 0.01*level"), ("b", "qb - 0.3*b")],
        outputs: &[("total", "a + b + qa*feed")],
    };
    let equations = Equations {
        algebraic: [
            ("junction", "qa - qb"),
            ("level", "level^3 + level - k*a"),
            ("qa", "qa + 0.2*qa^3 - k*(a + 5 - junction)"),
            ("qb", "qb + 0.1*qb^3 - (junction - b)"),
        ]
        .map(unknown)
        .into(),
        ..equations(&text)
    };
    equations.compile_with(&["k"]).expect("valid equations").into_dyn()
}

/// Seven states, more than are integrated in registers.
fn chain_plant(varying: &[&str]) -> Box<dyn DynPlant> {
    let chain = Text {
        inputs: &["u", "v"],
        parameters: &[("k1", 1.0), ("k2", 0.5), ("g", 1.0)],
        derivatives: &[
            ("x1", "u - k1*x1*x2"),
            ("x2", "k1*x1 - k2*x2^2"),
            ("x3", "g*(x2 - x3)"),
            ("x4", "g*(x3 - x4) + v"),
            ("x5", "sin(x4) - x5"),
            ("x6", "k2*x5 - x6*v"),
            ("x7", "x6/(1 + x7^2) - x7"),
        ],
        outputs: &[("last", "k2*x7 + u")],
    };
    plant_of(varying, &chain)
}

/// A rod of `nodes` nodes that is heated at its first and radiates; its end is measured.
fn rod(nodes: usize) -> Box<dyn DynPlant> {
    let name = |i: usize| format!("T{i}");
    let equation = |i: usize| {
        let left = if i == 0 { "heat".to_owned() } else { format!("g*(T{} - T{i})", i - 1) };
        let right =
            if i + 1 == nodes { String::new() } else { format!(" + g*(T{} - T{i})", i + 1) };
        (name(i), format!("{left}{right} - 0.1*T{i}^4"))
    };
    let end = OutputExpression { expression: name(nodes - 1), unit: String::new() };
    let equations = Equations {
        states: (0..nodes).map(|i| Variable { name: name(i).into(), unit: "".into() }).collect(),
        inputs: vec![Variable::new("heat", "")],
        parameters: [("g".to_owned(), 1.0)].into(),
        derivatives: (0..nodes).map(equation).collect(),
        outputs: [("end".to_owned(), end)].into(),
        ..Equations::default()
    };
    equations.compile_with(&["g"]).expect("valid equations").into_dyn()
}

/// A net with its starting weights: the suite does not need a good one.
fn net(plant: &dyn DynRhs, hard: bool) -> Box<dyn Model> {
    let dims = plant.dims();
    let domain = Domain {
        state_low: vec![-3.0; dims.nx],
        state_high: vec![3.0; dims.nx],
        input_low: vec![-1.0; dims.nu],
        input_high: vec![1.0; dims.nu],
        parameters: Vec::new(),
    };
    let ansatz = if hard { Ansatz::HardLinear } else { Ansatz::Direct };
    let config =
        NetConfig { sample_time_s: 0.5, hidden_layers: 3, neurons: 9, ansatz, time_only: None };
    let net = PincNet::new(plant, &config, &domain, 7).expect("a net");
    Box::new(PincModel::new(&net).expect("a net of every initial state"))
}
