//! A contact problem in the displacements: `K` in blocks of nodes, and the contacts.

use std::iter;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use crate::bodies::basis::{motions_of_nodes, translations_of_nodes};
use crate::condensation::condense::ProblemArrays;
use crate::error::{Error, check_finite, check_length};
use crate::law::cone::Status;
use crate::law::contact_law::{self, ContactLaw};
use crate::linalg::amg;
use crate::linalg::amg::following::Following;
use crate::linalg::amg::single_rows::SingleRows;
use crate::linalg::amg::soft_motions::complete;
use crate::linalg::amg::symmetric_blocks::SymmetricBlocks;
use crate::linalg::compensated::Sum;
use crate::linalg::parallel::zero_where;
use crate::linalg::small::Block;
use crate::linalg::sparse::csc::{Index, narrow};
use crate::linalg::sparse::rows::{OwnedMatrix, Rows};
use crate::primal::contacts::Contacts;
use crate::primal::frames::Frames;
use crate::primal::interface::Interface;
use crate::primal::nodes::{Nodes, add_to_node, at_node};
use crate::primal::own_nodes::AboutNodes;
use crate::primal::stiffness_rows::StiffnessRows;
use crate::primal::supports::{self, Motions, Supports};
use crate::primal::tangent::Tangent;
use crate::primal::tuning;
use crate::reduced::elliptic_scaling::{EllipticScaling, over, times};
use crate::reduced::rotation::Rotation;

/// Bodies and supports.
#[derive(Debug)]
pub struct Stiffness {
    /// `K` of the free degrees of freedom.
    pub matrix: SymmetricBlocks,
    pub nodes: Nodes,
    /// Whether each place has a free degree of freedom.
    pub free: Vec<bool>,
    pub fixed: Vec<usize>,
    /// Number of each prescribed degree of freedom.
    pub(super) position: Vec<Option<usize>>,
    /// Columns of `K` at the prescribed degrees of freedom; rows of free ones only.
    pub(super) coupling: OwnedMatrix,
    pub(super) spectrum: OnceLock<Option<f64>>,
    /// Near-null vectors if there are no coordinates.
    pub(super) motions: Option<Vec<f64>>,
    pub(super) supports: Supports,
}

impl Stiffness {
    /// Bound of the eigenvalues of `D⁻¹ K`, which holds for all statuses. It is that of `K`
    /// alone, so that a path that continues has the same bits as an uninterrupted one. It is
    /// computed when it is first asked for: the caller's K may have been freed by then.
    pub(super) fn spectrum(&self) -> Option<f64> {
        *self
            .spectrum
            .get_or_init(|| SingleRows::new(&self.matrix, iter::empty()).spectrum())
    }

    /// Gives the rows of `K`: columns ascend, with the zeros of its blocks, and without the
    /// entries between prescribed degrees of freedom.
    pub(super) fn rows(&self) -> impl Fn(usize) -> Vec<(usize, f64)> + Sync {
        let (b, place) = (self.matrix.block_size(), &self.nodes.place);
        let mut dof = vec![0; place.len()];
        for (i, &at) in (0..).zip(place) {
            dof[at as usize] = i;
        }
        let mut beside: Vec<(usize, usize, f64)> = Vec::new();
        for (p, &j) in self.fixed.iter().enumerate() {
            beside.extend(self.coupling.entries(p).map(|(i, value)| (i, j, value)));
        }
        beside.sort_unstable_by_key(|&(i, j, _)| (i, j));
        move |i| {
            if let Some(p) = self.position[i] {
                return self.coupling.entries(p).collect();
            }
            let first = beside.partition_point(|&(other, ..)| other < i);
            let own = beside[first..]
                .iter()
                .take_while(|&&(other, ..)| other == i);
            let mut row: Vec<(usize, f64)> = own.map(|&(_, j, value)| (j, value)).collect();
            let at = place[i] as usize;
            self.matrix.for_each_block(at / b, |node, block| {
                let own = (0..b).map(|c| (dof[b * node + c], block[b * c + at % b]));
                row.extend(own.filter(|&(j, _)| self.position[j].is_none()));
            });
            row.sort_unstable_by_key(|&(j, _)| j);
            row
        }
    }

    /// What multigrid wants to know of the nodes; the motions of `wanted` ones, or of all.
    pub(super) fn about_nodes(
        &self,
        bodies: Vec<u32>,
        wanted: Option<&[bool]>,
    ) -> amg::nodes::LevelNodes {
        let coordinates = self.nodes.coordinates.clone().unwrap_or_default();
        amg::nodes::LevelNodes {
            motions: match &self.motions {
                Some(motions) => motions.clone(),
                None => motions_of_nodes(&coordinates, self.matrix.block_size(), wanted),
            },
            coordinates,
            bodies,
        }
    }
}

/// Forces by places, and the digits below their rounding.
#[derive(Clone, Debug, Default)]
pub struct Force {
    pub values: Vec<f64>,
    low: Vec<f64>,
}

/// A contact problem.
#[derive(Clone, Debug)]
pub struct Primal<const D: usize> {
    pub stiffness: Arc<Stiffness>,
    contact: Arc<OwnedMatrix>,
    pub contacts: Contacts<D>,
    /// What the preconditioner needs of contacts that join nodes, if there are any.
    pub(super) interface: Option<Arc<Interface>>,
}

impl<const D: usize> Primal<D> {
    /// Checks the arrays and copies `K` into blocks; `has_copies` is that of the check of supports.
    pub fn new<I: Index>(
        given: &ProblemArrays<D, I>,
        elliptic: Option<&EllipticScaling>,
        has_copies: bool,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let n = given.stiffness.n();
        check_contacts(&given.contact, given.gap, given.law, n)?;
        let _ = given.stiffness.check_symmetry()?;
        if let Some(places) = given.places {
            check_length("coordinates", places.len(), n)?;
            check_finite("coordinates", places.as_flattened())?;
        }
        let contact = given.contact.select(Some);
        let nodes = Nodes::new::<D>(n, given.places, &contact)?;
        let count = nodes.count;
        let _ = narrow(given.stiffness.row_idx().len());
        let mut rows = StiffnessRows::new(nodes, given.fixed)?;
        rows.append(count, |dof| given.stiffness.column(dof));
        Self::of_rows(
            rows,
            contact,
            (given.gap, given.law),
            elliptic,
            has_copies,
            stop,
        )
    }

    /// The problem with `K` of these rows, which is bitwise symmetric, and the rows of `B`.
    pub fn of_rows(
        rows: StiffnessRows,
        contact: OwnedMatrix,
        (gap, law): (&[[f64; D]], &[ContactLaw]),
        elliptic: Option<&EllipticScaling>,
        has_copies: bool,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let mut stiffness = rows.finish()?;
        let bodies = stiffness.matrix.connected();
        if let Some(at) = &stiffness.nodes.coordinates {
            let motions = Motions {
                values: &motions_of_nodes(at, D, None),
                bodies: &bodies,
            };
            stiffness.supports = supports::check::<D>(&stiffness, &contact, motions, has_copies)?;
        } else {
            // Which rotations are soft is not known.
            let spectrum = stiffness.spectrum();
            stiffness.motions = Some(motions_of(&stiffness.matrix, bodies, spectrum, stop)?);
        }
        Self::of(
            Arc::new(stiffness),
            Arc::new(contact),
            elliptic,
            elliptic.map_or_else(|| gap.to_vec(), |scaling| scaling.times(gap)),
            law.to_vec(),
        )
    }

    fn of(
        stiffness: Arc<Stiffness>,
        contact: Arc<OwnedMatrix>,
        elliptic: Option<&EllipticScaling>,
        gap: Vec<[f64; D]>,
        law: Vec<ContactLaw>,
    ) -> Result<Self, Error> {
        let block =
            |node: usize| Block::<D>::from_column_slice(stiffness.matrix.diagonal_block(node));
        let nodes = AboutNodes {
            free: &stiffness.free,
            block: &block,
            bodies: &|| stiffness.matrix.connected(),
        };
        let (place, position) = (&stiffness.nodes.place, &stiffness.position);
        let frames = Frames::new(&contact, elliptic, place, position, &nodes)?;
        let contacts = Contacts::new(frames, gap, law, &block)?;
        let join = contacts.frames.join();
        let interface = join.then(|| Arc::new(Interface::new(&stiffness.matrix, &contacts.frames)));
        Ok(Self {
            stiffness,
            contact,
            contacts,
            interface,
        })
    }

    /// Degrees of freedom, with the prescribed ones.
    pub fn order(&self) -> usize {
        self.stiffness.nodes.place.len()
    }

    /// Bytes of `K` in blocks, and a forecast of the bytes beside it: the hierarchy, and the
    /// vectors of GMRES.
    pub fn bytes(&self) -> (usize, usize) {
        let own = self.stiffness.matrix.bytes();
        #[expect(
            clippy::cast_precision_loss,
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a forecast"
        )]
        let hierarchy = (tuning::hierarchy_bytes() * own as f64) as usize;
        let vectors = tuning::vector_bytes() * self.order();
        // A second hierarchy follows the statuses; the factor of the filter is about as large as
        // its rows.
        let joined = self
            .interface
            .as_ref()
            .map_or(0, |interface| hierarchy + 2 * interface.rows.bytes());
        (own, hierarchy + joined + vectors)
    }

    /// The same bodies and contacts with other laws. `elliptic` is the change
    /// of variables that belongs to them, `change` the one from the present variables.
    pub fn with_law(
        &self,
        law: Vec<ContactLaw>,
        elliptic: Option<&EllipticScaling>,
        change: Option<&EllipticScaling>,
    ) -> Result<Self, Error> {
        contact_law::check(&law, self.contacts.count())?;
        let Some(change) = change else {
            let mut same = self.clone();
            same.contacts.law = law;
            return Ok(same);
        };
        let (stiffness, contact) = (Arc::clone(&self.stiffness), Arc::clone(&self.contact));
        let gap = change.times(&self.contacts.gap);
        Self::of(stiffness, contact, elliptic, gap, law)
    }

    /// The same bodies and contacts with other gaps.
    pub fn with_gap(&self, gap: Vec<[f64; D]>) -> Result<Self, Error> {
        let mut moved = self.clone();
        moved.contacts = self.contacts.with_gap(gap)?;
        Ok(moved)
    }

    /// The same bodies and contacts in rotated frames. `elliptic` is the present change of
    /// variables; `rotation` is about the variables of the caller.
    pub fn rotated(
        &self,
        rotation: &Rotation<D>,
        elliptic: Option<&EllipticScaling>,
    ) -> Result<Self, Error> {
        check_length("rotation", rotation.contacts(), self.contacts.count())?;
        let contact = Arc::new(self.contact.rotated(rotation));
        let gap = over(elliptic, &self.contacts.gap);
        let gap = rotation.times(&gap);
        let gap = times(elliptic, &gap).into_owned();
        let (stiffness, law) = (Arc::clone(&self.stiffness), self.contacts.law.clone());
        Self::of(stiffness, contact, elliptic, gap, law)
    }

    /// `Tᵀ (f − K_fp u_p)` by places, with sums in twice the precision.
    pub fn force(&self, load: &[f64], prescribed: &[f64]) -> Result<Force, Error> {
        let known = &self.stiffness;
        check_length("load", load.len(), self.order())?;
        check_finite("load", load)?;
        check_length("prescribed", prescribed.len(), known.fixed.len())?;
        check_finite("prescribed", prescribed)?;
        let mut sums: Vec<Sum> = load.iter().map(|&value| Sum::new(value)).collect();
        for (p, u) in prescribed.iter().enumerate() {
            for (dof, value) in known.coupling.entries(p) {
                sums[dof].add_product(value, -u);
            }
        }
        for &dof in &known.fixed {
            sums[dof] = Sum::default();
        }
        let (values, low): (Vec<f64>, Vec<f64>) = sums.iter().map(Sum::parts).unzip();
        let (mut values, mut low) = (known.nodes.gather(&values), known.nodes.gather(&low));
        let frames = &self.contacts.frames;
        frames.forces_to_local_in_two(&mut values, &mut low);
        Ok(Force { values, low })
    }

    /// `Tᵀ K T y − f` with sums in twice the precision: a motion that springs hold softly would
    /// be lost in the rounding of the others.
    pub fn imbalance(&self, y: &[f64], force: &Force) -> Vec<f64> {
        let mut u = y.to_vec();
        self.contacts.frames.to_displacements(&mut u);
        let (mut forces, mut low) = self.stiffness.matrix.product_in_two(&u);
        self.clear_prescribed(&mut forces);
        self.clear_prescribed(&mut low);
        let frames = &self.contacts.frames;
        frames.forces_to_local_in_two(&mut forces, &mut low);
        let loads = force.values.iter().zip(&force.low);
        for ((e, low), (f, f_low)) in forces.iter_mut().zip(&low).zip(loads) {
            let mut sum = Sum::new(*e);
            sum.add(-f);
            sum.add(low - f_low);
            *e = sum.value();
        }
        forces
    }

    /// `Tᵀ K T y`; `work` has the length of `y`.
    pub fn product(&self, y: &[f64], work: &mut Vec<f64>, out: &mut [f64]) {
        work.clear();
        work.extend_from_slice(y);
        self.contacts.frames.to_displacements(work);
        self.stiffness.matrix.product(work, out);
        self.clear_prescribed(out);
        self.contacts.frames.forces_to_local(out);
    }

    /// `Tᵀ K T y` for a `y` that is zero but at the nodes of contacts, by the rows of `K` at the
    /// nodes that these move.
    pub fn product_of_contacts(&self, y: &[f64]) -> Vec<f64> {
        let mut u = y.to_vec();
        self.contacts.frames.to_displacements(&mut u);
        let mut out = vec![0.0; y.len()];
        let nodes = self.contacts.frames.list.iter().map(|frame| frame.node);
        for node in nodes.filter(|&node| node != usize::MAX) {
            let own = at_node::<D>(&u, node);
            if own.iter().all(|&value| value == 0.0) {
                continue;
            }
            self.stiffness.matrix.for_each_block(node, |other, block| {
                let force = Block::<D>::from_column_slice(block).tr_mul(&own);
                add_to_node(&mut out, other, force);
            });
        }
        self.clear_prescribed(&mut out);
        self.contacts.frames.forces_to_local(&mut out);
        out
    }

    /// `|Tᵀ| |K| |T y|`: the size of the terms of [`Primal::product`].
    pub fn terms(&self, y: &[f64]) -> Vec<f64> {
        let mut u = y.to_vec();
        self.contacts.frames.terms_of_displacements(&mut u);
        let mut out = vec![0.0; y.len()];
        self.stiffness.matrix.absolute_product(&u, &mut out);
        self.clear_prescribed(&mut out);
        self.contacts.frames.terms_of_forces(&mut out);
        out
    }

    /// Sets the places without a degree of freedom to zero.
    fn clear_prescribed(&self, values: &mut [f64]) {
        zero_where(&self.stiffness.free, false, values);
    }

    /// The nodes, with the motions of `wanted` ones, or of all, in the variables of the contacts.
    pub(super) fn about_nodes(&self, wanted: Option<&[bool]>) -> amg::nodes::LevelNodes {
        let bodies = self.interface.as_ref();
        let bodies = bodies.map_or(Vec::new(), |interface| interface.bodies.clone());
        let mut about = self.stiffness.about_nodes(bodies, wanted);
        let motions = &mut about.motions;
        let m = motions.len() / self.stiffness.free.len().max(1);
        for (_, frame) in self.contacts.frames.with_node() {
            let own = &mut motions[D * frame.node * m..D * (frame.node + 1) * m];
            let before = own.to_vec();
            for k in 0..D {
                for c in 0..m {
                    let parts = (0..D).map(|l| frame.to_local[(k, l)] * before[l * m + c]);
                    own[k * m + c] = parts.sum();
                }
            }
        }
        about
    }

    /// The hierarchy of one body, which follows the statuses of its contacts.
    pub(super) fn hierarchy(
        &self,
        settings: &amg::settings::CycleSettings,
        stop: &AtomicBool,
    ) -> Result<Following, Error> {
        let blocks = self.contacts.frames.blocks();
        let blocks = blocks.map(|(node, block)| (node, block.as_slice()));
        let matrix = SingleRows::new(&self.stiffness.matrix, blocks);
        let nodes = self.contacts.frames.with_node();
        let nodes = nodes.map(|(_, frame)| narrow(frame.node)).collect();
        Following::new(&matrix, &self.about_nodes(None), nodes, settings, stop)
    }

    /// Whether supports, springs and contacts hold every rigid motion at a point: a contact that
    /// sticks in all directions, one that slips along its normal and across its slip.
    pub(super) fn is_held(&self, tangent: &Tangent<D>, statuses: &[Status]) -> bool {
        let known = &self.stiffness;
        let (Some(loose), Some(at)) = (&known.supports.loose, &known.nodes.coordinates) else {
            return true;
        };
        let mut rows = OwnedMatrix::default();
        let mut add = |contact: usize, direction: [f64; D]| {
            let parts = direction.into_iter().enumerate();
            rows.push(parts.filter(|(_, f)| *f != 0.0).flat_map(|(k, factor)| {
                let entries = self.contact.entries(D * contact + k);
                entries.map(move |(dof, b)| (dof, factor * b))
            }));
        };
        for (i, &status) in statuses.iter().enumerate() {
            let held = match status {
                Status::Open => 0,
                Status::Slip => 1,
                Status::Stick => D,
            };
            for k in 0..held {
                add(i, std::array::from_fn(|l| f64::from(u8::from(l == k))));
            }
        }
        for (i, spring) in tangent.springs_of_contacts() {
            for row in spring.row_iter() {
                add(i, std::array::from_fn(|l| row[l]));
            }
        }
        let motions = Motions {
            values: &motions_of_nodes(at, D, None),
            bodies: &known.matrix.connected(),
        };
        loose.are_held_by(&rows, &known.nodes, motions)
    }

    /// The contacts of each body without a support.
    pub fn floating(&self) -> Vec<Vec<usize>> {
        let Some(interface) = &self.interface else {
            let all = (0..self.contacts.count()).collect();
            return if self.stiffness.fixed.is_empty() {
                vec![all]
            } else {
                Vec::new()
            };
        };
        let count = interface.bodies.iter().max();
        let count = count.map_or(0, |&last| last as usize + 1);
        let mut held = vec![false; count];
        let nodes = self.stiffness.free.chunks_exact(D).zip(&interface.bodies);
        for (free, &body) in nodes {
            held[body as usize] |= free.contains(&false);
        }
        self.contacts.floating(&interface.bodies, &held)
    }

    /// `K` by rows, with the zeros of its blocks and without the entries between prescribed
    /// degrees of freedom.
    pub fn stiffness_by_rows(&self) -> OwnedMatrix {
        let (row, mut out) = (self.stiffness.rows(), OwnedMatrix::default());
        for i in 0..self.order() {
            out.push(row(i));
        }
        out
    }

    /// All displacements from the unknowns.
    pub fn displacement(&self, y: &[f64], prescribed: &[f64]) -> Vec<f64> {
        let mut u = y.to_vec();
        self.contacts.frames.to_displacements(&mut u);
        let mut u = self.stiffness.nodes.scatter(&u);
        for (&dof, &value) in self.stiffness.fixed.iter().zip(prescribed) {
            u[dof] = value;
        }
        u
    }

    /// The unknowns of a displacement.
    pub fn unknowns(&self, u: &[f64]) -> Vec<f64> {
        let mut y = self.stiffness.nodes.gather(u);
        self.clear_prescribed(&mut y);
        self.contacts.frames.to_local(&mut y);
        y
    }
}

/// Refuses contacts that do not fit together, or not to `n` degrees of freedom.
pub fn check_contacts<const D: usize>(
    contact: &Rows<'_>,
    gap: &[[f64; D]],
    law: &[ContactLaw],
    n: usize,
) -> Result<(), Error> {
    contact.check("B", D * gap.len(), n)?;
    check_finite("gap", gap.as_flattened())?;
    contact_law::check(law, gap.len())
}

/// Near-null vectors from `K` alone. Supports must hold each body: whether contact can hold one,
/// only its rigid motions tell.
fn motions_of(
    matrix: &SymmetricBlocks,
    bodies: Vec<u32>,
    spectrum: Option<f64>,
    stop: &AtomicBool,
) -> Result<Vec<f64>, Error> {
    let mut about = amg::nodes::LevelNodes {
        motions: translations_of_nodes(matrix.nodes(), matrix.block_size()),
        coordinates: Vec::new(),
        bodies,
    };
    let settings = amg::settings::CycleSettings {
        spectrum,
        ..amg::settings::CycleSettings::default()
    };
    let single = SingleRows::new(matrix, iter::empty()).whole();
    match complete(&mut about, matrix, &single, &settings, stop) {
        Ok(()) => Ok(about.motions),
        Err(Error::Multigrid { .. }) => Err(Error::NotIterative {
            reason: "without coordinates, supports do not seem to hold each body, or a rigid set \
                     turns freely: give coordinates, or take the direct engine",
            dof: None,
        }),
        Err(other) => Err(other),
    }
}
