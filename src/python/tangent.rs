//! Derivatives of the steps of a load path: the contacts that close, and the systems (33), (34).

use pyo3::prelude::*;

use crate::condensation::bodies::Loaded;
use crate::condensation::candidates::View;
use crate::error::Error;
use crate::law::contact_law::ContactLaw;
use crate::linalg::small::Block;
use crate::path::working_set;
use crate::python::arrays::{self, Indices, Matrix, NewIndices, NewMatrix, NewVector, Vector};
use crate::python::condensed_arrays::CondensedArrays;
use crate::python::dimension::{Dimension, for_either, map_either};
use crate::python::interrupt;
use crate::python::problem::PyCondensed;
use crate::python::reduced_arrays::ReducedArrays;
use crate::reduced::elliptic_scaling::EllipticScaling;
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
    if let Some(&contact) = contacts.iter().find(|&&contact| contact >= count) {
        let error = Error::Shape {
            what: "contacts",
            expected: count,
            found: contact,
        };
        return Err(error.into());
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
        Ok(Self {
            factors: for_either!(&kind, view => factors_of(view, elliptic)),
            kind,
            num_threads,
        })
    }

    #[getter]
    fn members<'py>(&self, py: Python<'py>) -> PyResult<NewIndices<'py>> {
        arrays::from_indices(py, for_either!(&self.kind, view => view.members.clone()))
    }

    #[getter]
    fn diagonal<'py>(&self, py: Python<'py>) -> PyResult<NewMatrix<'py>> {
        fn of<const D: usize>(view: &View<D>) -> (Vec<f64>, usize) {
            let compliance = view.problem.compliance();
            let blocks: Vec<[f64; D]> = (0..compliance.contacts())
                .map(|i| compliance.block(i).diagonal().into())
                .collect();
            (compliance.scatter(&blocks).as_flattened().to_vec(), D)
        }
        let (diagonal, d) = for_either!(&self.kind, view => of(view));
        // W = T⁻¹ W̃ T⁻¹.
        let own = diagonal.iter().zip(&self.factors);
        arrays::of_contacts(py, own.map(|(w, t)| w / (t * t)).collect(), d)
    }

    #[getter]
    fn modes<'py>(&self, py: Python<'py>) -> PyResult<NewMatrix<'py>> {
        let modes = for_either!(&self.kind, view => {
            let modes = view.problem.modes();
            modes.iter().map(|mode| mode.as_flattened().to_vec()).collect::<Vec<_>>()
        });
        let own = modes.iter().flat_map(|mode| over(mode, &self.factors));
        arrays::square(py, own.collect(), modes.len(), self.factors.len())
    }

    fn free_part<'py>(
        &self,
        py: Python<'py>,
        load: Vector<'py>,
        prescribed: Vector<'py>,
    ) -> PyResult<Free<'py>> {
        let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
        let (q, e, d) = for_either!(&self.kind, view => {
            let part = interrupt::run(py, self.num_threads, |_| {
                view.problem.free_part(load, prescribed)
            })?;
            let q = over(part.q.as_flattened(), &self.factors);
            (q, part.rigid.load, part.q.first().map_or(2, |v| v.len()))
        });
        Ok((arrays::of_contacts(py, q, d)?, arrays::from_vec(py, e)))
    }

    fn product<'py>(
        &self,
        py: Python<'py>,
        reaction: Matrix<'py>,
        rigid: Vector<'py>,
    ) -> PyResult<NewMatrix<'py>> {
        fn of<const D: usize>(
            view: &View<D>,
            factors: &[f64],
            reaction: &Matrix<'_>,
            rigid: &[f64],
        ) -> PyResult<(Vec<f64>, usize)> {
            let given = arrays::rows_of::<D>("reaction", reaction, view.members.len())?;
            let modes = view.problem.modes();
            arrays::length("rigid", rigid.len(), modes.len())?;
            let own = over(given.as_flattened(), factors);
            let compliance = view.problem.compliance();
            let r = compliance.gather(own.as_chunks::<D>().0);
            let mut v = vec![[0.0; D]; r.len()];
            compliance.product(&r, &mut v);
            let mut v = compliance.scatter(&v);
            for (mode, amount) in modes.iter().zip(rigid) {
                for (v, m) in v.as_flattened_mut().iter_mut().zip(mode.as_flattened()) {
                    *v += amount * m;
                }
            }
            Ok((over(v.as_flattened(), factors), D))
        }
        let rigid = rigid.as_slice()?;
        let (v, d) = for_either!(&self.kind, view => of(view, &self.factors, &reaction, rigid)?);
        arrays::of_contacts(py, v, d)
    }

    fn displacements<'py>(
        &self,
        py: Python<'py>,
        states: Vec<(Vector<'py>, Vector<'py>, Matrix<'py>, Vector<'py>)>,
    ) -> PyResult<NewMatrix<'py>> {
        fn of<const D: usize>(
            py: Python<'_>,
            view: &PyTangentView,
            inner: &View<D>,
            states: &[(Vector<'_>, Vector<'_>, Matrix<'_>, Vector<'_>)],
        ) -> PyResult<(Vec<f64>, usize)> {
            let mut reactions = Vec::with_capacity(states.len());
            for (_, _, reaction, _) in states {
                let given = arrays::rows_of::<D>("reaction", reaction, inner.members.len())?;
                let own = over(given.as_flattened(), &view.factors);
                reactions.push(own.as_chunks::<D>().0.to_vec());
            }
            let mut loaded = Vec::with_capacity(states.len());
            for ((load, prescribed, _, rigid), reaction) in states.iter().zip(&reactions) {
                loaded.push(Loaded {
                    load: load.as_slice()?,
                    prescribed: prescribed.as_slice()?,
                    reaction,
                    rigid: rigid.as_slice()?,
                });
            }
            let problem = &inner.problem;
            let all = interrupt::run(py, view.num_threads, |_| {
                problem.bodies().changes(problem.surface(), &loaded)
            })?;
            Ok((all.concat(), problem.bodies().order()))
        }
        let (u, n) = for_either!(&self.kind, inner => of(py, self, inner, &states)?);
        arrays::square(py, u, states.len(), n)
    }

    fn system(
        &self,
        py: Python<'_>,
        closed: Indices<'_>,
        by_r: Matrix<'_>,
        by_v: Matrix<'_>,
    ) -> PyResult<Option<PyTangentSystem>> {
        fn of<const D: usize>(
            py: Python<'_>,
            view: &View<D>,
            factors: &[f64],
            (closed, by_r, by_v): (&[usize], &Matrix<'_>, &Matrix<'_>),
            threads: Option<usize>,
        ) -> PyResult<(Option<Box<dyn FactoredTangent>>, usize)> {
            let compliance = view.problem.compliance();
            let by_r = arrays::rows_of::<D>("by_r", by_r, D * closed.len())?;
            let by_v = arrays::rows_of::<D>("by_v", by_v, D * closed.len())?;
            let factor = |i: usize, k: usize| factors[D * i + k];
            let laws = laws(closed, compliance.order(), (by_r, by_v), factor)?;
            let modes = view.problem.modes();
            let system = interrupt::run(py, threads, |stop| {
                let contacts = view.members.len();
                let load = vec![0.0; modes.len()];
                let q = vec![[0.0; D]; contacts];
                let law = vec![ContactLaw::default(); contacts];
                let still = modes.is_empty();
                let modes = modes.into();
                let problem = Reduced::new(compliance, &q, &law, &Rigid { modes, load })?;
                if still {
                    let shared = view.problem.shared_compliance();
                    let small = TangentStiffnessForm::new(shared, &problem.scaling, &laws, stop)?;
                    if let Some(small) = small {
                        return Ok(Some(Box::new(small) as Box<dyn FactoredTangent>));
                    }
                }
                boxed(TangentSystem::new(&problem, &laws, stop))
            })?;
            Ok((system, D))
        }
        let closed = arrays::indices(&closed, "closed")?;
        let given = (&closed[..], &by_r, &by_v);
        let (system, d) = for_either!(&self.kind, view => {
            of(py, view, &self.factors, given, self.num_threads)?
        });
        let at = |&i: &usize| &self.factors[d * i..d * (i + 1)];
        let factors = closed.iter().flat_map(at).copied().collect();
        Ok(system.map(|system| PyTangentSystem { system, factors }))
    }
}

/// The system of some contacts of a reduced problem; nothing if it is singular.
pub(super) fn of_reduced<const D: usize>(
    problem: &ReducedArrays<D>,
    py: Python<'_>,
    closed: &[usize],
    (by_r, by_v): (&Matrix<'_>, &Matrix<'_>),
) -> PyResult<Option<PyTangentSystem>> {
    let elliptic = problem.elliptic.as_ref();
    let factor = |i: usize, k: usize| elliptic.map_or(1.0, |s| s.factor(i, k));
    let by_r = arrays::rows_of::<D>("by_r", by_r, D * closed.len())?;
    let by_v = arrays::rows_of::<D>("by_v", by_v, D * closed.len())?;
    let system = problem.run(py, None, None, |problem, stop, _| {
        let laws = laws(closed, problem.compliance.order(), (by_r, by_v), factor)?;
        boxed(TangentSystem::new(problem, &laws, stop))
    })?;
    let factors = factors::<D>(closed, elliptic);
    Ok(system.map(|system| PyTangentSystem { system, factors }))
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
            for (value, t) in x.iter_mut().zip(&self.factors) {
                *value *= t;
            }
        })
    }

    fn solve_transposed<'py>(
        &self,
        py: Python<'py>,
        right: Matrix<'py>,
    ) -> PyResult<NewMatrix<'py>> {
        self.each(py, &right, |x| {
            for (value, t) in x.iter_mut().zip(&self.factors) {
                *value *= t;
            }
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
        arrays::length("right", columns, self.system.order())?;
        let mut all = right.as_slice()?.to_vec();
        for x in all.chunks_exact_mut(columns.max(1)) {
            solve(x);
        }
        arrays::square(py, all, rows, columns)
    }
}

fn boxed(
    made: Result<Option<TangentSystem>, Error>,
) -> Result<Option<Box<dyn FactoredTangent>>, Error> {
    Ok(made?.map(|system| Box::new(system) as Box<dyn FactoredTangent>))
}

/// `T` of some contacts.
pub(super) fn factors<const D: usize>(
    members: &[usize],
    elliptic: Option<&EllipticScaling>,
) -> Vec<f64> {
    let of = |&i: &usize| (0..D).map(move |k| elliptic.map_or(1.0, |s| s.factor(i, k)));
    members.iter().flat_map(of).collect()
}

fn factors_of<const D: usize>(view: &View<D>, elliptic: Option<&EllipticScaling>) -> Vec<f64> {
    factors::<D>(&view.members, elliptic)
}

pub(super) fn over(values: &[f64], factors: &[f64]) -> Vec<f64> {
    values.iter().zip(factors).map(|(x, t)| x / t).collect()
}

/// Laws of contacts, in the variables of the problem: `r = T r̃`, `v = T⁻¹ ṽ`.
pub(super) fn laws<const D: usize>(
    closed: &[usize],
    order: &[usize],
    (by_r, by_v): (&[[f64; D]], &[[f64; D]]),
    factor: impl Fn(usize, usize) -> f64,
) -> Result<Vec<ClosedLaw<D>>, Error> {
    let mut place = vec![None; order.len()];
    for (position, &node) in order.iter().enumerate() {
        place[node] = Some(position);
    }
    let of = |(c, &i): (usize, &usize)| {
        let position = place.get(i).copied().flatten().ok_or(Error::Shape {
            what: "closed",
            expected: order.len(),
            found: i,
        })?;
        Ok(ClosedLaw {
            position,
            by_r: Block::from_fn(|k, l| by_r[D * c + k][l] * factor(i, l)),
            by_v: Block::from_fn(|k, l| by_v[D * c + k][l] / factor(i, l)),
        })
    };
    closed.iter().enumerate().map(of).collect()
}
