//! Symbolic analysis: the tree of fronts and its cost.
//!
//! It works on *nodes*, groups of unknowns with the same pattern: a ninth of the work in 3D.
//! The kept nodes come after all others and are never eliminated; they form the root of the
//! tree, whose matrix is the Schur complement.

mod layout;
mod pattern;
mod tasks;

use std::ops::{Deref, Range};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use crate::error::{Error, check_finite, check_length};
use crate::linalg::packed::{Packed, Panel, Run};
use crate::linalg::pages::zeros;
use crate::linalg::sparse::csc::{Symmetric, positions};
use crate::linalg::sparse::ordering::{Graph, by_coordinates, by_metis};
use crate::linalg::sparse::supervariables::SupervariableGraph;
use crate::linalg::sparse::symbolic::layout::Layout;
use crate::linalg::sparse::symbolic::pattern::SymbolicPattern;
use crate::linalg::sparse::symbolic::tasks::Tasks;
use crate::linalg::sparse::tree::{Tree, flops_of};
use crate::linalg::sparse::tuning;
use crate::tasks::collect;

/// Options of the analysis.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options<'a> {
    /// Position of each unknown, for bisection by coordinates. Any unit is allowed, and the
    /// third coordinate may be zero. If the work is larger than the cost of METIS, both orders
    /// are made, and the one with fewer operations is used.
    pub coordinates: Option<&'a [[f64; 3]]>,
}

/// The cost of the factorisation, counted before any allocation.
#[derive(Clone, Debug, PartialEq)]
pub struct Counts {
    /// Number of unknowns, with the kept ones.
    pub n: usize,
    /// Number of kept unknowns, the order of S.
    pub kept: usize,
    /// Entries of the factor: the eliminated columns, kept rows included.
    pub nnz_factor: usize,
    /// Additions and multiplications of the partial factorisation.
    pub flops: f64,
    /// Memory of the factor and S.
    pub bytes_factor: usize,
    /// Largest memory during the factorisation on one thread, with the analysis.
    pub bytes_peak: usize,
    /// `bytes_peak` if only S is kept, not the factor.
    pub bytes_peak_dropped: usize,
    /// Upper bound of `bytes_peak` for any number of threads, in any order of tasks; it is
    /// rarely approached.
    pub bytes_peak_threads: usize,
    /// Memory of the analysis itself.
    pub bytes_symbolic: usize,
    /// Origin of the elimination order.
    pub ordering: &'static str,
    /// Seconds spent ordering.
    pub seconds_order: f64,
    /// Seconds spent on the rest of the analysis.
    pub seconds_symbolic: f64,
}

/// A front: `np` pivots, then `nu` updated rows.
#[derive(Clone, Debug)]
pub(crate) struct Front {
    /// First pivot in elimination numbering.
    pub(crate) first: usize,
    /// First pivot of all its descendants.
    pub(crate) base: usize,
    pub(crate) np: usize,
    pub(crate) nu: usize,
    /// Front that takes the update; `None` for S.
    pub(crate) parent: Option<usize>,
    /// Position of the panel of the front in the factor.
    pub(crate) panel: usize,
    /// Updated rows, in [`Symbolic::runs`].
    pub(crate) runs: Range<usize>,
    /// Entries of K in the rows of the pivots, in [`Symbolic::entries`].
    pub(crate) entries: Range<usize>,
}

impl Front {
    pub(crate) fn nf(&self) -> usize {
        self.np + self.nu
    }

    pub(crate) fn layout(&self) -> Panel {
        Panel::new(self.np, self.nf())
    }

    pub(crate) fn update(&self) -> Packed {
        Packed::new(self.nu)
    }
}

/// A range of fronts that one thread handles in order.
#[derive(Clone, Debug)]
pub(crate) struct Task {
    /// Consecutive fronts in postorder. Several fronts are whole subtrees that are small
    /// together. A single front may be large and is then divided into tiles.
    pub(crate) fronts: Range<usize>,
    /// Whether it takes updates of other tasks and is divided into tiles.
    pub(crate) is_top: bool,
    /// Task of the front that takes the updates; `None` for S.
    pub(crate) parent: Option<usize>,
    /// Tasks whose updates go to this one, in order.
    pub(crate) children: Range<usize>,
    /// Stack that the fronts need [f64].
    pub(crate) stack: usize,
    /// The rest of the stack: the updates of the roots of the subtrees.
    pub(crate) left: usize,
    /// The largest of its panels [f64].
    pub(crate) panel: usize,
}

/// The analysis of one pattern, with memory for its factors.
#[derive(Debug)]
pub struct Symbolic {
    plan: Arc<Plan>,
    counts: Counts,
    spare: Spare,
}

/// Memory of earlier factors of a pattern, for the next one: the first access to new memory
/// costs a second for each gigabyte. No thread waits for its lock: in a forked child, a thread
/// that does not exist may hold it.
#[derive(Debug, Default)]
struct Spare {
    panels: Mutex<Vec<f64>>,
    stack: Mutex<Vec<f64>>,
    /// Whether the next factor leaves its stack.
    keeps_stack: AtomicBool,
}

impl Deref for Symbolic {
    type Target = Plan;

    fn deref(&self) -> &Plan {
        &self.plan
    }
}

/// The elimination order and the positions of all entries, for each matrix of the pattern, and
/// for several problems at once.
#[derive(Debug)]
pub struct Plan {
    pub(crate) n: usize,
    /// Number of eliminated unknowns; the following ones in elimination numbering are kept, in
    /// the order of the caller.
    pub(crate) interior: usize,
    /// The unknown of the caller at each place of the elimination order.
    pub(crate) old: Vec<u32>,
    /// Place in the elimination order of each unknown of the caller.
    pub(crate) new: Vec<u32>,
    pub(crate) fronts: Vec<Front>,
    pub(crate) runs: Vec<Run>,
    /// (position in the values of K, position in the panel of the front).
    pub(crate) entries: Vec<(u32, u32)>,
    pub(crate) tasks: Vec<Task>,
    /// Lists of children, for [`Task::children`].
    pub(crate) task_children: Vec<usize>,
    /// Tasks whose updates go to S, in order.
    pub(crate) roots: Vec<usize>,
    pub(crate) panels: usize,
    /// Largest memory of updates on one thread, and with a panel that is not kept [f64].
    pub(crate) stack: usize,
    pub(crate) stack_dropped: usize,
    fingerprints: Vec<u64>,
}

impl Symbolic {
    /// Orders and analyses the pattern of `k`, for the elimination of all but `kept`.
    ///
    /// `kept` may be empty or contain all unknowns; S has its order. The rest may be
    /// disconnected. Stored zeros belong to the pattern.
    pub fn analyse(k: &Symmetric, kept: &[usize], options: &Options) -> Result<Self, Error> {
        let begin = Instant::now();
        let n = k.n();
        check_sizes(k)?;
        let place = positions("list of kept degrees of freedom", kept, n)?;
        if let Some(at) = options.coordinates {
            check_length("coordinates", at.len(), n)?;
            check_finite("coordinates", at.as_flattened())?;
        }
        let pattern = SymbolicPattern::of(k);
        let nodes = SupervariableGraph::new(&pattern.col_ptr, &pattern.row_idx, kept, &place);
        let (node_order, tree, ordering, seconds_order) = best_order(&nodes, options)?;

        let mut layout = Layout::new(&nodes, &tree, &node_order);
        layout.place_rows();
        let entries = layout.place_entries(k, &pattern);
        let Layout {
            fronts,
            runs,
            old,
            new,
            panels,
            children,
            ..
        } = layout;
        let tasks = Tasks::new(&fronts, &children);
        let m = kept.len();
        let f64s = size_of::<f64>();
        let bytes_factor = (panels + m * m) * f64s;
        let bytes_symbolic = size_of_val(entries.as_slice())
            + size_of_val(fronts.as_slice())
            + size_of_val(runs.as_slice())
            + n * (size_of::<u64>() + 2 * size_of::<u32>());
        // S is made after the last updates have reached it; the diagonal of K is stored too.
        let peak = |own: usize, stack: usize| {
            bytes_symbolic + (own + stack.max(tasks.end + m * m) + n) * f64s
        };
        let most = tasks.most();
        let flops = fronts.iter().map(|f| flops_of(f.np, f.nf())).sum();
        let nnz_factor = fronts
            .iter()
            .map(|f| f.np * f.nf() - f.np * (f.np - 1) / 2)
            .sum();
        let plan = Plan {
            n,
            interior: n - m,
            old,
            new,
            fronts,
            runs,
            entries,
            tasks: tasks.list,
            task_children: tasks.children,
            roots: tasks.roots,
            panels,
            stack: tasks.peak,
            stack_dropped: tasks.peak_dropped,
            fingerprints: collect(n, |j| fingerprint(k, j)),
        };
        Ok(Self {
            plan: Arc::new(plan),
            counts: Counts {
                n,
                kept: m,
                nnz_factor,
                flops,
                bytes_factor,
                bytes_peak: peak(panels, tasks.peak),
                bytes_peak_dropped: peak(0, tasks.peak_dropped),
                bytes_peak_threads: peak(panels, most),
                bytes_symbolic,
                ordering,
                seconds_order,
                seconds_symbolic: begin.elapsed().as_secs_f64() - seconds_order,
            },
            spare: Spare::default(),
        })
    }

    /// The cost of the factorisation.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// The same analysis for another problem, with its own memory and zero seconds.
    pub fn for_another(&self) -> Self {
        let counts = Counts {
            seconds_order: 0.0,
            seconds_symbolic: 0.0,
            ..self.counts.clone()
        };
        Self {
            plan: Arc::clone(&self.plan),
            counts,
            spare: Spare::default(),
        }
    }

    /// Bytes stored for the next factor of this pattern, panels and stack;
    /// [`Counts::bytes_peak`] contains them.
    pub fn bytes_spare(&self) -> usize {
        [&self.spare.panels, &self.spare.stack]
            .map(|spare| spare.try_lock().map_or(0, |held| size_of_val(&held[..])))
            .iter()
            .sum()
    }

    /// Whether later factors leave their stack of updates here for the next one, as they leave
    /// their panels: [`Plan::bytes_stack`] more for this time.
    pub fn keep_stack(&self, keep: bool) {
        self.spare.keeps_stack.store(keep, Ordering::Relaxed);
        if !keep {
            let _ = take(&self.spare.stack);
        }
    }

    pub(crate) fn keeps_stack(&self) -> bool {
        self.spare.keeps_stack.load(Ordering::Relaxed)
    }

    /// Memory for panels, from an earlier factor if possible.
    pub(crate) fn take_panels(&self) -> Vec<f64> {
        take(&self.spare.panels)
    }

    pub(crate) fn give_panels(&self, panels: Vec<f64>) {
        give(&self.spare.panels, panels);
    }

    /// Memory for updates, from an earlier factor or new.
    pub(crate) fn take_stack(&self) -> Vec<f64> {
        let spare = take(&self.spare.stack);
        if spare.len() == self.stack {
            spare
        } else {
            zeros(self.stack)
        }
    }

    pub(crate) fn give_stack(&self, stack: Vec<f64>) {
        give(&self.spare.stack, stack);
    }
}

fn take(spare: &Mutex<Vec<f64>>) -> Vec<f64> {
    spare
        .try_lock()
        .map_or_else(|_| Vec::new(), |mut spare| std::mem::take(&mut *spare))
}

fn give(spare: &Mutex<Vec<f64>>, values: Vec<f64>) {
    if let Ok(mut spare) = spare.try_lock() {
        *spare = values;
    }
}

impl Plan {
    /// Bytes of the stack of updates besides a factor, on one thread.
    pub fn bytes_stack(&self) -> usize {
        self.stack * size_of::<f64>()
    }

    /// Order of S.
    pub fn kept(&self) -> usize {
        self.n - self.interior
    }

    /// Whether `k` has the analysed pattern.
    pub(crate) fn check_pattern(&self, k: &Symmetric) -> Result<(), Error> {
        check_length("K", k.n(), self.n)?;
        let same = collect(self.n, |j| fingerprint(k, j) == self.fingerprints[j]);
        match same.iter().position(|&same| !same) {
            Some(row) => Err(Error::SparseStructure {
                what: "K, taken for the pattern analysed before,",
                row,
            }),
            None => Ok(()),
        }
    }

    pub(crate) fn runs_of(&self, front: &Front) -> &[Run] {
        &self.runs[front.runs.clone()]
    }
}

/// A hash of the pattern of a column with its number.
fn fingerprint(k: &Symmetric, j: usize) -> u64 {
    let start = k.col_ptr()[j];
    k.row_idx()[start..k.col_ptr()[j + 1]]
        .iter()
        .fold(start as u64, |hash, &i| {
            (hash.rotate_left(5) ^ i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        })
}

fn check_sizes(k: &Symmetric) -> Result<(), Error> {
    for (what, found) in [
        ("list of unknowns of K", k.n()),
        ("values of K", k.values().len()),
    ] {
        if u32::try_from(found).is_err() {
            return Err(Error::IndexRange {
                what,
                position: found - 1,
                found,
                limit: u32::MAX as usize,
            });
        }
    }
    Ok(())
}

/// The order of the interior nodes with fewer operations, its tree, its name, and the seconds
/// used.
fn best_order(
    nodes: &SupervariableGraph,
    options: &Options,
) -> Result<(Vec<u32>, Tree, &'static str, f64), Error> {
    let begin = Instant::now();
    let (inner, dense) = nodes.split_dense();
    let (start, neighbours, weight) = nodes.subgraph(&inner);
    let graph = Graph::new(&start, &neighbours, &weight)?;
    let back = |order: Vec<u32>| -> Vec<u32> {
        let picked = order.into_iter().map(|v| inner[v as usize]);
        picked.chain(dense.iter().copied()).collect()
    };
    let counted = |name: &'static str, order: Vec<u32>| {
        let order = back(order);
        let tree = Tree::new(nodes, &order);
        (order, tree, name)
    };
    let by_places = options.coordinates.map(|at| {
        let place = |&v: &u32| at[nodes.members(v as usize)[0] as usize];
        let places: Vec<[f64; 3]> = inner.iter().map(place).collect();
        counted("coordinate bisection", by_coordinates(&graph, &places))
    });
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let worth = tuning::worth_metis() * inner.len() as f64;
    let best = match by_places {
        Some(found) if found.1.flops <= worth => Some(found),
        found => match (by_metis(&graph).map(|order| counted("METIS", order)), found) {
            (Some(a), Some(b)) => Some(if b.1.flops < a.1.flops { b } else { a }),
            (a, b) => a.or(b),
        },
    };
    let numbered = || counted("as numbered", (0..).take(inner.len()).collect());
    let (order, tree, name) = best.unwrap_or_else(numbered);
    let seconds = begin.elapsed().as_secs_f64();
    Ok((order, tree, name, seconds))
}
