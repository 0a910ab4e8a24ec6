//! A net as an external function of CasADi.

use crate::net_c::{check_member, net_core, net_page, places};
use crate::open::Open;
use crate::origin::Origin;
use crate::{ExportError, GeneratedFile, Name};
use pinc_net::PincNet;

/// The net as C that CasADi's `external` takes, with exact first and second derivatives.
///
/// The function has the name itself, inputs `x` and `u` and the output `x_next`; its derivatives
/// are `jac_NAME` and `jac_jac_NAME`, by CasADi's rules for external functions.
///
/// # Errors
///
/// [`ExportError::Net`] for a conventional PINN, which is no model; [`ExportError::Family`].
pub fn net_to_casadi(
    net: &PincNet,
    name: &Name,
    origin: &Origin,
) -> Result<Vec<GeneratedFile>, ExportError> {
    check_member(net)?;
    let mut files = net_core((net, false), Open::default(), name, origin)?;
    let mut t = places(net, Open::default(), name, origin)?;
    files.push(t.file("casadi.c", include_str!("../templates/casadi.c")));
    net_page(net, origin, &mut t);
    files.push(t.named("README.md", include_str!("../templates/casadi_readme.md")));
    Ok(files)
}
