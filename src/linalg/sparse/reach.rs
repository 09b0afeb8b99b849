//! Half solves `L⁻¹ b` of vectors with few entries: they use only the fronts between these
//! entries and the root.

use crate::linalg::dense::forward;
use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::symbolic::{Front, Symbolic};
use crate::tasks;

/// Columns in one task. Fewer columns are filled up with zeros: products of another width may
/// sum in another order, and a column would depend on the others.
const COLUMNS: usize = 32;

/// The fronts that entries at some unknowns reach, in the order of elimination.
#[derive(Debug)]
pub struct Reach {
    fronts: Vec<usize>,
    /// Their pivots in the numbering of the caller.
    pivots: Vec<u32>,
}

impl Reach {
    /// Made from the unknowns with entries; kept ones are ignored.
    pub fn new(symbolic: &Symbolic, unknowns: impl Iterator<Item = usize>) -> Self {
        let mut reached = vec![false; symbolic.fronts.len()];
        for unknown in unknowns {
            let place = symbolic.new[unknown] as usize;
            if place >= symbolic.interior {
                continue;
            }
            let after = |f: &Front| f.first <= place;
            let mut at = Some(symbolic.fronts.partition_point(after) - 1);
            while let Some(front) = at {
                if std::mem::replace(&mut reached[front], true) {
                    break;
                }
                at = symbolic.fronts[front].parent;
            }
        }
        let fronts: Vec<usize> = (0..reached.len()).filter(|&f| reached[f]).collect();
        let pivots = fronts.iter().flat_map(|&f| {
            let front = &symbolic.fronts[f];
            symbolic.old[front.first..front.first + front.np].iter()
        });
        Self {
            pivots: pivots.copied().collect(),
            fronts,
        }
    }

    /// Pivots reached, in the numbering of the caller, in the order of half solves.
    pub fn pivots(&self) -> &[u32] {
        &self.pivots
    }
}

impl Factor {
    /// Condenses columns given by entries (unknown, value) within the reach: `L⁻¹ b_i` on the
    /// pivots reached, and `b_c − K_ci K_ii⁻¹ b_i` on the kept unknowns, column by column. A
    /// column has the same bits alone and among others.
    pub fn half_solve(&self, reach: &Reach, columns: &[&[(usize, f64)]]) -> (Vec<f64>, Vec<f64>) {
        let symbolic = &*self.symbolic;
        let (p, m) = (reach.pivots.len(), symbolic.kept());
        let of_chunk = |_: usize, columns: &[&[(usize, f64)]]| {
            let n = symbolic.n;
            let mut x = vec![0.0; n * columns.len()];
            for (column, x) in columns.iter().zip(x.chunks_exact_mut(n.max(1))) {
                for &(unknown, value) in *column {
                    x[symbolic.new[unknown] as usize] += value;
                }
            }
            let mut local = Vec::new();
            for &f in &reach.fronts {
                let front = &symbolic.fronts[f];
                gather(symbolic, front, &x, columns.len(), &mut local);
                local.resize(front.nf() * COLUMNS, 0.0);
                forward(self.panel(front), front.layout(), &mut local, COLUMNS);
                scatter(symbolic, front, &mut x, columns.len(), &local);
            }
            let mut inside = Vec::with_capacity(p * columns.len());
            let mut kept = Vec::with_capacity(m * columns.len());
            for x in x.chunks_exact(n.max(1)) {
                let pivots = reach.pivots.iter();
                inside.extend(pivots.map(|&pivot| x[symbolic.new[pivot as usize] as usize]));
                kept.extend_from_slice(&x[symbolic.interior..]);
            }
            (inside, kept)
        };
        let chunks = tasks::map(columns.chunks(COLUMNS), of_chunk);
        let mut inside = Vec::with_capacity(p * columns.len());
        let mut kept = Vec::with_capacity(m * columns.len());
        for chunk in chunks {
            inside.extend(chunk.0);
            kept.extend(chunk.1);
        }
        (inside, kept)
    }
}

/// Ranges of the rows of a front in the elimination numbering.
fn stretches<'s>(
    symbolic: &'s Symbolic,
    front: &Front,
) -> impl Iterator<Item = std::ops::Range<usize>> + 's {
    let pivots = front.first..front.first + front.np;
    let runs = symbolic.runs_of(front).iter();
    std::iter::once(pivots)
        .chain(runs.map(|run| run.start as usize..(run.start + run.len) as usize))
}

fn gather(symbolic: &Symbolic, front: &Front, x: &[f64], columns: usize, local: &mut Vec<f64>) {
    local.clear();
    for column in x.chunks_exact(symbolic.n).take(columns) {
        for rows in stretches(symbolic, front) {
            local.extend_from_slice(&column[rows]);
        }
    }
}

/// Writes the rows of a front back.
fn scatter(symbolic: &Symbolic, front: &Front, x: &mut [f64], columns: usize, local: &[f64]) {
    let locals = local.chunks_exact(front.nf());
    for (column, local) in x.chunks_exact_mut(symbolic.n).zip(locals).take(columns) {
        let mut from = 0;
        for stretch in stretches(symbolic, front) {
            let len = stretch.len();
            column[stretch].copy_from_slice(&local[from..from + len]);
            from += len;
        }
    }
}
