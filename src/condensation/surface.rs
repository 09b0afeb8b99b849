//! The contacts on the bodies: the rows of `B` of each body.

use std::sync::Arc;

use crate::condensation::body::Body;
use crate::linalg::compensated::Sum;
use crate::linalg::small::dot_long;
use crate::linalg::sparse::reach::Reach;
use crate::linalg::sparse::rows::{OwnedMatrix, Rows};
use crate::reduced::elliptic_scaling::EllipticScaling;
use crate::reduced::rotation::Rotation;

/// A row of `B` restricted to a body: its local degrees of freedom, and values.
#[derive(Clone, Debug)]
pub struct ContactRow {
    pub row: usize,
    pub entries: Vec<(usize, f64)>,
}

/// The rows of one body, in ascending order.
#[derive(Clone, Debug, Default)]
pub struct Share {
    pub rows: Vec<ContactRow>,
    /// Their half solves, if they contain more than the kept unknowns of the body.
    pub far: Option<Far>,
}

/// Columns `b` of `Bᵀ` after the forward solve, one for each row of the share.
#[derive(Clone, Debug)]
pub struct Far {
    pub reach: Arc<Reach>,
    /// `L⁻¹ b_i` on the pivots reached.
    pub inside: Vec<f64>,
    /// `b_c − K_ci K_ii⁻¹ b_i` on the kept unknowns.
    pub kept: Vec<f64>,
}

impl Far {
    /// The two parts of a column.
    pub fn column(&self, k: usize, kept: usize) -> (&[f64], &[f64]) {
        let reached = self.reach.pivots().len();
        (
            &self.inside[k * reached..(k + 1) * reached],
            &self.kept[k * kept..(k + 1) * kept],
        )
    }

    /// Multiplies each column by its factor.
    fn scale(&mut self, factors: &[f64]) {
        for values in [&mut self.inside, &mut self.kept] {
            let length = values.len() / factors.len().max(1);
            let columns = values.chunks_exact_mut(length.max(1));
            for (column, t) in columns.zip(factors) {
                for value in column {
                    *value *= t;
                }
            }
        }
    }
}

impl Share {
    /// The rows of `Q B`, without half solves.
    fn rotated<const D: usize>(&self, rotation: &Rotation<D>) -> Self {
        let mut rows = Vec::with_capacity(self.rows.len());
        for own in self.rows.chunk_by(|a, b| a.row / D == b.row / D) {
            let contact = own[0].row / D;
            let entries = own.iter().flat_map(|row| {
                let entries = row.entries.iter();
                entries.map(|&(i, value)| (row.row % D, i, value))
            });
            for (k, entries) in rotation.rows(contact, entries).into_iter().enumerate() {
                if !entries.is_empty() {
                    let row = D * contact + k;
                    rows.push(ContactRow { row, entries });
                }
            }
        }
        Self { rows, far: None }
    }

    /// `v += B_c u_c` of the kept unknowns of `body`.
    fn add_kept(&self, body: &Body, u: &[f64], v: &mut [f64]) {
        for (k, row) in self.rows.iter().enumerate() {
            v[row.row] += match &self.far {
                None => row
                    .entries
                    .iter()
                    .map(|&(i, b)| body.place(i).map_or(0.0, |at| b * u[at]))
                    .sum::<f64>(),
                Some(far) => dot_long(far.column(k, body.kept()).1, u),
            };
        }
    }

    /// `v += amount B R_k`.
    pub fn add_motion(&self, body: &Body, motion: usize, amount: f64, v: &mut [f64]) {
        let z = body.motion(motion);
        for row in &self.rows {
            let moved: f64 = row.entries.iter().map(|&(i, b)| b * z[i]).sum();
            v[row.row] += amount * moved;
        }
    }

    /// `v += B K⁻¹ f` of condensed forces without their rigid part.
    pub fn add_free_displacement(&self, body: &Body, condensed: &[f64], v: &mut [f64]) {
        self.add_kept(body, &body.free_displacement(condensed), v);
        if let Some(far) = &self.far {
            let pivots = far.reach.pivots().iter();
            let inside: Vec<f64> = pivots.map(|&i| condensed[i as usize]).collect();
            for (k, row) in self.rows.iter().enumerate() {
                v[row.row] += dot_long(far.column(k, body.kept()).0, &inside);
            }
        }
    }

    /// `v += B u` for the part of a displacement on this body.
    fn add_to_sums(&self, body: &Body, u: &[f64], v: &mut [Sum]) {
        for row in &self.rows {
            for &(i, b) in &row.entries {
                v[row.row].add_product(b, u[body.dofs()[i]]);
            }
        }
    }

    /// `unit Bᵀ r` at the degrees of freedom of the body.
    pub fn push(&self, body: &Body, reaction: &[f64]) -> Vec<f64> {
        let mut push = vec![0.0; body.dofs().len()];
        for row in &self.rows {
            for &(i, b) in &row.entries {
                push[i] += b * body.unit() * reaction[row.row];
            }
        }
        push
    }
}

/// The data of all contacts except friction. Copies share all but the gap, which changes in
/// each step with moving obstacles.
#[derive(Clone, Debug, Default)]
pub struct Surface<const D: usize> {
    /// One for each body.
    pub shares: Arc<Vec<Share>>,
    /// `B` at the prescribed degrees of freedom.
    pub held: Arc<OwnedMatrix>,
    /// Gap by components.
    pub gap: Vec<[f64; D]>,
    /// Contacts whose normal row has no free degree of freedom.
    pub unmoved: Arc<Vec<usize>>,
}

impl<const D: usize> Surface<D> {
    /// Sorts the rows of `B` by bodies. `place` has the body and the local number of each free
    /// degree of freedom, `position` the number of each prescribed one.
    pub fn new(
        contact: &Rows,
        gap: &[[f64; D]],
        place: &[Option<(usize, usize)>],
        position: &[Option<usize>],
        bodies: usize,
    ) -> Self {
        let mut shares = vec![Share::default(); bodies];
        let mut unmoved = Vec::new();
        for row in 0..D * gap.len() {
            let found = contact.by_body(row, place);
            if row % D == 0 && found.is_empty() {
                unmoved.push(row / D);
            }
            for (body, entries) in found {
                shares[body].rows.push(ContactRow { row, entries });
            }
        }
        Self {
            shares: Arc::new(shares),
            held: Arc::new(contact.select(|j| position[j])),
            gap: gap.to_vec(),
            unmoved: Arc::new(unmoved),
        }
    }

    pub fn contacts(&self) -> usize {
        self.gap.len()
    }

    /// Replaces `B` and `g` by `T B` and `T g`.
    pub fn scale(&mut self, elliptic: &EllipticScaling) {
        self.gap = elliptic.times(&self.gap);
        let factor = |row: usize| elliptic.factor(row / D, row % D);
        let held = Arc::make_mut(&mut self.held);
        for (row, ends) in held.pointer.windows(2).enumerate() {
            for value in &mut held.values[ends[0]..ends[1]] {
                *value *= factor(row);
            }
        }
        for share in Arc::make_mut(&mut self.shares) {
            let factors: Vec<f64> = share.rows.iter().map(|row| factor(row.row)).collect();
            for (row, t) in share.rows.iter_mut().zip(&factors) {
                for (_, value) in &mut row.entries {
                    *value *= t;
                }
            }
            if let Some(far) = &mut share.far {
                far.scale(&factors);
            }
        }
    }

    /// The same contacts with `Q B` and `Q g`, without half solves.
    pub fn rotated(&self, rotation: &Rotation<D>) -> Self {
        let shares: Vec<Share> = self.shares.iter().map(|s| s.rotated(rotation)).collect();
        let mut moved = vec![false; self.contacts()];
        for row in shares.iter().flat_map(|share| &share.rows) {
            if row.row % D == 0 {
                moved[row.row / D] = true;
            }
        }
        Self {
            shares: Arc::new(shares),
            held: Arc::new(self.held.rotated(rotation)),
            gap: rotation.times(&self.gap),
            unmoved: Arc::new((0..moved.len()).filter(|&i| !moved[i]).collect()),
        }
    }

    /// `B u + gap` of a displacement, with sums in twice the precision. `low` are the digits of
    /// `u` below its rounding, `fixed` the prescribed degrees of freedom.
    pub fn relative_displacement(
        &self,
        bodies: &[Body],
        fixed: &[usize],
        u: &[f64],
        low: Option<&[f64]>,
    ) -> Vec<[f64; D]> {
        self.sums(bodies, fixed, (u, low), self.gap.as_flattened())
    }

    /// `B u` in the same way.
    pub fn product(&self, bodies: &[Body], fixed: &[usize], u: &[f64]) -> Vec<[f64; D]> {
        let nothing = vec![0.0; D * self.contacts()];
        self.sums(bodies, fixed, (u, None), &nothing)
    }

    fn sums(
        &self,
        bodies: &[Body],
        fixed: &[usize],
        (u, low): (&[f64], Option<&[f64]>),
        start: &[f64],
    ) -> Vec<[f64; D]> {
        let mut sums: Vec<Sum> = start.iter().map(|&g| Sum::new(g)).collect();
        let prescribed: Vec<f64> = fixed.iter().map(|&dof| u[dof]).collect();
        self.held.add_to_sums(&prescribed, &mut sums);
        for (share, body) in self.shares.iter().zip(bodies) {
            share.add_to_sums(body, u, &mut sums);
            if let Some(low) = low {
                share.add_to_sums(body, low, &mut sums);
            }
        }
        let values: Vec<f64> = sums.iter().map(Sum::value).collect();
        values.as_chunks::<D>().0.to_vec()
    }

    /// Some of the contacts, ascending, without half solves.
    pub fn of(&self, members: &[usize]) -> Self {
        let mut number = vec![usize::MAX; self.contacts()];
        for (k, &contact) in members.iter().enumerate() {
            number[contact] = k;
        }
        let renumbered = |row: &ContactRow| {
            let k = number[row.row / D];
            (k != usize::MAX).then(|| ContactRow {
                row: D * k + row.row % D,
                entries: row.entries.clone(),
            })
        };
        let share = |share: &Share| Share {
            rows: share.rows.iter().filter_map(renumbered).collect(),
            far: None,
        };
        let rows: Vec<usize> = members.iter().flat_map(|&i| D * i..D * (i + 1)).collect();
        let unmoved = |&k: &usize| self.unmoved.binary_search(&members[k]).is_ok();
        let unmoved = (0..members.len()).filter(unmoved);
        Self {
            shares: Arc::new(self.shares.iter().map(share).collect()),
            held: Arc::new(self.held.rows(&rows)),
            gap: members.iter().map(|&i| self.gap[i]).collect(),
            unmoved: Arc::new(unmoved.collect()),
        }
    }
}
