//! A preconditioner that follows changes at a few nodes: the statuses of contacts.
//!
//! The aggregates are chosen once, without a change. A change at a node then reaches the motions
//! of its aggregate, the rows of `P` beside this aggregate, and the blocks of `Pᵀ A P` of the
//! aggregates about them. All else keeps its bits, and what is computed anew has the bits of a
//! set-up from the start. Coarser levels are small: they are made again.

use std::sync::atomic::AtomicBool;

use crate::error::Error;
use crate::linalg::amg::aggregates::Aggregates;
use crate::linalg::amg::block_matrix::{ABSENT, BlockMatrix};
use crate::linalg::amg::coarsest::Coarsest;
use crate::linalg::amg::galerkin;
use crate::linalg::amg::hierarchy::{Levels, Made, failure, level, omega, running};
use crate::linalg::amg::inverse_diagonal::invert_node;
use crate::linalg::amg::level::Level;
use crate::linalg::amg::multigrid::{Multigrid, check_lengths};
use crate::linalg::amg::node_rows::NodeRows;
use crate::linalg::amg::nodes::LevelNodes;
use crate::linalg::amg::prolongation::Smoothed;
use crate::linalg::amg::settings::CycleSettings;
use crate::linalg::amg::tentative::Tentative;
use crate::linalg::amg::tuning;

/// Multigrid whose matrix changes at some nodes.
#[derive(Debug)]
pub struct Following {
    b: usize,
    rows: NodeRows,
    about: LevelNodes,
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
    /// The next matrix, with zeros for unknowns without a motion, while no level has it.
    coarse: Option<BlockMatrix>,
}

impl Following {
    /// `matrix` without held unknowns, but for those without a degree of freedom; `nodes` may
    /// change. Nothing can be solved before [`Following::update`].
    ///
    /// # Errors
    /// As [`Multigrid::new`].
    ///
    /// # Panics
    /// If an argument has another length.
    pub fn new(
        mut matrix: BlockMatrix,
        about: LevelNodes,
        nodes: Vec<u32>,
        settings: &CycleSettings,
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        let held = matrix.held.clone();
        check_lengths(&matrix, &about, &held);
        let rows = NodeRows::new(&matrix, nodes);
        let b = matrix.b;
        let springs = vec![0.0; rows.nodes.len() * b * b];
        for k in 0..rows.nodes.len() {
            rows.write(k, &mut matrix, &held, &springs[..b * b]);
        }
        let mut multigrid = Multigrid::empty(held.len(), matrix.exponent, settings);
        let finest = if held.len() <= tuning::dense_unknowns() {
            Finest::Small(matrix)
        } else {
            let Made {
                level,
                aggregates,
                tentative,
                coarse,
            } = level(matrix, &about, &held, settings.spectrum, stop)?;
            multigrid.replace(vec![level], Coarsest::none());
            Finest::Large(Box::new(Kept {
                aggregates,
                tentative,
                coarse: Some(coarse),
            }))
        };
        Ok(Self {
            b,
            rows,
            about,
            held,
            springs,
            finest,
            multigrid,
            ready: false,
        })
    }

    /// Follows to `held` unknowns and to a spring at each of the nodes that may change, `b × b`
    /// by columns. The bits do not depend on what was before. After an error this cannot be used.
    ///
    /// # Errors
    /// As [`Multigrid::new`].
    ///
    /// # Panics
    /// If an argument has another length.
    pub fn update(
        &mut self,
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
                let made = Levels::new(matrix.clone(), self.about.clone(), stop)?;
                self.multigrid.replace(made.list, made.coarsest);
            }
            Finest::Large(kept) => {
                let mut levels = std::mem::take(&mut self.multigrid.levels);
                let mut below = levels.drain(1..);
                let mut coarse = match (kept.coarse.take(), below.next()) {
                    (Some(coarse), _) => coarse,
                    (None, Some(level)) => {
                        let mut coarse = level.matrix;
                        coarse.clear_dead(&kept.tentative.dead);
                        coarse
                    }
                    (None, None) => return Err(failure("the second level is missing")),
                };
                drop(below);
                let finest = levels
                    .first_mut()
                    .ok_or(failure("the finest level is missing"))?;
                write(&mut finest.matrix);
                let nodes: Vec<u32> = changed.iter().map(|&k| self.rows.nodes[k]).collect();
                let reached = (&mut *finest, &mut coarse);
                kept.follow(reached, &nodes, &self.about, &self.held, stop)?;
                if coarse.b * coarse.nodes() <= tuning::dense_unknowns() {
                    // A dense factor takes its place.
                    kept.coarse = Some(coarse.clone());
                }
                coarse.replace_dead(&kept.tentative.dead);
                let next = kept
                    .aggregates
                    .coarse(&self.about, kept.tentative.coarse.clone());
                let below = Levels::new(coarse, next, stop)?;
                levels.extend(below.list);
                self.multigrid.replace(levels, below.coarsest);
            }
        }
        self.ready = true;
        Ok(())
    }

    /// `x ≈ A⁻¹ b`, as [`Multigrid::apply`], with a smoother of this degree.
    ///
    /// # Panics
    /// If `b` or `x` has another length than the matrix.
    pub fn apply(&mut self, degree: usize, b: &[f64], x: &mut [f64]) {
        self.multigrid.set_degree(degree);
        self.multigrid.apply(b, x);
    }

    /// Memory of all levels, and of what the next change needs.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let about = 8 * (self.about.motions.len() + self.about.coordinates.len());
        let finest = match &self.finest {
            Finest::Small(matrix) => matrix.bytes(),
            Finest::Large(kept) => {
                let coarse = kept.coarse.as_ref().map_or(0, BlockMatrix::bytes);
                coarse + kept.tentative.bytes() + kept.aggregates.bytes()
            }
        };
        self.multigrid.bytes() + self.rows.bytes() + 8 * self.springs.len() + about + finest
    }
}

impl Kept {
    /// Computes anew what depends on the rows of `nodes`, which the matrix has already.
    fn follow(
        &mut self,
        (finest, next): (&mut Level, &mut BlockMatrix),
        nodes: &[u32],
        about: &LevelNodes,
        held: &[bool],
        stop: &AtomicBool,
    ) -> Result<(), Error> {
        let (b, count) = (finest.matrix.b, finest.matrix.nodes());
        for &i in nodes {
            let own = i as usize * b * b;
            let inverse = &mut finest.inverse[own..own + b * b];
            if !invert_node(&finest.matrix, i as usize, inverse) {
                return Err(failure("a diagonal entry is not positive, or not finite"));
            }
        }
        let mut which: Vec<u32> = nodes
            .iter()
            .map(|&i| self.aggregates.of_node[i as usize])
            .filter(|&g| g != ABSENT)
            .collect();
        which.sort_unstable();
        which.dedup();
        self.tentative
            .update(&which, &self.aggregates, &about.motions, held, b);
        running(stop)?;
        // Rows of P: of nodes beside a changed row of T or of A.
        let mut reached = Reached::new(count);
        for &i in nodes {
            reached.add(i);
        }
        for &g in &which {
            for &i in self.aggregates.members_of(g as usize) {
                reached.add(i);
            }
        }
        reached.spread(&finest.matrix);
        let of = Smoothed {
            matrix: &finest.matrix,
            inverse: &finest.inverse,
            aggregates: &self.aggregates,
            tentative: &self.tentative,
            about,
            omega: omega(finest.spectrum),
        };
        finest.p.smooth(&of, Some(&reached.is));
        running(stop)?;
        // Rows of A P: of nodes beside these.
        reached.spread(&finest.matrix);
        let mut coarse = vec![false; self.aggregates.count()];
        for &i in &reached.list {
            for &g in &finest.p.column[finest.p.row(i as usize)] {
                coarse[g as usize] = true;
            }
        }
        galerkin::update(next, &finest.matrix, &finest.p, &coarse);
        running(stop)
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
    fn spread(&mut self, matrix: &BlockMatrix) {
        for k in 0..self.list.len() {
            for at in matrix.row(self.list[k] as usize) {
                self.add(matrix.column[at]);
            }
        }
    }
}
