//! The model description of FMI 3.0, whose variables are arrays.

use crate::Name;
use crate::fmu::{Description, Real, Role, guid};
use crate::origin::{Origin, attribute};
use crate::template::{Template, constant};

impl Description<'_> {
    /// The arrays that the variables make, in order.
    fn arrays(&self) -> Vec<&[Real]> {
        self.variables.chunk_by(|a, b| a.array == b.array).collect()
    }

    /// Fills the places of the arrays in the sources.
    pub(crate) fn set_arrays(&self, t: &mut Template) {
        let mut begin = 0;
        let mut places = String::new();
        for array in self.arrays() {
            places += &format!("    {{{begin}, {}}},\n", array.len());
            begin += array.len();
        }
        t.set("ARRAYS", self.arrays().len()).set("PLACES", places);
    }

    /// `buildDescription.xml`.
    pub(crate) fn build_description(&self, name: &Name) -> String {
        let files = self.sources.iter();
        let files: String =
            files.map(|file| format!("      <SourceFile name=\"{file}\"/>\n")).collect();
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiBuildDescription \
             fmiVersion=\"3.0\">\n  <BuildConfiguration modelIdentifier=\"{}\">\n    \
             <SourceFileSet language=\"C99\">\n{files}    </SourceFileSet>\n  \
             </BuildConfiguration>\n</fmiBuildDescription>\n",
            name.as_str(),
        )
    }

    /// `modelDescription.xml` of FMI 3.0.
    pub(crate) fn xml3(&self, name: &Name, origin: &Origin) -> String {
        let name = name.as_str();
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"3.0\" \
             modelName=\"{name}\"{}\n    instantiationToken=\"{}\"\n    generationTool=\"pinc {}\" \
             variableNamingConvention=\"structured\">\n  <CoSimulation modelIdentifier=\"{name}\" \
             canHandleVariableCommunicationStepSize=\"{}\"\n      canGetAndSetFMUState=\"true\" \
             canSerializeFMUState=\"true\"/>\n{}  <DefaultExperiment startTime=\"0\" \
             stepSize=\"{}\"/>\n  <ModelVariables>\n    <Float64 name=\"time\" \
             valueReference=\"0\" causality=\"independent\" variability=\"continuous\"/>\n{}  \
             </ModelVariables>\n{}</fmiModelDescription>\n",
            self.description(),
            guid(origin),
            attribute(&origin.version),
            self.any_step,
            self.units(),
            constant(self.step_s),
            self.array_variables(),
            self.array_structure(),
        )
    }

    fn array_variables(&self) -> String {
        let variable = |(i, array): (usize, &&[Real])| {
            let (first, count) = (&array[0], array.len());
            let discrete = if self.feed_through { "discrete" } else { "continuous" };
            let kind = match first.role {
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
            let starts: Vec<_> = array.iter().map(|v| constant(v.start)).collect();
            let start = match first.role {
                Role::Output => String::new(),
                _ => format!(" start=\"{}\"", starts.join(" ")),
            };
            let names: Vec<_> = array.iter().map(|v| attribute(&v.description)).collect();
            // An array has one unit.
            let same = array.iter().all(|v| v.unit == first.unit) && !first.unit.is_empty();
            let unit =
                if same { format!(" unit=\"{}\"", attribute(&first.unit)) } else { String::new() };
            format!(
                "    <Float64 name=\"{}\" valueReference=\"{}\" description=\"{}\"\n        \
                 {kind}{start}{unit}>\n      <Dimension start=\"{count}\"/>\n    </Float64>\n",
                first.array,
                i + 1,
                names.join(", "),
            )
        };
        let arrays = self.arrays();
        let mut text: String = arrays.iter().enumerate().map(variable).collect();
        for (i, (name, good)) in self.statuses.iter().enumerate() {
            text += &format!(
                "    <Int32 name=\"{name}\" valueReference=\"{}\" description=\"0: {good}\" \
                 causality=\"output\" variability=\"discrete\" initial=\"calculated\"/>\n",
                arrays.len() + 1 + i,
            );
        }
        text
    }

    fn array_structure(&self) -> String {
        let arrays = self.arrays();
        let of = |role: Role| {
            let places = arrays.iter().enumerate().filter(move |(_, a)| a[0].role == role);
            places.map(|(i, _)| (i + 1).to_string()).collect::<Vec<_>>()
        };
        let mut outputs = of(Role::Output);
        outputs.extend((0..self.statuses.len()).map(|i| (arrays.len() + 1 + i).to_string()));
        let always = if self.feed_through { of(Role::Input).join(" ") } else { String::new() };
        let first = if self.feed_through { always.clone() } else { of(Role::Start).join(" ") };
        let list = |tag: &str, on: &str| -> String {
            let row = |vr: &String| {
                format!("    <{tag} valueReference=\"{vr}\" dependencies=\"{on}\"/>\n")
            };
            outputs.iter().map(row).collect()
        };
        format!(
            "  <ModelStructure>\n{}{}  </ModelStructure>\n",
            list("Output", &always),
            list("InitialUnknown", &first),
        )
    }
}
