//! Nets and controllers as co-simulation slaves of FMI 2.0.

use crate::controller::Controller;
use crate::mpc_c::controller_sources;
use crate::net_c::{check_member, has_time, net_core, places};
use crate::origin::{Origin, attribute};
use crate::rk4_c::{Rk4Model, rk4_core};
use crate::template::{Template, constant};
use crate::{ExportError, GeneratedFile, Name};
use pinc_net::PincNet;
use pinc_ode::Variable;
use std::collections::BTreeSet;
use std::fmt::Write as _;

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
    let mut t = places(net, name, origin)?;
    let between = match has_time(net) {
        true => "        pinc_net_at(PINC_N(end - begin), s->state, s->input, next);\n",
        false => "        /* The net knows t = T only. */\n        return fmi2Error;\n",
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
        status: false,
        sources: vec![format!("{}_net.c", name.as_str())],
    };
    Ok(description.files(t, net_core(net, name, origin)?, name, origin))
}

/// A controller as the content of an FMU: its inputs are the measured states `x[i]` and the
/// references `reference[i]`, held over the horizon; its outputs the inputs `u[i]` of the plant and
/// the `status`.
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
) -> Result<Vec<GeneratedFile>, ExportError> {
    let (mut t, sources) = controller_sources(controller, name, origin)?;
    let tracked: Vec<Variable> =
        controller.tracked().into_iter().map(|i| origin.states[i].clone()).collect();
    let first = controller.reference.at(0);
    let input = vec![0.0; origin.inputs.len()];
    let mut variables = list(&origin.inputs, "u", Role::Output, &input);
    variables.extend(list(&origin.states, "x", Role::Input, controller.initial_state));
    variables.extend(list(&tracked, "reference", Role::Input, first));
    t.set("HEADER", "mpc").set("FIRST_SET", origin.inputs.len());
    t.set("FIELDS", include_str!("../templates/fmu_mpc_fields.c"));
    t.set("MODEL_CODE", include_str!("../templates/fmu_mpc.c"));
    let description = Description {
        variables: &variables,
        step_s: controller.sample_time_s(),
        any_step: true,
        feed_through: true,
        status: true,
        sources: sources
            .iter()
            .map(|file| file.path.clone())
            .filter(|path| path.ends_with(".c"))
            .collect(),
    };
    Ok(description.files(t, sources, name, origin))
}

/// A plant by its equations as the content of an FMU, integrated accurately: what a controller can
/// be tried on. Variables are those of [`net_to_fmu`]; it starts in `initial_state`.
///
/// # Errors
///
/// [`ExportError::Equations`] if the equations are none.
pub fn plant_to_fmu(
    plant: Rk4Model<'_>,
    initial_state: &[f64],
    name: &Name,
    origin: &Origin,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let (states, inputs) = (&origin.states, &origin.inputs);
    let mut variables = list(states, "x", Role::Output, initial_state);
    variables.extend(list(inputs, "u", Role::Input, &vec![0.0; inputs.len()]));
    variables.extend(list(states, "x_start", Role::Start, initial_state));
    let mut t = Template::new(name);
    t.set("BANNER", origin.banner("A plant, integrated.", None));
    t.set("HEADER", "rk4").set("FIRST_SET", states.len()).set("FIELDS", "");
    t.set("FINE", constant(plant.sample_time_s / FINE));
    t.set("MODEL_CODE", include_str!("../templates/fmu_plant.c"));
    let description = Description {
        variables: &variables,
        step_s: plant.sample_time_s,
        any_step: true,
        feed_through: false,
        status: false,
        sources: vec![format!("{}_rk4.c", name.as_str())],
    };
    Ok(description.files(t, rk4_core(plant, name, origin)?, name, origin))
}

/// What a variable is for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Role {
    Output,
    Input,
    Start,
}

/// A real variable.
struct Real {
    name: String,
    description: String,
    unit: String,
    role: Role,
    start: f64,
}

fn list(variables: &[Variable], name: &str, role: Role, starts: &[f64]) -> Vec<Real> {
    let real = |(i, (variable, &start)): (usize, (&Variable, &f64))| Real {
        name: format!("{name}[{}]", i + 1),
        description: variable.name.to_string(),
        unit: variable.unit.to_string(),
        role,
        start,
    };
    variables.iter().zip(starts).enumerate().map(real).collect()
}

/// What `modelDescription.xml` says.
struct Description<'a> {
    variables: &'a [Real],
    step_s: f64,
    any_step: bool,
    /// Whether outputs depend on inputs at the same time.
    feed_through: bool,
    /// Whether there is an integer `status`.
    status: bool,
    sources: Vec<String>,
}

impl Description<'_> {
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
        let slave = t.file("fmu.c", include_str!("../templates/fmu.c"));
        self.sources.insert(0, slave.path.clone());
        let xml = self.xml(name, origin);
        let mut files = vec![GeneratedFile::text("modelDescription.xml".to_owned(), xml)];
        let below = |file: GeneratedFile| GeneratedFile {
            path: format!("sources/{}", file.path),
            bytes: file.bytes,
        };
        files.extend(sources.into_iter().chain([slave]).map(below));
        files
    }

    fn xml(&self, name: &Name, origin: &Origin) -> String {
        let name = name.as_str();
        let sources: String =
            self.sources.iter().map(|file| format!("      <File name=\"{file}\"/>\n")).collect();
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"2.0\" \
             modelName=\"{name}\" guid=\"{}\"\n    generationTool=\"pinc {}\" \
             variableNamingConvention=\"structured\">\n  <CoSimulation modelIdentifier=\"{name}\" \
             canHandleVariableCommunicationStepSize=\"{}\"\n      canGetAndSetFMUstate=\"true\" \
             canSerializeFMUstate=\"true\">\n    <SourceFiles>\n{sources}    </SourceFiles>\n  \
             </CoSimulation>\n{}  <DefaultExperiment startTime=\"0\" stepSize=\"{}\"/>\n  \
             <ModelVariables>\n{}  </ModelVariables>\n{}</fmiModelDescription>\n",
            guid(origin),
            attribute(&origin.version),
            self.any_step,
            self.units(),
            constant(self.step_s),
            self.model_variables(),
            self.structure(),
        )
    }

    fn units(&self) -> String {
        let units: BTreeSet<&str> =
            self.variables.iter().map(|v| &*v.unit).filter(|unit| !unit.is_empty()).collect();
        if units.is_empty() {
            return String::new();
        }
        let list: String = units
            .iter()
            .map(|unit| format!("    <Unit name=\"{}\"/>\n", attribute(unit)))
            .collect();
        format!("  <UnitDefinitions>\n{list}  </UnitDefinitions>\n")
    }

    fn model_variables(&self) -> String {
        let mut text = String::new();
        for (i, variable) in self.variables.iter().enumerate() {
            let discrete = if self.feed_through { "discrete" } else { "continuous" };
            let kind = match variable.role {
                Role::Output => {
                    format!(
                        "causality=\"output\" variability=\"{discrete}\" initial=\"calculated\""
                    )
                }
                Role::Input => "causality=\"input\" variability=\"continuous\"".to_owned(),
                Role::Start => {
                    "causality=\"parameter\" variability=\"fixed\" initial=\"exact\"".to_owned()
                }
            };
            let unit = match &*variable.unit {
                "" => String::new(),
                unit => format!(" unit=\"{}\"", attribute(unit)),
            };
            let start = match variable.role {
                Role::Output => String::new(),
                _ => format!(" start=\"{}\"", constant(variable.start)),
            };
            let _ = writeln!(
                text,
                "    <ScalarVariable name=\"{}\" valueReference=\"{i}\" description=\"{}\" {kind}>\n      \
                 <Real{unit}{start}/>\n    </ScalarVariable>",
                variable.name,
                attribute(&variable.description),
            );
        }
        if self.status {
            text += "    <ScalarVariable name=\"status\" valueReference=\"0\" description=\"0: \
                     converged\" causality=\"output\" variability=\"discrete\" \
                     initial=\"calculated\">\n      <Integer/>\n    </ScalarVariable>\n";
        }
        text
    }

    /// Which outputs depend on what, at all times and at the first.
    fn structure(&self) -> String {
        let places = |role: Role| {
            let all = self.variables.iter().enumerate().filter(move |(_, v)| v.role == role);
            all.map(|(i, _)| i + 1)
        };
        let mut outputs: Vec<usize> = places(Role::Output).collect();
        if self.status {
            outputs.push(self.variables.len() + 1);
        }
        let join =
            |list: Vec<usize>| list.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
        let inputs = join(places(Role::Input).collect());
        let starts: Vec<usize> = places(Role::Start).collect();
        let unknowns = |of: &dyn Fn(usize) -> String| -> String {
            let row = |(at, index): (usize, &usize)| {
                format!("      <Unknown index=\"{index}\" dependencies=\"{}\"/>\n", of(at))
            };
            outputs.iter().enumerate().map(row).collect()
        };
        let always = |_: usize| if self.feed_through { inputs.clone() } else { String::new() };
        let first = |at: usize| match starts.get(at) {
            Some(start) => start.to_string(),
            None => always(at),
        };
        format!(
            "  <ModelStructure>\n    <Outputs>\n{}    </Outputs>\n    <InitialUnknowns>\n{}    \
             </InitialUnknowns>\n  </ModelStructure>\n",
            unknowns(&always),
            unknowns(&first),
        )
    }
}

/// The hash in the form of a GUID.
fn guid(origin: &Origin) -> String {
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
