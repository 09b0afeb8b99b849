//! Condensation of loads, and recovery of unknowns, with a factor.

use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::symbolic::Front;
use crate::linalg::sparse::task_tree::{downwards, upwards};
use crate::linalg::sparse::tree_solves::{Backward, Forward, SolveColumns};
use crate::tasks;

/// SolveColumns solved together: enough for the rate of a product, and few enough that the waiting
/// data are small relative to the factor.
const COLUMNS: usize = 32;

impl Factor {
    /// Condenses `columns` loads of length `n`, consecutive in `f`: the eliminated entries
    /// become `L⁻¹ f_i`, the kept ones `f_c − K_ci K_ii⁻¹ f_i`. It runs in the current rayon
    /// pool, and the bits do not depend on its size.
    pub fn condense(&self, f: &mut [f64], columns: usize) {
        let symbolic = &*self.symbolic;
        self.blocks(f, columns, |f, count| {
            let mut inner = SolveColumns::new(symbolic, f, count);
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

    /// The inverse of [`Factor::condense`]: given its eliminated entries, with the kept ones
    /// replaced by the unknowns `u_c`, every entry becomes the unknown,
    /// `u_i = K_ii⁻¹ (f_i − K_ic u_c)`.
    pub fn recover(&self, x: &mut [f64], columns: usize) {
        let symbolic = &*self.symbolic;
        self.blocks(x, columns, |x, count| {
            let mut inner = SolveColumns::new(symbolic, x, count);
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
        tasks::for_each(x.chunks_mut(n * COLUMNS), |_, x| work(x, x.len() / n));
    }

    pub(crate) fn panel(&self, front: &Front) -> &[f64] {
        &self.panels[front.panel..front.panel + front.layout().len()]
    }
}
