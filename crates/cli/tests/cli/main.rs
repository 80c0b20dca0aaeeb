//! The programs, and the parameters of their options.

mod hostile_parameters;
mod programs;
mod service_names;
