//! The compliance `W` of contacts on condensed bodies, (3), for each island.

use std::borrow::Cow;

use rayon::prelude::*;

use crate::condensation::body::Body;
use crate::condensation::surface::{Share, Surface};
use crate::error::Error;
use crate::linalg::dense::{self, Op};
use crate::linalg::small::{Block, add_scaled};
use crate::linalg::sparse::blocks::Blocks;
use crate::linalg::union::Union;
use crate::reduced::compliance::{Compliance, Part, is_sparse};
use crate::reduced::memory::Budget;

/// The origin of the bodies: new ones give their inverses away, others have none.
#[derive(Debug)]
pub enum Source<'b> {
    Fresh(&'b mut [Body]),
    Shared(&'b [Body]),
}

/// `W = Σ B_c (S + α R Rᵀ)⁻¹ B_cᵀ` for each island; sparse if many bodies have a few contacts
/// each.
pub fn assemble<const D: usize>(
    bodies: &mut Source<'_>,
    surface: &Surface<D>,
    budget: &Budget,
) -> Result<Compliance<'static, D>, Error> {
    let contacts = surface.contacts();
    let shares = &surface.shares;
    let islands = islands::<D>(contacts, shares);
    let stored = stored_blocks::<D>(&islands, shares);
    let blocks: u128 = stored.iter().map(|&blocks| blocks as u128).sum();
    budget.check("the compliance W", 8 * (D * D) as u128 * blocks, 0)?;
    let mut whole = Vec::with_capacity(islands.len());
    let mut place = vec![0; contacts];
    for ((nodes, members), stored) in islands.into_iter().zip(stored) {
        let n = nodes.len();
        let part = if let [body] = members[..] {
            let share = &shares[body];
            Part::Dense(Cow::Owned(
                bodies.matrix::<D>(body, share, &nodes, &mut place),
            ))
        } else {
            let mut parts = Vec::with_capacity(members.len());
            for &b in &members {
                let own = touched::<D>(&shares[b]);
                let matrix = bodies.matrix::<D>(b, &shares[b], &own, &mut place);
                parts.push((own, matrix));
            }
            for (k, &node) in nodes.iter().enumerate() {
                place[node] = k;
            }
            for node in parts.iter_mut().flat_map(|(own, _)| own) {
                *node = place[*node];
            }
            if stored < n * n {
                Part::Sparse(Cow::Owned(sparse_sum(n, &parts)))
            } else {
                Part::Dense(Cow::Owned(dense_sum::<D>(n, &parts)))
            }
        };
        whole.push((nodes, part));
    }
    Compliance::new(whole)
}

/// Blocks of `W` that each island stores. Pairs of contacts that share two bodies count twice.
fn stored_blocks<const D: usize>(islands: &[Members], shares: &[Share]) -> Vec<usize> {
    let of_island = |(nodes, members): &Members| {
        let squares = members
            .iter()
            .map(|&b| touched::<D>(&shares[b]).len().pow(2));
        let (pairs, n) = (squares.sum(), nodes.len());
        if is_sparse(pairs, n) { pairs } else { n * n }
    };
    islands.iter().map(of_island).collect()
}

/// Bytes of `W` besides the inverses that it is made of, for bodies with these numbers of kept
/// unknowns. The inverse of a single body may itself become `W`.
pub fn bytes_beside<const D: usize>(surface: &Surface<D>, kept: &[usize]) -> u128 {
    let shares = &surface.shares;
    let islands = islands::<D>(surface.contacts(), shares);
    let stored = stored_blocks::<D>(&islands, shares);
    let beside = |((nodes, members), stored): (&Members, usize)| match members[..] {
        [body] if kept[body] == D * nodes.len() => 0,
        _ => 8 * (D * D) as u128 * stored as u128,
    };
    islands.iter().zip(stored).map(beside).sum()
}

/// Contacts that share a body, and the bodies that they touch, both ascending.
type Members = (Vec<usize>, Vec<usize>);

/// Contacts with rows on a body, ascending.
fn touched<const D: usize>(share: &Share) -> Vec<usize> {
    let mut contacts: Vec<usize> = share.rows.iter().map(|row| row.row / D).collect();
    contacts.sort_unstable();
    contacts.dedup();
    contacts
}

impl Source<'_> {
    /// The share of one body in `W`, among the given contacts.
    fn matrix<const D: usize>(
        &mut self,
        body: usize,
        share: &Share,
        contacts: &[usize],
        place: &mut [usize],
    ) -> Vec<f64> {
        for (k, &node) in contacts.iter().enumerate() {
            place[node] = k;
        }
        let m = D * contacts.len();
        let at: Vec<usize> = share
            .rows
            .iter()
            .map(|row| D * place[row.row / D] + row.row % D)
            .collect();
        let mut matrix = match self {
            Self::Fresh(bodies) => by_inverse(&mut bodies[body], share, &at, m),
            Self::Shared(bodies) => by_half_solves(&bodies[body], share, &at, m),
        };
        // The upper triangle by columns is the lower one by rows.
        dense::mirror_lower(&mut matrix, m);
        matrix
    }
}

/// Contacts and matrix of each body; contacts as indices among `n`.
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
    // The bodies of each contact, with its index in each.
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

/// The upper triangle of `B_c (S + α R Rᵀ)⁻¹ B_cᵀ`, with the rows of the share at the places
/// `at` of `m`, from the inverse, which is consumed.
fn by_inverse(body: &mut Body, share: &Share, at: &[usize], m: usize) -> Vec<f64> {
    let (inverse, unit) = body.take_inverse();
    let order = body.kept();
    let entries: Vec<Vec<(usize, f64)>> = share
        .rows
        .iter()
        .map(|row| {
            let kept = |&(i, b)| Some((body.place(i)?, b));
            row.entries.iter().filter_map(kept).collect()
        })
        .collect();
    // If each row is a component of one node, in the order of the kept unknowns, the inverse
    // itself becomes W.
    let alone = |(k, entries): (usize, &Vec<(usize, f64)>)| match entries[..] {
        [(place, b)] => at[k] == k && place == k && b.abs().to_bits() == 1.0_f64.to_bits(),
        _ => false,
    };
    if order == m && entries.len() == m && entries.iter().enumerate().all(alone) {
        let sign: Vec<f64> = entries.iter().map(|row| unit * row[0].1).collect();
        let mut matrix = inverse;
        matrix
            .par_chunks_exact_mut(m.max(1))
            .zip(&sign)
            .for_each(|(row, a)| {
                for (value, b) in row.iter_mut().zip(&entries) {
                    *value *= a * b[0].1;
                }
            });
        return matrix;
    }
    let mut of_row: Vec<Option<&Vec<(usize, f64)>>> = vec![None; m];
    for (&at, entries) in at.iter().zip(&entries) {
        of_row[at] = Some(entries);
    }
    let mut matrix = vec![0.0; m * m];
    matrix
        .par_chunks_exact_mut(m.max(1))
        .enumerate()
        .with_min_len(8)
        .for_each_init(
            || vec![0.0; order],
            |combined, (i, out)| {
                let Some(row) = of_row[i] else { return };
                combined.fill(0.0);
                for &(a, b) in row {
                    let column = &inverse[a * order..(a + 1) * order];
                    add_scaled(combined, b, column);
                }
                for (j, other) in of_row.iter().enumerate().skip(i) {
                    let Some(other) = other else { continue };
                    let own: f64 = other.iter().map(|&(a, b)| b * combined[a]).sum();
                    out[j] += unit * own;
                }
            },
        );
    matrix
}

/// The share of a body in `W` from half solves, also for rows beyond the kept unknowns:
/// `B K⁻¹ Bᵀ = (L⁻¹Bᵀ)ᵀ(L⁻¹Bᵀ)`.
fn by_half_solves(body: &Body, share: &Share, at: &[usize], m: usize) -> Vec<f64> {
    let (rows, kept) = (share.rows.len(), body.kept());
    let mut columns = vec![0.0; kept * rows];
    if let Some(far) = &share.far {
        columns.copy_from_slice(&far.kept);
    } else {
        for (k, row) in share.rows.iter().enumerate() {
            for &(i, b) in &row.entries {
                if let Some(place) = body.place(i) {
                    columns[k * kept + place] += b;
                }
            }
        }
    }
    body.half_solve_contact(&mut columns, rows);
    let mut gram = vec![0.0; rows * rows];
    let mut add = |columns: &[f64], length: usize, beta: f64| {
        let size = (rows, rows, length);
        let (left, right) = (Op::Transposed, Op::Plain);
        dense::matmul(&mut gram, size, 1.0, columns, left, columns, right, beta);
    };
    add(&columns, kept, 0.0);
    if let Some(far) = &share.far {
        add(&far.inside, far.reach.pivots().len(), 1.0);
    }
    let mut matrix = vec![0.0; m * m];
    for (j, &b) in at.iter().enumerate() {
        for (i, &a) in at.iter().enumerate().take(j + 1) {
            matrix[a.min(b) * m + a.max(b)] = body.unit() * gram[j * rows + i];
        }
    }
    matrix
}

/// Contacts that share a body, and the bodies that they touch, both ascending.
fn islands<const D: usize>(contacts: usize, bodies: &[Share]) -> Vec<Members> {
    // The smallest member leads, so that the first contact names an island.
    let mut sets = Union::new(contacts + bodies.len());
    for (b, body) in bodies.iter().enumerate() {
        for row in &body.rows {
            sets.join(row.row / D, contacts + b);
        }
    }
    let mut number = vec![usize::MAX; contacts + bodies.len()];
    let mut islands: Vec<Members> = Vec::new();
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
