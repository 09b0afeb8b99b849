//! Division of the fronts into tasks: small subtrees whole, large fronts one by one.

use std::ops::Range;

use crate::linalg::sparse::symbolic::{Front, Task};
use crate::linalg::sparse::tree::flops_of;
use crate::linalg::sparse::tuning;

/// The tasks: small subtrees whole, large fronts one by one.
pub(super) struct Tasks {
    pub(super) list: Vec<Task>,
    pub(super) children: Vec<usize>,
    pub(super) roots: Vec<usize>,
    /// Largest stack of updates on one thread [f64].
    pub(super) peak: usize,
    /// Largest stack of updates with the current panel besides it [f64].
    pub(super) peak_dropped: usize,
    /// The rest for S at the end.
    pub(super) end: usize,
}

impl Tasks {
    pub(super) fn new(fronts: &[Front], children: &[Vec<usize>]) -> Self {
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
        let leaf =
            (whole / tuning::task_parts()).clamp(tuning::least_leaf(), tuning::largest_leaf());
        let mut this = Self {
            list: Vec::new(),
            children: Vec::new(),
            roots: Vec::new(),
            peak: 0,
            peak_dropped: 0,
            end: 0,
        };
        // On one thread in order, updates wait on one stack.
        let mut stack: Vec<(Option<usize>, usize)> = Vec::new();
        let mut height = 0;
        let mut task_of: Vec<Vec<usize>> = vec![Vec::new(); fronts.len()];
        let mut f = 0;
        while f < fronts.len() {
            // The largest small subtree that begins here, or else the front alone.
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
        // Until now parents were fronts; now every task has its number.
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
    /// Largest memory of updates if tasks run in any order, children first: for each subtree,
    /// its root is finished, or it is in progress with its children waiting, or neither and its
    /// own subtrees count.
    pub(super) fn most(&self) -> usize {
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

/// Stack of a task, and its rest: an update is made above those of its children, then takes
/// their place.
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
