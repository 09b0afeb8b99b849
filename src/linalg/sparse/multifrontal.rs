//! Partial Cholesky factorisation, front by front.
//!
//! A front collects the rows of K of its pivots and the updates of its children. Its pivots are
//! eliminated, and the rest, the *update*, goes to its parent. Kept unknowns are never pivots:
//! they receive
//!
//! ```text
//! S = K_cc − K_ci K_ii⁻¹ K_ic
//! ```
//!
//! without any shift.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use crate::error::{Error, check_running};
use crate::linalg::dense::{factor_panel, mirror_upper, rank_update};
use crate::linalg::packed::{Packed, Run, add_to_panel, add_to_update, segments};
use crate::linalg::pages::{release, zeros};
use crate::linalg::sparse::arena::{Arena, ArenaEnd, Detached, Piece};
use crate::linalg::sparse::csc::{Symmetric, narrow};
use crate::linalg::sparse::symbolic::{Front, Symbolic, Task};
use crate::linalg::sparse::task_tree::upwards;
use crate::linalg::sparse::tree_solves::{Forward, SolveColumns};
use crate::linalg::sparse::tuning;
use crate::tasks::{inner, lock};

/// S of the kept unknowns and its pivots, without a factor.
#[derive(Debug)]
pub struct Schur {
    values: Vec<f64>,
    weakest: Option<(usize, f64)>,
}

impl Schur {
    /// Eliminates all but the kept unknowns of `k` as [`Factor::new`], bitwise equally, but
    /// stores the factor of each front only while it is made:
    /// [`Counts::bytes_peak_dropped`](crate::linalg::sparse::symbolic::Counts) instead of
    /// `bytes_peak`.
    ///
    /// `loads`, consecutive columns of length `n` or none, are condensed at the same time, as
    /// by [`Factor::condense`].
    ///
    /// # Errors
    /// Those of [`Factor::new`]; then `loads` are unchanged.
    pub fn new(
        symbolic: &Symbolic,
        k: &Symmetric,
        loads: &mut [f64],
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let columns = loads.len() / symbolic.n.max(1);
        assert_eq!(loads.len(), symbolic.n * columns);
        let diagonal = checked_diagonal(symbolic, k)?;
        let k = (k, diagonal.as_slice());
        let mut inner = SolveColumns::new(symbolic, loads, columns);
        let tree_solve = (columns > 0).then(|| Forward::new(&mut inner));
        let (values, weakest) = eliminate(symbolic, k, stop, None, tree_solve.as_ref())?;
        if let Some(tree_solve) = tree_solve {
            tree_solve.finish();
            inner.write(loads);
        }
        Ok(Self { values, weakest })
    }

    /// S, `m × m`, in the order of the kept unknowns, bitwise symmetric.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// As [`Factor::weakest_pivot`].
    pub fn weakest_pivot(&self) -> Option<(usize, f64)> {
        self.weakest
    }
}

/// The factor of the eliminated unknowns, and S of the kept ones.
#[derive(Debug)]
pub struct Factor {
    pub(crate) symbolic: Arc<Symbolic>,
    /// Panels `U = Lᵀ` of all fronts, one after another.
    pub(crate) panels: Vec<f64>,
    schur: Vec<f64>,
    weakest: Option<(usize, f64)>,
}

impl Factor {
    /// Eliminates all but the kept unknowns of `k`; only the lower triangle is read. It runs in
    /// the current rayon pool, and the bits do not depend on its size. `stop` is checked before
    /// each front.
    ///
    /// It uses the memory of an earlier factor of the same analysis, if there was one; the
    /// analysis keeps this memory. It keeps the stack of updates too, if
    /// [`Symbolic::keep_stack`] says so.
    pub fn new(symbolic: Arc<Symbolic>, k: &Symmetric, stop: &AtomicBool) -> Result<Self, Error> {
        let diagonal = checked_diagonal(&symbolic, k)?;
        let k = (k, diagonal.as_slice());
        let mut panels = Panels::of(&symbolic);
        let done = eliminate(&symbolic, k, stop, Some(&mut panels), None);
        if done.is_err() && !panels.is_clear {
            symbolic.give_panels(std::mem::take(&mut panels.values));
        }
        let (schur, weakest) = done?;
        Ok(Self {
            symbolic,
            panels: panels.values,
            schur,
            weakest,
        })
    }

    /// S, `m × m`, in the order of the kept unknowns, bitwise symmetric.
    pub fn schur(&self) -> &[f64] {
        &self.schur
    }

    /// S, moved out: [`Factor::schur`] is empty afterwards.
    pub fn take_schur(&mut self) -> Vec<f64> {
        std::mem::take(&mut self.schur)
    }

    /// The unknown with the smallest pivot relative to its diagonal in K, and this ratio;
    /// `None` if nothing is eliminated.
    pub fn weakest_pivot(&self) -> Option<(usize, f64)> {
        self.weakest
    }

    /// The analysis of this factor.
    pub fn symbolic(&self) -> &Arc<Symbolic> {
        &self.symbolic
    }
}

impl Drop for Factor {
    fn drop(&mut self) {
        self.symbolic.give_panels(std::mem::take(&mut self.panels));
    }
}

/// The memory of the factor.
struct Panels {
    values: Vec<f64>,
    /// Whether it is zero: new memory is, and writing zeros would access it once more.
    is_clear: bool,
}

impl Panels {
    fn of(symbolic: &Symbolic) -> Self {
        let spare = symbolic.take_panels();
        let is_clear = spare.len() != symbolic.panels;
        Self {
            values: if is_clear {
                zeros(symbolic.panels)
            } else {
                spare
            },
            is_clear,
        }
    }
}

/// Eliminates; returns S and the weakest pivot.
fn eliminate(
    symbolic: &Symbolic,
    (k, diagonal): (&Symmetric, &[f64]),
    stop: &AtomicBool,
    panels: Option<&mut Panels>,
    loads: Option<&Forward>,
) -> Result<SchurAndPivot, Error> {
    let keeps = panels.is_some() && symbolic.keeps_stack();
    let mut memory = match panels {
        Some(_) => symbolic.take_stack(),
        None => zeros(symbolic.stack_dropped),
    };
    let arena = Arena::new(&mut memory);
    let done = FrontWork::new(symbolic, k, diagonal, stop, &arena, panels, loads).go();
    if keeps {
        let found = done.map(|done| (done.schur(symbolic, k, &memory), done.weakest));
        symbolic.give_stack(memory);
        return found;
    }
    let done = done?;
    // S takes the memory of the updates.
    let end = done.updates.iter().map(Detached::end).max();
    memory.truncate(end.unwrap_or(0));
    memory.shrink_to_fit();
    let schur = done.schur(symbolic, k, &memory);
    release(memory);
    Ok((schur, done.weakest))
}

/// S, and the weakest pivot as in [`Factor::weakest_pivot`].
type SchurAndPivot = (Vec<f64>, Option<(usize, f64)>);

/// The diagonal of a matrix with the analysed pattern.
///
/// A diagonal that is negative, or zero in a nonzero row, is indefinite before any elimination;
/// as a pivot it could look like a free motion.
fn checked_diagonal(symbolic: &Symbolic, k: &Symmetric) -> Result<Vec<f64>, Error> {
    symbolic.check_pattern(k)?;
    let diagonal = k.diagonal();
    let bad = (0..symbolic.n).find(|&j| {
        diagonal[j] < 0.0 || diagonal[j] == 0.0 && k.column(j).any(|(_, value)| value != 0.0)
    });
    bad.map_or(Ok(diagonal), |dof| Err(Error::Indefinite { dof }))
}

/// A factorisation in progress.
struct FrontWork<'a, 'l> {
    symbolic: &'a Symbolic,
    k: &'a Symmetric<'a>,
    diagonal: &'a [f64],
    stop: &'a AtomicBool,
    /// The part of the factor of each task; empty if it is dropped.
    panels: Option<Vec<Mutex<&'a mut [f64]>>>,
    /// Whether these are zero.
    is_clear: bool,
    loads: Option<&'a Forward<'l>>,
    /// The memory of waiting updates.
    stack: &'a Arena<'a>,
    /// The end from which each task takes memory: not that of its children. On one thread, each
    /// end is then a stack, and both need the counted memory.
    ends: Vec<ArenaEnd>,
    /// The updates of each finished task, one after another.
    updates: Vec<Mutex<Option<Piece<'a>>>>,
    /// Smallest pivot of each task, as (ratio, unknown).
    weakest: Vec<Mutex<Option<(f64, usize)>>>,
    /// The error of the earliest task. Tasks that do not depend on a failed one are still
    /// finished: the reported error must not depend on the order of threads.
    failure: Mutex<Option<(usize, Error)>>,
}

/// The results after all fronts.
struct Done {
    updates: Vec<Detached>,
    weakest: Option<(usize, f64)>,
}

impl<'a, 'l> FrontWork<'a, 'l> {
    fn new(
        symbolic: &'a Symbolic,
        k: &'a Symmetric<'a>,
        diagonal: &'a [f64],
        stop: &'a AtomicBool,
        stack: &'a Arena<'a>,
        panels: Option<&'a mut Panels>,
        loads: Option<&'a Forward<'l>>,
    ) -> Self {
        let tasks = &symbolic.tasks;
        let is_clear = panels.as_ref().is_some_and(|p| p.is_clear);
        let split = |panels: &'a mut Panels| {
            let mut rest = panels.values.as_mut_slice();
            let mut parts = Vec::with_capacity(tasks.len());
            for task in tasks {
                let fronts = symbolic.fronts[task.fronts.clone()].iter();
                let len = fronts.map(|f| f.layout().len()).sum();
                let (part, next) = rest.split_at_mut(len);
                parts.push(Mutex::new(part));
                rest = next;
            }
            parts
        };
        let mut ends = vec![ArenaEnd::Low; tasks.len()];
        // Parents come after their children.
        for (number, task) in tasks.iter().enumerate().rev() {
            if let Some(parent) = task.parent {
                ends[number] = ends[parent].other();
            }
        }
        Self {
            symbolic,
            k,
            diagonal,
            stop,
            panels: panels.map(split),
            is_clear,
            loads,
            stack,
            ends,
            updates: tasks.iter().map(|_| Mutex::default()).collect(),
            weakest: tasks.iter().map(|_| Mutex::default()).collect(),
            failure: Mutex::new(None),
        }
    }

    fn go(self) -> Result<Done, Error> {
        upwards(self.symbolic, &|number| {
            match self.work(number, &self.symbolic.tasks[number]) {
                Ok(updates) => *lock(&self.updates[number]) = Some(updates),
                Err(error) => {
                    let mut failure = lock(&self.failure);
                    if failure.as_ref().is_none_or(|(first, _)| number < *first) {
                        *failure = Some((number, error));
                    }
                    return false;
                }
            }
            true
        });
        check_running(self.stop)?;
        if let Some((_, error)) = inner(self.failure) {
            return Err(error);
        }
        let mut weakest: Option<(f64, usize)> = None;
        for own in self.weakest {
            weakest = smaller(weakest, inner(own));
        }
        let left = |updates: Mutex<Option<Piece>>| {
            inner(updates).map_or_else(Detached::default, Piece::leave)
        };
        Ok(Done {
            updates: self.updates.into_iter().map(left).collect(),
            weakest: weakest.map(|(ratio, dof)| (dof, ratio)),
        })
    }

    fn work(&self, number: usize, task: &Task) -> Result<Piece<'a>, Error> {
        let mut panels = self.panels.as_ref().map(|parts| lock(&parts[number]));
        let end = self.ends[number];
        let own = if panels.is_some() { 0 } else { task.panel };
        let mut dropped = self.stack.take(own, end.other());
        let mut loads = self.loads.map(|loads| loads.begin(number));
        let mut stack = self.stack.take(task.stack, end);
        debug_assert!(
            rayon::current_num_threads() > 1 || dropped.is_part() && stack.is_part(),
            "one thread needs more than was counted"
        );
        let mut weakest = None;
        // Start of each update on the stack.
        let mut waiting: Vec<(usize, usize)> = Vec::new();
        let mut from = 0;
        for f in task.fronts.clone() {
            check_running(self.stop)?;
            let front = &self.symbolic.fronts[f];
            let len = front.layout().len();
            let panel = match &mut panels {
                Some(panels) => &mut panels[from..from + len],
                None => &mut dropped[..len],
            };
            from += len;
            if !self.is_clear {
                panel.fill(0.0);
            }
            for &(value, at) in &self.symbolic.entries[front.entries.clone()] {
                panel[at as usize] = self.k.values()[value as usize];
            }
            if task.is_top {
                self.top(front, task, panel, &mut stack, &mut weakest)?;
            } else {
                let mine = waiting
                    .iter()
                    .rposition(|&(child, _)| !self.is_child(child, f));
                let base = mine.map_or(0, |last| last + 1);
                let children = waiting.split_off(base);
                let top = children.last().map_or_else(
                    || {
                        waiting
                            .last()
                            .map_or(0, |&(w, start)| start + self.update(w).len())
                    },
                    |&(child, start)| start + self.update(child).len(),
                );
                let bottom = children.first().map_or(top, |&(_, start)| start);
                let (below, own) = stack.split_at_mut(top);
                let of = |(child, start): (usize, usize)| (child, &below[start..]);
                self.eliminate(
                    front,
                    panel,
                    children.into_iter().map(of),
                    own,
                    false,
                    &mut weakest,
                )?;
                let len = front.update().len();
                if bottom < top {
                    stack.copy_within(top..top + len, bottom);
                }
                waiting.push((f, bottom));
            }
            if let (Some(tree_solve), Some(waiting)) = (self.loads, &mut loads) {
                tree_solve.front(number, f, panel, waiting);
            }
        }
        if let (Some(tree_solve), Some(waiting)) = (self.loads, loads) {
            tree_solve.end(number, waiting);
        }
        *lock(&self.weakest[number]) = weakest;
        stack.keep(task.left);
        Ok(stack)
    }

    fn update(&self, front: usize) -> Packed {
        self.symbolic.fronts[front].update()
    }

    fn is_child(&self, child: usize, parent: usize) -> bool {
        self.symbolic.fronts[child].parent == Some(parent)
    }

    /// A large front, whose children are other tasks.
    fn top(
        &self,
        front: &Front,
        task: &Task,
        panel: &mut [f64],
        update: &mut [f64],
        weakest: &mut Option<(f64, usize)>,
    ) -> Result<(), Error> {
        let numbers = &self.symbolic.task_children[task.children.clone()];
        let taken: Vec<Option<Piece>> = numbers
            .iter()
            .map(|&child| lock(&self.updates[child]).take())
            .collect();
        let children = numbers
            .iter()
            .zip(taken.iter().flatten())
            .flat_map(|(&child, updates)| left_by(self.symbolic, child, updates));
        for &child in numbers {
            *weakest = smaller(*weakest, *lock(&self.weakest[child]));
        }
        self.eliminate(front, panel, children, update, true, weakest)
    }

    /// Takes a pivot after `before` eliminated unknowns, or returns its error.
    #[expect(clippy::cast_precision_loss, reason = "a bound")]
    fn check_pivot(
        &self,
        dof: usize,
        pivot: f64,
        before: usize,
        weakest: &mut Option<(f64, usize)>,
    ) -> Result<(), Error> {
        // The diagonal may be zero: an empty row; others are refused.
        let original = self.diagonal[dof];
        let rounding = tuning::pivot_roundings() * (before as f64 + 1.0) * f64::EPSILON;
        // Of any size: a pivot cannot distinguish a soft body from a free one.
        if pivot > 0.0 {
            *weakest = smaller(*weakest, Some((pivot / original, dof)));
            return Ok(());
        }
        // A weak pivot has lost digits by cancellation, and later unknowns have this loss.
        let carried = rounding / weakest.map_or(1.0, |(ratio, _)| ratio.min(1.0));
        if pivot >= -carried * original {
            Err(Error::FloatingBody { dof })
        } else {
            Err(Error::Indefinite { dof })
        }
    }

    /// Assembles a front, eliminates its pivots, and leaves its update.
    ///
    /// Children are added to the update after the product that overwrites it, so that its
    /// memory need not be cleared.
    fn eliminate<'c>(
        &self,
        front: &Front,
        panel: &mut [f64],
        children: impl Iterator<Item = (usize, &'c [f64])>,
        update: &mut [f64],
        shared: bool,
        weakest: &mut Option<(f64, usize)>,
    ) -> Result<(), Error> {
        let layout = front.update();
        let update = &mut update[..layout.len()];
        let rows = self.symbolic.runs_of(front);
        let children: Vec<_> = children
            .map(|(child, values)| {
                let own = self.symbolic.runs_of(&self.symbolic.fronts[child]);
                (values, segments(own, front.first, front.np, rows))
            })
            .collect();
        for (values, map) in &children {
            add_to_panel(panel, front.layout(), values, map);
        }
        factor_panel(panel, front.layout(), shared, &mut |k, pivot: f64| {
            let dof = self.symbolic.old[front.first + k] as usize;
            self.check_pivot(dof, pivot, front.first + k - front.base, weakest)
        })?;
        rank_update(panel, front.layout(), update, shared);
        for (values, map) in &children {
            add_to_update(update, |j| layout.column(j), front.np, values, map);
        }
        Ok(())
    }
}

impl Done {
    /// Adds the updates of the kept unknowns to their block of K.
    fn schur(&self, symbolic: &Symbolic, k: &Symmetric, stack: &[f64]) -> Vec<f64> {
        let m = symbolic.kept();
        let mut schur = zeros(m * m);
        // S is also summed in its upper triangle.
        for (q, &j) in symbolic.old[symbolic.interior..].iter().enumerate() {
            for (i, value) in k.column(j as usize).filter(|&(i, _)| i >= j as usize) {
                let p = symbolic.new[i] as usize;
                if let Some(p) = p.checked_sub(symbolic.interior) {
                    schur[p.max(q) * m + p.min(q)] = value;
                }
            }
        }
        let all = [Run {
            start: narrow(symbolic.interior),
            len: narrow(m),
        }];
        for &task in &symbolic.roots {
            for (front, values) in left_by(symbolic, task, self.updates[task].within(stack)) {
                let rows = symbolic.runs_of(&symbolic.fronts[front]);
                let map = segments(rows, symbolic.interior, 0, &all);
                add_to_update(&mut schur, |j| j * m, 0, values, &map);
            }
        }
        mirror_upper(&mut schur, m);
        schur
    }
}

/// The updates of a task, with their fronts.
fn left_by<'u>(
    symbolic: &'u Symbolic,
    task: usize,
    updates: &'u [f64],
) -> impl Iterator<Item = (usize, &'u [f64])> {
    let fronts = symbolic.tasks[task].fronts.clone();
    let end = fronts.end;
    let roots = fronts.filter(move |&f| symbolic.fronts[f].parent.is_none_or(|p| p >= end));
    let mut start = 0;
    roots.map(move |f| {
        let from = start;
        start += symbolic.fronts[f].update().len();
        (f, &updates[from..start])
    })
}

fn smaller(a: Option<(f64, usize)>, b: Option<(f64, usize)>) -> Option<(f64, usize)> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if b.0 < a.0 { b } else { a }),
        (a, b) => a.or(b),
    }
}
