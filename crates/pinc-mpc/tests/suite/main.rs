//! The controller against answers known by other means: formulas for linear models, an
//! independent assembly of the KKT conditions, and what must happen when things go wrong.

mod agreement;
mod applied_input;
mod crawl;
mod deadlines;
mod economic;
mod failures;
mod faulty;
mod feedthrough;
mod formulation;
mod guard;
mod kkt;
mod linear;
mod memory;
mod methods;
mod misuse;
mod optimality;
mod outputs;
mod problems;
mod random;
mod scenarios;
mod stages;
mod stream;
mod support;
mod survey;
mod timetable;
mod together;
mod tube;
mod units;
mod wicked;
mod work;
