//! From `K`, `B` and `f` to `S`, `W` and `q`, and back to `u`: (1)–(4).
//!
//! `K` falls into bodies, the connected components of its free part. Each is
//! condensed onto its contact set, the free degrees of freedom that `B` touches:
//! `S = K_cc − K_ci K_ii⁻¹ K_ic`. Then `W = Σ B_c (S + α R Rᵀ)⁻¹ B_cᵀ`, with `R`
//! the rigid motions that the supports leave free; contacts that share a body
//! share an island of `W`.

use std::borrow::Cow;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use rayon::prelude::*;

use crate::error::Error;
use crate::linalg::blocks::Blocks;
use crate::linalg::csc::Symmetric;
use crate::linalg::exact::Sum;
use crate::linalg::small::Block;
use crate::linalg::union::Union;
use crate::problem::body::{Body, Row};
use crate::problem::border::{check_finite, check_length};
use crate::problem::compliance::{Compliance, Part, is_sparse};
use crate::problem::memory;
use crate::problem::reduced::{Reduced, Rigid};
use crate::problem::sparse::{self, Owned, Rows};
use crate::problem::stats::Stats;

/// What a contact problem is made of, borrowed from the caller.
#[derive(Clone, Copy, Debug)]
pub struct Given<'a, const D: usize> {
    /// Symmetric positive semidefinite stiffness, both triangles; the lower one is read.
    pub stiffness: Symmetric<'a>,
    /// `B`, a row each component of each contact.
    pub contact: Rows<'a>,
    /// Gap, by component.
    pub gap: &'a [[f64; D]],
    pub mu: &'a [f64],
    /// Prescribed degrees of freedom.
    pub fixed: &'a [usize],
}

/// A condensed contact problem: everything that does not depend on the loads.
#[derive(Debug)]
pub struct Condensed<const D: usize> {
    n: usize,
    fixed: Vec<usize>,
    bodies: Vec<Body>,
    /// Columns of `K` at the prescribed degrees of freedom, free rows only.
    coupling: Owned,
    /// `B` at the prescribed degrees of freedom.
    contact_fixed: Owned,
    gap: Vec<[f64; D]>,
    mu: Vec<f64>,
    /// Contacts whose normal row touches no free degree of freedom.
    unmoved: Vec<usize>,
    compliance: Compliance<'static, D>,
    /// Body and number within it of each rigid motion.
    motions: Vec<(usize, usize)>,
    stats: Stats,
}

/// What one set of loads does with no contact force.
#[derive(Clone, Debug)]
pub struct FreePart<const D: usize> {
    /// `q` with the whole gap: total relative displacement at `r = 0`, `a = 0`.
    pub q: Vec<[f64; D]>,
    /// `R` and `e`.
    pub rigid: Rigid<D>,
}

impl<const D: usize> Condensed<D> {
    /// Checks, orders, factors and forms `W`.
    ///
    /// # Errors
    /// Wrong arguments, each naming the place; [`Error::Asymmetric`] and
    /// [`Error::Indefinite`] for a `K` that is no stiffness;
    /// [`Error::FloatingBody`], [`Error::Mechanism`] and
    /// [`Error::DependentMotion`] for motions that contact cannot hold;
    /// [`Error::Memory`]; [`Error::Interrupted`].
    pub fn new(given: &Given<D>, stop: &AtomicBool) -> Result<Self, Error> {
        let n = given.stiffness.n();
        let rows = D * given.gap.len();
        given.contact.check("B", rows, n)?;
        check_finite("gap", given.gap.as_flattened())?;
        let position = positions("fixed", given.fixed, n)?;
        given.stiffness.check_symmetry()?;

        let (free, global) = sparse::free_part(&given.stiffness, &position);
        let coupling = sparse::columns(&given.stiffness, given.fixed, &position);
        let component = free.view()?.components();
        let contact_fixed = given.contact.select(|j| position[j]);
        let mut stats = Stats::default();

        let mut started = Instant::now();
        let parts = sparse::split(free, &component);
        let mut bodies = Vec::with_capacity(parts.len());
        let local = sparse::local_numbers(&component, parts.len());
        let mut rows_of: Vec<Vec<Row>> = vec![Vec::new(); parts.len()];
        let place = free_places(&position, &component, &local);
        for row in 0..rows {
            for (body, entries) in given.contact.by_body(row, &place) {
                rows_of[body].push(Row { row, entries });
            }
        }
        for ((dofs, stiffness), rows) in parts.into_iter().zip(rows_of) {
            let dofs: Vec<usize> = dofs.into_iter().map(|i| global[i]).collect();
            bodies.push(Body::new(dofs, stiffness, rows, D, stop)?);
        }
        for body in &bodies {
            body.add_to(&mut stats);
        }
        stats.seconds_factor =
            started.elapsed().as_secs_f64() - stats.seconds_symbolic - stats.seconds_order;

        started = Instant::now();
        let compliance = assemble::<D>(given.gap.len(), &mut bodies)?;
        stats.seconds_compliance = started.elapsed().as_secs_f64();
        stats.bodies = bodies.len();
        stats.islands = compliance.islands().len();
        let most = |of: fn(&Body) -> f64| bodies.iter().map(of).fold(0.0, f64::max);
        stats.cond_s = most(Body::condition);
        stats.amplification = most(Body::amplification);

        let touched = |row: usize| place_of_row(given.contact, row, &position);
        let motions = bodies
            .iter()
            .enumerate()
            .flat_map(|(b, body)| (0..body.motions()).map(move |k| (b, k)))
            .collect();
        let made = Self {
            n,
            fixed: given.fixed.to_vec(),
            bodies,
            coupling,
            contact_fixed,
            gap: given.gap.to_vec(),
            mu: given.mu.to_vec(),
            unmoved: (0..given.gap.len()).filter(|&i| !touched(D * i)).collect(),
            compliance,
            motions,
            stats,
        };
        made.check_pinned()?;
        Ok(made)
    }

    /// Friction coefficients, and rigid motions that no contact feels: found
    /// here, before any load.
    fn check_pinned(&self) -> Result<(), Error> {
        let rigid = Rigid {
            modes: self.modes(),
            load: vec![0.0; self.motions.len()],
        };
        let q = vec![[0.0; D]; self.gap.len()];
        match Reduced::new(&self.compliance, &q, &self.mu, &rigid) {
            Err(Error::DependentMotion { mode }) => Err(Error::FloatingBody {
                dof: self.bodies[self.motions[mode].0].most_moved(self.motions[mode].1),
            }),
            other => other.map(|_| ()),
        }
    }

    #[must_use]
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    #[must_use]
    pub fn order(&self) -> usize {
        self.n
    }

    #[must_use]
    pub fn contacts(&self) -> usize {
        self.gap.len()
    }

    /// Length of a vector of contact components, `D n_c`.
    #[must_use]
    pub fn contact_components(&self) -> usize {
        D * self.gap.len()
    }

    #[must_use]
    pub fn fixed(&self) -> &[usize] {
        &self.fixed
    }

    #[must_use]
    pub fn mu(&self) -> &[f64] {
        &self.mu
    }

    #[must_use]
    pub fn compliance(&self) -> &Compliance<'static, D> {
        &self.compliance
    }

    /// The degree of freedom that each rigid motion moves most.
    #[must_use]
    pub fn rigid_dofs(&self) -> Vec<usize> {
        self.motions
            .iter()
            .map(|&(b, k)| self.bodies[b].most_moved(k))
            .collect()
    }

    /// The body that each rigid motion moves.
    #[must_use]
    pub fn rigid_bodies(&self) -> Vec<usize> {
        self.motions.iter().map(|&(body, _)| body).collect()
    }

    /// Columns of the border, `B_c R`, over all contacts.
    #[must_use]
    pub fn modes(&self) -> Vec<Vec<[f64; D]>> {
        let of_motion = |&(b, k): &(usize, usize)| {
            let mut mode = vec![[0.0; D]; self.gap.len()];
            self.bodies[b].add_motion(k, 1.0, mode.as_flattened_mut());
            mode
        };
        self.motions.iter().map(of_motion).collect()
    }

    /// `q` and `e` of a load `f` and prescribed displacements, (4).
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`].
    pub fn free_part(&self, load: &[f64], prescribed: &[f64]) -> Result<FreePart<D>, Error> {
        let force = self.forces(load, prescribed)?;
        let mut q = self.gap.clone();
        let mut size = q.clone();
        for value in size.as_flattened_mut() {
            *value = value.abs();
        }
        self.contact_fixed
            .add_product(prescribed, q.as_flattened_mut());
        self.contact_fixed
            .add_absolute_product(prescribed, size.as_flattened_mut());
        for &i in &self.unmoved {
            // A wall moved exactly onto the surface of a held node touches it: what
            // the sum leaves of zero is rounding, not penetration.
            if q[i][0].abs() <= 4.0 * f64::EPSILON * size[i][0] {
                q[i][0] = 0.0;
            }
        }
        let mut load = Vec::with_capacity(self.motions.len());
        for body in &self.bodies {
            let condensed = body.condense(&force);
            body.add_free_displacement(&condensed, q.as_flattened_mut());
            load.extend(body.rigid_load(&condensed));
        }
        let rigid = Rigid {
            modes: self.modes(),
            load,
        };
        Ok(FreePart { q, rigid })
    }

    /// The displacement `u` of all degrees of freedom under the loads and the
    /// reactions, (23); `rigid` holds the amounts `a` of the rigid motions.
    ///
    /// One step of refinement against `K` itself takes out what the
    /// factorisation's rounding leaves.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`].
    pub fn displacement(
        &self,
        load: &[f64],
        prescribed: &[f64],
        reaction: &[[f64; D]],
        rigid: &[f64],
    ) -> Result<Vec<f64>, Error> {
        check_length("reaction", reaction.len(), self.gap.len())?;
        check_length("rigid motion", rigid.len(), self.motions.len())?;
        let force = self.forces(load, prescribed)?;
        let mut u = vec![0.0; self.n];
        for (&dof, &value) in self.fixed.iter().zip(prescribed) {
            u[dof] = value;
        }
        let mut amounts = rigid;
        for body in &self.bodies {
            let (own, rest) = amounts.split_at(body.motions());
            amounts = rest;
            body.displacement(&force, reaction.as_flattened(), own, &mut u);
        }
        Ok(u)
    }

    /// `B u + gap` of a displacement, in twice the precision and rounded once.
    #[must_use]
    pub fn relative_displacement(&self, u: &[f64]) -> Vec<[f64; D]> {
        let mut sums: Vec<Sum> = self
            .gap
            .as_flattened()
            .iter()
            .map(|&g| Sum::new(g))
            .collect();
        let prescribed: Vec<f64> = self.fixed.iter().map(|&dof| u[dof]).collect();
        self.contact_fixed.add_to_sums(&prescribed, &mut sums);
        for body in &self.bodies {
            body.add_to_sums(u, &mut sums);
        }
        let values: Vec<f64> = sums.iter().map(Sum::value).collect();
        values.as_chunks::<D>().0.to_vec()
    }

    /// What rounding may have made of the `e` of these loads, above which a proof
    /// that nothing balances them must stand. Costs a solve each rigid motion.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`].
    pub fn load_rounding(&self, load: &[f64], prescribed: &[f64]) -> Result<Vec<f64>, Error> {
        let force = self.forces(load, prescribed)?;
        let of_body = |body: &Body| body.load_rounding(&force);
        Ok(self.bodies.iter().flat_map(of_body).collect())
    }

    /// `f − K_fp u_p` at the free degrees of freedom.
    fn forces(&self, load: &[f64], prescribed: &[f64]) -> Result<Vec<f64>, Error> {
        check_length("load", load.len(), self.n)?;
        check_finite("load", load)?;
        check_length("prescribed", prescribed.len(), self.fixed.len())?;
        check_finite("prescribed", prescribed)?;
        let mut force = load.to_vec();
        let minus: Vec<f64> = prescribed.iter().map(|u| -u).collect();
        self.coupling.add_transposed_product(&minus, &mut force);
        Ok(force)
    }
}

/// Position in `list` of each index below `n`.
fn positions(what: &'static str, list: &[usize], n: usize) -> Result<Vec<Option<usize>>, Error> {
    let mut position = vec![None; n];
    for (k, &index) in list.iter().enumerate() {
        let Some(slot) = position.get_mut(index) else {
            return Err(Error::IndexRange {
                what,
                position: k,
                found: index,
                limit: n,
            });
        };
        if let Some(first) = slot.replace(k) {
            return Err(Error::Repeated {
                what,
                index,
                first,
                second: k,
            });
        }
    }
    Ok(position)
}

/// Body and local number of every free degree of freedom.
fn free_places(
    position: &[Option<usize>],
    component: &[usize],
    local: &[usize],
) -> Vec<Option<(usize, usize)>> {
    let mut next = 0;
    let place = |fixed: &Option<usize>| {
        if fixed.is_some() {
            return None;
        }
        next += 1;
        Some((component[next - 1], local[next - 1]))
    };
    position.iter().map(place).collect()
}

/// Whether a row of `B` has an entry at a free degree of freedom.
fn place_of_row(contact: Rows, row: usize, position: &[Option<usize>]) -> bool {
    contact
        .row(row)
        .any(|(j, value)| value != 0.0 && position[j].is_none())
}

/// `W = Σ B_c (S + α R Rᵀ)⁻¹ B_cᵀ`, island by island: sparse where many bodies
/// have a few contacts each.
fn assemble<const D: usize>(
    contacts: usize,
    bodies: &mut [Body],
) -> Result<Compliance<'static, D>, Error> {
    let islands = islands::<D>(contacts, bodies);
    // Pairs of contacts that share a body; a pair that shares two is counted twice.
    let pairs = |members: &[usize]| -> usize {
        let of_body = members
            .iter()
            .map(|&b| touched::<D>(&bodies[b]).len().pow(2));
        of_body.sum()
    };
    let counted = islands
        .iter()
        .map(|(nodes, members)| (pairs(members), nodes.len()));
    let stored = counted.map(|(pairs, n)| if is_sparse(pairs, n) { pairs } else { n * n });
    let stored: Vec<usize> = stored.collect();
    let blocks: u128 = stored.iter().map(|&blocks| blocks as u128).sum();
    memory::check("the compliance W", 8 * (D * D) as u128 * blocks)?;
    let mut parts = Vec::with_capacity(islands.len());
    let mut place = vec![0; contacts];
    for ((nodes, members), stored) in islands.into_iter().zip(stored) {
        let n = nodes.len();
        let part = if let [body] = members[..] {
            Part::Dense(Cow::Owned(of_body::<D>(
                &mut bodies[body],
                &nodes,
                &mut place,
            )))
        } else {
            let mut shares = Vec::with_capacity(members.len());
            for &b in &members {
                let own = touched::<D>(&bodies[b]);
                let matrix = of_body::<D>(&mut bodies[b], &own, &mut place);
                shares.push((own, matrix));
            }
            for (k, &node) in nodes.iter().enumerate() {
                place[node] = k;
            }
            for node in shares.iter_mut().flat_map(|(own, _)| own) {
                *node = place[*node];
            }
            if stored < n * n {
                Part::Sparse(Cow::Owned(sparse_sum(n, &shares)))
            } else {
                Part::Dense(Cow::Owned(dense_sum::<D>(n, &shares)))
            }
        };
        parts.push((nodes, part));
    }
    Compliance::new(parts)
}

/// Contacts that a body has rows of, ascending.
fn touched<const D: usize>(body: &Body) -> Vec<usize> {
    let mut contacts: Vec<usize> = body.rows().iter().map(|row| row.row / D).collect();
    contacts.sort_unstable();
    contacts.dedup();
    contacts
}

/// The whole share of one body in `W`, among the contacts named.
fn of_body<const D: usize>(body: &mut Body, contacts: &[usize], place: &mut [usize]) -> Vec<f64> {
    for (k, &node) in contacts.iter().enumerate() {
        place[node] = k;
    }
    let m = D * contacts.len();
    let mut matrix = vec![0.0; m * m];
    add_body::<D>(body, place, m, &mut matrix);
    mirror(&mut matrix, m);
    matrix
}

/// Contacts and matrix of each body, contacts by their place among `n`.
type Shares = [(Vec<usize>, Vec<f64>)];

fn dense_sum<const D: usize>(n: usize, shares: &Shares) -> Vec<f64> {
    let m = D * n;
    let mut sum = vec![0.0; m * m];
    for (own, matrix) in shares {
        let order = D * own.len();
        for (i, row) in matrix.chunks_exact(order.max(1)).enumerate() {
            let out = &mut sum[(D * own[i / D] + i % D) * m..][..m];
            for (values, &node) in row.as_chunks::<D>().0.iter().zip(own) {
                for (value, w) in out[D * node..][..D].iter_mut().zip(values) {
                    *value += w;
                }
            }
        }
    }
    sum
}

fn sparse_sum<const D: usize>(n: usize, shares: &Shares) -> Blocks<D> {
    // The bodies of each contact, with its place in each.
    let mut of_contact: Vec<Vec<(usize, usize)>> = vec![Vec::new(); n];
    for (b, (own, _)) in shares.iter().enumerate() {
        for (k, &node) in own.iter().enumerate() {
            of_contact[node].push((b, k));
        }
    }
    Blocks::from_rows(n, |i, add| {
        for &(b, k) in &of_contact[i] {
            let (own, matrix) = &shares[b];
            let m = D * own.len();
            for (l, &node) in own.iter().enumerate() {
                add(
                    node,
                    Block::from_fn(|x, y| matrix[(D * k + x) * m + D * l + y]),
                );
            }
        }
    })
}

/// Adds `B_c (S + α R Rᵀ)⁻¹ B_cᵀ` of one body to the upper triangle of an island.
fn add_body<const D: usize>(body: &mut Body, place: &[usize], m: usize, matrix: &mut [f64]) {
    let (inverse, unit) = body.take_inverse();
    let order = body.kept();
    let at = |row: usize| D * place[row / D] + row % D;
    let rows = body.rows();
    let mut of_row: Vec<Option<&Row>> = vec![None; m];
    for row in rows {
        of_row[at(row.row)] = Some(row);
    }
    matrix
        .par_chunks_exact_mut(m.max(1))
        .enumerate()
        .with_min_len(8)
        .for_each_init(
            || vec![0.0; order],
            |combined, (i, out)| {
                let Some(row) = of_row[i] else { return };
                combined.fill(0.0);
                for &(a, b) in &row.entries {
                    let column = &inverse[a * order..(a + 1) * order];
                    for (value, s) in combined.iter_mut().zip(column) {
                        *value += b * s;
                    }
                }
                for (j, other) in of_row.iter().enumerate().skip(i) {
                    let Some(other) = other else { continue };
                    let own: f64 = other.entries.iter().map(|&(a, b)| b * combined[a]).sum();
                    out[j] += unit * own;
                }
            },
        );
}

/// Copies the upper triangle of a row-major matrix below the diagonal.
fn mirror(matrix: &mut [f64], m: usize) {
    const TILE: usize = 32;
    for tile_i in (0..m).step_by(TILE) {
        for tile_j in (0..=tile_i).step_by(TILE) {
            for i in tile_i..(tile_i + TILE).min(m) {
                for j in tile_j..(tile_j + TILE).min(i) {
                    matrix[i * m + j] = matrix[j * m + i];
                }
            }
        }
    }
}

/// Contacts that share a body, with the bodies they touch, both ascending.
fn islands<const D: usize>(contacts: usize, bodies: &[Body]) -> Vec<(Vec<usize>, Vec<usize>)> {
    // The smallest member leads, so that an island is named by its first contact.
    let mut sets = Union::new(contacts + bodies.len());
    for (b, body) in bodies.iter().enumerate() {
        for row in body.rows() {
            sets.join(row.row / D, contacts + b);
        }
    }
    let mut number = vec![usize::MAX; contacts + bodies.len()];
    let mut islands: Vec<(Vec<usize>, Vec<usize>)> = Vec::new();
    for i in 0..contacts + bodies.len() {
        let root = sets.leader(i);
        if root >= contacts {
            continue; // a body without contacts
        }
        if number[root] == usize::MAX {
            number[root] = islands.len();
            islands.push((Vec::new(), Vec::new()));
        }
        let island = &mut islands[number[root]];
        if i < contacts {
            island.0.push(i);
        } else {
            island.1.push(i - contacts);
        }
    }
    islands
}
