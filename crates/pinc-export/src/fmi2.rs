//! The model description of FMI 2.0.

use crate::Name;
use crate::fmu::{Description, Role, Status, guid};
use crate::origin::{Origin, attribute};
use crate::template::constant;
use std::collections::BTreeSet;
use std::fmt::Write as _;

impl Description<'_> {
    /// `modelDescription.xml` of FMI 2.0.
    pub(crate) fn xml2(&self, name: &Name, origin: &Origin) -> String {
        let name = name.as_str();
        let sources: String =
            self.sources.iter().map(|file| format!("      <File name=\"{file}\"/>\n")).collect();
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"2.0\" \
             modelName=\"{name}\"{} guid=\"{}\"\n    generationTool=\"pinc {}\" \
             variableNamingConvention=\"structured\">\n  <CoSimulation modelIdentifier=\"{name}\" \
             canHandleVariableCommunicationStepSize=\"{}\"\n      canGetAndSetFMUstate=\"true\" \
             canSerializeFMUstate=\"true\">\n    <SourceFiles>\n{sources}    </SourceFiles>\n  \
             </CoSimulation>\n{}{}  <DefaultExperiment startTime=\"0\" stepSize=\"{}\"/>\n  \
             <ModelVariables>\n{}  </ModelVariables>\n{}</fmiModelDescription>\n",
            self.description(),
            guid(origin),
            attribute(&origin.version),
            self.any_step,
            self.units(),
            self.types(),
            constant(self.step_s),
            self.model_variables(),
            self.structure(),
        )
    }

    /// The units that variables have.
    pub(crate) fn units(&self) -> String {
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

    fn types(&self) -> String {
        let of = |status: &Status| {
            let (name, items) = (status.type_name(), status.items());
            format!(
                "    <SimpleType name=\"{name}\">\n      <Enumeration>\n{items}      \
                 </Enumeration>\n    </SimpleType>\n"
            )
        };
        let types: String = self.statuses.iter().map(of).collect();
        match types.is_empty() {
            true => types,
            false => format!("  <TypeDefinitions>\n{types}  </TypeDefinitions>\n"),
        }
    }

    fn model_variables(&self) -> String {
        let mut text = String::new();
        for (i, variable) in self.variables.iter().enumerate() {
            let kind = variable.role.attributes(self.sampled);
            let _ = writeln!(
                text,
                "    <ScalarVariable name=\"{}\" valueReference=\"{i}\"{} {kind}>\n      \
                 <Real{}/>\n    </ScalarVariable>",
                attribute(&variable.name),
                described(variable.description),
                variable.attributes(),
            );
        }
        for (i, status) in self.statuses.iter().enumerate() {
            let _ = writeln!(
                text,
                "    <ScalarVariable name=\"{}\" valueReference=\"{i}\" causality=\"output\" \
                 variability=\"discrete\" initial=\"calculated\">\n      \
                 <Enumeration declaredType=\"{}\"/>\n    </ScalarVariable>",
                status.name,
                status.type_name(),
            );
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
        outputs.extend((0..self.statuses.len()).map(|i| self.variables.len() + 1 + i));
        let join =
            |list: Vec<usize>| list.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
        let inputs = join(places(Role::Input).collect());
        let starts: Vec<usize> = places(Role::Start).chain(places(Role::Tunable)).collect();
        let unknowns = |of: &dyn Fn(usize) -> String| -> String {
            let row = |(at, index): (usize, &usize)| {
                format!("      <Unknown index=\"{index}\" dependencies=\"{}\"/>\n", of(at))
            };
            outputs.iter().enumerate().map(row).collect()
        };
        let always = |at: usize| match at < self.from_starts {
            true => String::new(),
            false => inputs.clone(),
        };
        let all_starts = join(starts.clone());
        let first = |at: usize| match starts.get(at).filter(|_| at < self.from_starts) {
            Some(start) => start.to_string(),
            None => format!("{inputs} {all_starts}"),
        };
        format!(
            "  <ModelStructure>\n    <Outputs>\n{}    </Outputs>\n    <InitialUnknowns>\n{}    \
             </InitialUnknowns>\n  </ModelStructure>\n",
            unknowns(&always),
            unknowns(&first),
        )
    }
}

/// A description as an attribute, if there is one.
pub(crate) fn described(description: &str) -> String {
    match description {
        "" => String::new(),
        text => format!(" description=\"{}\"", attribute(text)),
    }
}
