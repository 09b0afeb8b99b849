//! Derivatives of the steps of a load path: the contacts that close, and the systems (33), (34).

use std::sync::atomic::AtomicBool;

use pyo3::prelude::*;

use crate::condensation::candidates::View;
use crate::error::{Error, check_length};
use crate::law::contact_law::ContactLaw;
use crate::linalg::small::add_scaled;
use crate::path::working_set;
use crate::python::arrays::{self, Indices, Matrix, NewIndices, NewMatrix, NewVector, Vector};
use crate::python::condensed_arrays::{CondensedArrays, StateArrays, loaded};
use crate::python::contact_values::{self, factors, laws, over, scale};
use crate::python::dimension::{Dimension, for_either, map_either};
use crate::python::interrupt;
use crate::python::problem::PyCondensed;
use crate::python::reduced_arrays::ReducedArrays;
use crate::reduced::reduced::{Reduced, Rigid};
use crate::solver::derivatives::tangent_stiffness_form::TangentStiffnessForm;
use crate::solver::derivatives::tangent_system::{ClosedLaw, FactoredTangent, TangentSystem};

/// The contacts of a problem that close in a load path, for its derivatives.
#[pyclass(frozen, name = "TangentView", module = "bipot_rs._core")]
pub(super) struct PyTangentView {
    kind: Dimension<View<2>, View<3>>,
    /// `T` of the members, component by component.
    factors: Vec<f64>,
    num_threads: Option<usize>,
}

/// Relative displacements without gaps, and the work on rigid motions.
pub(super) type Free<'py> = (NewMatrix<'py>, NewVector<'py>);

/// The view of a problem with `W` of `contacts`.
fn close<const D: usize>(
    py: Python<'_>,
    problem: &CondensedArrays<D>,
    contacts: Vec<usize>,
) -> PyResult<View<D>> {
    let count = problem.contacts();
    if let Some(&found) = contacts.iter().find(|&&contact| contact >= count) {
        check_length("contacts", found, count)?;
    }
    let mut view = problem.run(py, |stop| {
        working_set::with(&problem.problem, contacts.into_iter(), stop)
    })?;
    // Derivatives have no gaps.
    view.problem = view.problem.with_gap(vec![[0.0; D]; view.members.len()]);
    Ok(view)
}

#[pymethods]
impl PyTangentView {
    #[new]
    fn new(py: Python<'_>, problem: &PyCondensed, contacts: Indices<'_>) -> PyResult<Self> {
        let contacts = arrays::indices(&contacts, "contacts")?;
        let (elliptic, num_threads) = for_either!(&problem.kind, problem => {
            (problem.elliptic.as_ref(), problem.num_threads)
        });
        let kind = map_either!(&problem.kind, problem => close(py, problem, contacts)?);
        let members = for_either!(&kind, view => view.members.iter());
        Ok(Self {
            factors: factors(kind.count(), members.copied(), elliptic),
            kind,
            num_threads,
        })
    }

    #[getter]
    fn members<'py>(&self, py: Python<'py>) -> NewIndices<'py> {
        arrays::from_indices(py, for_either!(&self.kind, view => view.members.clone()))
    }

    #[getter]
    fn diagonal<'py>(&self, py: Python<'py>) -> NewMatrix<'py> {
        let diagonal: Vec<f64> = for_either!(&self.kind, view => {
            let compliance = view.problem.compliance();
            let own = (0..compliance.contacts()).map(|i| compliance.block(i).diagonal());
            let own = compliance.scatter(&own.collect::<Vec<_>>());
            own.iter().flatten().copied().collect()
        });
        // W = T⁻¹ W̃ T⁻¹.
        let own = over(&over(&diagonal, &self.factors), &self.factors);
        arrays::of_contacts(py, own, self.kind.count())
    }

    #[getter]
    fn modes<'py>(&self, py: Python<'py>) -> NewMatrix<'py> {
        let modes: Vec<Vec<f64>> = for_either!(&self.kind, view => {
            let modes = view.problem.modes();
            modes.iter().map(|mode| over(mode.as_flattened(), &self.factors)).collect()
        });
        arrays::square(py, modes.concat(), modes.len(), self.factors.len())
    }

    fn free_part<'py>(
        &self,
        py: Python<'py>,
        load: Vector<'py>,
        prescribed: Vector<'py>,
    ) -> PyResult<Free<'py>> {
        let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
        let (q, e) = for_either!(&self.kind, view => {
            let part = interrupt::run(py, self.num_threads, |_| {
                view.problem.free_part(load, prescribed)
            })?;
            (over(part.q.as_flattened(), &self.factors), part.rigid.load)
        });
        let q = arrays::of_contacts(py, q, self.kind.count());
        Ok((q, arrays::from_vec(py, e)))
    }

    fn product<'py>(
        &self,
        py: Python<'py>,
        reaction: Matrix<'py>,
        rigid: Vector<'py>,
    ) -> PyResult<NewMatrix<'py>> {
        let v = for_either!(&self.kind, view => {
            let compliance = view.problem.compliance();
            let modes = view.problem.modes();
            let rigid = arrays::numbers("rigid", &rigid, modes.len())?;
            let r = contact_values::read("reaction", &reaction, &self.factors)?;
            let r = compliance.gather(&r);
            let mut v = vec![[0.0; _]; r.len()];
            compliance.product(&r, &mut v);
            let mut v = compliance.scatter(&v).into_flattened();
            for (mode, amount) in modes.iter().zip(rigid) {
                add_scaled(&mut v, *amount, mode.as_flattened());
            }
            over(&v, &self.factors)
        });
        Ok(arrays::of_contacts(py, v, self.kind.count()))
    }

    fn displacements<'py>(
        &self,
        py: Python<'py>,
        states: Vec<StateArrays<'py>>,
    ) -> PyResult<NewMatrix<'py>> {
        let (u, n) = for_either!(&self.kind, inner => {
            let reactions = states.iter().map(|(_, _, reaction, _)| {
                contact_values::read("reaction", reaction, &self.factors)
            });
            let reactions = reactions.collect::<PyResult<Vec<_>>>()?;
            let loaded = loaded(&states, &reactions)?;
            let problem = &inner.problem;
            let bodies = problem.bodies();
            let u = interrupt::run(py, self.num_threads, |_| {
                bodies.changes(problem.surface(), &loaded)
            })?;
            (u.concat(), bodies.order())
        });
        Ok(arrays::square(py, u, states.len(), n))
    }

    fn system(
        &self,
        py: Python<'_>,
        closed: Indices<'_>,
        by_r: Matrix<'_>,
        by_v: Matrix<'_>,
    ) -> PyResult<Option<PyTangentSystem>> {
        let closed = arrays::indices(&closed, "closed")?;
        let (system, factors) = for_either!(&self.kind, view => {
            let (laws, factors) = laws(&closed, (&by_r, &by_v), &self.factors)?;
            let system = interrupt::run(py, self.num_threads, |stop| {
                factored(view, placed(laws, view.problem.compliance().order()), stop)
            });
            (system?, factors)
        });
        Ok(system.map(|system| PyTangentSystem { system, factors }))
    }
}

type Factored = Result<Option<Box<dyn FactoredTangent>>, Error>;

/// The system of some contacts of a view; nothing if it is singular.
fn factored<const D: usize>(
    view: &View<D>,
    laws: Vec<ClosedLaw<D>>,
    stop: &AtomicBool,
) -> Factored {
    let contacts = view.members.len();
    let modes = view.problem.modes();
    let load = vec![0.0; modes.len()];
    let q = vec![[0.0; D]; contacts];
    let law = vec![ContactLaw::default(); contacts];
    let still = modes.is_empty();
    let modes = modes.into();
    let problem = Reduced::new(view.problem.compliance(), &q, &law, &Rigid { modes, load })?;
    if still {
        let shared = view.problem.shared_compliance();
        let small = TangentStiffnessForm::new(shared, &problem.scaling, &laws, stop)?;
        if let Some(small) = small {
            return Ok(Some(Box::new(small)));
        }
    }
    boxed(TangentSystem::new(&problem, &laws, stop))
}

/// The system of some contacts of a reduced problem; nothing if it is singular.
pub(super) fn of_reduced<const D: usize>(
    problem: &ReducedArrays<D>,
    py: Python<'_>,
    closed: &[usize],
    law: (&Matrix<'_>, &Matrix<'_>),
) -> PyResult<Option<PyTangentSystem>> {
    let all = factors(D, 0..problem.contacts(), problem.elliptic.as_ref());
    let (laws, factors) = laws::<D>(closed, law, &all)?;
    let system = problem.run(py, None, None, |problem, stop, _| {
        let laws = placed(laws, problem.compliance.order());
        boxed(TangentSystem::new(problem, &laws, stop))
    })?;
    Ok(system.map(|system| PyTangentSystem { system, factors }))
}

/// Laws with the places of their contacts in an order.
fn placed<const D: usize>(mut laws: Vec<ClosedLaw<D>>, order: &[usize]) -> Vec<ClosedLaw<D>> {
    let mut place = vec![0; order.len()];
    for (position, &contact) in order.iter().enumerate() {
        place[contact] = position;
    }
    for law in &mut laws {
        law.position = place[law.position];
    }
    laws
}

fn boxed(made: Result<Option<TangentSystem>, Error>) -> Factored {
    Ok(made?.map(|system| Box::new(system) as Box<dyn FactoredTangent>))
}

/// The factored system of one step.
#[pyclass(frozen, name = "TangentSystem", module = "bipot_rs._core")]
pub(super) struct PyTangentSystem {
    system: Box<dyn FactoredTangent>,
    /// `T` of its contacts: `r = T r̃`.
    factors: Vec<f64>,
}

#[pymethods]
impl PyTangentSystem {
    fn solve<'py>(&self, py: Python<'py>, right: Matrix<'py>) -> PyResult<NewMatrix<'py>> {
        self.each(py, &right, |x| {
            self.system.solve(x);
            scale(x, &self.factors);
        })
    }

    fn solve_transposed<'py>(
        &self,
        py: Python<'py>,
        right: Matrix<'py>,
    ) -> PyResult<NewMatrix<'py>> {
        self.each(py, &right, |x| {
            scale(x, &self.factors);
            self.system.solve_transposed(x);
        })
    }

    #[getter]
    fn reciprocal_condition(&self) -> f64 {
        self.system.reciprocal_condition()
    }
}

impl PyTangentSystem {
    fn each<'py>(
        &self,
        py: Python<'py>,
        right: &Matrix<'py>,
        solve: impl Fn(&mut [f64]),
    ) -> PyResult<NewMatrix<'py>> {
        let (rows, columns) = right.as_array().dim();
        check_length("right", columns, self.system.order())?;
        let mut all = right.as_slice()?.to_vec();
        all.chunks_exact_mut(columns.max(1)).for_each(solve);
        Ok(arrays::square(py, all, rows, columns))
    }
}
