//! The contact problem in the displacements, and its load path.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use pyo3::prelude::*;

use crate::condensation::condense::ProblemArrays;
use crate::error::{Error, check_length};
use crate::law::contact_law::ContactLaw;
use crate::linalg::sparse::csc::{Index, Symmetric};
use crate::primal::path::PrimalPath;
use crate::primal::problem::{Primal, check_contacts};
use crate::python::arrays::{self, Csr, CsrArrays, Indices, LawArrays, Matrix, NewVector, Vector};
use crate::python::condensed_arrays::Loads;
use crate::python::contact_variables::{Interface, InterfaceVariables, PyContactVariables};
use crate::python::dimension::{Dimension, for_either, map_either};
use crate::python::interrupt;
use crate::python::load_path::{ContactArrays, state_of_contacts};
use crate::python::solution::PyNewtonStep;
use crate::python::solver::PySettings;
use crate::python::stiffness_rows::PyStiffnessRows;
use crate::reduced::elliptic_scaling::{EllipticScaling, times};
use crate::reduced::memory::Budget;
use crate::reduced::rotation::Rotation;
use crate::solver::Settings;

/// A problem in the displacements, in the variables of [`EllipticScaling`].
#[derive(Clone)]
pub(super) struct PrimalArrays<const D: usize> {
    pub(super) problem: Arc<Primal<D>>,
    pub(super) elliptic: Option<EllipticScaling>,
    pub(super) num_threads: Option<usize>,
}

/// `K`, `B`, gap and friction, for Newton on the displacements.
#[pyclass(frozen, name = "Primal", module = "bipot_rs._core")]
pub(super) struct PyPrimal {
    pub(super) kind: Dimension<PrimalArrays<2>, PrimalArrays<3>>,
}

/// The indices of `K`, in the bits of the caller if that can be.
enum Columns<'a> {
    Narrow(&'a [i32]),
    Wide(Vec<usize>),
}

/// The arguments that do not depend on the dimension.
struct Arguments<'a> {
    pointer: Vec<usize>,
    columns: Columns<'a>,
    values: &'a [f64],
    contact: CsrArrays<'a>,
    law: Vec<ContactLaw>,
    elliptic: Option<EllipticScaling>,
    fixed: Vec<usize>,
    places: Option<&'a [[f64; 3]]>,
    has_copies: bool,
}

impl Arguments<'_> {
    fn make<const D: usize>(
        &self,
        py: Python<'_>,
        gap: &Matrix<'_>,
        num_threads: Option<usize>,
    ) -> PyResult<PrimalArrays<D>> {
        let gap = arrays::rows(gap)?;
        let problem = interrupt::run(py, num_threads, |stop| match &self.columns {
            Columns::Narrow(columns) => self.made_of(columns, gap, stop),
            Columns::Wide(columns) => self.made_of(columns, gap, stop),
        })?;
        Ok(PrimalArrays {
            problem: Arc::new(problem),
            elliptic: self.elliptic.clone(),
            num_threads,
        })
    }

    fn made_of<const D: usize, I: Index>(
        &self,
        columns: &[I],
        gap: &[[f64; D]],
        stop: &AtomicBool,
    ) -> Result<Primal<D>, Error> {
        let n = self.pointer.len().saturating_sub(1);
        let given = ProblemArrays {
            stiffness: Symmetric::new(n, &self.pointer, columns, self.values)?,
            contact: self.contact.rows(),
            gap,
            law: &self.law,
            fixed: &self.fixed,
            places: self.places,
            kinematics: None,
            known: None,
            budget: Budget::default(),
        };
        Primal::new(&given, self.elliptic.as_ref(), self.has_copies, stop)
    }
}

impl<const D: usize> PrimalArrays<D> {
    fn variables(&self) -> InterfaceVariables<D> {
        let problem = &self.problem;
        InterfaceVariables {
            interface: Arc::new(Interface {
                contacts: problem.contacts.clone(),
                free: problem.stiffness.free.clone(),
                floating: problem.floating(),
            }),
            elliptic: self.elliptic.clone(),
            fixed: problem.stiffness.fixed.len(),
        }
    }

    fn with_law(&self, law: &LawArrays<'_>) -> PyResult<Self> {
        let (law, elliptic) = law.read(D)?;
        let change = EllipticScaling::between(self.elliptic.as_ref(), elliptic.as_ref());
        let problem = self
            .problem
            .with_law(law, elliptic.as_ref(), change.as_ref())?;
        Ok(Self {
            problem: Arc::new(problem),
            elliptic,
            num_threads: self.num_threads,
        })
    }

    fn rotated(&self, py: Python<'_>, rotation: &Matrix<'_>) -> PyResult<Option<Self>> {
        let rotation = Rotation::new(arrays::rows(rotation)?, None);
        let elliptic = self.elliptic.as_ref();
        let made = interrupt::run(py, self.num_threads, |_| {
            match self.problem.rotated(&rotation, elliptic) {
                Err(Error::NoOwnNode { .. }) => Ok(None),
                made => made.map(Some),
            }
        })?;
        Ok(made.map(|problem| Self {
            problem: Arc::new(problem),
            ..self.clone()
        }))
    }
}

#[pymethods]
impl PyPrimal {
    #[new]
    #[pyo3(signature = (stiffness, contact, gap, law, fixed, num_threads, places=None, has_copies=false))]
    fn new<'py>(
        py: Python<'py>,
        stiffness: Csr<'py>,
        contact: Csr<'py>,
        gap: Matrix<'py>,
        law: LawArrays<'py>,
        fixed: Indices<'py>,
        num_threads: Option<usize>,
        places: Option<Matrix<'py>>,
        has_copies: bool,
    ) -> PyResult<Self> {
        let (law, elliptic) = law.read(gap.as_array().ncols())?;
        let asked = Arguments {
            pointer: arrays::indices(&stiffness.0, "K")?,
            columns: match &stiffness.1 {
                Indices::Narrow(columns) => Columns::Narrow(columns.as_slice()?),
                columns @ Indices::Wide(_) => {
                    Columns::Wide(arrays::many_indices(columns, "K", num_threads)?)
                }
            },
            values: stiffness.2.as_slice()?,
            contact: CsrArrays::new(&contact, "B", num_threads)?,
            fixed: arrays::indices(&fixed, "fixed")?,
            law,
            elliptic,
            places: places.as_ref().map(arrays::rows::<3>).transpose()?,
            has_copies,
        };
        let kind = map_either!(Dimension::of(gap.as_array().ncols()), () => {
            asked.make(py, &gap, num_threads)?
        });
        Ok(Self { kind })
    }

    #[staticmethod]
    fn of_rows<'py>(
        py: Python<'py>,
        rows: &mut PyStiffnessRows,
        contact: Csr<'py>,
        gap: Matrix<'py>,
        law: LawArrays<'py>,
    ) -> PyResult<Self> {
        let ((law, elliptic), num_threads) = (law.read(3)?, rows.num_threads);
        let (gap, contact) = (
            arrays::rows(&gap)?,
            CsrArrays::new(&contact, "B", num_threads)?,
        );
        let known = rows
            .rows
            .take()
            .ok_or(Error::SparseStructure { what: "K", row: 0 })?;
        let problem = interrupt::run(py, num_threads, |stop| {
            check_contacts(&contact.rows(), gap, &law, known.known())?;
            let contact = contact.rows().select(Some);
            Primal::of_rows(known, contact, (gap, &law), elliptic.as_ref(), false, stop)
        })?;
        Ok(Self {
            kind: Dimension::Space(PrimalArrays {
                problem: Arc::new(problem),
                elliptic,
                num_threads,
            }),
        })
    }

    fn with_law(&self, law: LawArrays<'_>) -> PyResult<Self> {
        let kind = map_either!(&self.kind, problem => problem.with_law(&law)?);
        Ok(Self { kind })
    }

    /// The same bodies and contacts with `Q B` and `Q g`; `rotation` has the rows of all `Q`.
    /// `None` if supports are oblique to the new frames.
    fn rotated(&self, py: Python<'_>, rotation: Matrix<'_>) -> PyResult<Option<Self>> {
        let kind = map_either!(&self.kind, problem => match problem.rotated(py, &rotation)? {
            Some(problem) => problem,
            None => return Ok(None),
        });
        Ok(Some(Self { kind }))
    }

    /// The contacts; the places are the unknowns.
    fn variables(&self) -> PyContactVariables {
        let kind = map_either!(&self.kind, inner => inner.variables());
        PyContactVariables { kind }
    }

    #[getter]
    fn bytes(&self) -> (usize, usize) {
        for_either!(&self.kind, problem => problem.problem.bytes())
    }
}

/// A step, and the displacements at its end.
type Solved<'py> = (PyNewtonStep, NewVector<'py>);

/// A path and its problem.
struct Progress<const D: usize> {
    problem: PrimalArrays<D>,
    path: PrimalPath<D>,
}

impl<const D: usize> Progress<D> {
    fn new(
        problem: &PrimalArrays<D>,
        start: Option<&ContactArrays<'_>>,
        displacement: Option<&Vector<'_>>,
    ) -> PyResult<Self> {
        let mut path = PrimalPath::default();
        if let Some((reaction, displaced, status)) = start {
            let (contacts, elliptic) = (&problem.problem.contacts, problem.elliptic.as_ref());
            let arrays = (reaction, displaced, status);
            let state = state_of_contacts(contacts.count(), elliptic, arrays)?;
            let u = displacement.map_or(Ok(&[][..]), |u| u.as_slice())?;
            if !u.is_empty() {
                let order = problem.problem.order();
                check_length("displacement of start", u.len(), order)?;
            }
            path = PrimalPath::new(Some(state), u.to_vec());
        }
        let problem = problem.clone();
        Ok(Self { problem, path })
    }

    fn step<'py>(
        &mut self,
        py: Python<'py>,
        (load, prescribed): Loads<'_>,
        gap: Option<&Matrix<'_>>,
        settings: &Settings,
    ) -> PyResult<Solved<'py>> {
        let elliptic = self.problem.elliptic.as_ref();
        let gap = gap.map(arrays::rows).transpose()?;
        let gap = gap.map(|gap| times(elliptic, gap).into_owned());
        let (path, problem) = (&mut self.path, &self.problem.problem);
        let made = interrupt::run(py, self.problem.num_threads, |stop| {
            let moved = gap.map(|gap| problem.with_gap(gap)).transpose()?;
            let problem = moved.as_ref().unwrap_or(problem);
            path.advance(problem, load, prescribed, settings, stop)
        })?;
        let step = PyNewtonStep::new(py, &made.made, made.bytes, elliptic)?;
        Ok((step, arrays::from_vec(py, made.displacement)))
    }
}

/// A load path in the displacements. Without a state it starts from the unloaded bodies.
#[pyclass(name = "PrimalPath", module = "bipot_rs._core")]
pub(super) struct PyPrimalPath {
    progress: Dimension<Progress<2>, Progress<3>>,
}

#[pymethods]
impl PyPrimalPath {
    #[new]
    #[pyo3(signature = (problem, start=None, displacement=None))]
    fn new(
        problem: &PyPrimal,
        start: Option<ContactArrays<'_>>,
        displacement: Option<Vector<'_>>,
    ) -> PyResult<Self> {
        let progress = map_either!(&problem.kind, problem => {
            Progress::new(problem, start.as_ref(), displacement.as_ref())?
        });
        Ok(Self { progress })
    }

    /// A step to the total loads, with the gaps of the problem unless others are given. The
    /// state changes only if the step converges.
    ///
    /// `again` makes the last step once more, with other loads, from its solution; `draft`
    /// leaves out the estimate of its errors.
    #[pyo3(signature = (load, prescribed, gap, settings, again=false, draft=false))]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        load: Vector<'py>,
        prescribed: Vector<'py>,
        gap: Option<Matrix<'py>>,
        settings: &PySettings,
        again: bool,
        draft: bool,
    ) -> PyResult<Solved<'py>> {
        let loads = (load.as_slice()?, prescribed.as_slice()?);
        for_either!(&mut self.progress, path => {
            if again {
                path.path.retract();
            }
            path.path.draft = draft;
            path.step(py, loads, gap.as_ref(), &settings.checked)
        })
    }
}
