//! What the entries of K say of the bodies: where their surfaces are, and how stiff they are.
//!
//! K times a displacement that is linear in the coordinates gives the forces that hold this
//! strain: on the surface for a dilation, and their work is the modulus for a shear. All sums
//! are of differences of coordinates, `Σ_j K_ij (x_j − x_i)`, which cannot cancel where rows add
//! up to zero.

use std::ops::Range;

use crate::linalg::sparse::csc::{Index, narrow};
use crate::linalg::union::Union;
use crate::tasks;

/// The sum of a row is below this part of its entries if no support was written into it.
const FREE: f64 = 1e-2;
/// Forces below this part of their terms are rounding: the node is inside a body.
const WITHIN: f64 = 1e-6;

/// Rows of one task.
const ROWS: usize = 4096;

/// K by rows, of `D` degrees of freedom for each node.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a, I> {
    pub pointer: &'a [I],
    pub index: &'a [I],
    pub values: &'a [f64],
    /// Whether the degrees of freedom are numbered node by node, else component by component.
    pub by_node: bool,
}

impl<'a, I: Index> Rows<'a, I> {
    /// Columns and values of a row.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + use<'a, I> {
        let row = self.pointer[row].at()..self.pointer[row + 1].at();
        let columns = self.index[row.clone()].iter().map(|j| j.at());
        columns.zip(self.values[row].iter().copied())
    }
}

/// The diagonal of K in its rows from `first` on, zero where it has no entry. Columns of a row
/// ascend.
pub fn diagonal<I: Index>(k: &Rows<'_, I>, first: usize) -> Vec<f64> {
    tasks::collect(k.pointer.len().saturating_sub(1), |i| {
        let row = k.pointer[i].at()..k.pointer[i + 1].at();
        let columns = &k.index[row.clone()];
        let place = columns.partition_point(|j| j.at() < first + i);
        let found = columns.get(place).is_some_and(|j| j.at() == first + i);
        if found {
            k.values[row.start + place]
        } else {
            0.0
        }
    })
}

/// The bodies of K: nodes that its entries couple.
#[derive(Clone, Debug, Default)]
pub struct Bodies<const D: usize> {
    /// For each degree of freedom the force of a dilation, which points outwards; zero inside,
    /// and in rows of supports.
    pub outward: Vec<f64>,
    /// The body of each degree of freedom.
    pub body: Vec<i64>,
    /// For each body the work of all shears of size one in free rows.
    pub work: Vec<f64>,
    /// Least and greatest coordinates of each body.
    pub low: Vec<[f64; D]>,
    pub high: Vec<[f64; D]>,
    /// Degrees of freedom of each body, and those whose row has no support.
    pub all: Vec<i64>,
    pub free: Vec<i64>,
}

/// The force of a dilation at a degree of freedom, the work of shears there, and whether its row
/// of `K` has no support.
#[derive(Debug)]
struct Row {
    outward: f64,
    shear: f64,
    free: bool,
}

/// Looks at all rows. `places` are the coordinates of each degree of freedom.
pub fn bodies<I: Index, const D: usize>(k: Rows<'_, I>, places: &[[f64; D]]) -> Bodies<D> {
    let mut inspected = InspectedRows::default();
    inspected.add(k, places);
    inspected.bodies(places, k.by_node)
}

/// What the first rows of K say.
#[derive(Debug, Default)]
pub struct InspectedRows {
    rows: Vec<Row>,
    sets: Union,
}

/// The node and the component of a degree of freedom.
fn split<const D: usize>(n: usize, by_node: bool) -> impl Fn(usize) -> (usize, usize) + Copy {
    let count = n / D;
    move |dof| {
        if by_node {
            (dof / D, dof % D)
        } else {
            (dof % count, dof / count)
        }
    }
}

impl InspectedRows {
    /// Rows that have been looked at.
    pub fn count(&self) -> usize {
        self.rows.len()
    }

    /// Looks at the next rows; `places` are the coordinates of all degrees of freedom.
    pub fn add<I: Index, const D: usize>(&mut self, k: Rows<'_, I>, places: &[[f64; D]]) {
        let (first, own) = (self.rows.len(), k.pointer.len() - 1);
        let (count, split) = (places.len() / D, split::<D>(places.len(), k.by_node));
        let entries = |i: usize| k.row(i);
        let rows: Vec<Vec<Row>> = tasks::map(0..own.div_ceil(ROWS), |_, task| {
            let rows = task * ROWS..own.min((task + 1) * ROWS);
            let rows = rows.map(|i| row(places, first + i, entries(i), |dof| split(dof).1));
            rows.collect()
        });
        self.rows.extend(rows.into_iter().flatten());
        // Each set is led by its smallest member: the parts may be joined in any order.
        let joined = |rows: Range<usize>| {
            let mut sets = Union::new(count);
            for i in rows {
                let own = split(first + i).0;
                let mut last = own;
                for (j, value) in entries(i) {
                    let node = split(j).0;
                    if node != last && node > own && value != 0.0 {
                        sets.join(own, node);
                        last = node;
                    }
                }
            }
            sets
        };
        let parts = rayon::current_num_threads();
        let sets = tasks::map(0..parts, |_, part| {
            joined(own * part / parts..own * (part + 1) / parts)
        });
        let before = (first > 0).then(|| std::mem::take(&mut self.sets));
        let sets = before.into_iter().chain(sets).reduce(Union::with);
        self.sets = sets.unwrap_or_default();
    }

    /// The bodies of K, of which all rows are known.
    pub fn bodies<const D: usize>(self, places: &[[f64; D]], by_node: bool) -> Bodies<D> {
        let (n, split) = (places.len(), split::<D>(places.len(), by_node));
        let number = self.sets.numbers();
        let bodies = number.iter().max().map_or(0, |last| last + 1);
        let mut found = Bodies {
            work: vec![0.0; bodies],
            low: vec![[f64::INFINITY; D]; bodies],
            high: vec![[f64::NEG_INFINITY; D]; bodies],
            all: vec![0; bodies],
            free: vec![0; bodies],
            ..Bodies::default()
        };
        found.outward.reserve_exact(n);
        found.body.reserve_exact(n);
        for (i, row) in self.rows.into_iter().enumerate() {
            let body = number[split(i).0];
            found.outward.push(row.outward);
            found.body.push(i64::from(narrow(body)));
            found.all[body] += 1;
            if row.free {
                found.free[body] += 1;
                found.work[body] -= 0.5 * row.shear;
            }
            for (l, &x) in places[i].iter().enumerate() {
                found.low[body][l] = found.low[body][l].min(x);
                found.high[body][l] = found.high[body][l].max(x);
            }
        }
        found
    }
}

fn row<const D: usize>(
    places: &[[f64; D]],
    i: usize,
    entries: impl Iterator<Item = (usize, f64)>,
    component: impl Fn(usize) -> usize,
) -> Row {
    let (own, here) = (component(i), places[i]);
    let (mut sums, mut size) = ([0.0; D], 0.0);
    let (mut force, mut terms, mut shear) = (0.0, 0.0, 0.0);
    for (j, value) in entries {
        let (a, x) = (component(j), &places[j]);
        sums[a] += value;
        size += value.abs();
        force += value * (x[a] - here[a]);
        terms += value.abs() * x[a].abs();
        if a == own {
            for b in (0..D).filter(|&b| b != a) {
                shear += value * (x[b] - here[b]).powi(2);
            }
        }
    }
    let free = sums.iter().all(|sum| sum.abs() <= FREE * size);
    let inside = !free || force.abs() <= WITHIN * terms;
    Row {
        outward: if inside { 0.0 } else { force },
        shear,
        free,
    }
}
