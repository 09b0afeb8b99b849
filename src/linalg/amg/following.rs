//! A preconditioner that follows changes at a few nodes: the statuses of contacts.
//!
//! Aggregates and bounds of spectra are chosen once, without a change. A change at a node then
//! reaches the motions of its aggregate, the rows of `P` beside this aggregate, and the blocks of
//! `Pᵀ A P` of the aggregates about them, which are changes of the next level. All else keeps its
//! bits, and what is computed anew has the bits of a set-up from the start. The factor of the
//! coarsest level is made again.

use std::sync::atomic::AtomicBool;

use crate::error::{Error, check_running};
use crate::linalg::amg::aggregates::Aggregates;
use crate::linalg::amg::block_matrix::{ABSENT, BlockMatrix};
use crate::linalg::amg::coarsest::Coarsest;
use crate::linalg::amg::galerkin;
use crate::linalg::amg::hierarchy::{Kept, Made, failure, level, make_levels, omega};
use crate::linalg::amg::inverse_diagonal::invert_node;
use crate::linalg::amg::level::Level;
use crate::linalg::amg::multigrid::{Multigrid, check_lengths};
use crate::linalg::amg::node_rows::NodeRows;
use crate::linalg::amg::nodes::LevelNodes;
use crate::linalg::amg::prolongation::{Prolongation, Smoothed};
use crate::linalg::amg::scaled_blocks::ScaledBlocks;
use crate::linalg::amg::settings::CycleSettings;
use crate::linalg::amg::single_rows::{LevelMatrix, SingleRows};
use crate::linalg::amg::tuning;

/// Multigrid whose matrix changes at some nodes.
#[derive(Debug)]
pub struct Following {
    b: usize,
    rows: NodeRows,
    held: Vec<bool>,
    /// Springs of the nodes of `rows`, in the units of the matrix before it was scaled.
    springs: Vec<f64>,
    /// What a change of each level needs. Of the finest matrix this has some rows only.
    kept: Vec<Kept>,
    /// The whole matrix of the coarsest level, which for few unknowns is the finest.
    last: BlockMatrix,
    /// The nodes whose motions a change reads.
    read: Vec<bool>,
    multigrid: Multigrid,
    state: State,
}

/// Whether all levels are those of the matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// Without a factor of the coarsest level.
    Made,
    Ready,
    /// An update has ended with some levels changed.
    Broken,
}

/// What changed of the matrix of a level.
struct Change {
    /// Nodes with another diagonal block.
    nodes: Vec<u32>,
    /// Nodes with another row: these, and others that have mirror images of their blocks.
    rows: Vec<u32>,
    /// Nodes with other motions, or held otherwise.
    moved: Vec<u32>,
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
        let mut kept = Vec::new();
        let mut read = vec![false; own.nodes()];
        let last = if held.len() <= tuning::dense_unknowns() {
            matrix.whole()
        } else {
            let (made, mut coarse) = level(own, about, &held, settings.spectrum, stop)?;
            coarse.replace_dead(&made.tentative.dead);
            let next = made.aggregates.coarse(about, &made.tentative);
            // The largest arrays come last.
            let keep = |made: Made, matrix: BlockMatrix| {
                made.keep(ScaledBlocks::new(LevelMatrix::Whole(&matrix)), matrix)
            };
            let (coarser, last) = make_levels(coarse, next, None, keep, stop)?;
            let all = Change::at_finest(rows.nodes.clone(), own);
            let reached = reach(&all, &made.aggregates, own, &made.p);
            let near = matrix.only(&reached.needed(&made.p));
            let finest = made.keep(ScaledBlocks::new(own), near);
            let levels;
            (levels, kept) = std::iter::once(finest).chain(coarser).unzip();
            multigrid.replace(levels, Coarsest::none());
            read = reached.read;
            last
        };
        Ok(Self {
            b,
            rows,
            held,
            springs,
            kept,
            last,
            read,
            multigrid,
            state: State::Made,
        })
    }

    /// Follows to `held` unknowns and to a spring at each of the nodes that may change, `b × b`
    /// by columns; `about` is that of [`Following::new`], too large to be kept, with the motions of
    /// [`Following::nodes_read`] at least. The bits do not depend on what was before.
    ///
    /// # Panics
    /// After an update with an error, as [`Following::apply`] does.
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
        assert_ne!(self.state, State::Broken, "an update has failed before");
        if self.state == State::Ready && changed.is_empty() {
            return Ok(());
        }
        self.state = State::Broken;
        let finest = match self.kept.first_mut() {
            Some(kept) => &mut kept.matrix,
            None => &mut self.last,
        };
        for &k in &changed {
            let i = b * self.rows.nodes[k] as usize;
            self.held[i..i + b].copy_from_slice(&held[i..i + b]);
            let spring = b * b * k..b * b * (k + 1);
            self.springs[spring.clone()].copy_from_slice(&springs[spring.clone()]);
            self.rows.write(k, finest, held, &springs[spring]);
        }
        let nodes = changed.iter().map(|&k| self.rows.nodes[k]).collect();
        let mut change = Change::at_finest(nodes, LevelMatrix::Whole(finest));
        for (k, level) in self.multigrid.levels.iter_mut().enumerate() {
            let (finer, rest) = self.kept.split_at_mut(k);
            let Some((own, coarser)) = rest.split_first_mut() else {
                break;
            };
            let next = match coarser.first_mut() {
                Some(kept) => &mut kept.matrix,
                None => &mut self.last,
            };
            let (motions, held) = match finer.last() {
                Some(kept) => (&kept.tentative.coarse, None),
                None => (&about.motions, Some(held)),
            };
            change = own.follow(level, next, &change, motions, held, stop)?;
        }
        self.multigrid
            .replace_coarsest(Coarsest::new(&self.last, stop)?);
        self.state = State::Ready;
        Ok(())
    }

    /// The nodes whose motions an update reads.
    pub fn nodes_read(&self) -> &[bool] {
        &self.read
    }

    /// `x ≈ A⁻¹ b`, as [`Multigrid::apply`], with a smoother of this degree.
    pub fn apply(&mut self, degree: usize, b: &[f64], x: &mut [f64]) {
        assert_eq!(self.state, State::Ready, "no update, or one that failed");
        self.multigrid.set_degree(degree);
        self.multigrid.apply(b, x);
    }

    /// Memory of all levels, and of what the next change needs.
    pub fn bytes(&self) -> usize {
        let kept = self.kept.iter().map(Kept::bytes).sum::<usize>() + self.last.bytes();
        let own = self.rows.bytes() + 8 * self.springs.len() + self.read.len();
        self.multigrid.bytes() + own + kept
    }
}

impl Kept {
    /// Computes anew what depends on a change, which the matrix has already: all but the `next`
    /// matrix, whose change is returned, of this level. `motions` are those of its nodes; without
    /// `held`, unknowns are those that the matrix holds.
    fn follow(
        &mut self,
        level: &mut Level,
        next: &mut BlockMatrix,
        change: &Change,
        motions: &[f64],
        held: Option<&[bool]>,
        stop: &AtomicBool,
    ) -> Result<Change, Error> {
        check_running(stop)?;
        let (b, own) = (self.matrix.b, &self.matrix);
        for &i in &change.nodes {
            let at = i as usize * b * b;
            let inverse = &mut level.inverse[at..at + b * b];
            if !invert_node(own.diagonal_block(i as usize), inverse) {
                return Err(failure("a diagonal entry is not positive, or not finite"));
            }
        }
        let matrix = LevelMatrix::Whole(own);
        let reached = reach(change, &self.aggregates, matrix, &level.p);
        self.tentative.update(
            &reached.aggregates,
            &self.aggregates,
            motions,
            held.unwrap_or(&own.held),
            b,
        );
        let of = Smoothed {
            matrix,
            inverse: &level.inverse,
            aggregates: &self.aggregates,
            tentative: &self.tentative,
            motions,
            omega: omega(level.spectrum),
        };
        level.p.smooth(&of, Some(&reached.rows));
        check_running(stop)?;
        galerkin::update(next, matrix, &level.p, &reached.coarse);
        next.replace_dead(&self.tentative.dead);
        for &i in &change.rows {
            level.matrix.copy_row(i as usize, own);
        }
        let rows: Vec<u32> = (0..)
            .zip(&reached.coarse)
            .filter_map(|(g, &changed)| changed.then_some(g))
            .collect();
        Ok(Change {
            nodes: rows.clone(),
            rows,
            moved: reached.aggregates,
        })
    }

    fn bytes(&self) -> usize {
        self.matrix.bytes() + self.tentative.bytes() + self.aggregates.bytes()
    }
}

impl Change {
    /// Of rows of the finest matrix, and of the columns that mirror them.
    fn at_finest(nodes: Vec<u32>, matrix: LevelMatrix<'_>) -> Self {
        let mut reached = Reached::new(matrix.nodes());
        for &i in &nodes {
            reached.add(i);
        }
        reached.spread(matrix);
        Self {
            moved: nodes.clone(),
            nodes,
            rows: reached.list,
        }
    }
}

/// What a change determines.
struct Reach {
    /// Aggregates whose motions change, ascending.
    aggregates: Vec<u32>,
    /// Rows of `P` that change: of nodes beside a changed row of `T`, or with one of `A`.
    rows: Vec<bool>,
    /// The nodes beside these, too: those whose motions they are made of.
    read: Vec<bool>,
    /// Coarse nodes whose rows change: those of the rows of `A P` of nodes beside these.
    coarse: Vec<bool>,
}

fn reach(
    change: &Change,
    aggregates: &Aggregates,
    matrix: LevelMatrix<'_>,
    p: &Prolongation,
) -> Reach {
    let mut which: Vec<u32> = change
        .moved
        .iter()
        .map(|&i| aggregates.of_node[i as usize])
        .filter(|&g| g != ABSENT)
        .collect();
    which.sort_unstable();
    which.dedup();
    let mut reached = Reached::new(matrix.nodes());
    for &i in which
        .iter()
        .flat_map(|&g| aggregates.members_of(g as usize))
    {
        reached.add(i);
    }
    reached.spread(matrix);
    for &i in &change.rows {
        reached.add(i);
    }
    let rows = reached.is.clone();
    reached.spread(matrix);
    let mut coarse = vec![false; aggregates.count()];
    for &i in &reached.list {
        for &g in &p.column[p.row(i as usize)] {
            coarse[g as usize] = true;
        }
    }
    Reach {
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
