//! The model description of FMI 3.0.

use crate::Name;
use crate::fmi2::described;
use crate::fmu::{Description, Real, Role, Status, guid};
use crate::origin::{Origin, attribute};
use crate::template::constant;

impl Description<'_> {
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
             canSerializeFMUState=\"true\"/>\n{}{}  <DefaultExperiment startTime=\"0\" \
             stepSize=\"{}\"/>\n  <ModelVariables>\n    <Float64 name=\"time\" \
             valueReference=\"0\" causality=\"independent\" variability=\"continuous\"/>\n{}  \
             </ModelVariables>\n{}</fmiModelDescription>\n",
            self.description(),
            guid(origin),
            attribute(&origin.version),
            self.any_step,
            self.units(),
            self.types3(),
            constant(self.step_s),
            self.variables3(),
            self.structure3(),
        )
    }

    fn types3(&self) -> String {
        let of = |status: &Status| {
            let (name, items) = (status.type_name(), status.items());
            format!("    <EnumerationType name=\"{name}\">\n{items}    </EnumerationType>\n")
        };
        let types: String = self.statuses.iter().map(of).collect();
        match types.is_empty() {
            true => types,
            false => format!("  <TypeDefinitions>\n{types}  </TypeDefinitions>\n"),
        }
    }

    fn variables3(&self) -> String {
        let variable = |(i, of): (usize, &Real)| {
            let kind = of.role.attributes(self.sampled);
            format!(
                "    <Float64 name=\"{}\" valueReference=\"{}\"{} {kind}{}/>\n",
                attribute(&of.name),
                i + 1,
                described(of.description),
                of.attributes(),
            )
        };
        let mut text: String = self.variables.iter().enumerate().map(variable).collect();
        for (i, status) in self.statuses.iter().enumerate() {
            text += &format!(
                "    <Enumeration name=\"{}\" valueReference=\"{}\" declaredType=\"{}\" \
                 causality=\"output\" variability=\"discrete\" initial=\"calculated\"/>\n",
                status.name,
                self.variables.len() + 1 + i,
                status.type_name(),
            );
        }
        text
    }

    fn structure3(&self) -> String {
        let of = |role: Role| {
            let places = self.variables.iter().enumerate().filter(move |(_, v)| v.role == role);
            places.map(|(i, _)| (i + 1).to_string()).collect::<Vec<_>>()
        };
        let mut outputs = of(Role::Output);
        let statuses = 0..self.statuses.len();
        outputs.extend(statuses.map(|i| (self.variables.len() + 1 + i).to_string()));
        let starts = [of(Role::Start), of(Role::Tunable)].concat();
        let inputs = of(Role::Input).join(" ");
        let always = |at: usize| match at < self.from_starts {
            true => String::new(),
            false => inputs.clone(),
        };
        let first = |at: usize| match starts.get(at).filter(|_| at < self.from_starts) {
            Some(start) => start.clone(),
            None => format!("{inputs} {}", starts.join(" ")),
        };
        let list = |tag: &str, on: &dyn Fn(usize) -> String| -> String {
            let row = |(at, vr): (usize, &String)| {
                let on = on(at);
                format!("    <{tag} valueReference=\"{vr}\" dependencies=\"{on}\"/>\n")
            };
            outputs.iter().enumerate().map(row).collect()
        };
        format!(
            "  <ModelStructure>\n{}{}  </ModelStructure>\n",
            list("Output", &always),
            list("InitialUnknown", &first),
        )
    }
}
