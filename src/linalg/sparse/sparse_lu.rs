//! LU of a sparse matrix of blocks with a symmetric pattern, front by front.
//!
//! The tree of fronts is that of the pattern, ordered once for all its matrices. Rows are
//! exchanged within the pivots of a front only: the fill is as counted, and a matrix that needs
//! other exchanges counts as singular.

use std::borrow::Borrow;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::{Error, check_running};
use crate::linalg::dense;
use crate::linalg::lu;
use crate::linalg::small::add_scaled;
use crate::linalg::sparse::blocks::Blocks;
use crate::linalg::sparse::csc::Symmetric;
use crate::linalg::sparse::symbolic::{Counts, Front, Options, Symbolic};
use crate::tasks;

/// Columns in one task.
const TILE: usize = 64;

/// The order of elimination of a pattern, and its fronts.
#[derive(Debug)]
pub struct Analysis {
    symbolic: Symbolic,
    order: usize,
}

impl Analysis {
    pub fn new<const D: usize>(blocks: &Blocks<D>) -> Result<Self, Error> {
        let order = D * blocks.rows();
        let mut start = vec![0];
        let mut rows = Vec::with_capacity(D * D * blocks.stored());
        for unknown in 0..order {
            let columns = blocks.in_row(unknown / D);
            rows.extend(columns.flat_map(|(j, _)| D * j..D * (j + 1)));
            start.push(rows.len());
        }
        let values = vec![1.0; rows.len()];
        let pattern = Symmetric::new(order, &start, &rows, &values)?;
        Ok(Self {
            symbolic: Symbolic::analyse(&pattern, &[], &Options::default())?,
            order,
        })
    }

    /// The cost of a symmetric factorisation; an LU costs twice as much.
    pub fn counts(&self) -> &Counts {
        self.symbolic.counts()
    }
}

/// An eliminated front, by columns.
#[derive(Debug)]
struct EliminatedFront {
    /// `L₁₁` below the diagonal, without its unit diagonal, and `U₁₁`.
    pivots: Vec<f64>,
    /// The row of the front at each place.
    rows: Vec<usize>,
    /// `U₁₂ = L₁₁⁻¹ P F₁₂`.
    upper: Vec<f64>,
    /// `L₂₁ᵀ = U₁₁⁻ᵀ F₂₁ᵀ`.
    lower: Vec<f64>,
}

/// The factors of a matrix.
#[derive(Debug)]
pub struct SparseLu<A> {
    analysis: A,
    fronts: Vec<EliminatedFront>,
    /// Whether the determinant is negative.
    negative: bool,
}

impl<A: Borrow<Analysis>> SparseLu<A> {
    /// Factors a matrix of the analysed pattern; `None` if a pivot is below the rounding of the
    /// largest entry.
    pub fn new<const D: usize>(
        analysis: A,
        matrix: &Blocks<D>,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, Error> {
        let Analysis { symbolic, order } = analysis.borrow();
        assert_eq!(*order, D * matrix.rows());
        let largest = matrix.largest();
        // Place of each unknown in the current front.
        let mut place = vec![0; *order];
        let mut updates: Vec<Vec<f64>> = vec![Vec::new(); symbolic.fronts.len()];
        let mut children: Vec<Vec<usize>> = vec![Vec::new(); symbolic.fronts.len()];
        let mut fronts = Vec::with_capacity(symbolic.fronts.len());
        let mut negative = false;
        for (f, front) in symbolic.fronts.iter().enumerate() {
            check_running(stop)?;
            for (at, unknown) in unknowns(symbolic, front).enumerate() {
                place[unknown] = at;
            }
            let (np, nu) = (front.np, front.nu);
            let mut own = EliminatedFront {
                pivots: vec![0.0; np * np],
                rows: Vec::new(),
                upper: vec![0.0; np * nu],
                lower: vec![0.0; np * nu],
            };
            let mut update = vec![0.0; nu * nu];
            own.gather(symbolic, front, matrix, &place);
            for child in std::mem::take(&mut children[f]) {
                let of_child = &symbolic.fronts[child];
                let places: Vec<usize> = unknowns(symbolic, of_child)
                    .skip(of_child.np)
                    .map(|unknown| place[unknown])
                    .collect();
                own.add(
                    &mut update,
                    np,
                    &places,
                    &std::mem::take(&mut updates[child]),
                );
            }
            // A pivot is a sum of up to as many terms as its front has rows.
            #[expect(clippy::cast_precision_loss, reason = "an order")]
            let rounding = (np + nu) as f64 * f64::EPSILON * largest;
            let Some((rows, odd)) = lu::factor(&mut own.pivots, np, rounding, stop)? else {
                return Ok(None);
            };
            let below_zero = (0..np).filter(|k| own.pivots[k * (np + 1)] < 0.0);
            negative ^= odd ^ (below_zero.count() % 2 == 1);
            own.rows = rows;
            own.eliminate(np, &mut update, stop)?;
            if let Some(parent) = front.parent {
                children[parent].push(f);
                updates[f] = update;
            }
            fronts.push(own);
        }
        Ok(Some(Self {
            analysis,
            fronts,
            negative,
        }))
    }

    pub fn order(&self) -> usize {
        self.analysis.borrow().order
    }

    /// The sign of the determinant, 1 or −1.
    pub fn sign(&self) -> f64 {
        if self.negative { -1.0 } else { 1.0 }
    }

    /// `b ← A⁻¹ b`.
    pub fn solve(&self, b: &mut [f64]) {
        self.substitute(
            b,
            (|own| &own.lower, |own| &own.upper),
            |own, first| {
                lu::reorder(first, &own.rows);
                dense::lu_upper(&own.pivots, first.len(), first);
            },
            |own, first| dense::lu_solve_upper(&own.pivots, first.len(), first),
        );
    }

    /// `b ← A⁻ᵀ b`.
    pub fn solve_transposed(&self, b: &mut [f64]) {
        self.substitute(
            b,
            (|own| &own.upper, |own| &own.lower),
            |own, first| dense::lu_lower(&own.pivots, first.len(), first),
            |own, first| {
                dense::lu_solve_lower_transposed(&own.pivots, first.len(), first);
                let ordered = first.to_vec();
                for (&row, value) in own.rows.iter().zip(ordered) {
                    first[row] = value;
                }
            },
        );
    }

    /// Both substitutions: `forward` and `back` are those within the pivots of a front, `beyond`
    /// them are the two parts of its factors that they use.
    fn substitute(
        &self,
        b: &mut [f64],
        (ahead, behind): (Beyond, Beyond),
        forward: impl Fn(&EliminatedFront, &mut [f64]),
        back: impl Fn(&EliminatedFront, &mut [f64]),
    ) {
        let Analysis { symbolic, order } = self.analysis.borrow();
        assert_eq!(b.len(), *order);
        let list = || symbolic.fronts.iter().zip(&self.fronts);
        let mut x: Vec<f64> = symbolic.old.iter().map(|&i| b[i as usize]).collect();
        for (front, own) in list() {
            let np = front.np;
            let first = &mut x[front.first..front.first + np];
            forward(own, first);
            let first = first.to_vec();
            for (row, factors) in beyond(symbolic, front).zip(ahead(own).chunks_exact(np)) {
                x[row] -= dot(factors, &first);
            }
        }
        for (front, own) in list().rev() {
            let np = front.np;
            let mut first = x[front.first..front.first + np].to_vec();
            for (row, factors) in beyond(symbolic, front).zip(behind(own).chunks_exact(np)) {
                add_scaled(&mut first, -x[row], factors);
            }
            back(own, &mut first);
            x[front.first..front.first + np].copy_from_slice(&first);
        }
        for (&i, value) in symbolic.old.iter().zip(x) {
            b[i as usize] = value;
        }
    }
}

/// The factors of a front beyond its pivots, below or to the right of them.
type Beyond = fn(&EliminatedFront) -> &[f64];

impl EliminatedFront {
    /// Gathers the entries of the rows and columns of the pivots.
    fn gather<const D: usize>(
        &mut self,
        symbolic: &Symbolic,
        front: &Front,
        matrix: &Blocks<D>,
        place: &[usize],
    ) {
        let np = front.np;
        for at in 0..np {
            let unknown = symbolic.old[front.first + at] as usize;
            let (node, k) = (unknown / D, unknown % D);
            for (other, block) in matrix.in_row(node) {
                for l in 0..D {
                    let column = D * other + l;
                    if (symbolic.new[column] as usize) < front.first {
                        continue;
                    }
                    match place[column].checked_sub(np) {
                        None => self.pivots[place[column] * np + at] = block[(k, l)],
                        Some(column) => self.upper[column * np + at] = block[(k, l)],
                    }
                }
            }
            for (other, block) in matrix.in_column(node) {
                for l in 0..D {
                    let row = D * other + l;
                    if symbolic.new[row] as usize >= front.first + np {
                        self.lower[(place[row] - np) * np + at] = block[(l, k)];
                    }
                }
            }
        }
    }

    /// The update of the rest by the factored pivots, in tiles cut at fixed places.
    fn eliminate(&mut self, np: usize, update: &mut [f64], stop: &AtomicBool) -> Result<(), Error> {
        let Self {
            pivots,
            rows,
            upper,
            lower,
        } = self;
        let nu = upper.len() / np.max(1);
        let tile = np * TILE;
        tasks::for_each(upper.chunks_mut(tile), |_, columns| {
            for column in columns.chunks_exact_mut(np) {
                lu::reorder(column, rows);
            }
            dense::lu_upper(pivots, np, columns);
        });
        tasks::for_each(lower.chunks_mut(tile), |_, columns| {
            dense::lu_lower(pivots, np, columns);
        });
        let tiles = update.chunks_mut(nu.max(1) * TILE);
        let lower: &[f64] = lower;
        tasks::for_each(tiles.zip(upper.chunks(tile)), |_, (rest, upper)| {
            if !stop.load(Ordering::Relaxed) {
                dense::lu_rest(lower, upper, np, rest);
            }
        });
        check_running(stop)
    }

    /// Adds the update of a child, whose rows have these places.
    fn add(&mut self, update: &mut [f64], np: usize, places: &[usize], values: &[f64]) {
        let nu = self.upper.len() / np.max(1);
        for (&column, values) in places.iter().zip(values.chunks_exact(places.len().max(1))) {
            for (&row, &value) in places.iter().zip(values) {
                let at = match (row.checked_sub(np), column.checked_sub(np)) {
                    (None, None) => &mut self.pivots[column * np + row],
                    (None, Some(column)) => &mut self.upper[column * np + row],
                    (Some(row), None) => &mut self.lower[row * np + column],
                    (Some(row), Some(column)) => &mut update[column * nu + row],
                };
                *at += value;
            }
        }
    }
}

/// Places in the elimination order of the updated rows of a front.
fn beyond<'s>(symbolic: &'s Symbolic, front: &'s Front) -> impl Iterator<Item = usize> + 's {
    let runs = symbolic.runs_of(front).iter();
    runs.flat_map(|run| run.start as usize..(run.start + run.len) as usize)
}

/// The unknowns of a front in the numbering of the caller: its pivots, then its updated rows.
fn unknowns<'s>(symbolic: &'s Symbolic, front: &'s Front) -> impl Iterator<Item = usize> + 's {
    let pivots = front.first..front.first + front.np;
    let all = pivots.chain(beyond(symbolic, front));
    all.map(|place| symbolic.old[place] as usize)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}
