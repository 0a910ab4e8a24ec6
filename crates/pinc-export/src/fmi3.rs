//! The model description of FMI 3.0.

use crate::Name;
use crate::fmi2::described;
use crate::fmu::{Description, GUID, LOG_CATEGORIES};
use crate::fmu_variables::{Real, Role};
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
        let kept = "canGetAndSetFMUState=\"true\" canSerializeFMUState=\"true\"/>\n";
        let exchange = match self.exchanges() {
            true => format!("  <ModelExchange modelIdentifier=\"{name}\" {kept}"),
            false => String::new(),
        };
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"3.0\" \
             modelName=\"{name}\"{}\n    instantiationToken=\"{}\"\n    generationTool=\"pinc {}\" \
             variableNamingConvention=\"flat\">\n{exchange}  <CoSimulation \
             modelIdentifier=\"{name}\" canHandleVariableCommunicationStepSize=\"{}\"\n      \
             {kept}{}{}{}  <DefaultExperiment startTime=\"0\" \
             stepSize=\"{}\"/>\n  <ModelVariables>\n    <Float64 name=\"time\" \
             valueReference=\"0\" causality=\"independent\" variability=\"continuous\"/>\n{}  \
             </ModelVariables>\n{}</fmiModelDescription>\n",
            self.description(),
            GUID,
            attribute(&origin.version),
            self.any_step,
            self.units(),
            self.types3(),
            LOG_CATEGORIES,
            constant(self.step_s),
            self.variables3(),
            self.structure3(),
        )
    }

    fn types3(&self) -> String {
        self.type_definitions(|name, items| {
            format!("    <EnumerationType name=\"{name}\">\n{items}    </EnumerationType>\n")
        })
    }

    fn variables3(&self) -> String {
        let variable = |(i, of): (usize, &Real)| {
            let mut kind = of.role.attributes(self.sampled);
            if let Role::Derivative(state) = of.role {
                kind += &format!(" derivative=\"{}\"", state + 1);
            }
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
        let list = |tag: &str, of: &[(usize, String)]| -> String {
            let row = |(place, on): &(usize, String)| {
                format!("    <{tag} valueReference=\"{place}\" dependencies=\"{on}\"/>\n")
            };
            of.iter().map(row).collect()
        };
        let [always, first] = self.dependencies();
        let (outputs, unknowns) = (list("Output", &always), list("InitialUnknown", &first));
        // Of any state and input.
        let free = |tag: &str| -> String {
            let row = |place| format!("    <{tag} valueReference=\"{place}\"/>\n");
            self.derivatives().map(row).collect()
        };
        let (derivatives, more) = (free("ContinuousStateDerivative"), free("InitialUnknown"));
        format!("  <ModelStructure>\n{outputs}{derivatives}{unknowns}{more}  </ModelStructure>\n")
    }
}
