//! Algorithms on the reduced problem, with their input, their result and the monitor.

pub mod anderson;
mod associated;
pub mod at_rest;
pub mod auto;
mod bordered;
pub mod derivatives;
pub mod enumerate;
pub mod evaluated_point;
mod fallback;
pub mod farkas;
pub mod gauss_seidel;
pub mod interior;
pub mod monitor;
pub mod newton;
pub mod outcome;
pub mod paper;
pub mod proximal;
pub mod settings;
pub mod solution;
pub mod solve;
mod tuning;

pub use crate::solver::outcome::Outcome;
pub use crate::solver::settings::{Method, Settings, Start};
pub use crate::solver::solution::Solution;
pub use crate::solver::solve::{certify, solve, solve_watched};
