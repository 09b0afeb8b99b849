//! Condensing loads, and recovering unknowns, with a factor at hand.

use rayon::prelude::*;

use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::symbolic::Front;
use crate::linalg::sparse::task_tree::{downwards, upwards};
use crate::linalg::sparse::tree_solves::{Backward, Columns, Forward};

/// Columns that pass the factor together: enough for the rate of a product,
/// few enough that what waits on the tree is small beside the factor.
const COLUMNS: usize = 32;

impl Factor {
    /// Condenses `columns` loads of length `n`, one after another in `f`: the
    /// eliminated entries become `L⁻¹ f_i`, the kept ones
    /// `f_c − K_ci K_ii⁻¹ f_i`. Works in the rayon pool that is installed; the
    /// bits do not depend on its size.
    ///
    /// # Panics
    /// If `f` has not `n · columns` entries.
    pub fn condense(&self, f: &mut [f64], columns: usize) {
        let symbolic = &*self.symbolic;
        self.blocks(f, columns, |f, count| {
            let mut inner = Columns::new(symbolic, f, count);
            let tree_solve = Forward::new(&mut inner);
            upwards(symbolic, &|number| {
                let mut waiting = tree_solve.begin(number);
                for front in symbolic.tasks[number].fronts.clone() {
                    let panel = self.panel(&symbolic.fronts[front]);
                    tree_solve.front(number, front, panel, &mut waiting);
                }
                tree_solve.end(number, waiting);
                true
            });
            tree_solve.finish();
            inner.write(f);
        });
    }

    /// The way back of [`Factor::condense`]: with the eliminated entries as it
    /// left them and the kept ones replaced by the unknowns `u_c`, every entry
    /// becomes the unknown, `u_i = K_ii⁻¹ (f_i − K_ic u_c)`.
    ///
    /// # Panics
    /// If `x` has not `n · columns` entries.
    pub fn recover(&self, x: &mut [f64], columns: usize) {
        let symbolic = &*self.symbolic;
        self.blocks(x, columns, |x, count| {
            let mut inner = Columns::new(symbolic, x, count);
            let tree_solve = Backward::new(&mut inner);
            downwards(symbolic, &None, &|number, given| {
                tree_solve.task(number, given, |front| self.panel(front))
            });
            inner.write(x);
        });
    }

    fn blocks(&self, x: &mut [f64], columns: usize, work: impl Fn(&mut [f64], usize) + Sync) {
        let n = self.symbolic.n;
        assert_eq!(x.len(), n * columns);
        if x.is_empty() {
            return;
        }
        x.par_chunks_mut(n * COLUMNS)
            .for_each(|x| work(x, x.len() / n));
    }

    pub(crate) fn panel(&self, front: &Front) -> &[f64] {
        &self.panels[front.panel..front.panel + front.layout().len()]
    }
}
