//! Nets, plants and controllers as co-simulation slaves.

use crate::controller::Controller;
use crate::mpc_c::controller_sources;
use crate::net_c::{check_member, has_time, net_core, places};
use crate::open::Open;
use crate::origin::{Origin, attribute};
use crate::runge_kutta_c::{RungeKuttaModel, runge_kutta_core};
use crate::template::{Template, constant};
use crate::{ExportError, GeneratedFile, Name};
use pinc_net::PincNet;
use pinc_ode::Variable;

/// Substeps per T of a plant that is to be accurate.
const FINE: f64 = 100.0;

/// A net as the content of an FMU: model description and sources. It is a plant: its inputs are
/// `u[i]`, its outputs the states `x[i]`, and its parameters the initial states `x_start[i]`.
///
/// Communication steps may be of any length, and the net is chained every T as in a free run, with
/// a new chain where an input changes within a step; a net that knows t = T only takes whole steps.
///
/// # Errors
///
/// [`ExportError::Net`] for a conventional PINN, which is no model; [`ExportError::Family`].
pub fn net_to_fmu(
    net: &PincNet,
    name: &Name,
    origin: &Origin,
    version: FmiVersion,
) -> Result<Vec<GeneratedFile>, ExportError> {
    check_member(net)?;
    let middle: Vec<f64> =
        net.domain().ends().map(|(low, high)| f64::midpoint(low, high)).collect();
    let (states, inputs) = (&origin.states, &origin.inputs);
    let (x, u) = middle.split_at(states.len());
    let mut variables = Vec::new();
    variables.extend(list(states, "x", Role::Output, x));
    variables.extend(list(inputs, "u", Role::Input, u));
    variables.extend(list(states, "x_start", Role::Start, x));
    let mut t = places(net, Open::default(), name, origin)?;
    let between = match has_time(net) {
        true => "        pinc_net_at(PINC_N(end - begin), s->state, s->input, next);\n",
        false => "        /* The net knows t = T only. */\n        return 1;\n",
    };
    t.set("HEADER", "net").set("FIRST_SET", states.len());
    t.set("FIELDS", include_str!("../templates/fmu_net_fields.c"));
    t.set("BETWEEN", between);
    t.set("MODEL_CODE", include_str!("../templates/fmu_net.c"));
    let description = Description {
        variables: &variables,
        step_s: net.sample_time_s(),
        any_step: has_time(net),
        feed_through: false,
        statuses: &[],
        note: origin.proven.clone(),
        sources: vec![format!("{}_net.c", name.as_str())],
        version,
    };
    Ok(description.files(t, net_core((net, false), Open::default(), name, origin)?, name, origin))
}

/// A controller as the content of an FMU: its inputs are the measured states `x[i]` and the
/// references `reference[i]`, held over the horizon; its outputs the inputs `u[i]` of the plant and
/// the `status`. With an estimator its inputs are what is measured, `y[i]`, in place of the states,
/// and the estimated states are outputs, `x_estimate[i]`, with the `estimator_status`.
///
/// It is sampled every T. At a sample its outputs depend on what is set at that time, so that the
/// input acts at once; a communication step must not go beyond the next sample.
///
/// # Errors
///
/// As [`controller_to_c`](crate::controller_to_c).
pub fn controller_to_fmu(
    controller: &Controller<'_>,
    name: &Name,
    origin: &Origin,
    version: FmiVersion,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let (mut t, sources) = controller_sources(controller, name, origin)?;
    let (nx, nu) = (origin.states.len(), origin.inputs.len());
    let dims = controller.library_model()?.dims();
    let named = |places: Vec<usize>| origin.quantities(&places).cloned().collect::<Vec<_>>();
    let mut variables = list(&origin.inputs, "u", Role::Output, &vec![0.0; nu]);
    let start = controller.initial_state;
    let (header, estimated, seen, statuses) = match controller.estimator {
        None => {
            variables.extend(list(&origin.states, "x", Role::Input, start));
            ("mpc", 0, nx, &STATUSES[..1])
        }
        Some(estimation) => {
            let measured = named(estimation.measured(dims)?);
            variables.extend(list(&origin.states, "x_estimate", Role::Output, start));
            variables.extend(list(&measured, "y", Role::Input, &controller.measured_at_start()?));
            ("feedback", nx, measured.len(), &STATUSES[..])
        }
    };
    let tracked = named(controller.tracked(dims)?);
    variables.extend(list(&tracked, "reference", Role::Input, controller.reference.at(0)));
    t.set("HEADER", header).set("FIRST_SET", nu + estimated);
    t.set("ESTIMATED", estimated).set("SEEN", seen).set("CONTROLLER", format!("pinc_{header}"));
    t.set("FIELDS", include_str!("../templates/fmu_mpc_fields.c"));
    t.set("MODEL_CODE", include_str!("../templates/fmu_mpc.c"));
    let description = Description {
        variables: &variables,
        step_s: controller.sample_time_s(),
        any_step: true,
        feed_through: true,
        statuses,
        note: notes(controller, origin),
        sources: sources
            .iter()
            .map(|file| file.path.clone())
            .filter(|path| path.ends_with(".c"))
            .collect(),
        version,
    };
    Ok(description.files(t, sources, name, origin))
}

/// The notes of the controller: how its budget counts, and what is proven of its net.
fn notes(controller: &Controller<'_>, origin: &Origin) -> Option<String> {
    let notes: Vec<String> =
        budget_note(controller).into_iter().chain(origin.proven.clone()).collect();
    (!notes.is_empty()).then(|| notes.join("; "))
}

/// What takes the place of a time budget, which an FMU has no clock for.
fn budget_note(controller: &Controller<'_>) -> Option<String> {
    let most = controller.config.max_iterations;
    controller.budget_us.map(|us| {
        format!(
            "A controller. It has no clock: a step solves at most {most} quadratic programs \
             (sqp.max_iterations), whatever its budget_us of {us}."
        )
    })
}

/// A plant by its equations as the content of an FMU, integrated accurately: what a controller can
/// be tried on. Its variables are as in [`net_to_fmu`]; it starts in `initial_state`.
///
/// # Errors
///
/// [`ExportError::Equations`] if the equations are none.
pub fn plant_to_fmu(
    plant: RungeKuttaModel<'_>,
    initial_state: &[f64],
    name: &Name,
    origin: &Origin,
    version: FmiVersion,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let (states, inputs) = (&origin.states, &origin.inputs);
    let mut variables = list(states, "x", Role::Output, initial_state);
    variables.extend(list(inputs, "u", Role::Input, &vec![0.0; inputs.len()]));
    variables.extend(list(states, "x_start", Role::Start, initial_state));
    let mut t = Template::new(name);
    t.set("BANNER", origin.banner("A plant, integrated.", None));
    let method = plant.method.name();
    t.set("HEADER", method).set("RK", method).set("FIRST_SET", states.len()).set("FIELDS", "");
    t.set("FINE", constant(plant.sample_time_s / FINE));
    t.set("MODEL_CODE", include_str!("../templates/fmu_plant.c"));
    let description = Description {
        variables: &variables,
        step_s: plant.sample_time_s,
        any_step: true,
        feed_through: false,
        statuses: &[],
        note: None,
        sources: vec![format!("{}_{method}.c", name.as_str())],
        version,
    };
    Ok(description.files(t, runge_kutta_core(plant, Open::default(), name, origin)?, name, origin))
}

/// The version of the interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FmiVersion {
    /// 2.0, with a variable per number.
    Two,
    /// 3.0, with arrays.
    Three,
}

/// The statuses of a controller and of its estimator.
const STATUSES: [(&str, &str); 2] = [("status", "converged"), ("estimator_status", "updated")];

/// What a variable is for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    Output,
    Input,
    Start,
}

/// A real variable.
pub(crate) struct Real {
    /// The array that it is of.
    pub(crate) array: &'static str,
    pub(crate) name: String,
    pub(crate) description: String,
    pub(crate) unit: String,
    pub(crate) role: Role,
    pub(crate) start: f64,
}

fn list(variables: &[Variable], array: &'static str, role: Role, starts: &[f64]) -> Vec<Real> {
    let real = |(i, (variable, &start)): (usize, (&Variable, &f64))| Real {
        array,
        name: format!("{array}[{}]", i + 1),
        description: variable.name.to_string(),
        unit: variable.unit.to_string(),
        role,
        start,
    };
    variables.iter().zip(starts).enumerate().map(real).collect()
}

/// What `modelDescription.xml` is made of.
pub(crate) struct Description<'a> {
    pub(crate) variables: &'a [Real],
    pub(crate) step_s: f64,
    pub(crate) any_step: bool,
    /// Whether outputs depend on inputs at the same time.
    pub(crate) feed_through: bool,
    /// The integers that say how a step ended: their names, and what 0 means.
    pub(crate) statuses: &'static [(&'static str, &'static str)],
    /// What the description of the model says.
    pub(crate) note: Option<String>,
    pub(crate) sources: Vec<String>,
    version: FmiVersion,
}

impl Description<'_> {
    /// The note as an attribute of the model.
    pub(crate) fn description(&self) -> String {
        let note = self.note.as_ref();
        note.map_or_else(String::new, |note| format!(" description=\"{}\"", attribute(note)))
    }

    fn files(
        mut self,
        mut t: Template,
        sources: Vec<GeneratedFile>,
        name: &Name,
        origin: &Origin,
    ) -> Vec<GeneratedFile> {
        let starts: String =
            self.variables.iter().map(|v| format!("    {},\n", constant(v.start))).collect();
        t.set("GUID", guid(origin)).set("REALS", self.variables.len()).set("STARTS", starts);
        // C has no array of 0: without a status there is one that nothing names.
        t.set("STATUSES", self.statuses.len().max(1));
        let [fmi, upper, instance, state] = match self.version {
            FmiVersion::Two => ["fmi2", "FMI2", "fmi2Component", "FMUstate"],
            FmiVersion::Three => ["fmi3", "FMI3", "fmi3Instance", "FMUState"],
        };
        t.set("FMI", fmi).set("FMI_UPPER", upper).set("INSTANCE", instance).set("STATE", state);
        t.set("COMMON", include_str!("../templates/fmu_common.c"));
        t.set("MODEL_PART", include_str!("../templates/fmu_model.c"));
        let slave = match self.version {
            FmiVersion::Two => include_str!("../templates/fmu2.c"),
            FmiVersion::Three => {
                self.set_arrays(&mut t);
                include_str!("../templates/fmu3.c")
            }
        };
        let slave = t.file("fmu.c", slave);
        self.sources.insert(0, slave.path.clone());
        let xml = match self.version {
            FmiVersion::Two => self.xml2(name, origin),
            FmiVersion::Three => self.xml3(name, origin),
        };
        let mut files = vec![GeneratedFile::text("modelDescription.xml".to_owned(), xml)];
        if self.version == FmiVersion::Three {
            let path = "sources/buildDescription.xml".to_owned();
            files.push(GeneratedFile::text(path, self.build_description(name)));
        }
        let below = |file: GeneratedFile| GeneratedFile {
            path: format!("sources/{}", file.path),
            bytes: file.bytes,
        };
        files.extend(sources.into_iter().chain([slave]).map(below));
        files
    }
}

/// The hash in the form of a GUID.
pub(crate) fn guid(origin: &Origin) -> String {
    let digits: String = origin
        .hash
        .chars()
        .filter(char::is_ascii_hexdigit)
        .chain(std::iter::repeat('0'))
        .take(32)
        .collect();
    let parts = [0..8, 8..12, 12..16, 16..20, 20..32].map(|range| digits[range].to_owned());
    format!("{{{}}}", parts.join("-"))
}
