//! Forward and backward solves in the tree of fronts.
//!
//! As in the factorisation, a front collects the loads of its pivots and the results of its
//! children for its rows, and passes a result to its parent. Sums have one order for any
//! parallel execution.

use std::ops::Range;
use std::sync::{Arc, Mutex};

use crate::linalg::dense::{backward, forward};
use crate::linalg::packed::{Segment, segments};
use crate::linalg::sparse::symbolic::{Front, Symbolic, Task};
use crate::tasks::{inner, lock};

/// SolveColumns by tasks: for each task the rows of its pivots, column by column, in elimination
/// numbering; the rows of the kept unknowns come last.
pub(crate) struct SolveColumns<'a> {
    symbolic: &'a Symbolic,
    count: usize,
    values: Vec<f64>,
}

impl<'a> SolveColumns<'a> {
    /// Made from `count` columns in the numbering of the caller.
    pub(crate) fn new(symbolic: &'a Symbolic, x: &[f64], count: usize) -> Self {
        let mut values = Vec::with_capacity(x.len());
        for rows in stretches(symbolic) {
            for column in x.chunks_exact(symbolic.n.max(1)) {
                let dofs = &symbolic.old[rows.clone()];
                values.extend(dofs.iter().map(|&dof| column[dof as usize]));
            }
        }
        Self {
            symbolic,
            count,
            values,
        }
    }

    /// Back to the numbering of the caller.
    pub(crate) fn write(&self, x: &mut [f64]) {
        let mut rest = self.values.as_slice();
        for rows in stretches(self.symbolic) {
            for column in x.chunks_exact_mut(self.symbolic.n.max(1)) {
                let (values, next) = rest.split_at(rows.len());
                for (&dof, value) in self.symbolic.old[rows.clone()].iter().zip(values) {
                    column[dof as usize] = *value;
                }
                rest = next;
            }
        }
    }

    /// The part of each task, and that of the kept unknowns.
    fn parts(&mut self) -> (Vec<Mutex<&mut [f64]>>, &mut [f64]) {
        let mut rest = self.values.as_mut_slice();
        let mut parts = Vec::with_capacity(self.symbolic.tasks.len());
        for task in &self.symbolic.tasks {
            let rows = pivots(self.symbolic, task);
            let (part, next) = rest.split_at_mut(rows.len() * self.count);
            parts.push(Mutex::new(part));
            rest = next;
        }
        (parts, rest)
    }
}

/// Rows of the pivots of each task, then the kept ones.
fn stretches(symbolic: &Symbolic) -> impl Iterator<Item = Range<usize>> + '_ {
    let tasks = symbolic.tasks.iter();
    tasks
        .map(|task| pivots(symbolic, task))
        .chain(std::iter::once(symbolic.interior..symbolic.n))
}

fn pivots(symbolic: &Symbolic, task: &Task) -> Range<usize> {
    let fronts = &symbolic.fronts[task.fronts.clone()];
    let end = fronts.last().map_or(0, |f| f.first + f.np);
    fronts.first().map_or(0, |f| f.first)..end
}

/// The result of a front for the rows after its pivots, `nu × count`.
type FrontRest = (usize, Vec<f64>);

/// Forward solve of loads, to the kept unknowns.
pub(crate) struct Forward<'a> {
    symbolic: &'a Symbolic,
    count: usize,
    parts: Vec<Mutex<&'a mut [f64]>>,
    kept: &'a mut [f64],
    left: Vec<Mutex<Vec<FrontRest>>>,
}

impl<'a> Forward<'a> {
    pub(crate) fn new(columns: &'a mut SolveColumns<'_>) -> Self {
        let (symbolic, count) = (columns.symbolic, columns.count);
        let (parts, kept) = columns.parts();
        Self {
            symbolic,
            count,
            parts,
            kept,
            left: symbolic.tasks.iter().map(|_| Mutex::default()).collect(),
        }
    }

    /// The results of the children of a task, its initial data.
    pub(crate) fn begin(&self, number: usize) -> Vec<FrontRest> {
        let children = self.symbolic.tasks[number].children.clone();
        let numbers = self.symbolic.task_children[children].iter();
        numbers
            .flat_map(|&child| std::mem::take(&mut *lock(&self.left[child])))
            .collect()
    }

    /// Condenses the loads of a front of this task: `waiting` has the results of earlier
    /// fronts.
    pub(crate) fn front(
        &self,
        number: usize,
        f: usize,
        panel: &[f64],
        waiting: &mut Vec<FrontRest>,
    ) {
        let front = &self.symbolic.fronts[f];
        let mut part = lock(&self.parts[number]);
        let own = pivots(self.symbolic, &self.symbolic.tasks[number]);
        let (nf, at) = (front.nf(), front.first - own.start);
        let mut local = vec![0.0; nf * self.count];
        let columns = part.chunks_exact(own.len());
        for (local, column) in local.chunks_exact_mut(nf).zip(columns) {
            local[..front.np].copy_from_slice(&column[at..at + front.np]);
        }
        let last = waiting
            .iter()
            .rposition(|&(child, _)| self.symbolic.fronts[child].parent != Some(f));
        for (child, values) in waiting.split_off(last.map_or(0, |last| last + 1)) {
            let child = &self.symbolic.fronts[child];
            let map = places(self.symbolic, child, front);
            let columns = local.chunks_exact_mut(nf);
            for (local, values) in columns.zip(values.chunks_exact(child.nu.max(1))) {
                for s in &map {
                    let (to, from) = (&mut local[s.to..][..s.len], &values[s.from..][..s.len]);
                    to.iter_mut().zip(from).for_each(|(t, s)| *t += s);
                }
            }
        }
        forward(panel, front.layout(), &mut local, self.count);
        let columns = part.chunks_exact_mut(own.len());
        let mut rest = Vec::with_capacity(front.nu * self.count);
        for (local, column) in local.chunks_exact(nf).zip(columns) {
            column[at..at + front.np].copy_from_slice(&local[..front.np]);
            rest.extend_from_slice(&local[front.np..]);
        }
        waiting.push((f, rest));
    }

    pub(crate) fn end(&self, number: usize, waiting: Vec<FrontRest>) {
        *lock(&self.left[number]) = waiting;
    }

    /// Adds the loads that have reached the kept unknowns.
    pub(crate) fn finish(self) {
        let m = self.symbolic.kept();
        let interior = self.symbolic.interior;
        let mut left: Vec<Vec<FrontRest>> = self.left.into_iter().map(inner).collect();
        for &root in &self.symbolic.roots {
            for (front, values) in std::mem::take(&mut left[root]) {
                let front = &self.symbolic.fronts[front];
                let columns = self.kept.chunks_exact_mut(m.max(1));
                for (kept, values) in columns.zip(values.chunks_exact(front.nu.max(1))) {
                    let mut values = values.iter();
                    for run in self.symbolic.runs_of(front) {
                        let to = &mut kept[run.start as usize - interior..][..run.len as usize];
                        to.iter_mut().zip(&mut values).for_each(|(t, s)| *t += s);
                    }
                }
            }
        }
    }
}

/// Backward solve of unknowns, from the kept ones.
pub(crate) struct Backward<'a> {
    symbolic: &'a Symbolic,
    count: usize,
    parts: Vec<Mutex<&'a mut [f64]>>,
    kept: &'a [f64],
}

/// The unknowns of a front, `nf × count`.
pub(crate) type FrontUnknowns = Option<Arc<(usize, Vec<f64>)>>;

impl<'a> Backward<'a> {
    pub(crate) fn new(columns: &'a mut SolveColumns<'_>) -> Self {
        let (symbolic, count) = (columns.symbolic, columns.count);
        let (parts, kept) = columns.parts();
        Self {
            symbolic,
            count,
            parts,
            kept,
        }
    }

    /// Recovers the unknowns of a task, given those of the front above it; returns those of its
    /// last front.
    pub(crate) fn task<'p>(
        &self,
        number: usize,
        given: FrontUnknowns,
        panel: impl Fn(&Front) -> &'p [f64],
    ) -> FrontUnknowns {
        let task = &self.symbolic.tasks[number];
        let mut part = lock(&self.parts[number]);
        let own = pivots(self.symbolic, task);
        // Fronts with unfinished descendants.
        let mut above: Vec<Arc<(usize, Vec<f64>)>> = given.into_iter().collect();
        for f in task.fronts.clone().rev() {
            let front = &self.symbolic.fronts[f];
            let (nf, at) = (front.nf(), front.first - own.start);
            let mut local = vec![0.0; nf * self.count];
            let columns = part.chunks_exact(own.len());
            for (local, column) in local.chunks_exact_mut(nf).zip(columns) {
                local[..front.np].copy_from_slice(&column[at..at + front.np]);
            }
            if let Some(parent) = front.parent {
                while above.last().is_some_and(|known| known.0 != parent) {
                    let _ = above.pop();
                }
                if let Some(known) = above.last() {
                    self.take(front, &self.symbolic.fronts[parent], &known.1, &mut local);
                }
            } else {
                above.clear();
                self.take_kept(front, &mut local);
            }
            backward(panel(front), front.layout(), &mut local, self.count);
            let columns = part.chunks_exact_mut(own.len());
            for (local, column) in local.chunks_exact(nf).zip(columns) {
                column[at..at + front.np].copy_from_slice(&local[..front.np]);
            }
            above.push(Arc::new((f, local)));
        }
        above.pop()
    }

    fn take(&self, front: &Front, parent: &Front, known: &[f64], local: &mut [f64]) {
        let map = places(self.symbolic, front, parent);
        let columns = known.chunks_exact(parent.nf());
        for (local, known) in local.chunks_exact_mut(front.nf()).zip(columns) {
            let local = &mut local[front.np..];
            for s in &map {
                local[s.from..][..s.len].copy_from_slice(&known[s.to..][..s.len]);
            }
        }
    }

    fn take_kept(&self, front: &Front, local: &mut [f64]) {
        let interior = self.symbolic.interior;
        let columns = self.kept.chunks_exact(self.symbolic.kept().max(1));
        for (local, kept) in local.chunks_exact_mut(front.nf()).zip(columns) {
            let mut at = front.np;
            for run in self.symbolic.runs_of(front) {
                let len = run.len as usize;
                let from = &kept[run.start as usize - interior..][..len];
                local[at..at + len].copy_from_slice(from);
                at += len;
            }
        }
    }
}

/// Positions of the updated rows of a front in its parent.
fn places(symbolic: &Symbolic, child: &Front, parent: &Front) -> Vec<Segment> {
    let rows = symbolic.runs_of(parent);
    segments(symbolic.runs_of(child), parent.first, parent.np, rows)
}
