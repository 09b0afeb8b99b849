//! Load paths: step after step, of all contacts or of those that may close.

pub mod stepping;
pub mod working_set;
