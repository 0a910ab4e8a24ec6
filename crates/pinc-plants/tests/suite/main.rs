//! The tests of pinc-plants, as one program.

mod acetone_still;
mod johansson;
mod stiff_plants;
mod values;
