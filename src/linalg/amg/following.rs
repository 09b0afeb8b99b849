//! A preconditioner that follows changes at a few nodes: the statuses of contacts.
//!
//! The aggregates are chosen once, without a change. A change at a node then reaches the motions
//! of its aggregate, the rows of `P` beside this aggregate, and the blocks of `Pᵀ A P` of the
//! aggregates about them. All else keeps its bits, and what is computed anew has the bits of a
//! set-up from the start. Coarser levels are small: they are made again.

use std::borrow::Cow;
use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::amg::aggregates::Aggregates;
use crate::linalg::amg::block_matrix::{ABSENT, BlockMatrix};
use crate::linalg::amg::coarsest::Coarsest;
use crate::linalg::amg::galerkin;
use crate::linalg::amg::hierarchy::{Levels, failure, level, omega, running};
use crate::linalg::amg::inverse_diagonal::invert_node;
use crate::linalg::amg::level::Level;
use crate::linalg::amg::multigrid::{Multigrid, check_lengths};
use crate::linalg::amg::node_rows::NodeRows;
use crate::linalg::amg::nodes::LevelNodes;
use crate::linalg::amg::prolongation::{Prolongation, Smoothed};
use crate::linalg::amg::scaled_blocks::ScaledBlocks;
use crate::linalg::amg::settings::CycleSettings;
use crate::linalg::amg::single_rows::{LevelMatrix, SingleRows};
use crate::linalg::amg::tentative::Tentative;
use crate::linalg::amg::tuning;

/// Multigrid whose matrix changes at some nodes.
#[derive(Debug)]
pub struct Following {
    b: usize,
    rows: NodeRows,
    held: Vec<bool>,
    /// Springs of the nodes of `rows`, in the units of the matrix before it was scaled.
    springs: Vec<f64>,
    finest: Finest,
    multigrid: Multigrid,
    ready: bool,
}

/// The finest level.
#[derive(Debug)]
enum Finest {
    /// Few unknowns, which the coarsest level has all.
    Small(BlockMatrix),
    /// The level itself is with the others.
    Large(Box<Kept>),
}

/// What is left of the set-up of the finest level.
#[derive(Debug)]
struct Kept {
    aggregates: Aggregates,
    tentative: Tentative,
    /// The next matrix, with zeros for unknowns without a motion.
    coarse: BlockMatrix,
    /// The rows of the matrix that a change needs, in single precision.
    near: BlockMatrix,
    /// The nodes whose motions a change reads.
    read: Vec<bool>,
}

impl Following {
    /// `matrix` without held unknowns, but for those without a degree of freedom; `nodes` may
    /// change, with those that its variables belong to. Nothing can be solved before
    /// [`Following::update`].
    pub fn new(
        matrix: &SingleRows<'_>,
        about: &LevelNodes,
        nodes: Vec<u32>,
        settings: &CycleSettings,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let own = LevelMatrix::Made(matrix);
        let (b, held) = (own.b(), matrix.matrix().held().to_vec());
        check_lengths(b, own.nodes(), about, &held);
        let rows = NodeRows::new(matrix, nodes);
        let springs = vec![0.0; rows.nodes.len() * b * b];
        let mut multigrid = Multigrid::empty(held.len(), own.exponent(), settings);
        let finest = if held.len() <= tuning::dense_unknowns() {
            Finest::Small(matrix.whole())
        } else {
            let made = level(own, about, &held, settings.spectrum, stop)?;
            let reached = reach(&rows.nodes, &made.aggregates, own, &made.p);
            let near = matrix.only(&reached.needed(&made.p));
            let (level, aggregates, tentative, coarse) = made.level(ScaledBlocks::new(own));
            multigrid.replace(vec![level], Coarsest::none());
            Finest::Large(Box::new(Kept {
                aggregates,
                tentative,
                coarse,
                near,
                read: reached.read,
            }))
        };
        Ok(Self {
            b,
            rows,
            held,
            springs,
            finest,
            multigrid,
            ready: false,
        })
    }

    /// Follows to `held` unknowns and to a spring at each of the nodes that may change, `b × b`
    /// by columns; `about` is that of [`Following::new`], too large to be kept, with the motions of
    /// [`Following::nodes_read`] at least. The bits do not depend on what was before. After an error
    /// this cannot be used.
    pub fn update(
        &mut self,
        about: &LevelNodes,
        held: &[bool],
        springs: &[f64],
        stop: &AtomicBool,
    ) -> Result<(), Error> {
        assert_eq!(held.len(), self.held.len());
        assert_eq!(springs.len(), self.springs.len());
        let b = self.b;
        let changed: Vec<usize> = (0..self.rows.nodes.len())
            .filter(|&k| {
                let i = b * self.rows.nodes[k] as usize;
                let spring = b * b * k..b * b * (k + 1);
                held[i..i + b] != self.held[i..i + b]
                    || springs[spring.clone()] != self.springs[spring]
            })
            .collect();
        if self.ready && changed.is_empty() {
            return Ok(());
        }
        self.ready = false;
        for &k in &changed {
            let i = b * self.rows.nodes[k] as usize;
            self.held[i..i + b].copy_from_slice(&held[i..i + b]);
            let spring = b * b * k..b * b * (k + 1);
            self.springs[spring.clone()].copy_from_slice(&springs[spring]);
        }
        let write = |matrix: &mut BlockMatrix| {
            for &k in &changed {
                self.rows
                    .write(k, matrix, held, &springs[b * b * k..b * b * (k + 1)]);
            }
        };
        match &mut self.finest {
            Finest::Small(matrix) => {
                write(matrix);
                let made = Levels::new(Cow::Borrowed(matrix), about.clone(), None, stop)?;
                self.multigrid.replace(made.list, made.coarsest);
            }
            Finest::Large(kept) => {
                let mut levels = std::mem::take(&mut self.multigrid.levels);
                levels.truncate(1);
                let finest = levels
                    .first_mut()
                    .ok_or(failure("the finest level is missing"))?;
                write(&mut kept.near);
                let nodes: Vec<u32> = changed.iter().map(|&k| self.rows.nodes[k]).collect();
                kept.follow(finest, &nodes, about, &self.held, stop)?;
                kept.coarse.replace_dead(&kept.tentative.dead);
                let next = kept.aggregates.coarse(about, kept.tentative.coarse.clone());
                let below = Levels::new(Cow::Borrowed(&kept.coarse), next, None, stop)?;
                kept.coarse.clear_dead(&kept.tentative.dead);
                levels.extend(below.list);
                self.multigrid.replace(levels, below.coarsest);
            }
        }
        self.ready = true;
        Ok(())
    }

    /// The nodes whose motions an update reads; `None` if it may be all.
    pub fn nodes_read(&self) -> Option<&[bool]> {
        match &self.finest {
            Finest::Small(_) => None,
            Finest::Large(kept) => Some(&kept.read),
        }
    }

    /// `x ≈ A⁻¹ b`, as [`Multigrid::apply`], with a smoother of this degree.
    pub fn apply(&mut self, degree: usize, b: &[f64], x: &mut [f64]) {
        self.multigrid.set_degree(degree);
        self.multigrid.apply(b, x);
    }

    /// Memory of all levels, and of what the next change needs.
    pub fn bytes(&self) -> usize {
        let finest = match &self.finest {
            Finest::Small(matrix) => matrix.bytes(),
            Finest::Large(kept) => {
                let matrices = kept.coarse.bytes() + kept.near.bytes();
                matrices + kept.tentative.bytes() + kept.aggregates.bytes() + kept.read.len()
            }
        };
        self.multigrid.bytes() + self.rows.bytes() + 8 * self.springs.len() + finest
    }
}

impl Kept {
    /// Computes anew what depends on the rows of `nodes`, which the matrix has already.
    fn follow(
        &mut self,
        finest: &mut Level,
        nodes: &[u32],
        about: &LevelNodes,
        held: &[bool],
        stop: &AtomicBool,
    ) -> Result<(), Error> {
        let (b, near) = (self.near.b, &self.near);
        for &i in nodes {
            let own = i as usize * b * b;
            let inverse = &mut finest.inverse[own..own + b * b];
            if !invert_node(near.diagonal_block(i as usize), inverse) {
                return Err(failure("a diagonal entry is not positive, or not finite"));
            }
        }
        let matrix = LevelMatrix::Whole(near);
        let reached = reach(nodes, &self.aggregates, matrix, &finest.p);
        self.tentative.update(
            &reached.aggregates,
            &self.aggregates,
            &about.motions,
            held,
            b,
        );
        running(stop)?;
        let of = Smoothed {
            matrix,
            inverse: &finest.inverse,
            aggregates: &self.aggregates,
            tentative: &self.tentative,
            about,
            omega: omega(finest.spectrum),
        };
        finest.p.smooth(&of, Some(&reached.rows));
        running(stop)?;
        galerkin::update(&mut self.coarse, matrix, &finest.p, &reached.coarse);
        for &i in &reached.changed {
            finest.matrix.copy_row(i as usize, near);
        }
        running(stop)
    }
}

/// What the rows of some nodes determine.
struct Reach {
    /// These nodes and their neighbours: rows that a change of a row and its mirror image changes.
    changed: Vec<u32>,
    /// Aggregates whose motions change, ascending.
    aggregates: Vec<u32>,
    /// Rows of `P` that change: of nodes beside a changed row of `T` or of `A`.
    rows: Vec<bool>,
    /// The nodes beside these, too: those whose motions they are made of.
    read: Vec<bool>,
    /// Coarse nodes whose rows change: those of the rows of `A P` of nodes beside these.
    coarse: Vec<bool>,
}

fn reach(
    nodes: &[u32],
    aggregates: &Aggregates,
    matrix: LevelMatrix<'_>,
    p: &Prolongation,
) -> Reach {
    let mut which: Vec<u32> = nodes
        .iter()
        .map(|&i| aggregates.of_node[i as usize])
        .filter(|&g| g != ABSENT)
        .collect();
    which.sort_unstable();
    which.dedup();
    let mut reached = Reached::new(matrix.nodes());
    for &i in nodes {
        reached.add(i);
    }
    reached.spread(matrix);
    let changed = reached.list.clone();
    let mut reached = Reached::new(matrix.nodes());
    let members = which
        .iter()
        .flat_map(|&g| aggregates.members_of(g as usize));
    for &i in nodes.iter().chain(members) {
        reached.add(i);
    }
    reached.spread(matrix);
    let rows = reached.is.clone();
    reached.spread(matrix);
    let mut coarse = vec![false; aggregates.count()];
    for &i in &reached.list {
        for &g in &p.column[p.row(i as usize)] {
            coarse[g as usize] = true;
        }
    }
    Reach {
        changed,
        aggregates: which,
        rows,
        read: reached.is,
        coarse,
    }
}

impl Reach {
    /// The rows of the matrix that the new coarse rows are made of.
    fn needed(&self, p: &Prolongation) -> Vec<bool> {
        let mut needed = self.rows.clone();
        for &i in &self.changed {
            needed[i as usize] = true;
        }
        for g in (0..self.coarse.len()).filter(|&g| self.coarse[g]) {
            for &[i, _] in p.coarse_row(g) {
                needed[i as usize] = true;
            }
        }
        needed
    }
}

/// A growing set of nodes.
struct Reached {
    is: Vec<bool>,
    list: Vec<u32>,
}

impl Reached {
    fn new(nodes: usize) -> Self {
        Self {
            is: vec![false; nodes],
            list: Vec::new(),
        }
    }

    fn add(&mut self, node: u32) {
        if !std::mem::replace(&mut self.is[node as usize], true) {
            self.list.push(node);
        }
    }

    /// Adds the neighbours of all nodes.
    fn spread(&mut self, matrix: LevelMatrix<'_>) {
        for k in 0..self.list.len() {
            for &node in matrix.columns(self.list[k] as usize) {
                self.add(node);
            }
        }
    }
}
