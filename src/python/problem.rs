//! The condensed contact problem.

use std::sync::Arc;

use pyo3::prelude::*;

use crate::bodies::geometry::Kinematics;
use crate::condensation::bodies::Loads as OwnLoads;
use crate::condensation::condense::{ProblemArrays, SortedProblem};
use crate::condensation::forecast::Notice;
use crate::condensation::problem::Problem;
use crate::linalg::sparse::csc::Symmetric;
use crate::proof::uniqueness;
use crate::python::arrays::{
    self, Csr, CsrArrays, CsrOutput, Indices, LawArrays, Matrix, NewMatrix, NewVector, Vector,
};
use crate::python::bound::{self, PyBound};
use crate::python::condensed_arrays::{CondensedArrays, StateArrays};
use crate::python::dimension::{Dimension, for_either, map_either};
use crate::python::estimate::{self, Estimate};
use crate::python::interrupt;
use crate::python::stats::{PyForecast, PyStats};
use crate::reduced::elliptic_scaling::over;
use crate::reduced::memory::{self, Budget};
use crate::reduced::rotation::Rotation;

type FreePartArrays<'py> = (NewMatrix<'py>, NewMatrix<'py>, NewVector<'py>);

/// `K`, `B`, gap and friction, condensed onto the contact set.
#[pyclass(frozen, name = "Condensed", module = "bipot_rs._core")]
pub(super) struct PyCondensed {
    pub(super) kind: Dimension<CondensedArrays<2>, CondensedArrays<3>>,
}

#[pymethods]
impl PyCondensed {
    /// `places` are the positions in space of the degrees of freedom. `known` are all loads,
    /// for each step a pair of total forces and prescribed displacements. `memory_limit` is in
    /// bytes. `grow` decides whether `W` is formed for a working set; `None` lets the gaps
    /// decide. The analyses of `before` are used again for equal patterns. `on_forecast` is
    /// called with the counts of the analysis within 0.1 s; an exception from it stops the
    /// work. `kinematics`, from a mesh, are positions in place of `places`, what all rigid
    /// motions move `(n, m)`, and the loss of each row, as in [`Kinematics`].
    #[new]
    #[pyo3(signature = (
        stiffness, contact, gap, law, fixed, num_threads,
        places=None, known=None, memory_limit=None, grow=None, before=None, on_forecast=None,
        kinematics=None
    ))]
    fn new<'py>(
        py: Python<'py>,
        stiffness: Csr<'py>,
        contact: Csr<'py>,
        gap: Matrix<'py>,
        law: LawArrays<'py>,
        fixed: Indices<'py>,
        num_threads: Option<usize>,
        places: Option<Matrix<'py>>,
        known: Option<Vec<(Vector<'py>, Vector<'py>)>>,
        memory_limit: Option<u64>,
        grow: Option<bool>,
        before: Option<PyRef<'py, PyCondensed>>,
        on_forecast: Option<Py<PyAny>>,
        kinematics: Option<(Matrix<'py>, Matrix<'py>, Vector<'py>)>,
    ) -> PyResult<Self> {
        let notice = on_forecast.is_some().then(Notice::default);
        let tell = |py: Python<'_>| match (&on_forecast, &notice) {
            (Some(told), Some(notice)) => notice.take().map_or(Ok(()), |forecast| {
                told.call1(py, (PyForecast::from(forecast),)).map(drop)
            }),
            _ => Ok(()),
        };
        let loads = |(load, moved): &(Vector<'_>, Vector<'_>)| -> PyResult<OwnLoads> {
            Ok((load.as_slice()?.to_vec(), moved.as_slice()?.to_vec()))
        };
        let known = known.map(|steps| steps.iter().map(loads).collect::<PyResult<_>>());
        let (places, mesh) = match &kinematics {
            Some((places, motions, loss)) => {
                let (motions, loss) = (motions.as_slice()?, loss.as_slice()?);
                (Some(places), Some(Kinematics { motions, loss }))
            }
            None => (places.as_ref(), None),
        };
        let places = places.map(arrays::rows::<3>).transpose()?;
        let (law, elliptic) = law.read(gap.as_array().ncols())?;
        let k = CsrArrays::new(&stiffness, "K", num_threads)?;
        let contact = CsrArrays::new(&contact, "B", num_threads)?;
        let fixed = arrays::indices(&fixed, "fixed")?;
        let known = known.transpose()?;
        let limit = memory_limit.map(u128::from);
        let before = before.as_ref().map(|problem| &problem.kind);
        let before = match (Dimension::of(gap.as_array().ncols()), before) {
            (Dimension::Plane(()), Some(Dimension::Plane(own))) => Dimension::Plane(Some(own)),
            (Dimension::Space(()), Some(Dimension::Space(own))) => Dimension::Space(Some(own)),
            (Dimension::Plane(()), _) => Dimension::Plane(None),
            (Dimension::Space(()), _) => Dimension::Space(None),
        };
        let kind = map_either!(before, before => {
            let gap = arrays::rows(&gap)?;
            let scaling = elliptic.as_ref();
            let before = before.map(|before| &*before.problem);
            let notice = notice.clone();
            let problem = interrupt::watch(py, num_threads, &tell, |stop| {
                // The converted indices are freed before the factor is made.
                let mut sorted = {
                    let (k, contact) = (k, contact);
                    let n = k.pointer.len().saturating_sub(1);
                    SortedProblem::new(ProblemArrays {
                        stiffness: Symmetric::new(n, &k.pointer, &k.index, k.values)?,
                        contact: contact.rows(),
                        gap,
                        law: &law,
                        fixed: &fixed,
                        places,
                        kinematics: mesh,
                        known,
                        budget: Budget { limit },
                    })?
                };
                if let Some(scaling) = scaling {
                    sorted.surface.scale(scaling);
                }
                sorted.notice = notice;
                Problem::new(sorted, grow, before, stop)
            })?;
            CondensedArrays {
                problem: Arc::new(problem),
                elliptic,
                num_threads,
            }
        });
        // Small problems end before the first check.
        tell(py)?;
        Ok(Self { kind })
    }

    fn compliance<'py>(&self, py: Python<'py>) -> PyResult<NewMatrix<'py>> {
        let (dense, n) = for_either!(&self.kind, problem => {
            let n = problem.components();
            memory::check("the dense compliance W", 8 * (n as u128).pow(2))?;
            (problem.compliance(py, |compliance| Ok(compliance.to_dense()))?, n)
        });
        Ok(arrays::square(py, dense, n, n))
    }

    /// The blocks of `W` if it is sparse: the first block of each row, the column of each, and
    /// their entries, row-major.
    #[expect(clippy::type_complexity, reason = "the arrays of one sparse matrix")]
    fn sparse_compliance<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<(Vec<usize>, Vec<usize>, NewVector<'py>)>> {
        #[expect(
            clippy::redundant_closure_for_method_calls,
            reason = "the method is for one lifetime"
        )]
        let blocks = for_either!(&self.kind, problem => {
            problem.compliance(py, |compliance| compliance.rows_of_blocks())?
        });
        Ok(blocks.map(|(start, column, values)| (start, column, arrays::from_vec(py, values))))
    }

    fn free_part<'py>(
        &self,
        py: Python<'py>,
        load: Vector<'py>,
        prescribed: Vector<'py>,
    ) -> PyResult<FreePartArrays<'py>> {
        let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
        for_either!(&self.kind, problem => {
            let part = problem.run(py, |stop| {
                problem.problem.whole(stop)?.free_part(load, prescribed)
            })?;
            Ok((
                arrays::from_rows(py, &over(problem.elliptic.as_ref(), &part.q)),
                problem.as_rows(py, &part.rigid.modes.columns()),
                arrays::from_vec(py, part.rigid.load),
            ))
        })
    }

    fn stiffness<'py>(&self, py: Python<'py>) -> PyResult<CsrOutput<'py>> {
        let matrix = for_either!(&self.kind, problem => {
            problem.run(py, |_| Ok(problem.problem.bodies().stiffness()))?
        });
        Ok(arrays::from_csr(py, matrix))
    }

    fn modes<'py>(&self, py: Python<'py>) -> PyResult<NewMatrix<'py>> {
        for_either!(&self.kind, problem => {
            let modes = problem.run(py, |_| problem.problem.modes())?;
            Ok(problem.as_rows(py, &modes))
        })
    }

    fn make_inverse(&self, py: Python<'_>) -> PyResult<()> {
        for_either!(&self.kind, problem => match &*problem.problem {
            Problem::Whole(whole) => {
                problem.run(py, |stop| whole.compliance().make_inverse(stop)).map(drop)
            }
            Problem::Growing { .. } => Ok(()),
        })
    }

    #[pyo3(signature = (states, confirmed=None))]
    fn displacements<'py>(
        &self,
        py: Python<'py>,
        states: Vec<StateArrays<'py>>,
        confirmed: Option<Vec<[Matrix<'py>; 3]>>,
    ) -> PyResult<NewMatrix<'py>> {
        for_either!(&self.kind, problem => {
            problem.displacements(py, &states, confirmed.as_deref())
        })
    }

    fn with_law(&self, law: LawArrays<'_>) -> PyResult<Self> {
        let kind = map_either!(&self.kind, problem => problem.with_law(&law)?);
        Ok(Self { kind })
    }

    /// The same bodies and contacts with other gaps, as in a step with moving obstacles.
    fn with_gap(&self, gap: Matrix<'_>) -> PyResult<Self> {
        let kind = map_either!(&self.kind, problem => problem.moved(Some(arrays::rows(&gap)?))?);
        Ok(Self { kind })
    }

    fn rotated(&self, py: Python<'_>, rotation: Matrix<'_>) -> PyResult<Self> {
        let kind = map_either!(&self.kind, problem => {
            let rotation = Rotation::new(arrays::rows(&rotation)?, problem.elliptic.as_ref());
            problem.with(problem.run(py, |_| problem.problem.rotated(&rotation))?)
        });
        Ok(Self { kind })
    }

    #[getter]
    fn stats(&self) -> PyStats {
        for_either!(&self.kind, problem => PyStats::from(&*problem.problem))
    }

    #[pyo3(signature = (load, prescribed, before, reaction))]
    fn assess(
        &self,
        py: Python<'_>,
        load: Vector<'_>,
        prescribed: Vector<'_>,
        before: Option<Matrix<'_>>,
        reaction: Matrix<'_>,
    ) -> PyResult<&'static str> {
        let loads = (load.as_slice()?, prescribed.as_slice()?);
        let asked = (loads, before.as_ref(), &reaction);
        let unique = match &self.kind {
            Dimension::Plane(problem) => problem.assess(py, asked, uniqueness::assess_plane),
            Dimension::Space(problem) => problem.assess(py, asked, uniqueness::assess),
        };
        Ok(unique?.name())
    }

    fn forward_errors(
        &self,
        py: Python<'_>,
        load: Vector<'_>,
        prescribed: Vector<'_>,
        before: Option<Matrix<'_>>,
        reaction: Matrix<'_>,
        rigid: Vector<'_>,
    ) -> PyResult<Estimate> {
        let loads = (load.as_slice()?, prescribed.as_slice()?);
        let rigid = rigid.as_slice()?;
        for_either!(&self.kind, problem => {
            let state = problem.state(before.as_ref())?;
            let reaction = problem.reaction(&reaction)?;
            estimate::of_step(problem, py, (loads, state), (&reaction, rigid))
        })
    }

    fn error_bound(
        &self,
        py: Python<'_>,
        load: Vector<'_>,
        prescribed: Vector<'_>,
        before: Option<Matrix<'_>>,
        reaction: Matrix<'_>,
        reported: Matrix<'_>,
        rigid: Vector<'_>,
    ) -> PyResult<Option<PyBound>> {
        let loads = (load.as_slice()?, prescribed.as_slice()?);
        let rigid = rigid.as_slice()?;
        for_either!(&self.kind, problem => {
            let state = problem.state(before.as_ref())?;
            let reaction = problem.reaction(&reaction)?;
            bound::of_step(problem, py, (loads, state.as_ref()), (&reaction, rigid), &reported)
        })
    }
}
