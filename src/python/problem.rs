//! The condensed contact problem.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::condensation::bodies::{Loaded, Loads};
use crate::condensation::condense::{ProblemArrays, SortedProblem};
use crate::condensation::forecast::{Forecast, Notice};
use crate::condensation::problem::{Confirmed, Problem};
use crate::error::Error;
use crate::linalg::sparse::csc::Symmetric;
use crate::linalg::sparse::rows::Rows;
use crate::path::stepping::State;
use crate::python::arrays::{self, Coefficients, Csr, Indices, Matrix, Vector};
use crate::python::interrupt;
use crate::reduced::elliptic_scaling::{EllipticScaling, over, times};
use crate::reduced::memory::{self, Budget};
use crate::reduced::rotation::Rotation;

/// The same arrays as results.
pub(super) type CsrOutput<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
);

type FreePartArrays<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
);

#[derive(Clone)]
pub(super) enum AnyProblem {
    Two(Arc<Problem<2>>),
    Three(Arc<Problem<3>>),
}

/// Calls one generic expression for both dimensions.
macro_rules! either {
    ($kind:expr, $inner:ident => $body:expr) => {
        match $kind {
            AnyProblem::Two($inner) => $body,
            AnyProblem::Three($inner) => $body,
        }
    };
}

/// `K`, `B`, gap and friction, condensed onto the contact set.
#[pyclass(frozen, name = "Condensed", module = "bipot_rs._core")]
pub(super) struct PyCondensed {
    /// In the variables of [`EllipticScaling`].
    pub(super) kind: AnyProblem,
    pub(super) elliptic: Option<EllipticScaling>,
    pub(super) num_threads: Option<usize>,
}

/// A sparse matrix with indices as `usize`.
pub(super) struct CsrArrays<'a> {
    pub(super) pointer: Vec<usize>,
    pub(super) index: Vec<usize>,
    pub(super) values: &'a [f64],
}

impl<'a> CsrArrays<'a> {
    pub(super) fn new(
        csr: &'a Csr<'_>,
        what: &'static str,
        num_threads: Option<usize>,
    ) -> PyResult<Self> {
        Ok(Self {
            pointer: arrays::indices(&csr.0, what)?,
            index: arrays::many_indices(&csr.1, what, num_threads)?,
            values: csr.2.as_slice()?,
        })
    }
}

/// The arguments that do not depend on the dimension.
struct Arguments<'a> {
    stiffness: CsrArrays<'a>,
    contact: CsrArrays<'a>,
    mu: Vec<f64>,
    elliptic: Option<EllipticScaling>,
    fixed: Vec<usize>,
    places: Option<&'a [[f64; 3]]>,
    known: Option<Vec<Loads>>,
    limit: Option<u128>,
    grow: Option<bool>,
    notice: Option<Notice>,
}

impl Arguments<'_> {
    fn condense<const D: usize>(
        self,
        gap: &[[f64; D]],
        before: Option<&Problem<D>>,
        stop: &AtomicBool,
    ) -> Result<Arc<Problem<D>>, Error> {
        // The converted indices are freed before the factor is made.
        let mut sorted = {
            let (k, b) = (self.stiffness, self.contact);
            let n = k.pointer.len().saturating_sub(1);
            SortedProblem::new(ProblemArrays {
                stiffness: Symmetric::new(n, &k.pointer, &k.index, k.values)?,
                contact: Rows {
                    row_ptr: &b.pointer,
                    columns: &b.index,
                    values: b.values,
                },
                gap,
                mu: &self.mu,
                fixed: &self.fixed,
                places: self.places,
                known: self.known,
                budget: Budget { limit: self.limit },
            })?
        };
        if let Some(elliptic) = &self.elliptic {
            sorted.surface.scale(elliptic);
        }
        sorted.notice = self.notice;
        Problem::new(sorted, self.grow, before, stop).map(Arc::new)
    }
}

#[pymethods]
impl PyCondensed {
    /// `places` are the positions in space of the degrees of freedom. `known` are all loads,
    /// for each step a pair of total forces and prescribed displacements. `memory_limit` is in
    /// bytes. `grow` decides whether `W` is formed for a working set; `None` lets the gaps
    /// decide. The analyses of `before` are used again for equal patterns. `on_forecast` is
    /// called with the counts of the analysis within 0.1 s; an exception from it stops the
    /// work.
    #[new]
    #[pyo3(signature = (
        stiffness, contact, gap, mu, fixed, num_threads,
        places=None, known=None, memory_limit=None, grow=None, before=None, on_forecast=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "the arguments of one problem")]
    fn new<'py>(
        py: Python<'py>,
        stiffness: Csr<'py>,
        contact: Csr<'py>,
        gap: Matrix<'py>,
        mu: Coefficients<'py>,
        fixed: Indices<'py>,
        num_threads: Option<usize>,
        places: Option<Matrix<'py>>,
        known: Option<Vec<(Vector<'py>, Vector<'py>)>>,
        memory_limit: Option<u64>,
        grow: Option<bool>,
        before: Option<PyRef<'py, PyCondensed>>,
        on_forecast: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let notice = on_forecast.is_some().then(Notice::default);
        let tell = |py: Python<'_>| match (&on_forecast, &notice) {
            (Some(told), Some(notice)) => notice
                .take()
                .map_or(Ok(()), |found| call(told.bind(py), &found)),
            _ => Ok(()),
        };
        let loads = |(load, moved): &(Vector<'_>, Vector<'_>)| -> PyResult<Loads> {
            Ok((load.as_slice()?.to_vec(), moved.as_slice()?.to_vec()))
        };
        let known = known.map(|steps| steps.iter().map(loads).collect::<PyResult<_>>());
        let plane = gap.as_array().ncols() == 2;
        let (mu, elliptic) = mu.friction(gap.as_array().ncols())?;
        let asked = Arguments {
            stiffness: CsrArrays::new(&stiffness, "K", num_threads)?,
            contact: CsrArrays::new(&contact, "B", num_threads)?,
            fixed: arrays::indices(&fixed, "fixed")?,
            mu,
            elliptic: elliptic.clone(),
            places: places.as_ref().map(arrays::rows::<3>).transpose()?,
            known: known.transpose()?,
            limit: memory_limit.map(u128::from),
            grow,
            notice: notice.clone(),
        };
        let before = before.as_ref().map(|problem| &problem.kind);
        let kind = if plane {
            let gap = arrays::rows::<2>(&gap)?;
            let before = match before {
                Some(AnyProblem::Two(problem)) => Some(&**problem),
                _ => None,
            };
            let made = interrupt::watch(py, num_threads, &tell, |stop| {
                asked.condense(gap, before, stop)
            });
            AnyProblem::Two(made?)
        } else {
            let gap = arrays::rows::<3>(&gap)?;
            let before = match before {
                Some(AnyProblem::Three(problem)) => Some(&**problem),
                _ => None,
            };
            let made = interrupt::watch(py, num_threads, &tell, |stop| {
                asked.condense(gap, before, stop)
            });
            AnyProblem::Three(made?)
        };
        // Small problems end before the first check.
        tell(py)?;
        Ok(Self {
            kind,
            elliptic,
            num_threads,
        })
    }

    /// `W`, dense.
    fn compliance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (dense, n) = either!(&self.kind, inner => {
            let n = components(inner);
            memory::check("the dense compliance W", 8 * (n as u128).pow(2))?;
            let dense = interrupt::run(py, self.num_threads, |stop| {
                let whole = inner.whole(stop)?;
                Ok(match self.inverse_scaling() {
                    None => whole.compliance().to_dense(),
                    Some(inverse) => whole.compliance().scaled(&inverse)?.to_dense(),
                })
            });
            (dense?, n)
        });
        arrays::square(py, dense, n, n)
    }

    /// The blocks of `W` if it is sparse: the first block of each row, the column of each, and
    /// their entries, row-major.
    #[expect(clippy::type_complexity, reason = "the arrays of one sparse matrix")]
    fn sparse_compliance<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<(Vec<usize>, Vec<usize>, Bound<'py, PyArray1<f64>>)>> {
        let blocks = either!(&self.kind, inner => {
            interrupt::run(py, self.num_threads, |stop| {
                let whole = inner.whole(stop)?;
                match self.inverse_scaling() {
                    None => whole.compliance().rows_of_blocks(),
                    Some(inverse) => whole.compliance().scaled(&inverse)?.rows_of_blocks(),
                }
            })?
        });
        Ok(blocks.map(|(start, column, values)| (start, column, arrays::from_vec(py, values))))
    }

    /// `q` with the whole gap, the columns of `R` as rows, and `e`.
    fn free_part<'py>(
        &self,
        py: Python<'py>,
        load: Vector<'py>,
        prescribed: Vector<'py>,
    ) -> PyResult<FreePartArrays<'py>> {
        let (load, prescribed) = (load.as_slice()?, prescribed.as_slice()?);
        either!(&self.kind, inner => {
            let part = interrupt::run(py, self.num_threads, |stop| {
                inner.whole(stop)?.free_part(load, prescribed)
            })?;
            let modes = as_rows(py, &part.rigid.modes, components(inner), self.elliptic.as_ref())?;
            Ok((
                arrays::from_rows(py, &over(self.elliptic.as_ref(), &part.q))?,
                modes,
                arrays::from_vec(py, part.rigid.load),
            ))
        })
    }

    /// Row pointers, columns and values of the part of `K` that results depend on.
    fn stiffness<'py>(&self, py: Python<'py>) -> PyResult<CsrOutput<'py>> {
        let whole = either!(&self.kind, inner => {
            interrupt::run(py, self.num_threads, |_| Ok(inner.bodies().stiffness()))?
        });
        Ok((
            arrays::from_indices(py, whole.pointer)?,
            arrays::from_indices(py, whole.index)?,
            arrays::from_vec(py, whole.values),
        ))
    }

    /// Each rigid motion at the contacts, as a row.
    fn modes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        either!(&self.kind, inner => {
            let modes = interrupt::run(py, self.num_threads, |_| inner.modes())?;
            as_rows(py, &modes, components(inner), self.elliptic.as_ref())
        })
    }

    /// Makes the inverse of `W`, if it exists, before a step needs it.
    fn make_inverse(&self, py: Python<'_>) -> PyResult<()> {
        either!(&self.kind, inner => {
            if let Problem::Whole(whole) = &**inner {
                interrupt::run(py, self.num_threads, |stop| whole.compliance().make_inverse(stop))?;
            }
        });
        Ok(())
    }

    /// `u` of all degrees of freedom, one row for each state of total loads, reaction and rigid
    /// motion. `confirmed` has for each state `v`, the gap, and the change of the tangential
    /// parts of `v` in the step; `B u + gap` is compared with these.
    #[pyo3(signature = (states, confirmed=None))]
    fn displacements<'py>(
        &self,
        py: Python<'py>,
        states: Vec<(Vector<'py>, Vector<'py>, Matrix<'py>, Vector<'py>)>,
        confirmed: Option<Vec<[Matrix<'py>; 3]>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        either!(&self.kind, inner => {
            let elliptic = self.elliptic.as_ref();
            let reactions = states
                .iter()
                .map(|(_, _, reaction, _)| Ok(over(elliptic, arrays::rows(reaction)?)))
                .collect::<PyResult<Vec<_>>>()?;
            let loaded = states
                .iter()
                .zip(&reactions)
                .map(|((load, prescribed, _, rigid), reaction)| {
                    Ok(Loaded {
                        load: load.as_slice()?,
                        prescribed: prescribed.as_slice()?,
                        reaction,
                        rigid: rigid.as_slice()?,
                    })
                })
                .collect::<PyResult<Vec<_>>>()?;
            let confirmed = confirmed
                .iter()
                .flatten()
                .map(|[v, gap, slip]| {
                    let of = |given| Ok::<_, PyErr>(times(elliptic, arrays::rows(given)?).into_owned());
                    Ok(Confirmed {
                        v: of(v)?,
                        gap: of(gap)?,
                        slip: of(slip)?,
                    })
                })
                .collect::<PyResult<Vec<_>>>()?;
            let all = interrupt::run(py, self.num_threads, |_| {
                let all = inner.displacements(&loaded)?;
                for ((u, state), held_to) in all.iter().zip(&loaded).zip(&confirmed) {
                    inner.confirm(state, u, held_to)?;
                }
                Ok(all)
            })?;
            arrays::square(py, all.concat(), states.len(), inner.bodies().order())
        })
    }

    /// The same bodies and contacts with other friction coefficients.
    fn with_mu(&self, mu: Coefficients<'_>) -> PyResult<Self> {
        fn of<const D: usize>(
            inner: &Arc<Problem<D>>,
            mu: Vec<f64>,
            change: Option<&EllipticScaling>,
        ) -> Result<Arc<Problem<D>>, Error> {
            let made = inner.with_mu(mu)?;
            Ok(Arc::new(match change {
                None => made,
                Some(change) => made.scaled(change)?,
            }))
        }
        let (mu, elliptic) = match &self.kind {
            AnyProblem::Two(_) => mu.friction(2)?,
            AnyProblem::Three(_) => mu.friction(3)?,
        };
        let change = EllipticScaling::between(self.elliptic.as_ref(), elliptic.as_ref());
        let kind = match &self.kind {
            AnyProblem::Two(inner) => AnyProblem::Two(of(inner, mu, change.as_ref())?),
            AnyProblem::Three(inner) => AnyProblem::Three(of(inner, mu, change.as_ref())?),
        };
        Ok(Self {
            kind,
            elliptic,
            num_threads: self.num_threads,
        })
    }

    /// The same bodies and contacts with other gaps, as in a step with moving obstacles.
    fn with_gap(&self, gap: Matrix<'_>) -> PyResult<Self> {
        let elliptic = self.elliptic.as_ref();
        let kind = match &self.kind {
            AnyProblem::Two(inner) => {
                AnyProblem::Two(moved(inner, elliptic, Some(arrays::rows(&gap)?))?)
            }
            AnyProblem::Three(inner) => {
                AnyProblem::Three(moved(inner, elliptic, Some(arrays::rows(&gap)?))?)
            }
        };
        Ok(Self {
            kind,
            elliptic: self.elliptic.clone(),
            num_threads: self.num_threads,
        })
    }

    /// The same bodies and contacts with `Q B` and `Q g`; `rotation` has the rows of all `Q`.
    fn rotated(&self, py: Python<'_>, rotation: Matrix<'_>) -> PyResult<Self> {
        let elliptic = self.elliptic.as_ref();
        let kind = match &self.kind {
            AnyProblem::Two(inner) => {
                let rotation = Rotation::new(arrays::rows(&rotation)?, elliptic);
                let made = interrupt::run(py, self.num_threads, |_| inner.rotated(&rotation))?;
                AnyProblem::Two(Arc::new(made))
            }
            AnyProblem::Three(inner) => {
                let rotation = Rotation::new(arrays::rows(&rotation)?, elliptic);
                let made = interrupt::run(py, self.num_threads, |_| inner.rotated(&rotation))?;
                AnyProblem::Three(Arc::new(made))
            }
        };
        Ok(Self {
            kind,
            elliptic: elliptic.cloned(),
            num_threads: self.num_threads,
        })
    }

    /// Counts and seconds of the condensation.
    #[getter]
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (stats, bodies, bytes, working) = either!(&self.kind, inner => {
            let working = match &**inner {
                Problem::Whole(_) => None,
                Problem::Growing { candidates, .. } => Some(candidates.seeds().len()),
            };
            (inner.stats(), inner.bodies(), inner.bytes_compliance(), working)
        });
        let motions = 0..bodies.motions().len();
        let dofs: Vec<usize> = motions.map(|k| bodies.most_moved(k)).collect();
        let moved: Vec<usize> = bodies.motions().iter().map(|&(body, _)| body).collect();
        let dict = PyDict::new(py);
        dict.set_item("n", bodies.order())?;
        dict.set_item("n_contact_dofs", stats.contact_dofs)?;
        dict.set_item("nnz_factor", stats.nnz_factor)?;
        dict.set_item("flops", stats.flops)?;
        dict.set_item("bytes_factor", stats.bytes_factor)?;
        dict.set_item("bytes_peak", stats.bytes_peak)?;
        dict.set_item("bytes_compliance", bytes)?;
        dict.set_item("cond_S", stats.cond_s)?;
        dict.set_item("factor_kept", stats.factor_kept)?;
        dict.set_item("working_set", working)?;
        dict.set_item("bodies", stats.bodies)?;
        dict.set_item("islands", stats.islands)?;
        dict.set_item("rigid_motions", dofs.len())?;
        dict.set_item("rigid_motion_dofs", dofs)?;
        dict.set_item("rigid_motion_bodies", moved)?;
        dict.set_item("ordering", stats.ordering)?;
        dict.set_item("orderings", stats.orderings)?;
        dict.set_item("seconds_order", stats.seconds_order)?;
        dict.set_item("seconds_symbolic", stats.seconds_symbolic)?;
        dict.set_item("seconds_factor", stats.seconds_factor)?;
        dict.set_item("seconds_compliance", stats.seconds_compliance)?;
        Ok(dict)
    }
}

impl PyCondensed {
    /// The change of variables back to those of the caller.
    fn inverse_scaling(&self) -> Option<EllipticScaling> {
        self.elliptic.as_ref().map(EllipticScaling::inverse)
    }

    /// `r̃` of a reaction.
    pub(super) fn reaction<const D: usize>(
        &self,
        array: &Matrix<'_>,
        contacts: usize,
    ) -> PyResult<Vec<[f64; D]>> {
        let rows = arrays::rows_of("reaction", array, contacts)?;
        Ok(over(self.elliptic.as_ref(), rows).into_owned())
    }

    /// The part of the state before a step that its reduced problem needs: `ṽ`.
    pub(super) fn left<const D: usize>(
        &self,
        before: Option<&Matrix<'_>>,
        contacts: usize,
    ) -> PyResult<Option<State<D>>> {
        let Some(before) = before else {
            return Ok(None);
        };
        let rows = arrays::rows_of("before", before, contacts)?;
        Ok(Some(State {
            relative_displacement: times(self.elliptic.as_ref(), rows).into_owned(),
            ..State::default()
        }))
    }
}

/// The problem of one step, with the gaps of the step if there are any.
pub(super) fn moved<const D: usize>(
    problem: &Arc<Problem<D>>,
    elliptic: Option<&EllipticScaling>,
    gap: Option<&[[f64; D]]>,
) -> Result<Arc<Problem<D>>, Error> {
    let Some(gap) = gap else {
        return Ok(Arc::clone(problem));
    };
    arrays::length("gap", gap.len(), problem.contacts())?;
    Ok(Arc::new(
        problem.with_gap(times(elliptic, gap).into_owned())?,
    ))
}

/// Calls a Python function with a forecast; its keys are those of `stats`.
fn call(told: &Bound<'_, PyAny>, found: &Forecast) -> PyResult<()> {
    let dict = PyDict::new(told.py());
    dict.set_item("bodies", found.bodies)?;
    dict.set_item("n_contact_dofs", found.contact_dofs)?;
    dict.set_item("nnz_factor", found.nnz_factor)?;
    dict.set_item("flops", found.flops)?;
    dict.set_item("bytes_factor", found.bytes_factor)?;
    dict.set_item("bytes_peak", found.bytes_peak)?;
    dict.set_item("ordering", found.ordering)?;
    told.call1((dict,)).map(|_| ())
}

/// Number of contact components, `D n_c`.
fn components<const D: usize>(problem: &Problem<D>) -> usize {
    D * problem.contacts()
}

fn as_rows<'py, const D: usize>(
    py: Python<'py>,
    modes: &[Vec<[f64; D]>],
    components: usize,
    elliptic: Option<&EllipticScaling>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat = modes
        .iter()
        .flat_map(|mode| over(elliptic, mode).as_flattened().to_vec());
    arrays::square(py, flat.collect(), modes.len(), components)
}
