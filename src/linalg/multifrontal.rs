//! Partial Cholesky factorisation, front by front.
//!
//! A front gathers the rows of K of its pivots and what its children have left
//! over; its pivots are eliminated and the rest, the *update*, goes to its
//! parent. Kept unknowns are never pivots: what reaches them is
//!
//! ```text
//! S = K_cc − K_ci K_ii⁻¹ K_ic
//! ```
//!
//! itself, with nothing shifted and nothing undone.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::Error;
use crate::linalg::csc::{Symmetric, narrow};
use crate::linalg::dense::{factor_panel, mirror_upper, rank_update, zeros};
use crate::linalg::packed::{Packed, Run, add_to_panel, add_to_update, segments};
use crate::linalg::symbolic::{Front, Symbolic, Task};

/// Roundings that a pivot may be off by, against its diagonal in K, for each
/// unknown eliminated before it. The stiffness of a free motion sums to nothing
/// but the rounding of K itself, and where cells are alike these add up: free
/// plates of 1e2 to 1e5 unknowns leave 1.6 roundings an unknown. The weakest
/// sound pivots, of a stiff part on one 1e8 times softer, are near 1e-9.
const ROUNDINGS: f64 = 8.0;

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
    /// Eliminates all but the kept unknowns of `k`, of which only the lower
    /// triangle is read. Works in the rayon pool that is installed; the bits do
    /// not depend on its size. `stop` is looked at before every front.
    ///
    /// # Errors
    /// [`Error::Indefinite`] and [`Error::FloatingBody`] name the caller's
    /// unknown where a pivot is negative or vanishes against the diagonal of K;
    /// [`Error::Interrupted`] when `stop` is set; [`Error::Shape`] or
    /// [`Error::SparseStructure`] when `k` has not the pattern analysed.
    pub fn new(symbolic: Arc<Symbolic>, k: &Symmetric, stop: &AtomicBool) -> Result<Self, Error> {
        symbolic.check_pattern(k)?;
        let diagonal = k.diagonal();
        check_diagonal(&symbolic, k, &diagonal)?;
        let mut panels = zeros(symbolic.panels);
        let run = Work::new(&symbolic, k, &diagonal, stop, &mut panels);
        let done = run.go()?;
        let schur = done.schur(&symbolic, k);
        let weakest = done.weakest;
        Ok(Self {
            symbolic,
            panels,
            schur,
            weakest,
        })
    }

    /// S, `m × m`, in the order of the kept unknowns, symmetric to the bit.
    #[must_use]
    pub fn schur(&self) -> &[f64] {
        &self.schur
    }

    /// The unknown whose pivot is smallest against its diagonal in K, and that
    /// ratio; `None` when nothing is eliminated.
    #[must_use]
    pub fn weakest_pivot(&self) -> Option<(usize, f64)> {
        self.weakest
    }

    /// The analysis that this factor follows.
    #[must_use]
    pub fn symbolic(&self) -> &Arc<Symbolic> {
        &self.symbolic
    }
}

/// A diagonal that is negative, or zero in a row that is not, is indefinite
/// before any elimination; as a pivot it could pass for a free motion.
fn check_diagonal(symbolic: &Symbolic, k: &Symmetric, diagonal: &[f64]) -> Result<(), Error> {
    let bad = (0..symbolic.n).find(|&j| {
        diagonal[j] < 0.0 || diagonal[j] == 0.0 && k.column(j).any(|(_, value)| value != 0.0)
    });
    bad.map_or(Ok(()), |dof| Err(Error::Indefinite { dof }))
}

/// What a finished task has left: one update after another.
type Updates = Vec<f64>;

/// One factorisation on its way.
struct Work<'a> {
    symbolic: &'a Symbolic,
    k: &'a Symmetric<'a>,
    diagonal: &'a [f64],
    stop: &'a AtomicBool,
    /// The part of the factor that each task fills.
    panels: Vec<Mutex<&'a mut [f64]>>,
    updates: Vec<Mutex<Updates>>,
    /// Children that each task still waits for.
    waiting: Vec<AtomicUsize>,
    buffers: Buffers,
    /// Smallest pivot of each task, as (ratio, unknown).
    weakest: Vec<Mutex<Option<(f64, usize)>>>,
    /// The failure of the earliest task. Tasks that do not depend on a failed
    /// one are finished all the same: which failure is reported must not
    /// depend on who came first.
    failure: Mutex<Option<(usize, Error)>>,
}

/// What is left when all fronts are done.
struct Done {
    updates: Vec<Updates>,
    weakest: Option<(usize, f64)>,
}

impl<'a> Work<'a> {
    fn new(
        symbolic: &'a Symbolic,
        k: &'a Symmetric<'a>,
        diagonal: &'a [f64],
        stop: &'a AtomicBool,
        panels: &'a mut [f64],
    ) -> Self {
        let tasks = &symbolic.tasks;
        let mut rest = panels;
        let mut parts = Vec::with_capacity(tasks.len());
        for task in tasks {
            let len = symbolic.fronts[task.fronts.clone()]
                .iter()
                .map(|f| f.layout().len())
                .sum();
            let (part, next) = std::mem::take(&mut rest).split_at_mut(len);
            parts.push(Mutex::new(part));
            rest = next;
        }
        Self {
            symbolic,
            k,
            diagonal,
            stop,
            panels: parts,
            updates: tasks.iter().map(|_| Mutex::default()).collect(),
            waiting: tasks
                .iter()
                .map(|t| AtomicUsize::new(t.children.len()))
                .collect(),
            buffers: Buffers::default(),
            weakest: tasks.iter().map(|_| Mutex::default()).collect(),
            failure: Mutex::new(None),
        }
    }

    fn go(self) -> Result<Done, Error> {
        let tasks = &self.symbolic.tasks;
        rayon::scope(|scope| {
            // A thread takes its own newest task first: started from the end,
            // one thread alone works in postorder, whose memory was counted.
            for start in (0..tasks.len())
                .rev()
                .filter(|&t| tasks[t].children.is_empty())
            {
                let this = &self;
                scope.spawn(move |_| this.climb(start));
            }
        });
        if self.stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        if let Some((_, error)) = inner(self.failure) {
            return Err(error);
        }
        let mut weakest: Option<(f64, usize)> = None;
        for own in self.weakest {
            weakest = smaller(weakest, inner(own));
        }
        Ok(Done {
            updates: self.updates.into_iter().map(inner).collect(),
            weakest: weakest.map(|(ratio, dof)| (dof, ratio)),
        })
    }

    /// Works on a task, and on those above it as long as it is the last of the
    /// children to finish. A loop, not a recursion: the tree may be deep.
    fn climb(&self, start: usize) {
        let mut number = start;
        loop {
            let task = &self.symbolic.tasks[number];
            match self.work(number, task) {
                Ok(updates) => *lock(&self.updates[number]) = updates,
                Err(error) => {
                    let mut failure = lock(&self.failure);
                    if failure.as_ref().is_none_or(|(first, _)| number < *first) {
                        *failure = Some((number, error));
                    }
                    return;
                }
            }
            match task.parent {
                Some(parent) if self.waiting[parent].fetch_sub(1, Ordering::AcqRel) == 1 => {
                    number = parent;
                }
                _ => return,
            }
        }
    }

    fn work(&self, number: usize, task: &Task) -> Result<Updates, Error> {
        let mut panels = lock(&self.panels[number]);
        let mut stack = self.buffers.take(task.stack);
        let mut weakest = None;
        // Start of each update that waits on the stack.
        let mut waiting: Vec<(usize, usize)> = Vec::new();
        let mut from = 0;
        for f in task.fronts.clone() {
            if self.stop.load(Ordering::Relaxed) {
                return Err(Error::Interrupted);
            }
            let front = &self.symbolic.fronts[f];
            let panel = &mut panels[from..from + front.layout().len()];
            from += panel.len();
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
        }
        *lock(&self.weakest[number]) = weakest;
        if task.stack > task.left {
            let mut left = self.buffers.take(task.left);
            left[..task.left].copy_from_slice(&stack[..task.left]);
            self.buffers.give(std::mem::replace(&mut stack, left));
        }
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
        let taken: Vec<Updates> = numbers
            .iter()
            .map(|&child| std::mem::take(&mut *lock(&self.updates[child])))
            .collect();
        let children = numbers
            .iter()
            .zip(&taken)
            .flat_map(|(&child, updates)| left_by(self.symbolic, child, updates));
        for &child in numbers {
            *weakest = smaller(*weakest, *lock(&self.weakest[child]));
        }
        self.eliminate(front, panel, children, update, true, weakest)?;
        for updates in taken {
            self.buffers.give(updates);
        }
        Ok(())
    }

    /// Takes a pivot with `before` unknowns eliminated below it, or says what
    /// is wrong with it.
    #[expect(clippy::cast_precision_loss, reason = "a bound")]
    fn check_pivot(
        &self,
        dof: usize,
        pivot: f64,
        before: usize,
        weakest: &mut Option<(f64, usize)>,
    ) -> Result<(), Error> {
        // The diagonal may be zero: an empty row, for the others are refused.
        let original = self.diagonal[dof];
        let rounding = ROUNDINGS * (before as f64 + 1.0) * f64::EPSILON;
        if pivot > rounding * original {
            *weakest = smaller(*weakest, Some((pivot / original, dof)));
            return Ok(());
        }
        // A weak pivot has lost digits to cancellation; what is eliminated
        // after it carries their loss.
        let carried = rounding / weakest.map_or(1.0, |(ratio, _)| ratio.min(1.0));
        if pivot >= -carried * original {
            Err(Error::FloatingBody { dof })
        } else {
            Err(Error::Indefinite { dof })
        }
    }

    /// Assembles a front, eliminates its pivots, and leaves its update.
    ///
    /// Children are added to the update after the product that overwrites it,
    /// so that its memory need not be cleared first.
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
    /// Adds what reached the kept unknowns to their block of K.
    fn schur(&self, symbolic: &Symbolic, k: &Symmetric) -> Vec<f64> {
        let m = symbolic.kept();
        let mut schur = zeros(m * m);
        // Of S too the upper triangle is summed.
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
            for (front, values) in left_by(symbolic, task, &self.updates[task]) {
                let rows = symbolic.runs_of(&symbolic.fronts[front]);
                let map = segments(rows, symbolic.interior, 0, &all);
                add_to_update(&mut schur, |j| j * m, 0, values, &map);
            }
        }
        mirror_upper(&mut schur, m);
        schur
    }
}

/// The updates that a task has left, with the fronts they come from.
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

/// Buffers that have been used before: memory fresh from the system costs a
/// second a gigabyte when it is first touched.
#[derive(Default)]
struct Buffers(Mutex<Vec<Vec<f64>>>);

impl Buffers {
    /// A buffer of at least `len` numbers, whatever they are.
    fn take(&self, len: usize) -> Vec<f64> {
        /// A buffer this much larger than asked for is left to others.
        const SLACK: usize = 2;
        let mut free = lock(&self.0);
        let fits = |b: &Vec<f64>| b.len() >= len && b.len() <= SLACK * len.max(1 << 16);
        let best = (0..free.len())
            .filter(|&i| fits(&free[i]))
            .min_by_key(|&i| free[i].len());
        if let Some(i) = best {
            return free.swap_remove(i);
        }
        // A new one takes the place of the largest that is too small: towards
        // the root updates grow, and nobody will ask for that one again.
        let small = (0..free.len())
            .filter(|&i| free[i].len() < len)
            .max_by_key(|&i| free[i].len());
        let dropped = small.map(|i| free.swap_remove(i));
        drop(free);
        drop(dropped);
        zeros(len)
    }

    fn give(&self, buffer: Vec<f64>) {
        lock(&self.0).push(buffer);
    }
}

/// A lock that a panic elsewhere does not close: the panic is passed on by
/// rayon, and what the lock guards is then never read.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn inner<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}
