//! The PINC net: a perceptron with its normalization, ansatz and domain.

use crate::error::{check, check_count, check_numbers};
use crate::mlp::MlpConfig;
use crate::sampling::{Points, Purpose, Sampler, rng};
use crate::{Ansatz, Domain, Mlp, NetError, Normalizer, TrainingTarget};
use pinc_ad::Scalar;
use pinc_ode::{BlackBox, Dims, DynRhs, OdeError, Variable};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Number of points at which the plant's velocities are evaluated to find their scale.
const SCALE_POINTS: usize = 4096;

/// The architecture of a net.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetConfig {
    /// Length T of one step, in s.
    #[serde(rename = "horizon_s")]
    pub sample_time_s: f64,
    /// Number of hidden layers.
    pub hidden_layers: usize,
    /// Neurons in each hidden layer.
    pub neurons: usize,
    /// How the initial condition enters the net.
    pub ansatz: Ansatz,
    /// Scenario of a conventional PINN y(t) = `f_w`(t), which is what is trained if this is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_only: Option<Scenario>,
}

/// One initial state and one input, held constant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Initial state y(0), in the plant's order and units.
    pub initial_state: Vec<f64>,
    /// Input u, in the plant's order and units.
    pub input: Vec<f64>,
}

impl NetConfig {
    /// A net of `hidden_layers` layers of `neurons` each for steps of `sample_time_s`, with the
    /// hard initial condition.
    #[must_use]
    pub fn new(sample_time_s: f64, hidden_layers: usize, neurons: usize) -> Self {
        let (ansatz, time_only) = (Ansatz::HardLinear, None);
        Self { sample_time_s, hidden_layers, neurons, ansatz, time_only }
    }

    /// The number of weights and biases of the net for a plant of these dimensions.
    #[must_use]
    pub fn parameters(&self, dims: Dims) -> usize {
        self.size(dims).parameters()
    }

    fn size(&self, dims: Dims) -> MlpConfig {
        let varying = if self.time_only.is_some() { 0 } else { dims.nx + dims.nu + dims.np };
        MlpConfig {
            inputs: 1 + varying,
            hidden_layers: self.hidden_layers,
            neurons: self.neurons,
            outputs: dims.nx,
        }
    }

    /// Checks the settings against the plant's dimensions.
    ///
    /// # Errors
    ///
    /// [`NetError::Setting`] or [`NetError::Dimension`].
    pub fn validate(&self, dims: Dims) -> Result<(), NetError> {
        let t = self.sample_time_s;
        check(t > 0.0 && t.is_finite(), "horizon_s", t, "a positive number of seconds")?;
        check_count("hidden_layers", self.hidden_layers)?;
        check_count("neurons", self.neurons)?;
        if let Some(Scenario { initial_state, input }) = &self.time_only {
            let expected = "nothing for a net of a family of plants";
            check(dims.np == 0, "time_only", "a scenario", expected)?;
            check_numbers("time_only.initial_state", initial_state, dims.nx, "state")?;
            check_numbers("time_only.input", input, dims.nu, "input")?;
        }
        Ok(())
    }
}

/// A trained (or fresh) net y(t) = `f_w`(t, y(0), u, p), Eq. (`net_pred`) of the paper, with the
/// parameters p of a family of plants if it is of one. It is self-contained: normalization, ansatz,
/// T, domain and the names of the variables are part of it.
#[derive(Clone, Debug, PartialEq)]
pub struct PincNet {
    pub(crate) mlp: Mlp,
    pub(crate) ansatz: Ansatz,
    pub(crate) sample_time_s: f64,
    /// The normalizer of (t, y(0), u, p), or of t alone.
    pub(crate) input: Normalizer,
    /// The normalizer of the states.
    pub(crate) output: Normalizer,
    pub(crate) states: Vec<String>,
    pub(crate) inputs: Vec<String>,
    /// The units of those states and inputs that have one, by their names.
    pub units: BTreeMap<String, String>,
    /// With the parameters in the plant's order.
    pub(crate) domain: Domain,
    pub(crate) time_only: Option<Scenario>,
    pub(crate) source: TrainingTarget,
    /// What is proven of the net: a text that its file has, for those who prove it and rely on it.
    pub certificate: Option<String>,
}

impl PincNet {
    /// A fresh net for `plant`: Glorot weights from `seed`, inputs scaled by `domain`, outputs by
    /// the domain (`direct`) or by the plant's velocities in it (`hard-linear`).
    ///
    /// # Errors
    ///
    /// [`NetError`] if a setting makes no sense or the plant has no finite velocity in the domain.
    pub fn new(
        plant: &dyn DynRhs,
        config: &NetConfig,
        domain: &Domain,
        seed: u64,
    ) -> Result<Self, NetError> {
        let dims = plant.dims();
        config.validate(dims)?;
        let domain = domain.in_order_of(plant)?;
        domain.validate(dims)?;
        let time = (0.0, config.sample_time_s);
        let input = match config.time_only {
            None => Normalizer::of_uniform(std::iter::once(time).chain(domain.ends())),
            Some(_) => Normalizer::of_uniform(std::iter::once(time)),
        };
        let output = match config.ansatz {
            Ansatz::Direct => Normalizer::of_uniform(domain.ends().take(dims.nx)),
            Ansatz::HardLinear => displacement_scale(plant, config, &domain, seed)?,
        };
        let size = config.size(dims);
        let names = |of: &[Variable]| of.iter().map(|v| v.name.to_string()).collect();
        let all = plant.states().iter().chain(plant.inputs());
        let units = all.filter(|v| !v.unit.is_empty());
        Ok(Self {
            mlp: Mlp::glorot_normal(size, &mut rng(seed, Purpose::Weights)),
            ansatz: config.ansatz,
            sample_time_s: config.sample_time_s,
            input,
            output,
            states: names(plant.states()),
            inputs: names(plant.inputs()),
            units: units.map(|v| (v.name.to_string(), v.unit.to_string())).collect(),
            domain,
            time_only: config.time_only.clone(),
            source: TrainingTarget::Physics,
            certificate: None,
        })
    }

    /// The numbers of states, inputs and parameters.
    #[must_use]
    pub fn dims(&self) -> Dims {
        self.domain.dims()
    }

    /// Length T of one step, in s.
    #[must_use]
    pub fn sample_time_s(&self) -> f64 {
        self.sample_time_s
    }

    /// Names of the states, in the plant's order.
    #[must_use]
    pub fn state_names(&self) -> &[String] {
        &self.states
    }

    /// Names of the inputs, in the plant's order.
    #[must_use]
    pub fn input_names(&self) -> &[String] {
        &self.inputs
    }

    /// Names of the parameters that it takes as inputs, in the plant's order.
    pub fn parameter_names(&self) -> impl Iterator<Item = &str> {
        self.domain.parameters.iter().map(|range| range.name.as_str())
    }

    /// The box that the net was trained on.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// The one scenario that a conventional PINN stands for; `None` for a PINC net.
    #[must_use]
    pub fn time_only(&self) -> Option<&Scenario> {
        self.time_only.as_ref()
    }

    /// Returns the target that it was trained on. A net trained on [`TrainingTarget::Integrator`]
    /// is meaningful at t = T only.
    #[must_use]
    pub fn source(&self) -> TrainingTarget {
        self.source
    }

    /// The perceptron inside.
    #[must_use]
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// The net with other parameters.
    ///
    /// # Panics
    ///
    /// If their number is not the net's.
    #[must_use]
    pub fn with_parameters(&self, parameters: &[f64]) -> Self {
        let mut net = self.clone();
        net.mlp.parameters_mut().copy_from_slice(parameters);
        net
    }

    /// The net of the plant with the parameters `p`, `np`, which takes none: their part goes into
    /// the biases. What is certified of the family is certified of each member.
    ///
    /// # Panics
    ///
    /// If the length of `p` does not fit.
    #[must_use]
    pub fn member(&self, p: &[f64]) -> Self {
        let Dims { nx, nu, np, .. } = self.dims();
        assert_eq!(p.len(), np, "length of p");
        if np == 0 {
            return self.clone();
        }
        let kept = 1 + nx + nu;
        let scale = self.input.mean[kept..].iter().zip(&self.input.std[kept..]);
        let normalized: Vec<f64> = p.iter().zip(scale).map(|(p, (m, s))| (p - m) / s).collect();
        let first = |values: &[f64]| values[..kept].to_vec();
        Self {
            mlp: self.mlp.with_inputs_fixed(kept, &normalized),
            input: Normalizer { mean: first(&self.input.mean), std: first(&self.input.std) },
            domain: Domain { parameters: Vec::new(), ..self.domain.clone() },
            ..self.clone()
        }
    }

    /// y(t) after `t` seconds from `y0` under the constant input `u`, of the plant with the
    /// parameters `p`.
    ///
    /// # Shapes
    ///
    /// `y0` and the result: `nx`; `u`: `nu`; `p`: `np`. A conventional PINN ignores `y0` and `u`
    /// except, with a hard initial condition, `y0`.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    #[must_use]
    pub fn evaluate(&self, t: f64, y0: &[f64], u: &[f64], p: &[f64]) -> Vec<f64> {
        self.state(self.mlp.parameters(), t, y0, u, p)
    }

    /// y(t) over any scalar, with `weights` (and biases) in place of the net's own: the
    /// specification of the net, and with `Dual<Var>` its derivatives in time inside those in the
    /// weights.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    pub fn state<S: Scalar>(&self, weights: &[S], t: S, y0: &[S], u: &[S], p: &[S]) -> Vec<S> {
        let Dims { nx, nu, np, .. } = self.dims();
        assert_eq!([y0.len(), u.len(), p.len()], [nx, nu, np], "lengths of y0, u and p");
        let raw = std::iter::once(&t).chain(y0).chain(u).chain(p);
        let normalized: Vec<S> = raw
            .zip(self.input.mean.iter().zip(&self.input.std))
            .map(|(&v, (&mean, &std))| (v - mean) / std)
            .collect();
        let z = self.mlp.forward(weights, &normalized);
        let output = self.output.mean.iter().zip(&self.output.std);
        z.into_iter()
            .zip(output)
            .zip(y0)
            .map(|((z, (&mean, &std)), &y0)| {
                self.ansatz.state(t, self.sample_time_s, y0, z * std + mean)
            })
            .collect()
    }
}

/// Mean and standard deviation over the domain of a state's displacement in one step: T f(y0, u,
/// p), or y(T) - y0 of a black box.
fn displacement_scale(
    plant: &dyn DynRhs,
    config: &NetConfig,
    domain: &Domain,
    seed: u64,
) -> Result<Normalizer, NetError> {
    let dims = plant.dims();
    let points = match &config.time_only {
        None => Sampler::Sobol.collocation(SCALE_POINTS, config.sample_time_s, domain, 1, seed),
        Some(scenario) => Sampler::Sobol.scenario(1, config.sample_time_s, scenario, seed),
    };
    let all = match plant.black_box() {
        Some(black_box) => ends(black_box, &points, config.sample_time_s)?,
        None => by_velocity(plant, &points, config.sample_time_s)?,
    };
    let mut displacements = vec![Vec::new(); dims.nx];
    for (k, displacement) in all.into_iter().enumerate() {
        displacements[k % dims.nx].push(displacement);
    }
    let (mean, std) = displacements
        .iter()
        .map(|v| {
            let count = crate::mlp::to_f64(v.len());
            let mean = v.iter().sum::<f64>() / count;
            let variance = v.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count;
            // A displacement that does not vary (one scenario, a pure integrator) still has a
            // magnitude.
            let std = if variance > 0.0 { variance.sqrt() } else { mean.abs() };
            (mean, if std > 0.0 { std } else { 1.0 })
        })
        .unzip();
    Ok(Normalizer { mean, std })
}

/// T f(y0, u, p) at these points, one after the other.
fn by_velocity(plant: &dyn DynRhs, points: &Points, t: f64) -> Result<Vec<f64>, NetError> {
    let mut velocity = vec![0.0; plant.dims().nx];
    let mut all = Vec::new();
    for i in 0..points.len() {
        let (x, u) = (points.state(i), points.input(i));
        plant.rhs(x, u, points.parameters(i), &mut velocity);
        if let Some(j) = velocity.iter().position(|v| !v.is_finite()) {
            let state = plant.states()[j].name.to_string();
            let reason = plant.explain(x, u, points.parameters(i)).unwrap_or_default();
            return Err(NetError::Plant { state, x: x.to_vec(), u: u.to_vec(), reason });
        }
        all.extend(velocity.iter().map(|v| t * v));
    }
    Ok(all)
}

/// y(T) - y0 of a black box, likewise.
fn ends(black_box: &BlackBox, points: &Points, t: f64) -> Result<Vec<f64>, NetError> {
    let of = |part: fn(&Points, usize) -> &[f64]| -> Vec<f64> {
        (0..points.len()).flat_map(|i| part(points, i)).copied().collect()
    };
    let (x, u) = (of(Points::state), of(Points::input));
    let mut ends = x.clone();
    black_box.flow.advance(&mut ends, &u, t)?;
    if let Some(bad) = ends.iter().position(|end| !end.is_finite()) {
        let state = points.state(bad / black_box.states.len()).to_vec();
        return Err(OdeError::NotFinite { t: 0.0, state }.into());
    }
    Ok(ends.iter().zip(&x).map(|(end, x)| end - x).collect())
}
