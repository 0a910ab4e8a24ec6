//! stub
use crate::BenchError; use crate::spec::*; use super::Options; use crate::record::Record; use pinc_net::PincNet; use pinc_ode::Plant;
pub(crate) struct Setup<'a> { pub spec: &'a ControlSpec, pub models: &'a [ModelKind], pub net: Option<&'a PincNet>, pub horizon_s: f64 }
pub(crate) fn stage<P: Plant + 'static>(_: &P, _: &Setup<'_>, _: &Options<'_>, _: &mut Record) -> Result<(), BenchError> { Ok(()) }
