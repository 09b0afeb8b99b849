//! Load paths, step by step, with all contacts or with a working set.

pub mod stepping;
mod tuning;
pub mod working_set;
