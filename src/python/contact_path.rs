//! Load steps in the displacements whose long vectors and linear systems are those of a Python
//! object.

use std::time::Instant;

use numpy::PyArray1;
use pyo3::prelude::*;

use crate::error::check_length;
use crate::law::cone::Status;
use crate::path::stepping::State;
use crate::primal::engine::{Correction, Engine, Terms};
use crate::primal::linearised::spread;
use crate::primal::load_step::{Start, advance};
use crate::primal::tangent::Tangent;
use crate::python::arrays::{self, Matrix, Vector};
use crate::python::contact_variables::{
    AnyTangent, Interface, InterfaceVariables, PyContactTangent, PyContactVariables,
};
use crate::python::dimension::{Dimension, for_either, map_either};
use crate::python::load_path::{ContactArrays, state_of_contacts};
use crate::python::solution::PyNewtonStep;
use crate::python::solver::PySettings;
use crate::reduced::elliptic_scaling::times;
use crate::solver::Settings;

/// Calls the methods of a Python object. Its exceptions pass through unchanged.
struct Callbacks<'a, 'py, const D: usize> {
    engine: &'a Bound<'py, PyAny>,
    interface: &'a Interface<D>,
}

impl<'py, const D: usize> Callbacks<'_, 'py, D> {
    /// Values at the contacts, from values by places.
    fn at_contacts_of(&self, values: &Vector<'py>) -> PyResult<Vec<[f64; D]>> {
        let places = self.interface.free.len();
        let values = arrays::numbers("values by places", values, places)?;
        Ok(self.interface.contacts.frames.at_contacts(values))
    }

    /// The statuses as an array.
    fn array(&self, statuses: &[Status]) -> Bound<'py, PyArray1<i8>> {
        arrays::from_status(self.engine.py(), statuses)
    }
}

impl<'py, const D: usize> Engine<D> for Callbacks<'_, 'py, D>
where
    AnyTangent: From<Tangent<D>>,
{
    type Vector = Bound<'py, PyAny>;
    type Error = PyErr;

    fn free(&self) -> &[bool] {
        &self.interface.free
    }

    fn floating(&self) -> Vec<Vec<usize>> {
        self.interface.floating.clone()
    }

    fn may_be_soft(&mut self) -> PyResult<bool> {
        self.engine.call_method0("may_be_soft")?.is_truthy()
    }

    fn is_held(&self, _: &Tangent<D>, _: &[Status]) -> bool {
        true
    }

    fn product(&mut self, y: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        self.engine.call_method1("product", (y,))
    }

    fn add(
        &mut self,
        y: Bound<'py, PyAny>,
        s: f64,
        x: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.engine.call_method1("add", (y, s, x))
    }

    fn at_contacts(&mut self, y: &Bound<'py, PyAny>) -> PyResult<Vec<[f64; D]>> {
        let values: Vector<'py> = self.engine.call_method1("at_places", (y,))?.extract()?;
        self.at_contacts_of(&values)
    }

    fn norm(&mut self, y: &Bound<'py, PyAny>) -> PyResult<f64> {
        self.engine.call_method1("norm", (y,))?.extract()
    }

    fn largest(&mut self, y: &Bound<'py, PyAny>) -> PyResult<f64> {
        self.engine.call_method1("largest", (y,))?.extract()
    }

    fn imbalance(&mut self, e: &Bound<'py, PyAny>, reaction: &[[f64; D]]) -> PyResult<f64> {
        let interface = self.interface;
        let forces = spread(&interface.contacts.frames, reaction, interface.free.len());
        let forces = arrays::from_vec(self.engine.py(), forces);
        self.engine
            .call_method1("imbalance", (e, forces))?
            .extract()
    }

    fn terms(&mut self, y: &Bound<'py, PyAny>) -> PyResult<Terms<D>> {
        let (norm, values): (f64, Vector<'py>) =
            self.engine.call_method1("terms", (y,))?.extract()?;
        Ok(Terms {
            norm,
            at_contacts: self.at_contacts_of(&values)?,
        })
    }

    fn correction(
        &mut self,
        tangent: &Tangent<D>,
        statuses: &[Status],
        e: &Bound<'py, PyAny>,
        tol: f64,
    ) -> PyResult<Option<Correction<Bound<'py, PyAny>>>> {
        let tangent = PyContactTangent::from(tangent.clone());
        let solved: Option<(Bound<'py, PyAny>, usize, bool)> = self
            .engine
            .call_method1("correction", (tangent, self.array(statuses), e, tol))?
            .extract()?;
        Ok(solved.map(|(dy, products, reached)| Correction {
            dy,
            products,
            reached,
        }))
    }

    fn estimate(
        &mut self,
        tangent: &Tangent<D>,
        statuses: &[Status],
        e: &Bound<'py, PyAny>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let tangent = PyContactTangent::from(tangent.clone());
        let asked = (tangent, self.array(statuses), e);
        let found = self.engine.call_method1("estimate", asked)?;
        Ok((!found.is_none()).then_some(found))
    }

    fn is_late(&mut self, start: Instant, seconds: f64) -> PyResult<bool> {
        let late = start.elapsed().as_secs_f64() > seconds;
        self.engine.call_method1("agreed", (late,))?.is_truthy()
    }
}

/// A path and its contacts.
struct Progress<const D: usize> {
    variables: InterfaceVariables<D>,
    state: Option<State<D>>,
}

/// The Python objects of one step: the engine, the start value of the unknowns, and the forces.
struct Objects<'a, 'py> {
    engine: &'a Bound<'py, PyAny>,
    start: Bound<'py, PyAny>,
    force: &'a Bound<'py, PyAny>,
    /// Of [`Start`].
    near: bool,
    draft: bool,
}

/// A step, and the unknowns at its end.
type Solved<'py> = (PyNewtonStep, Bound<'py, PyAny>);

impl<const D: usize> Progress<D>
where
    AnyTangent: From<Tangent<D>>,
{
    fn new(variables: &InterfaceVariables<D>, start: Option<&ContactArrays<'_>>) -> PyResult<Self> {
        let contacts = variables.interface.contacts.count();
        let elliptic = variables.elliptic.as_ref();
        let state = start.map(|(reaction, displaced, status)| {
            state_of_contacts(contacts, elliptic, (reaction, displaced, status))
        });
        Ok(Self {
            variables: variables.clone(),
            state: state.transpose()?,
        })
    }

    fn step<'py>(
        &mut self,
        objects: Objects<'_, 'py>,
        (prescribed, gap): (&[f64], Option<&Matrix<'_>>),
        settings: &Settings,
    ) -> PyResult<Solved<'py>> {
        let interface = &*self.variables.interface;
        let elliptic = self.variables.elliptic.as_ref();
        check_length("prescribed", prescribed.len(), self.variables.fixed)?;
        let moved = gap.map(|gap| {
            let gap = times(elliptic, arrays::rows(gap)?).into_owned();
            PyResult::Ok(interface.contacts.with_gap(gap)?)
        });
        let moved = moved.transpose()?;
        let contacts = moved.as_ref().unwrap_or(&interface.contacts);
        let mut engine = Callbacks {
            engine: objects.engine,
            interface,
        };
        let start = Start {
            state: self.state.as_ref(),
            y: objects.start,
            near: objects.near,
            draft: objects.draft,
        };
        let force = (objects.force, prescribed);
        let made = advance(&mut engine, contacts, start, force, settings)?;
        let step = PyNewtonStep::new(objects.engine.py(), &made, 0, elliptic)?;
        if let Some(reached) = made.state() {
            self.state = Some(reached);
        }
        Ok((step, made.y))
    }
}

/// A load path whose vectors are those of a Python object. Without a state it starts from the
/// unloaded bodies.
#[pyclass(name = "ContactPath", module = "bipot_rs._core")]
pub(super) struct PyContactPath {
    progress: Dimension<Progress<2>, Progress<3>>,
}

#[pymethods]
impl PyContactPath {
    #[new]
    #[pyo3(signature = (variables, start=None))]
    fn new(variables: &PyContactVariables, start: Option<ContactArrays<'_>>) -> PyResult<Self> {
        let progress = map_either!(&variables.kind, variables => {
            Progress::new(variables, start.as_ref())?
        });
        Ok(Self { progress })
    }

    #[pyo3(signature = (engine, start, force, prescribed, gap, settings, near=false, draft=false))]
    fn step<'py>(
        &mut self,
        engine: Bound<'py, PyAny>,
        start: Bound<'py, PyAny>,
        force: Bound<'py, PyAny>,
        prescribed: Vector<'py>,
        gap: Option<Matrix<'py>>,
        settings: &PySettings,
        near: bool,
        draft: bool,
    ) -> PyResult<Solved<'py>> {
        let objects = Objects {
            engine: &engine,
            start,
            force: &force,
            near,
            draft,
        };
        let asked = (prescribed.as_slice()?, gap.as_ref());
        for_either!(&mut self.progress, path => path.step(objects, asked, &settings.checked))
    }
}
