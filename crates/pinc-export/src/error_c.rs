//! The estimated error of a net's step, in C.

use crate::equation::{check_constants, jacobian};
use crate::error::finite;
use crate::golden::{CASES, points};
use crate::net_c::has_time;
use crate::open::Open;
use crate::origin::Origin;
use crate::runge_kutta_c::{RungeKuttaModel, runge_kutta_core};
use crate::template::{Template, numbers, table};
use crate::{ExportError, GeneratedFile, Name};
use pinc_expr::PlantEquations;
use pinc_net::PincNet;
use pinc_verify::{ErrorEstimate, NODES, quadrature_node, reference};

/// What the page says of it.
const TEXT: &str = "`pinc_error(x, u, error)` of `pinc_error.h` estimates the error of the net's step, the net's \
state minus the exact solution of the plant's equation, in the states' units.\n\n";

/// A net and the equation that it stands for, with the parameters that are arguments.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NetError<'a> {
    pub(crate) net: &'a PincNet,
    pub(crate) equations: &'a PlantEquations,
    pub(crate) open: Open<'a>,
}

impl NetError<'_> {
    /// Header and source of the estimate; the net's own has a function of the path.
    pub(crate) fn core(
        self,
        name: &Name,
        origin: &Origin,
    ) -> Result<Vec<GeneratedFile>, ExportError> {
        let Self { net, equations, open } = self;
        let names = self.names();
        let mut t = Template::new(name);
        t.set("BANNER", origin.banner("The estimated error of a net.", Some(net)));
        open.set(&mut t);
        let mut files = vec![t.file("error.h", include_str!("../templates/error.h"))];
        if has_time(net) {
            let (fixed, varying) = open.equations(equations, &names);
            let listing = fixed.listing(&varying)?;
            check_constants("a constant of the plant's equations", &listing)?;
            let dims = net.dims();
            let of = |i: usize| {
                numbers(&std::array::from_fn::<f64, NODES, _>(|k| quadrature_node(k)[i]))
            };
            t.set("NODES", NODES)
                .set("PLACES", of(0))
                .set("WEIGHTS", of(1))
                .set("JACOBIAN", jacobian(&listing, dims.nx, dims.nu + varying.len(), "dx").body);
            files.push(t.file("error.c", include_str!("../templates/error_residual.c")));
        } else {
            let varying: Vec<&str> = names.iter().map(String::as_str).collect();
            let plant = equations.compile_with(&varying)?.into_dyn();
            let (method, substeps) = reference(net, &*plant, net.sample_time_s())?;
            if method.tableau().is_none() {
                let feature = "the estimated error of a distilled net of a stiff plant";
                return Err(ExportError::Feature { feature, instead: "`pinc serve`" });
            }
            let sample_time_s = net.sample_time_s();
            let exact =
                RungeKuttaModel { equations, parameters: &names, method, sample_time_s, substeps };
            files.push(t.file("error.c", include_str!("../templates/error_reference.c")));
            files.extend(runge_kutta_core(exact, "exact", open, name, origin)?);
        }
        Ok(files)
    }

    fn names(&self) -> Vec<String> {
        self.net.parameter_names().map(str::to_owned).collect()
    }

    /// Fills what a self-test says of the estimate, with the library's at points of the domain;
    /// `call` is the statement that judges it.
    pub(crate) fn set_selftest(
        self,
        t: &mut Template,
        call: &'static str,
    ) -> Result<(), ExportError> {
        let Self { net, equations, open } = self;
        let names = self.names();
        if open.values().len() != names.len() {
            return Err(ExportError::Family(names.join(", ")));
        }
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let plant = equations.compile_with(&names)?.into_dyn();
        let mut estimate = ErrorEstimate::new(net, &*plant)?;
        let dims = net.dims();
        let ends: Vec<_> = net.domain().ends().take(dims.nx + dims.nu).collect();
        let (mut states, mut arguments, mut errors) = (Vec::new(), Vec::new(), Vec::new());
        for point in points(&ends) {
            let (x, u) = point.split_at(dims.nx);
            let mut error = vec![0.0; dims.nx];
            estimate.write(x, u, open.values(), &mut error);
            states.push(x.to_vec());
            arguments.push(u.iter().copied().chain(open.initial()).collect());
            errors.push(error);
        }
        finite("the estimated error in the net's domain", errors.iter().flatten())?;
        let tables = [("error_x", states), ("error_u", arguments), ("error_of", errors)];
        let tables = tables.map(|(name, rows)| table(name, &rows)).concat();
        open.set(t);
        t.set("CASES", CASES)
            .set("ERROR_TEXT", TEXT)
            .set("ERROR_INCLUDE", "#include \"pinc_error.h\"\n")
            .set("ERROR_TABLES", tables)
            .set("ERROR_TEST", include_str!("../templates/error_selftest.c"))
            .set("ERROR_CALL", call);
        Ok(())
    }
}

/// Fills the places of a self-test without an estimate.
pub(crate) fn without_estimate(t: &mut Template) {
    for key in ["ERROR_INCLUDE", "ERROR_TEST", "ERROR_CALL", "ERROR_TEXT"] {
        t.set(key, "");
    }
}
