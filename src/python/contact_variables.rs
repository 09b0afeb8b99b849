//! The variables of contacts whose stiffness is held elsewhere: arrays by the places of the
//! nodes of the interface, `d` places for each.

use std::sync::Arc;

use numpy::PyArray1;
use pyo3::prelude::*;

use crate::error::{Error, check_finite, check_length};
use crate::law::contact_law::{self, ContactLaw};
use crate::linalg::small::Block;
use crate::linalg::sparse::csc::narrow;
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::primal::contacts::Contacts;
use crate::primal::frames::Frames;
use crate::primal::linearised::spread;
use crate::primal::nodes::{at_node, set_node};
use crate::primal::own_nodes::AboutNodes;
use crate::primal::tangent::Tangent;
use crate::primal::transformation::Transformation;
use crate::python::arrays::{
    self, Changed, Csr, CsrArrays, CsrOutput, Indices, LawArrays, Matrix, NewIndices, NewMatrix,
    NewVector, Vector,
};
use crate::python::contact_values::{factors, over, read};
use crate::python::dimension::{Dimension, for_either, map_either};
use crate::reduced::elliptic_scaling::{EllipticScaling, times};

/// Contacts, and what is known of the nodes of their interface.
pub(super) struct Interface<const D: usize> {
    pub(super) contacts: Contacts<D>,
    /// The places with an unknown.
    pub(super) free: Vec<bool>,
    /// The contacts of each body without a support.
    pub(super) floating: Vec<Vec<usize>>,
}

/// An interface in the variables of [`EllipticScaling`].
#[derive(Clone)]
pub(super) struct InterfaceVariables<const D: usize> {
    pub(super) interface: Arc<Interface<D>>,
    pub(super) elliptic: Option<EllipticScaling>,
    /// Number of prescribed degrees of freedom.
    pub(super) fixed: usize,
}

impl<const D: usize> InterfaceVariables<D> {
    /// `T` of all contacts, component by component: `r = T r̃`, `v = T⁻¹ ṽ`.
    pub(super) fn factors(&self) -> Vec<f64> {
        let contacts = 0..self.interface.contacts.count();
        factors(D, contacts, self.elliptic.as_ref())
    }

    /// Estimate of the diagonal of `W = T⁻¹ W̃ T⁻¹`; zero at components without an unknown.
    fn diagonal(&self) -> Vec<f64> {
        let (contacts, factors) = (&self.interface.contacts, self.factors());
        let mut found = Vec::with_capacity(factors.len());
        for (i, frame) in contacts.frames.list.iter().enumerate() {
            let own = contacts.compliance.block(i).diagonal();
            found.extend((0..D).map(|k| if frame.free[k] { own[k] } else { 0.0 }));
        }
        over(&over(&found, &factors), &factors)
    }

    /// `B_f u_f` of prescribed displacements.
    fn offsets(&self, prescribed: &Vector<'_>) -> PyResult<Vec<f64>> {
        let prescribed = arrays::numbers("prescribed", prescribed, self.fixed)?;
        let contacts = &self.interface.contacts;
        let none = vec![[0.0; D]; contacts.count()];
        let v = contacts.frames.offsets(&none, prescribed);
        Ok(over(v.as_flattened(), &self.factors()))
    }

    /// `R y` of values of the places.
    fn moved(&self, y: &Vector<'_>) -> PyResult<Vec<f64>> {
        let y = arrays::numbers("y", y, self.interface.free.len())?;
        let v = self.interface.contacts.frames.at_contacts(y);
        Ok(over(v.as_flattened(), &self.factors()))
    }

    /// `Rᵀ v`, by places.
    fn work(&self, v: &Matrix<'_>) -> PyResult<Vec<f64>> {
        let Interface { contacts, free, .. } = &*self.interface;
        let v = read("v", v, &self.factors())?;
        Ok(spread(&contacts.frames, &v, free.len()))
    }

    /// The same contacts with other laws, in the same variables.
    fn with_law(&self, law: &LawArrays<'_>) -> PyResult<Self> {
        let (law, _) = law.read(D)?;
        let interface = &*self.interface;
        contact_law::check(&law, interface.contacts.count())?;
        let contacts = Contacts {
            law,
            ..interface.contacts.clone()
        };
        Ok(Self {
            interface: Arc::new(Interface {
                contacts,
                free: interface.free.clone(),
                floating: interface.floating.clone(),
            }),
            ..self.clone()
        })
    }

    /// Changes values by places with the frames.
    fn change(
        &self,
        values: &mut Changed<'_>,
        change: impl FnOnce(&Frames<D>, &mut [f64]),
    ) -> PyResult<()> {
        let values = arrays::changed("values", values, self.interface.free.len())?;
        change(&self.interface.contacts.frames, values);
        Ok(())
    }
}

/// The arguments that do not depend on the dimension.
struct Arguments<'a> {
    contact: CsrArrays<'a>,
    law: Vec<ContactLaw>,
    elliptic: Option<EllipticScaling>,
    /// Number of each place among the prescribed degrees of freedom.
    position: Vec<Option<usize>>,
    blocks: &'a [f64],
    bodies: Vec<u32>,
    held: Vec<bool>,
}

impl Arguments<'_> {
    fn make<const D: usize>(self, gap: &[[f64; D]]) -> Result<Interface<D>, Error> {
        let places = self.position.len();
        check_length("places", places, D * self.bodies.len())?;
        check_length("blocks", self.blocks.len(), D * places)?;
        check_finite("blocks", self.blocks)?;
        check_finite("gap", gap.as_flattened())?;
        contact_law::check(&self.law, gap.len())?;
        if let Some(position) =
            (0..self.bodies.len()).find(|&node| self.bodies[node] as usize >= self.held.len())
        {
            return Err(Error::IndexRange {
                what: "bodies",
                position,
                found: self.bodies[position] as usize,
                limit: self.held.len(),
            });
        }
        let rows = self.contact.rows();
        rows.check("B", D * gap.len(), places)?;
        let free: Vec<bool> = self.position.iter().map(Option::is_none).collect();
        let block = |node: usize| positive::<D>(&self.blocks[D * D * node..], &free[D * node..]);
        let nodes = AboutNodes {
            free: &free,
            block: &block,
            bodies: &|| self.bodies.clone(),
        };
        let own: Vec<u32> = (0..places).map(narrow).collect();
        let contact = rows.select(Some);
        let frames = Frames::new(
            &contact,
            self.elliptic.as_ref(),
            &own,
            &self.position,
            &nodes,
        )?;
        let gap = times(self.elliptic.as_ref(), gap).into_owned();
        let contacts = Contacts::new(frames, gap, self.law, &block)?;
        let floating = contacts.floating(&self.bodies, &self.held);
        Ok(Interface {
            contacts,
            free,
            floating,
        })
    }
}

/// The block of a node in the free components; the others have the mean diagonal of these.
fn positive<const D: usize>(block: &[f64], free: &[bool]) -> Block<D> {
    let own = Block::<D>::from_row_slice(&block[..D * D]);
    let (mut sum, mut count) = (0.0, 0.0);
    for k in (0..D).filter(|&k| free[k]) {
        sum += own[(k, k)];
        count += 1.0;
    }
    let mean = if sum > 0.0 { sum / count } else { 1.0 };
    Block::from_fn(|k, l| match (free[k] && free[l], k == l) {
        (true, _) => own[(k, l)],
        (false, true) => mean,
        (false, false) => 0.0,
    })
}

/// Contacts on an interface, in any dimension.
#[pyclass(frozen, name = "ContactVariables", module = "bipot_rs._core")]
pub(super) struct PyContactVariables {
    pub(super) kind: Dimension<InterfaceVariables<2>, InterfaceVariables<3>>,
}

#[pymethods]
impl PyContactVariables {
    #[new]
    fn new(
        contact: Csr<'_>,
        gap: Matrix<'_>,
        law: LawArrays<'_>,
        position: Indices<'_>,
        fixed: usize,
        blocks: Matrix<'_>,
        bodies: Indices<'_>,
        held: Indices<'_>,
    ) -> PyResult<Self> {
        let (law, elliptic) = law.read(gap.as_array().ncols())?;
        let numbers = arrays::indices(&position, "position")?;
        let position = numbers.into_iter().map(|k| (k < fixed).then_some(k));
        let bodies = arrays::indices(&bodies, "bodies")?;
        // A number that is too large is refused with those that are out of range.
        let number = |&body: &usize| u32::try_from(body).unwrap_or(u32::MAX);
        let asked = Arguments {
            contact: CsrArrays::new(&contact, "B", None)?,
            law,
            elliptic: elliptic.clone(),
            position: position.collect(),
            blocks: blocks.as_slice()?,
            bodies: bodies.iter().map(number).collect(),
            held: arrays::indices(&held, "held")?
                .iter()
                .map(|&h| h > 0)
                .collect(),
        };
        let kind = map_either!(Dimension::of(gap.as_array().ncols()), () => InterfaceVariables {
            interface: Arc::new(asked.make(arrays::rows(&gap)?)?),
            elliptic,
            fixed,
        });
        Ok(Self { kind })
    }

    fn with_law(&self, law: LawArrays<'_>) -> PyResult<Self> {
        let kind = map_either!(&self.kind, inner => inner.with_law(&law)?);
        Ok(Self { kind })
    }

    #[getter]
    pub(super) fn places(&self) -> usize {
        for_either!(&self.kind, inner => inner.interface.free.len())
    }

    #[getter]
    fn join(&self) -> bool {
        for_either!(&self.kind, inner => inner.interface.contacts.frames.join())
    }

    #[getter]
    fn nodes<'py>(&self, py: Python<'py>) -> NewIndices<'py> {
        let nodes = for_either!(&self.kind, inner => {
            inner.interface.contacts.frames.blocks().map(|(node, _)| node).collect()
        });
        arrays::from_indices(py, nodes)
    }

    /// Places whose component of `v` has no unknown, and of degrees of freedom that are
    /// prescribed.
    #[getter]
    fn absent<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        for_either!(&self.kind, inner => {
            let interface = &*inner.interface;
            let mut absent: Vec<bool> = interface.free.iter().map(|free| !free).collect();
            let nodes = absent.as_chunks_mut().0;
            for (_, frame) in interface.contacts.frames.with_node() {
                nodes[frame.node] = frame.free.map(|free| !free);
            }
            PyArray1::from_vec(py, absent)
        })
    }

    fn transformation<'py>(&self, py: Python<'py>) -> CsrOutput<'py> {
        fn of<const D: usize>(inner: &Interface<D>) -> OwnedMatrix {
            let nodes = inner.free.len() / D;
            let rows = Transformation::new(nodes, &inner.contacts.frames);
            let mut matrix = OwnedMatrix::default();
            for (node, k) in (0..nodes).flat_map(|node| (0..D).map(move |k| (node, k))) {
                match rows.row(node) {
                    None => matrix.push([(D * node + k, 1.0)]),
                    Some(row) => matrix.push(row.iter().flat_map(|(column, block)| {
                        (0..D).map(move |l| (D * *column as usize + l, block[(k, l)]))
                    })),
                }
            }
            matrix
        }
        arrays::from_csr(py, for_either!(&self.kind, inner => of(&inner.interface)))
    }

    #[getter]
    fn diagonal<'py>(&self, py: Python<'py>) -> NewMatrix<'py> {
        let own = for_either!(&self.kind, inner => inner.diagonal());
        arrays::of_contacts(py, own, self.kind.count())
    }

    fn offsets<'py>(&self, py: Python<'py>, prescribed: Vector<'py>) -> PyResult<NewMatrix<'py>> {
        let v = for_either!(&self.kind, inner => inner.offsets(&prescribed)?);
        Ok(arrays::of_contacts(py, v, self.kind.count()))
    }

    fn moved<'py>(&self, py: Python<'py>, y: Vector<'py>) -> PyResult<NewMatrix<'py>> {
        let v = for_either!(&self.kind, inner => inner.moved(&y)?);
        Ok(arrays::of_contacts(py, v, self.kind.count()))
    }

    fn work<'py>(&self, py: Python<'py>, v: Matrix<'py>) -> PyResult<NewVector<'py>> {
        let y = for_either!(&self.kind, inner => inner.work(&v)?);
        Ok(arrays::from_vec(py, y))
    }

    /// `B_s u_s` at the node of each contact, in place: a motion of its own body.
    fn to_own_variables(&self, mut values: Changed<'_>) -> PyResult<()> {
        fn turn<const D: usize>(frames: &Frames<D>, values: &mut [f64]) {
            for (_, frame) in frames.with_node() {
                let turned = frame.to_local * at_node(values, frame.node);
                set_node(values, frame.node, turned);
            }
        }
        for_either!(&self.kind, inner => inner.change(&mut values, turn))
    }

    fn to_displacements(&self, mut values: Changed<'_>) -> PyResult<()> {
        for_either!(&self.kind, inner => inner.change(&mut values, Frames::to_displacements))
    }

    fn to_local(&self, mut values: Changed<'_>) -> PyResult<()> {
        for_either!(&self.kind, inner => inner.change(&mut values, Frames::to_local))
    }

    fn forces_to_local(&self, mut values: Changed<'_>) -> PyResult<()> {
        for_either!(&self.kind, inner => inner.change(&mut values, Frames::forces_to_local))
    }

    fn terms_of_displacements(&self, mut values: Changed<'_>) -> PyResult<()> {
        for_either!(&self.kind, inner => {
            inner.change(&mut values, Frames::terms_of_displacements)
        })
    }

    fn terms_of_forces(&self, mut values: Changed<'_>) -> PyResult<()> {
        for_either!(&self.kind, inner => inner.change(&mut values, Frames::terms_of_forces))
    }
}

/// The system of one Newton step in either dimension.
pub(super) type AnyTangent = Dimension<Tangent<2>, Tangent<3>>;

/// The system of one Newton step at the places of the interface.
#[pyclass(frozen, name = "ContactTangent", module = "bipot_rs._core")]
pub(super) struct PyContactTangent {
    kind: AnyTangent,
}

impl From<Tangent<2>> for AnyTangent {
    fn from(tangent: Tangent<2>) -> Self {
        Self::Plane(tangent)
    }
}

impl From<Tangent<3>> for AnyTangent {
    fn from(tangent: Tangent<3>) -> Self {
        Self::Space(tangent)
    }
}

impl<T: Into<AnyTangent>> From<T> for PyContactTangent {
    fn from(tangent: T) -> Self {
        let kind = tangent.into();
        Self { kind }
    }
}

impl PyContactTangent {
    fn places(&self) -> usize {
        for_either!(&self.kind, tangent => tangent.held.len())
    }
}

#[pymethods]
impl PyContactTangent {
    #[getter]
    fn held<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        PyArray1::from_slice(
            py,
            for_either!(&self.kind, tangent => tangent.held.as_slice()),
        )
    }

    #[getter]
    fn known<'py>(&self, py: Python<'py>) -> NewVector<'py> {
        PyArray1::from_slice(
            py,
            for_either!(&self.kind, tangent => tangent.known.as_slice()),
        )
    }

    fn clear(&self, mut values: Changed<'_>) -> PyResult<()> {
        let values = arrays::changed("values", &mut values, self.places())?;
        for_either!(&self.kind, tangent => tangent.clear(values));
        Ok(())
    }

    fn add_laws(&self, x: Vector<'_>, mut out: Changed<'_>) -> PyResult<()> {
        let x = arrays::numbers("x", &x, self.places())?;
        let out = arrays::changed("out", &mut out, self.places())?;
        for_either!(&self.kind, tangent => tangent.add_laws(x, out));
        Ok(())
    }

    fn pull(&self, mut z: Changed<'_>) -> PyResult<()> {
        let z = arrays::changed("z", &mut z, self.places())?;
        for_either!(&self.kind, tangent => tangent.pull(z));
        Ok(())
    }

    fn add_transposed(&self, z: Vector<'_>, mut out: Changed<'_>) -> PyResult<()> {
        let z = arrays::numbers("z", &z, self.places())?;
        let out = arrays::changed("out", &mut out, self.places())?;
        for_either!(&self.kind, tangent => tangent.add_transposed(z, out));
        Ok(())
    }

    fn right_side<'py>(
        &self,
        py: Python<'py>,
        e: Vector<'_>,
        moved: Vector<'_>,
    ) -> PyResult<NewVector<'py>> {
        let e = arrays::numbers("e", &e, self.places())?;
        let mut moved = arrays::numbers("moved", &moved, self.places())?.to_vec();
        let right = for_either!(&self.kind, tangent => tangent.right_side(e, &mut moved));
        Ok(arrays::from_vec(py, right))
    }

    fn springs<'py>(&self, py: Python<'py>) -> (NewIndices<'py>, NewMatrix<'py>) {
        let (mut nodes, mut values) = (Vec::new(), Vec::<f64>::new());
        for_either!(&self.kind, tangent => {
            for (node, spring) in tangent.springs_of_nodes() {
                nodes.push(node);
                values.extend(spring.iter());
            }
        });
        let values = arrays::square(py, values, nodes.len(), self.kind.count().pow(2));
        (arrays::from_indices(py, nodes), values)
    }
}
