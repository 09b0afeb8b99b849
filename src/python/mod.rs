//! The extension module `bipot_rs._core`: registration only. `_core.pyi` says what a class and a
//! function do and take; here stands what it does not say.

#![expect(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    reason = "PyO3 hands arguments over by value; signatures are those that Python sees"
)]

mod arrays;
mod assembly;
mod bodies;
mod bound;
mod condensed_arrays;
mod contact_path;
mod contact_values;
mod contact_variables;
mod dimension;
mod equilibrium;
mod errors;
mod estimate;
mod interrupt;
mod linearised_laws;
mod load_path;
mod plastic_points;
mod primal;
mod primal_tangent;
mod problem;
mod reduced;
mod reduced_arrays;
mod solution;
mod solver;
mod stats;
mod stiffness_rows;
mod tangent;

use pyo3::prelude::*;

#[pymodule]
#[expect(non_upper_case_globals, reason = "the names that Python sees")]
mod _core {
    use pyo3::prelude::*;

    use crate::solver::Method;

    #[pyfunction]
    fn return_heap() {
        crate::linalg::pages::return_heap();
    }

    #[pymodule_export]
    use super::arrays::find_outside;
    #[pymodule_export]
    use super::assembly::{bodies, diagonal, stiffness, sum_of_cells};
    #[pymodule_export]
    use super::bodies::{
        combine_motions, connected, dof_directions, free_motions, resisting_rows, rigid_motions,
    };
    #[pymodule_export]
    use super::bound::PyBound;
    #[pymodule_export]
    use super::contact_path::PyContactPath;
    #[pymodule_export]
    use super::contact_variables::{PyContactTangent, PyContactVariables};
    #[pymodule_export]
    use super::equilibrium::{PyConeSet, PyDecision, PyLimitLoad, PyStatics};
    #[pymodule_export]
    use super::linearised_laws::PyLinearisedLaws;
    #[pymodule_export]
    use super::load_path::{PyPath, follow};
    #[pymodule_export]
    use super::plastic_points::respond_points;
    #[pymodule_export]
    use super::primal::{PyPrimal, PyPrimalPath};
    #[pymodule_export]
    use super::primal_tangent::PyPrimalTangent;
    #[pymodule_export]
    use super::problem::PyCondensed;
    #[pymodule_export]
    use super::reduced::PyReduced;
    #[pymodule_export]
    use super::solution::{PyLoadStep, PyNewtonStep, PySequence, PySolution};
    #[pymodule_export]
    use super::solver::{PySettings, is_sparse, isotropic, project, threads};
    #[pymodule_export]
    use super::stats::{PyForecast, PyStats};
    #[pymodule_export]
    use super::stiffness_rows::PyStiffnessRows;
    #[pymodule_export]
    use super::tangent::{PyTangentSystem, PyTangentView};

    /// Two friction coefficients of a contact are within this factor of each other.
    #[pymodule_export]
    const largest_friction_ratio: f64 = crate::reduced::elliptic_scaling::LARGEST_RATIO;

    /// Friction coefficients are at most this.
    #[pymodule_export]
    const largest_friction: f64 = crate::law::contact_law::LARGEST_FRICTION;

    /// Reactions that are this many times the loads are not a solution.
    #[pymodule_export]
    const largest_reaction: f64 = crate::reduced::existence::LARGEST_REACTION;

    /// Loads that are out of balance by a smaller share count as balanced.
    #[pymodule_export]
    const least_work: f64 = crate::reduced::existence::LEAST_WORK;

    /// More bodies that contact alone holds are left to the direct engine.
    #[pymodule_export]
    const most_loose_bodies: usize = crate::bodies::holding::MOST_LOOSE;

    /// How this module was compiled: `"release"`, or `"debug"`, which is far slower.
    #[pymodule_export]
    const build_profile: &str = if cfg!(debug_assertions) {
        "debug"
    } else {
        "release"
    };

    /// The names of the methods of solution.
    #[pymodule_export]
    const METHODS: [&str; Method::NAMES.len()] = {
        let mut names = [""; Method::NAMES.len()];
        let mut k = 0;
        while k < names.len() {
            names[k] = Method::NAMES[k].0;
            k += 1;
        }
        names
    };

    /// Adds the least share of the rows without supports that are in balance if coordinates are
    /// right.
    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("least_balanced", crate::bodies::tuning::believed_share())
    }

    /// The version of the crate.
    #[pymodule_export]
    const version: &str = env!("CARGO_PKG_VERSION");
}
