//! Condensing loads, and recovering unknowns, with a factor at hand.

use crate::linalg::dense::{backward, forward};
use crate::linalg::multifrontal::Factor;
use crate::linalg::symbolic::{Front, Symbolic};

impl Factor {
    /// Condenses `columns` loads of length `n`, one after another in `f`: the
    /// eliminated entries become `L⁻¹ f_i`, the kept ones
    /// `f_c − K_ci K_ii⁻¹ f_i`.
    ///
    /// # Panics
    /// If `f` has not `n · columns` entries.
    pub fn condense(&self, f: &mut [f64], columns: usize) {
        self.sweep(f, columns, |symbolic, x| {
            let mut local = Vec::new();
            for front in &symbolic.fronts {
                gather(symbolic, front, x, columns, &mut local);
                forward(self.panel(front), front.layout(), &mut local, columns);
                scatter(symbolic, front, x, columns, &local, front.nf());
            }
        });
    }

    /// The way back of [`Factor::condense`]: with the eliminated entries as it
    /// left them and the kept ones replaced by the unknowns `u_c`, every entry
    /// becomes the unknown, `u_i = K_ii⁻¹ (f_i − K_ic u_c)`.
    ///
    /// # Panics
    /// If `x` has not `n · columns` entries.
    pub fn recover(&self, x: &mut [f64], columns: usize) {
        self.sweep(x, columns, |symbolic, x| {
            let mut local = Vec::new();
            for front in symbolic.fronts.iter().rev() {
                gather(symbolic, front, x, columns, &mut local);
                backward(self.panel(front), front.layout(), &mut local, columns);
                scatter(symbolic, front, x, columns, &local, front.np);
            }
        });
    }

    /// Works on `x` in elimination numbering.
    fn sweep(&self, x: &mut [f64], columns: usize, work: impl FnOnce(&Symbolic, &mut [f64])) {
        let symbolic = &*self.symbolic;
        let n = symbolic.n;
        assert_eq!(x.len(), n * columns);
        if n == 0 {
            return;
        }
        let mut inner = Vec::with_capacity(x.len());
        for column in x.chunks_exact(n) {
            inner.extend(symbolic.old.iter().map(|&dof| column[dof as usize]));
        }
        work(symbolic, &mut inner);
        for (column, inner) in x.chunks_exact_mut(n).zip(inner.chunks_exact(n)) {
            for (&dof, value) in symbolic.old.iter().zip(inner) {
                column[dof as usize] = *value;
            }
        }
    }

    pub(crate) fn panel(&self, front: &Front) -> &[f64] {
        &self.panels[front.panel..front.panel + front.layout().len()]
    }
}

/// Rows of a front, as stretches of the elimination numbering.
fn stretches<'s>(
    symbolic: &'s Symbolic,
    front: &Front,
) -> impl Iterator<Item = std::ops::Range<usize>> + 's {
    let pivots = front.first..front.first + front.np;
    let runs = symbolic.runs_of(front).iter();
    std::iter::once(pivots)
        .chain(runs.map(|run| run.start as usize..(run.start + run.len) as usize))
}

pub(crate) fn gather(
    symbolic: &Symbolic,
    front: &Front,
    x: &[f64],
    columns: usize,
    local: &mut Vec<f64>,
) {
    local.clear();
    for column in x.chunks_exact(symbolic.n).take(columns) {
        for rows in stretches(symbolic, front) {
            local.extend_from_slice(&column[rows]);
        }
    }
}

/// Puts the first `rows` rows of a front back.
pub(crate) fn scatter(
    symbolic: &Symbolic,
    front: &Front,
    x: &mut [f64],
    columns: usize,
    local: &[f64],
    rows: usize,
) {
    let locals = local.chunks_exact(front.nf());
    for (column, local) in x.chunks_exact_mut(symbolic.n).zip(locals).take(columns) {
        let mut from = 0;
        for stretch in stretches(symbolic, front) {
            if from >= rows {
                break;
            }
            let len = stretch.len();
            column[stretch].copy_from_slice(&local[from..from + len]);
            from += len;
        }
    }
}
