//! Nets, plants and controllers as functional mock-up units.

use crate::controller::Controller;
use crate::fmu_variables::{Real, Role, bounded, derivatives, list, sized};
use crate::mpc_c::{controller_sources, set_selftest};
use crate::net_c::{check_member, has_time, net_core, places};
use crate::open::Open;
use crate::origin::{Origin, attribute};
use crate::outputs_c::outputs_core;
use crate::runge_kutta_c::{RungeKuttaModel, runge_kutta_core};
use crate::template::{self, Template, array, constant};
use crate::{ExportError, GeneratedFile, Name};
use pinc_mpc::{Bounds, Nmpc};
use pinc_net::PincNet;
use pinc_ode::{Dims, Variable};

/// Substeps per T of a plant that is to be accurate, and how often as many are taken if they are too few.
pub(crate) const FINE: usize = 100;
pub(crate) const HALVINGS: u32 = 10;

/// A net as the content of an FMU: model description and sources. It is a plant: inputs and outputs
/// are the net's inputs and states by their names, and parameters `<state>_start` the initial states.
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
    let box_of = |names: std::ops::Range<usize>| {
        let ends = net.domain().ends().skip(names.start).take(names.len());
        let (low, high) = ends.unzip();
        Bounds::new(low, high)
    };
    let (of_x, of_u) = (box_of(0..states.len()), box_of(states.len()..states.len() + inputs.len()));
    variables.extend(sized(list(states, "", Role::Output, x), &of_x));
    variables.extend(bounded(list(inputs, "", Role::Input, u), &of_u));
    variables.extend(sized(list(states, "_start", Role::Start, x), &of_x));
    let mut t = places(net, Open::default(), name, origin)?;
    let between = match has_time(net) {
        true => "        pinc_net_at(PINC_N(end - begin), s->state, s->input, next);\n",
        false => "        /* The net knows t = T only. */\n        return 1;\n",
    };
    t.set("HEADER", "net").set("FIRST_SET", states.len());
    t.set("FIELDS", include_str!("../templates/fmu_net_fields.c"));
    t.set("BETWEEN", between);
    let whole = match has_time(net) {
        true => String::new(),
        false => format!("a step takes whole multiples of {} s, or ", net.sample_time_s()),
    };
    t.set("REFUSAL", whole + "the net has no finite value there");
    t.set("MODEL_CODE", include_str!("../templates/fmu_net.c"));
    let description = Description {
        variables: &variables,
        step_s: net.sample_time_s(),
        any_step: has_time(net),
        sampled: false,
        from_starts: states.len(),
        statuses: Vec::new(),
        note: origin.proven.clone(),
        sources: Vec::new(),
        version,
    };
    description.files(t, net_core((net, false), Open::default(), name, origin)?, name, origin)
}

/// A controller as the content of an FMU: its inputs are the measured states by their names and the
/// references `<controlled>_ref`, held over the horizon; its outputs the inputs of the plant and the
/// `status`; parameters `<input>_start` are the inputs before the first sample. With an estimator its
/// inputs are what is measured, in place of the states, and the estimated states are outputs,
/// `<state>_estimate`, with the `estimator_status`. With a guard the output `trust` says what it found,
/// with a tube the output `tube` whether the plan fits.
///
/// It is sampled every T. At a sample its outputs depend on what is set at that time, so that the
/// input acts at once; a communication step must not go beyond the next sample.
///
/// # Errors
///
/// As [`controller_to_c`](crate::controller_to_c).
pub fn controller_to_fmu(
    (controller, library): (&Controller<'_>, Nmpc),
    name: &Name,
    origin: &Origin,
    version: FmiVersion,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let (mut t, sources) = controller_sources(controller, name, origin)?;
    // For its warnings: an FMU has no self-test.
    set_selftest(&mut t, controller, library)?;
    let (nx, nu) = (origin.states.len(), origin.inputs.len());
    let dims = controller.library_model()?.dims();
    let named = |places: Vec<usize>| origin.quantities(&places).cloned().collect::<Vec<_>>();
    let problem = controller.problem;
    let (of_x, of_u) = (&problem.state_bounds, &problem.input_bounds);
    let mut variables = bounded(list(&origin.inputs, "", Role::Output, &vec![0.0; nu]), of_u);
    let start = controller.initial_state;
    let word = |of: &str| enumeration(&sources, name, of);
    let mut statuses = vec![Status { name: "status", words: word("status") }];
    let (header, estimated, seen, reset) = match controller.estimator {
        None => {
            variables.extend(sized(list(&origin.states, "", Role::Input, start), of_x));
            ("mpc", 0, nx, "mpc_reset_input")
        }
        Some(estimation) => {
            let measured = named(estimation.measured(dims)?);
            variables.extend(sized(list(&origin.states, "_estimate", Role::Output, start), of_x));
            variables.extend(list(&measured, "", Role::Input, &controller.measured_at_start()?));
            statuses.push(Status { name: "estimator_status", words: word("estimate_status") });
            ("feedback", nx, measured.len(), "feedback_reset_to")
        }
    };
    let in_tube = [("does-not-fit", "0"), ("fits", "1")];
    let in_tube = in_tube.map(|(word, number)| (word.to_owned(), number.to_owned()));
    let of = if controller.estimator.is_some() { "controller." } else { "" };
    let mut judgements = String::new();
    for (name, field, words, is_there) in [
        ("trust", "trust", word("trust"), controller.guard.is_some()),
        ("tube", "fits", in_tube.to_vec(), controller.tube.is_some()),
    ] {
        if is_there {
            let place = statuses.len();
            judgements += &format!("    s->status[{place}] = (int)s->after.{of}{field};\n");
            statuses.push(Status { name, words });
        }
    }
    t.set("JUDGEMENTS", judgements);
    let tracked = named(controller.tracked(dims)?);
    variables.extend(list(&tracked, "_ref", Role::Input, controller.reference.at(0)));
    let first = controller.first_input(dims);
    variables.extend(list(&origin.inputs, "_start", Role::Start, &first));
    t.set("RESET", format!("pinc_{reset}")).set("FIRST_START", variables.len() - nu);
    variables.extend(tunables(&mut t, controller, origin, (&tracked, variables.len()), dims));
    let inner = if controller.estimator.is_some() { "s->after.controller" } else { "s->after" };
    t.set("MPC", inner);
    let sampled = format!(
        "a step must end at the next sample at the latest, and samples are every {} s",
        controller.sample_time_s()
    );
    t.set("REFUSAL", sampled);
    t.set("HEADER", header).set("FIRST_SET", nu + estimated);
    t.set("ESTIMATED", estimated).set("SEEN", seen).set("CONTROLLER", format!("pinc_{header}"));
    t.set("FIELDS", include_str!("../templates/fmu_mpc_fields.c"));
    t.set("MODEL_CODE", include_str!("../templates/fmu_mpc.c"));
    let description = Description {
        variables: &variables,
        step_s: controller.sample_time_s(),
        any_step: true,
        sampled: true,
        from_starts: 0,
        statuses,
        note: notes(controller, origin),
        sources: Vec::new(),
        version,
    };
    description.files(t, sources, name, origin)
}

/// The weights and bounds that may be changed while the controller runs, the first at a place among
/// all variables: diagonals that are the same in all stages, and finite bounds of states and inputs
/// that are the same along the horizon.
fn tunables(
    t: &mut Template,
    controller: &Controller<'_>,
    origin: &Origin,
    (tracked, first): (&[Variable], usize),
    dims: Dims,
) -> Vec<Real> {
    let mut variables = Vec::new();
    if let Some([q, r]) = controller.steady_weights() {
        variables.extend(list(tracked, "_q", Role::Tunable, q));
        variables.extend(list(&origin.inputs, "_r", Role::Tunable, r));
        variables.iter_mut().for_each(|weight| weight.unit = String::new());
    }
    t.set("FIRST_WEIGHT", first).set("TUNES_WEIGHTS", u8::from(!variables.is_empty()));
    t.set("FIRST_BOUND", first + variables.len());
    let problem = controller.problem;
    let (of_x, of_u) = (&problem.state_bounds, &problem.input_bounds);
    let sides = [
        list(&origin.states, "_low", Role::Tunable, &of_x.low),
        list(&origin.states, "_high", Role::Tunable, &of_x.high),
        sized(list(&origin.inputs, "_low", Role::Tunable, &of_u.low), of_u),
        sized(list(&origin.inputs, "_high", Role::Tunable, &of_u.high), of_u),
    ];
    let sides: Vec<Real> = sides.into_iter().flatten().collect();
    let bounds: Vec<f64> = sides.iter().map(|side| side.start).collect();
    let steady = controller.has_steady_bounds(dims);
    let finite = |(_, side): &(usize, Real)| steady && side.start.is_finite();
    let (places, own): (Vec<usize>, Vec<Real>) =
        sides.into_iter().enumerate().filter(finite).unzip();
    t.set("BOUNDS", own.len());
    let tables = array("bound", &bounds) + &template::places("bound_place", &places);
    t.set("BOUND_TABLES", if own.is_empty() { String::new() } else { tables });
    variables.extend(own);
    variables
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
/// be tried on. Its variables are as in [`net_to_fmu`], with the plant's outputs that are no states
/// as outputs; it starts with this state and input. It serves for model exchange too, with the derivatives
/// `der(<state>)` as local variables.
///
/// # Errors
///
/// [`ExportError::Equations`] if the equations are none.
pub fn plant_to_fmu(
    plant: RungeKuttaModel<'_>,
    [initial_state, initial_input]: [&[f64]; 2],
    name: &Name,
    origin: &Origin,
    version: FmiVersion,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let (states, inputs) = (&origin.states, &origin.inputs);
    let is_own = |output: &Variable| states.iter().all(|state| state.name != output.name);
    let (places, own): (Vec<usize>, Vec<Variable>) =
        origin.outputs.iter().cloned().enumerate().filter(|(_, output)| is_own(output)).unzip();
    let mut variables = list(states, "", Role::Output, initial_state);
    variables.extend(list(&own, "", Role::Output, &vec![0.0; own.len()]));
    let first_derivative = variables.len();
    variables.extend(derivatives(states));
    let first_input = variables.len();
    variables.extend(list(inputs, "", Role::Input, initial_input));
    variables.extend(list(states, "_start", Role::Start, initial_state));
    let mut t = Template::new(name);
    t.set("BANNER", origin.banner("A plant, integrated.", None));
    let method = plant.method.name();
    let mut sources = runge_kutta_core(plant, method, Open::default(), name, origin)?;
    let mut header = method;
    let mut refresh = format!(
        "    pinc_{method}_derivative(s->reals, s->reals + PINC_INPUTS, s->reals + {first_derivative});\n"
    );
    if !own.is_empty() {
        let RungeKuttaModel { equations, parameters, .. } = plant;
        let model = (name, method);
        sources.extend(outputs_core(equations, parameters, Open::default(), model, origin)?);
        header = "outputs";
        let outputs =
            "    double y[PINC_NO];\n    pinc_outputs(s->reals, s->reals + PINC_INPUTS, y);\n";
        refresh.insert_str(0, outputs);
        for (variable, place) in (states.len()..).zip(&places) {
            refresh += &format!("    s->reals[{variable}] = y[{place}];\n");
        }
    }
    t.set("HEADER", header).set("RK", method).set("FIRST_SET", first_input);
    t.set("FIELDS", include_str!("../templates/fmu_plant_fields.c"));
    t.set("REFRESH", refresh).set("INPUTS", first_input);
    t.set("FINE", constant(plant.sample_time_s / FINE as f64)).set("HALVINGS", HALVINGS);
    let too_fine = "the equations have no finite value there, or are too stiff for the integrator, \
                    which model exchange does without";
    t.set("REFUSAL", too_fine);
    t.set("MODEL_CODE", include_str!("../templates/fmu_plant.c"));
    let description = Description {
        variables: &variables,
        step_s: plant.sample_time_s,
        any_step: true,
        sampled: false,
        from_starts: states.len(),
        statuses: Vec::new(),
        note: None,
        sources: Vec::new(),
        version,
    };
    description.files(t, sources, name, origin)
}

/// The version of the interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FmiVersion {
    /// 2.0.
    Two,
    /// 3.0.
    Three,
}

/// An enumeration that says how a step ended.
pub(crate) struct Status {
    pub(crate) name: &'static str,
    /// Its words with their numbers in C.
    pub(crate) words: Vec<(String, String)>,
}

impl Status {
    /// The name of its type, which has to be the name of nothing else.
    pub(crate) fn type_name(&self) -> String {
        format!("pinc.{}", self.name)
    }

    /// The items of its type.
    pub(crate) fn items(&self) -> String {
        let item = |(word, number): &(String, String)| {
            format!("        <Item name=\"{word}\" value=\"{number}\"/>\n")
        };
        self.words.iter().map(item).collect()
    }
}

/// The words of the type `of` in the headers among `sources`, with their numbers.
fn enumeration(sources: &[GeneratedFile], name: &Name, of: &str) -> Vec<(String, String)> {
    let (name, prefix) = (name.as_str(), format!("{}_", name.as_str().to_uppercase()));
    let end = format!("}} {name}_{of};");
    let texts = sources.iter().filter_map(|file| std::str::from_utf8(&file.bytes).ok());
    let body = texts.filter_map(|text| text.split_once(&end)?.0.rsplit_once("typedef enum {"));
    let value = |line: &str| {
        let (word, number) = line.trim().strip_prefix(&prefix)?.split_once(" = ")?;
        let word = word.to_lowercase().replace('_', "-");
        Some((word, number.trim_end_matches(',').to_owned()))
    };
    body.flat_map(|(_, body)| body.lines()).filter_map(value).collect()
}

/// What `modelDescription.xml` is made of.
pub(crate) struct Description<'a> {
    pub(crate) variables: &'a [Real],
    pub(crate) step_s: f64,
    pub(crate) any_step: bool,
    /// Whether outputs change at samples only.
    pub(crate) sampled: bool,
    /// How many outputs, the first ones, depend on no input at the same time, and at the start on
    /// the parameter of their place alone. The others depend on all.
    pub(crate) from_starts: usize,
    /// How a step ended.
    pub(crate) statuses: Vec<Status>,
    /// What the description of the model says.
    pub(crate) note: Option<String>,
    /// The paths of what is to be compiled, known once there are files.
    pub(crate) sources: Vec<String>,
    version: FmiVersion,
}

impl Description<'_> {
    /// The note as an attribute of the model.
    pub(crate) fn description(&self) -> String {
        let note = self.note.as_ref();
        note.map_or_else(String::new, |note| format!(" description=\"{}\"", attribute(note)))
    }
    /// The definitions of the types of statuses, each as `definition` writes its name and items.
    pub(crate) fn type_definitions(&self, definition: impl Fn(String, String) -> String) -> String {
        let of = |status: &Status| definition(status.type_name(), status.items());
        let types: String = self.statuses.iter().map(of).collect();
        match types.is_empty() {
            true => types,
            false => format!("  <TypeDefinitions>\n{types}  </TypeDefinitions>\n"),
        }
    }

    /// The places of the outputs, counted from 1, each with those that it depends on: after a step,
    /// and at the start.
    pub(crate) fn dependencies(&self) -> [Vec<(usize, String)>; 2] {
        let of = |role: Role| -> Vec<usize> {
            let all = self.variables.iter().enumerate().filter(|(_, v)| v.role == role);
            all.map(|(i, _)| i + 1).collect()
        };
        let join = |list: &[usize]| list.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
        let mut outputs = of(Role::Output);
        outputs.extend((0..self.statuses.len()).map(|i| self.variables.len() + 1 + i));
        let (inputs, starts) =
            (join(&of(Role::Input)), [of(Role::Start), of(Role::Tunable)].concat());
        let all_starts = join(&starts);
        let own_start = |at: usize| starts.get(at).filter(|_| at < self.from_starts);
        // For model exchange states are known too.
        let states = if self.exchanges() { self.from_starts } else { 0 };
        let known = |at: usize| if at < states { (at + 1).to_string() } else { String::new() };
        let all = [&join(&(1..=states).collect::<Vec<_>>()), &*inputs].join(" ").trim().to_owned();
        let always = |at: usize| if at < self.from_starts { known(at) } else { all.clone() };
        let first = |at: usize| match own_start(at) {
            Some(start) => start.to_string(),
            None => format!("{inputs} {all_starts}"),
        };
        let with = |on: &dyn Fn(usize) -> String| {
            let rows = outputs.iter().enumerate().map(|(at, place)| (*place, on(at)));
            rows.collect::<Vec<_>>()
        };
        [with(&always), with(&first)]
    }

    fn files(
        mut self,
        mut t: Template,
        sources: Vec<GeneratedFile>,
        name: &Name,
        origin: &Origin,
    ) -> Result<Vec<GeneratedFile>, ExportError> {
        self.check_names()?;
        let starts: String =
            self.variables.iter().map(|v| format!("    {},\n", constant(v.start))).collect();
        t.set("REALS", self.variables.len()).set("STARTS", starts);
        let fixed = |v: &Real| v.role == Role::Start;
        t.set("FIRST_FIXED", self.variables.iter().take_while(|v| !fixed(v)).count());
        t.set("FIXED", self.variables.iter().filter(|v| fixed(v)).count());
        // C has no array of 0: without a status there is one that nothing names.
        t.set("STATUSES", self.statuses.len().max(1));
        let [fmi, upper, instance, state] = match self.version {
            FmiVersion::Two => ["fmi2", "FMI2", "fmi2Component", "FMUstate"],
            FmiVersion::Three => ["fmi3", "FMI3", "fmi3Instance", "FMUState"],
        };
        t.set("DESERIALIZE", if fmi == "fmi2" { "DeSerialize" } else { "Deserialize" });
        t.set("FMI", fmi).set("FMI_UPPER", upper).set("INSTANCE", instance).set("STATE", state);
        self.set_kinds(&mut t);
        t.set("COMMON", include_str!("../templates/fmu_common.c"));
        let own = [format!("{}_fmu.c", name.as_str())];
        let paths = own.into_iter().chain(sources.iter().map(|file| file.path.clone()));
        self.sources = paths.filter(|path| path.ends_with(".c")).collect();
        let (xml, slave) = match self.version {
            FmiVersion::Two => (self.xml2(name, origin), include_str!("../templates/fmu2.c")),
            FmiVersion::Three => (self.xml3(name, origin), include_str!("../templates/fmu3.c")),
        };
        let guid = guid(&origin.hash, &xml);
        let xml = xml.replacen(GUID, &guid, 1);
        t.set("GUID", guid).set("MODEL_PART", include_str!("../templates/fmu_model.c"));
        let slave = t.file("fmu.c", slave);
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
        Ok(files)
    }

    /// Whether the unit serves for model exchange too: a plant does.
    pub(crate) fn exchanges(&self) -> bool {
        self.derivatives().next().is_some()
    }

    /// The places of the derivatives, counted from 1.
    pub(crate) fn derivatives(&self) -> impl Iterator<Item = usize> {
        let is_one = |(_, v): &(usize, &Real)| matches!(v.role, Role::Derivative(_));
        self.variables.iter().enumerate().filter(is_one).map(|(i, _)| i + 1)
    }

    /// The functions of model exchange, or of units without it.
    fn set_kinds(&self, t: &mut Template) {
        let (two, three) = (self.version == FmiVersion::Two, self.version == FmiVersion::Three);
        t.set("DERIVATIVES", if two { "Derivatives" } else { "ContinuousStateDerivatives" });
        let [mut kinds, mut other] = ["co-simulation", "type != fmi2CoSimulation"];
        let (mut exchange, mut none) = (String::new(), "");
        if self.exchanges() {
            kinds = "co-simulation or model exchange";
            other = "(type != fmi2CoSimulation) && (type != fmi2ModelExchange)";
            exchange = include_str!("../templates/fmu_exchange.c").to_owned();
            exchange += match self.version {
                FmiVersion::Two => include_str!("../templates/fmu2_exchange.c"),
                FmiVersion::Three => include_str!("../templates/fmu3_exchange.c"),
            };
        } else if three {
            none = include_str!("../templates/fmu3_no_exchange.c");
        }
        t.set("KINDS", kinds).set("OTHER_KIND", other);
        t.set("EXCHANGE", exchange).set("NO_EXCHANGE", none);
    }

    /// Refuses two variables of one name.
    fn check_names(&self) -> Result<(), ExportError> {
        let own = self.statuses.iter().map(|of| of.name).chain(["time"]);
        let mut names: Vec<&str> = self.variables.iter().map(|v| &*v.name).chain(own).collect();
        names.sort_unstable();
        match names.windows(2).find(|pair| pair[0] == pair[1]) {
            None => Ok(()),
            Some(pair) => Err(ExportError::SameName { name: pair[0].to_owned() }),
        }
    }
}

/// What is logged.
pub(crate) const LOG_CATEGORIES: &str =
    "  <LogCategories>\n    <Category name=\"error\"/>\n  </LogCategories>\n";

/// Where a description has the GUID.
pub(crate) const GUID: &str = "@GUID@";

/// A GUID of the hash of what was exported, and of what the description says that it was exported as.
fn guid(hash: &str, description: &str) -> String {
    let digits = hash.chars().filter(char::is_ascii_hexdigit).chain(std::iter::repeat('0'));
    // FNV-1a.
    let mix = |sum: u64, byte| (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    let sum = description.bytes().fold(0xcbf2_9ce4_8422_2325, mix);
    let digits: String = digits.take(16).chain(format!("{sum:016x}").chars()).collect();
    let parts = [0..8, 8..12, 12..16, 16..20, 20..32].map(|range| digits[range].to_owned());
    format!("{{{}}}", parts.join("-"))
}
