//! Symbolic analysis: the tree of fronts and what it will cost.
//!
//! Works on *nodes*, groups of unknowns with the same pattern: a ninth of the
//! work in 3D. The kept nodes come after all others and are never eliminated;
//! they form the root of the tree, whose matrix is the Schur complement.

use std::borrow::Cow;
use std::ops::{Deref, Range};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use rayon::prelude::*;

use crate::error::Error;
use crate::linalg::csc::{Symmetric, narrow};
use crate::linalg::ordering::{Graph, by_coordinates, by_metis};
use crate::linalg::packed::{Packed, Panel, Run};
use crate::linalg::quotient::Quotient;
use crate::linalg::tree::{Tree, flops_of};

/// Work of a subtree that one thread does alone [flop]: some milliseconds, far
/// above the cost of handing it out. Where all there is is little more than that,
/// a part of it, but no less than what is worth handing out.
const LEAF_FLOPS: std::ops::RangeInclusive<f64> = 1e7..=2e8;

/// Subtrees that a small tree is cut into, about.
const PARTS: f64 = 16.0;

/// Work a node up to which METIS is not asked where coordinates have given an order
/// [flop]: it takes some 10 µs a node, and half of so much work takes no longer.
const WORTH_METIS: f64 = 1e6;

/// What the analysis may use besides the matrix.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options<'a> {
    /// Place of each unknown, for bisection by coordinates. Any unit, and the
    /// third coordinate may be zero. METIS is then asked too, and the order of fewer
    /// operations taken, where there is more work than METIS itself costs.
    pub coordinates: Option<&'a [[f64; 3]]>,
}

/// What the factorisation will cost, counted before anything is allocated.
#[derive(Clone, Debug, PartialEq)]
pub struct Counts {
    /// Unknowns, and those of them that are kept.
    pub n: usize,
    /// Kept unknowns, the order of S.
    pub kept: usize,
    /// Entries of the factor: the eliminated columns, kept rows included.
    pub nnz_factor: usize,
    /// Additions and multiplications of the partial factorisation.
    pub flops: f64,
    /// Memory that the factor and S hold.
    pub bytes_factor: usize,
    /// Largest memory on the way, on one thread, the analysis included.
    pub bytes_peak: usize,
    /// The same where the factor is not kept, only S.
    pub bytes_peak_dropped: usize,
    /// What `bytes_peak` may become on any number of threads, in whatever order
    /// they come: what no order exceeds, and few come near.
    pub bytes_peak_threads: usize,
    /// Memory of the analysis itself.
    pub bytes_symbolic: usize,
    /// Where the elimination order comes from.
    pub ordering: &'static str,
    /// Seconds spent ordering.
    pub seconds_order: f64,
    /// Seconds spent on the rest of the analysis.
    pub seconds_symbolic: f64,
}

/// One front: `np` pivots, then `nu` rows that it updates.
#[derive(Clone, Debug)]
pub(crate) struct Front {
    /// First pivot in elimination numbering.
    pub(crate) first: usize,
    /// First pivot of all its descendants.
    pub(crate) base: usize,
    pub(crate) np: usize,
    pub(crate) nu: usize,
    /// Front that takes the update; `None`: it goes to S.
    pub(crate) parent: Option<usize>,
    /// Where its panel lies in the factor.
    pub(crate) panel: usize,
    /// Updated rows, in [`Symbolic::runs`].
    pub(crate) runs: Range<usize>,
    /// Entries of K in the pivots' rows, in [`Symbolic::entries`].
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

/// A stretch of fronts that one thread works through in order.
#[derive(Clone, Debug)]
pub(crate) struct Task {
    /// Fronts, consecutive in postorder. More than one: whole subtrees, small
    /// together. One alone may be large and is then shared out by tiles.
    pub(crate) fronts: Range<usize>,
    /// Whether it consumes updates of other tasks and is shared out by tiles.
    pub(crate) is_top: bool,
    /// Task of the front that takes the updates; `None`: they go to S.
    pub(crate) parent: Option<usize>,
    /// Tasks whose updates come here, in order.
    pub(crate) children: Range<usize>,
    /// Stack that the fronts need [f64].
    pub(crate) stack: usize,
    /// What remains on the stack: the updates of the subtrees' roots.
    pub(crate) left: usize,
    /// The largest of the panels [f64].
    pub(crate) panel: usize,
}

/// The analysis of one pattern, with memory for its factors.
#[derive(Debug)]
pub struct Symbolic {
    plan: Arc<Plan>,
    counts: Counts,
    /// Memory of a factor of this pattern that is gone, for the next one: fresh
    /// memory costs a second a gigabyte when it is first touched.
    spare: Mutex<Vec<f64>>,
}

impl Deref for Symbolic {
    type Target = Plan;

    fn deref(&self) -> &Plan {
        &self.plan
    }
}

/// Who is eliminated when, and what goes where: good for every matrix of the
/// pattern, and for several problems at once.
#[derive(Debug)]
pub struct Plan {
    pub(crate) n: usize,
    /// Eliminated unknowns; those from here on, in elimination numbering, are
    /// kept, in the order the caller gave.
    pub(crate) interior: usize,
    /// The caller's unknown at each place of the elimination order.
    pub(crate) old: Vec<u32>,
    /// Place in the elimination order of each of the caller's unknowns.
    pub(crate) new: Vec<u32>,
    pub(crate) fronts: Vec<Front>,
    pub(crate) runs: Vec<Run>,
    /// (position in K's values, position in the front's panel).
    pub(crate) entries: Vec<(u32, u32)>,
    pub(crate) tasks: Vec<Task>,
    /// Child lists that [`Task::children`] points into.
    pub(crate) task_children: Vec<usize>,
    /// Tasks whose updates go to S, in order.
    pub(crate) roots: Vec<usize>,
    pub(crate) panels: usize,
    /// Most that updates take on one thread, and with a panel that is not kept
    /// [f64].
    pub(crate) stack: usize,
    pub(crate) stack_dropped: usize,
    fingerprints: Vec<u64>,
}

impl Symbolic {
    /// Orders and analyses the pattern of `k`, to eliminate all but `kept`.
    ///
    /// `kept` may be empty or hold every unknown; S comes out in its order. The
    /// rest may be in many pieces. Stored zeros count as pattern.
    ///
    /// # Errors
    /// [`Error::IndexRange`] and [`Error::Repeated`] for `kept`,
    /// [`Error::Shape`] and [`Error::NotFinite`] for the coordinates, and
    /// [`Error::IndexRange`] for a matrix that 32-bit indices cannot number.
    pub fn analyse(k: &Symmetric, kept: &[usize], options: &Options) -> Result<Self, Error> {
        let begin = Instant::now();
        let n = k.n();
        check_sizes(k)?;
        let place = places_of_kept(n, kept)?;
        if let Some(at) = options.coordinates {
            check_coordinates(at, n)?;
        }
        let pattern = Pattern::of(k);
        let nodes = Quotient::new(&pattern.col_ptr, &pattern.row_idx, kept, &place);
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
        // S is made when the last updates have reached it, and the diagonal of
        // K goes along.
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
            fingerprints: (0..n).into_par_iter().map(|j| fingerprint(k, j)).collect(),
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
            spare: Mutex::default(),
        })
    }

    /// What the factorisation will cost.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// The same analysis for another problem, which has memory of its own and spends
    /// no time on it.
    #[must_use]
    pub fn for_another(&self) -> Self {
        let counts = Counts {
            seconds_order: 0.0,
            seconds_symbolic: 0.0,
            ..self.counts.clone()
        };
        Self {
            plan: Arc::clone(&self.plan),
            counts,
            spare: Mutex::default(),
        }
    }

    /// Bytes held for the next factor of this pattern, which
    /// [`Counts::bytes_peak`] counts among what it takes.
    #[must_use]
    pub fn bytes_spare(&self) -> usize {
        let spare = self.spare.try_lock();
        spare.map_or(0, |spare| size_of_val(spare.as_slice()))
    }

    /// Memory for a factor, used before or none. Nobody waits: in a forked child
    /// the lock may be held by a thread that is not there.
    pub(crate) fn take_spare(&self) -> Vec<f64> {
        let spare = self.spare.try_lock();
        spare.map_or_else(|_| Vec::new(), |mut spare| std::mem::take(&mut *spare))
    }

    /// Keeps the memory of a factor for the next one.
    pub(crate) fn give_spare(&self, panels: Vec<f64>) {
        if let Ok(mut spare) = self.spare.try_lock() {
            *spare = panels;
        }
    }
}

impl Plan {
    /// Order of S.
    #[must_use]
    pub fn kept(&self) -> usize {
        self.n - self.interior
    }

    /// Whether `k` has the pattern analysed.
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::SparseStructure`].
    pub(crate) fn check_pattern(&self, k: &Symmetric) -> Result<(), Error> {
        if k.n() != self.n {
            return Err(Error::Shape {
                what: "K",
                expected: self.n,
                found: k.n(),
            });
        }
        let other = |&j: &usize| fingerprint(k, j) != self.fingerprints[j];
        match (0..self.n).into_par_iter().find_first(other) {
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

/// A number that tells the pattern of a column from others, place included.
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

/// Place of each kept unknown in `kept`.
fn places_of_kept(n: usize, kept: &[usize]) -> Result<Vec<Option<u32>>, Error> {
    let mut place: Vec<Option<u32>> = vec![None; n];
    for (position, &dof) in kept.iter().enumerate() {
        let slot = place.get_mut(dof).ok_or(Error::IndexRange {
            what: "list of kept degrees of freedom",
            position,
            found: dof,
            limit: n,
        })?;
        if let Some(first) = *slot {
            return Err(Error::Repeated {
                what: "list of kept degrees of freedom",
                index: dof,
                first: first as usize,
                second: position,
            });
        }
        *slot = u32::try_from(position).ok();
    }
    Ok(place)
}

fn check_coordinates(at: &[[f64; 3]], n: usize) -> Result<(), Error> {
    if at.len() != n {
        return Err(Error::Shape {
            what: "coordinates",
            expected: n,
            found: at.len(),
        });
    }
    for (index, x) in at.iter().enumerate() {
        if let Some(&value) = x.iter().find(|x| !x.is_finite()) {
            return Err(Error::NotFinite {
                what: "coordinates",
                index,
                value,
            });
        }
    }
    Ok(())
}

/// The pattern with both triangles: K's own, unless rounding has cancelled an
/// entry on one side only.
struct Pattern<'a> {
    col_ptr: Cow<'a, [usize]>,
    row_idx: Cow<'a, [usize]>,
    /// Where K is whole, of each entry above the diagonal the place of its partner
    /// below: a search in every column would take longer than all else of the analysis.
    partner: Option<Vec<u32>>,
}

impl<'a> Pattern<'a> {
    fn of(k: &Symmetric<'a>) -> Self {
        let mut whole = true;
        let mut partner = vec![0; k.values().len()];
        k.pairs(|_, _, lower, upper| match (lower, upper) {
            (Some(lower), Some(upper)) => partner[upper] = narrow(lower),
            _ => whole = false,
        });
        if whole {
            return Self {
                col_ptr: Cow::Borrowed(k.col_ptr()),
                row_idx: Cow::Borrowed(k.row_idx()),
                partner: Some(partner),
            };
        }
        let mut columns: Vec<Vec<usize>> = (0..k.n()).map(|j| vec![j]).collect();
        k.pairs(|i, j, _, _| {
            columns[j].push(i);
            columns[i].push(j);
        });
        let mut col_ptr = vec![0];
        let mut row_idx = Vec::new();
        for mut column in columns {
            column.sort_unstable();
            row_idx.extend(column);
            col_ptr.push(row_idx.len());
        }
        Self {
            col_ptr: Cow::Owned(col_ptr),
            row_idx: Cow::Owned(row_idx),
            partner: None,
        }
    }
}

/// Order of the interior nodes with the fewer flops, its tree, its name, and
/// the seconds that finding it took.
fn best_order(
    nodes: &Quotient,
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
    let worth = WORTH_METIS * inner.len() as f64;
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

/// Fronts, rows and numbering, as they are built.
struct Layout<'a> {
    nodes: &'a Quotient,
    /// Nodes in elimination order, kept ones last.
    order: Vec<u32>,
    /// Place of each node in that order.
    place: Vec<u32>,
    /// First unknown of each place; one more at the end.
    offset: Vec<u32>,
    old: Vec<u32>,
    new: Vec<u32>,
    fronts: Vec<Front>,
    /// Places (in `order`) of the pivots of each front.
    pivots: Vec<Range<usize>>,
    /// Fronts whose updates each front takes.
    children: Vec<Vec<usize>>,
    /// Updated rows of each front, places, and where each starts in the front.
    rows: Vec<Vec<u32>>,
    runs: Vec<Run>,
    panels: usize,
}

impl<'a> Layout<'a> {
    fn new(nodes: &'a Quotient, tree: &Tree, node_order: &[u32]) -> Self {
        let mut order: Vec<u32> = Vec::with_capacity(nodes.len());
        let mut fronts: Vec<Front> = Vec::with_capacity(tree.fronts.len());
        let mut pivots = Vec::with_capacity(tree.fronts.len());
        let mut children = vec![Vec::new(); tree.fronts.len()];
        let (mut first, mut panels) = (0, 0);
        for (f, front) in tree.fronts.iter().enumerate() {
            let from = order.len();
            order.extend(front.nodes.iter().map(|&v| node_order[v as usize]));
            pivots.push(from..order.len());
            let base = children[f].iter().map(|&child: &usize| fronts[child].base);
            fronts.push(Front {
                first,
                base: base.fold(first, usize::min),
                np: front.np,
                nu: front.nf - front.np,
                parent: front.parent,
                panel: panels,
                runs: 0..0,
                entries: 0..0,
            });
            if let Some(parent) = front.parent {
                children[parent].push(f);
            }
            first += front.np;
            panels += Panel::new(front.np, front.nf).len();
        }
        order.extend(nodes.kept());
        let n = nodes.unknowns();
        let mut place = vec![0; order.len()];
        let mut offset = Vec::with_capacity(order.len() + 1);
        let mut old = Vec::with_capacity(n);
        let mut new = vec![0; n];
        for (at, &v) in (0_u32..).zip(&order) {
            place[v as usize] = at;
            offset.push(narrow(old.len()));
            for &dof in nodes.members(v as usize) {
                new[dof as usize] = narrow(old.len());
                old.push(dof);
            }
        }
        offset.push(narrow(old.len()));
        Self {
            nodes,
            order,
            place,
            offset,
            old,
            new,
            fronts,
            pivots,
            children,
            rows: Vec::new(),
            runs: Vec::new(),
            panels,
        }
    }

    /// Rows that each front updates: the later neighbours of its pivots, and
    /// what its children update, less its own pivots.
    fn place_rows(&mut self) {
        let mut seen = vec![u32::MAX; self.order.len()];
        for f in 0..self.fronts.len() {
            let stamp = narrow(f);
            let pivots = self.pivots[f].clone();
            let mut rows: Vec<u32> = Vec::new();
            let mut add = |q: u32| {
                if q as usize >= pivots.end && seen[q as usize] != stamp {
                    seen[q as usize] = stamp;
                    rows.push(q);
                }
            };
            for &v in &self.order[pivots.clone()] {
                for &w in self.nodes.neighbours(v as usize) {
                    add(self.place[w as usize]);
                }
            }
            for &child in &self.children[f] {
                self.rows[child].iter().for_each(|&q| add(q));
            }
            rows.sort_unstable();
            let from = self.runs.len();
            let mut nu = 0;
            for &q in &rows {
                let (start, end) = (self.offset[q as usize], self.offset[q as usize + 1]);
                nu += (end - start) as usize;
                match self.runs[from..].last_mut() {
                    Some(run) if run.start + run.len == start => run.len += end - start,
                    _ => self.runs.push(Run {
                        start,
                        len: end - start,
                    }),
                }
            }
            debug_assert_eq!(nu, self.fronts[f].nu, "the counts foretold another front");
            self.fronts[f].runs = from..self.runs.len();
            self.rows.push(rows);
        }
    }

    /// Where each entry of K goes, front by front. Of a pair, the entry of K's
    /// lower triangle is taken, whichever of the two unknowns comes first.
    fn place_entries(&mut self, k: &Symmetric, pattern: &Pattern) -> Vec<(u32, u32)> {
        let count = |p: usize| {
            if pattern.partner.is_some() {
                let j = self.old[p] as usize;
                let rows = &pattern.row_idx[pattern.col_ptr[j]..pattern.col_ptr[j + 1]];
                rows.iter().filter(|&&i| self.new[i] as usize >= p).count()
            } else {
                self.later(k, pattern, p).count()
            }
        };
        let pivots = |front: &Front| front.first..front.first + front.np;
        let counts: Vec<usize> = self
            .fronts
            .par_iter()
            .map(|front| pivots(front).map(count).sum())
            .collect();
        let mut entries = vec![(0, 0); counts.iter().sum()];
        let mut rest = entries.as_mut_slice();
        let mut parts = Vec::with_capacity(counts.len());
        let mut from = 0;
        for (front, count) in self.fronts.iter_mut().zip(counts) {
            let (part, next) = std::mem::take(&mut rest).split_at_mut(count);
            parts.push(part);
            rest = next;
            front.entries = from..from + count;
            from += count;
        }
        let scratch = || vec![0_u32; self.order.len()];
        // Few scratches: each is as long as the order.
        parts
            .into_par_iter()
            .enumerate()
            .with_min_len(self.fronts.len().div_ceil(64).max(1))
            .for_each_init(scratch, |shift, (f, part)| {
                self.place_entries_of(f, k, pattern, shift, part);
            });
        entries
    }

    /// Entries of K in the row of pivot `p` of its front: places of unknowns, and
    /// positions in K's values.
    fn later<'p>(
        &'p self,
        k: &'p Symmetric,
        pattern: &'p Pattern,
        p: usize,
    ) -> impl Iterator<Item = (usize, usize)> + 'p {
        let j = self.old[p] as usize;
        (pattern.col_ptr[j]..pattern.col_ptr[j + 1]).filter_map(move |at| {
            let i = pattern.row_idx[at];
            if (self.new[i] as usize) < p {
                return None;
            }
            let value = match &pattern.partner {
                Some(_) if i >= j => Some(at),
                Some(partner) => Some(partner[at] as usize),
                None => k.position(i.max(j), i.min(j)),
            };
            value.map(|value| (i, value))
        })
    }

    /// `shift` becomes the column of this front at which a place starts, less
    /// `offset`.
    fn place_entries_of(
        &self,
        f: usize,
        k: &Symmetric,
        pattern: &Pattern,
        shift: &mut [u32],
        entries: &mut [(u32, u32)],
    ) {
        let pivots = self.pivots[f].clone();
        let front = &self.fronts[f];
        let layout = front.layout();
        let mut column = 0;
        for q in pivots.chain(self.rows[f].iter().map(|&q| q as usize)) {
            shift[q] = column;
            column += self.offset[q + 1] - self.offset[q];
        }
        let rows = front.first..front.first + front.np;
        let found = rows.flat_map(|p| self.later(k, pattern, p).map(move |found| (p, found)));
        for (entry, (p, (i, value))) in entries.iter_mut().zip(found) {
            let node = self.place[self.nodes.node_of(i)] as usize;
            let column = (shift[node] + self.new[i] - self.offset[node]) as usize;
            *entry = (narrow(value), narrow(layout.at(p - front.first, column)));
        }
    }
}

/// Who works on what: small subtrees whole, large fronts one at a time.
struct Tasks {
    list: Vec<Task>,
    children: Vec<usize>,
    roots: Vec<usize>,
    /// Largest stack of updates on one thread [f64].
    peak: usize,
    /// The same with the panel at work beside it.
    peak_dropped: usize,
    /// What is left for S in the end.
    end: usize,
}

impl Tasks {
    fn new(fronts: &[Front], children: &[Vec<usize>]) -> Self {
        let mut work: Vec<f64> = fronts.iter().map(|f| flops_of(f.np, f.nf())).collect();
        let mut first: Vec<usize> = (0..fronts.len()).collect();
        for (f, front) in fronts.iter().enumerate() {
            if let Some(parent) = front.parent {
                work[parent] += work[f];
                first[parent] = first[parent].min(first[f]);
            }
        }
        let roots = (0..fronts.len()).filter(|&f| fronts[f].parent.is_none());
        let whole: f64 = roots.map(|f| work[f]).sum();
        let leaf = (whole / PARTS).clamp(*LEAF_FLOPS.start(), *LEAF_FLOPS.end());
        let mut this = Self {
            list: Vec::new(),
            children: Vec::new(),
            roots: Vec::new(),
            peak: 0,
            peak_dropped: 0,
            end: 0,
        };
        // Updates wait on one stack when one thread does all in order.
        let mut stack: Vec<(Option<usize>, usize)> = Vec::new();
        let mut height = 0;
        let mut task_of: Vec<Vec<usize>> = vec![Vec::new(); fronts.len()];
        let mut f = 0;
        while f < fronts.len() {
            // The largest small subtree that begins here, else the front alone.
            let mut end = f;
            let mut at = f;
            let mut sum = 0.0;
            let parent = loop {
                // Climb while the subtree is small.
                let mut top = at;
                while let Some(up) = fronts[top].parent {
                    if work[up] > leaf || first[up] != at {
                        break;
                    }
                    top = up;
                }
                if work[top] > leaf || first[top] != at || sum + work[top] > leaf {
                    break (end > f).then(|| fronts[end - 1].parent);
                }
                let parent = fronts[top].parent;
                if end > f && fronts[end - 1].parent != parent {
                    break Some(fronts[end - 1].parent);
                }
                sum += work[top];
                end = top + 1;
                at = end;
                if at == fronts.len() {
                    break Some(parent);
                }
            };
            let number = this.list.len();
            let is_top = parent.is_none();
            let range = if is_top { f..f + 1 } else { f..end };
            let parent = parent.unwrap_or(fronts[f].parent);
            let from = this.children.len();
            if is_top {
                this.children.append(&mut task_of[f]);
            }
            let (need, left) = stack_of(fronts, children, range.clone());
            let largest = fronts[range.clone()].iter().map(|f| f.layout().len()).max();
            let panel = largest.unwrap_or(0);
            this.peak = this.peak.max(height + need);
            this.peak_dropped = this.peak_dropped.max(height + need + panel);
            while is_top && stack.last().is_some_and(|&(taker, _)| taker == Some(f)) {
                height -= stack.pop().map_or(0, |(_, len)| len);
            }
            stack.push((parent, left));
            height += left;
            match parent {
                Some(parent) => task_of[parent].push(number),
                None => this.roots.push(number),
            }
            f = range.end;
            this.list.push(Task {
                fronts: range,
                is_top,
                parent,
                children: from..this.children.len(),
                stack: need,
                left,
                panel,
            });
        }
        this.end = height;
        // Parents were fronts until every task had its number.
        let mut of_front = vec![0; fronts.len()];
        for (number, task) in this.list.iter().enumerate() {
            of_front[task.fronts.clone()].fill(number);
        }
        for task in &mut this.list {
            task.parent = task.parent.map(|front| of_front[front]);
        }
        this
    }
}

impl Tasks {
    /// Most that updates take when tasks are done in any order, children first:
    /// of each subtree its root is done, or at work above its children, or
    /// neither and its subtrees stand for themselves.
    fn most(&self) -> usize {
        let mut of: Vec<usize> = Vec::with_capacity(self.list.len());
        for task in &self.list {
            let children = &self.children[task.children.clone()];
            let done: usize = children.iter().map(|&child| self.list[child].left).sum();
            let apart: usize = children.iter().map(|&child| of[child]).sum();
            of.push(apart.max(done + task.stack));
        }
        self.roots.iter().map(|&root| of[root]).sum()
    }
}

/// Stack that a task needs, and what it leaves: an update is made above those
/// of its children, then takes their place.
fn stack_of(fronts: &[Front], children: &[Vec<usize>], range: Range<usize>) -> (usize, usize) {
    let (mut height, mut peak) = (0_usize, 0_usize);
    for f in range.clone() {
        let own = fronts[f].update().len();
        peak = peak.max(height + own);
        let inside = children[f].iter().filter(|&&child| child >= range.start);
        let taken: usize = inside.map(|&child| fronts[child].update().len()).sum();
        height = height + own - taken;
    }
    (peak, height)
}
