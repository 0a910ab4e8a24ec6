//! The model description of FMI 2.0.

use crate::Name;
use crate::fmu::{Description, GUID, LOG_CATEGORIES};
use crate::fmu_variables::Role;
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
        let kept = format!(
            "canNotUseMemoryManagementFunctions=\"true\"\n      canGetAndSetFMUstate=\"true\" \
             canSerializeFMUstate=\"true\">\n    \
             <SourceFiles>\n{sources}    </SourceFiles>\n  "
        );
        let exchange = match self.exchanges() {
            true => {
                format!("  <ModelExchange modelIdentifier=\"{name}\" {kept}</ModelExchange>\n")
            }
            false => String::new(),
        };
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"2.0\" \
             modelName=\"{name}\"{} guid=\"{}\"\n    generationTool=\"pinc {}\" \
             variableNamingConvention=\"flat\">\n{exchange}  <CoSimulation \
             modelIdentifier=\"{name}\" canHandleVariableCommunicationStepSize=\"{}\"\n      \
             {kept}</CoSimulation>\n{}{}{}  <DefaultExperiment startTime=\"0\" stepSize=\"{}\"/>\n  \
             <ModelVariables>\n{}  </ModelVariables>\n{}</fmiModelDescription>\n",
            self.description(),
            GUID,
            attribute(&origin.version),
            self.any_step,
            self.units(),
            self.types(),
            LOG_CATEGORIES,
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
        self.type_definitions(|name, items| {
            format!(
                "    <SimpleType name=\"{name}\">\n      <Enumeration>\n{items}      \
                 </Enumeration>\n    </SimpleType>\n"
            )
        })
    }

    fn model_variables(&self) -> String {
        let mut text = String::new();
        for (i, variable) in self.variables.iter().enumerate() {
            let kind = variable.role.attributes(self.sampled);
            let of = match variable.role {
                Role::Derivative(state) => format!(" derivative=\"{}\"", state + 1),
                _ => String::new(),
            };
            let _ = writeln!(
                text,
                "    <ScalarVariable name=\"{}\" valueReference=\"{i}\"{} {kind}>\n      \
                 <Real{}{of}/>\n    </ScalarVariable>",
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
        let row = |(place, on): (usize, String)| {
            format!("      <Unknown index=\"{place}\" dependencies=\"{on}\"/>\n")
        };
        let [always, first] =
            self.dependencies().map(|of| of.into_iter().map(row).collect::<String>());
        // Of any state and input.
        let free = self.derivatives().map(|place| format!("      <Unknown index=\"{place}\"/>\n"));
        let free: String = free.collect();
        let derivatives = match self.exchanges() {
            true => format!("    <Derivatives>\n{free}    </Derivatives>\n"),
            false => String::new(),
        };
        format!(
            "  <ModelStructure>\n    <Outputs>\n{always}    </Outputs>\n{derivatives}    \
             <InitialUnknowns>\n{first}{free}    </InitialUnknowns>\n  </ModelStructure>\n"
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
