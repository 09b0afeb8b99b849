//! K of a mesh, in compressed rows.

use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use crate::assembly::cells::Cells;
use crate::assembly::element::{Integrator, LANES, Law, Reference};
use crate::assembly::pattern::Pattern;
use crate::assembly::shapes::shapes;
use crate::assembly::sum::add;
use crate::error::{Error, check_length, check_running};
use crate::linalg::pages::zeros;
use crate::tasks;

/// Numbers of the matrices of cells that a thread makes before it adds them: 1 MB, which stays
/// in its cache.
const BUFFER: usize = 1 << 17;

/// Cells between two checks for an interruption.
const CELLS: usize = 1 << 15;

/// A mesh of elastic cells.
#[derive(Clone, Copy, Debug)]
pub struct Elastic<'a, const D: usize> {
    /// Nodes of the cells.
    pub cells: &'a Cells,
    /// Positions of the nodes: all of the first component, then all of the second, ….
    pub points: &'a [f64],
    /// Shape functions of the cells.
    pub reference: &'a Reference<D>,
    /// The materials.
    pub laws: &'a [Law],
    /// The material of each cell; empty if there is one for all.
    pub material: &'a [usize],
}

impl<const D: usize> Elastic<'_, D> {
    /// The values of K on its pattern: for each node `D` rows, columns as in the pattern with
    /// `D` components each.
    pub fn values(&self, pattern: &Pattern, stop: &AtomicBool) -> Result<Vec<f64>, Error> {
        self.check()?;
        let (cells, size) = (self.cells, (D * self.cells.corners()).pow(2));
        let mut values = zeros(D * D * pattern.blocks());
        let chunk = (BUFFER / size.max(1)).max(1) * rayon::current_num_threads();
        // Shared matrices may take a quarter of the memory of the values.
        let most = (cells.count() / 2).min(values.len() / (4 * size.max(1)));
        if let Some(shapes) = shapes(cells.count(), most, |cell, key| self.key(cell, key)) {
            let mut matrices = vec![0.0; size * shapes.first.len()];
            self.matrices(&mut matrices, |at| shapes.first[at] as usize)?;
            let of = |cell: usize| &matrices[shapes.which[cell] as usize * size..][..size];
            sum::<D>(cells, pattern, of, &mut values, stop)?;
            return Ok(values);
        }
        let mut matrices = vec![0.0; size * chunk.min(cells.count())];
        for first in (0..cells.count()).step_by(chunk) {
            check_running(stop)?;
            let range = first..cells.count().min(first + chunk);
            let own = &mut matrices[..size * range.len()];
            self.matrices(own, |at| first + at)?;
            let of = |cell: usize| &own[(cell - first) * size..][..size];
            add::<D>(pattern, cells, range, of, &mut values);
        }
        Ok(values)
    }

    fn check(&self) -> Result<(), Error> {
        check_length("points", self.points.len(), D * self.cells.nodes())?;
        if !self.material.is_empty() {
            check_length(
                "materials of cells",
                self.material.len(),
                self.cells.count(),
            )?;
        }
        let limit = self.laws.len();
        let wrong = self.material.iter().position(|&material| material >= limit);
        if let Some(position) = wrong {
            return Err(Error::IndexRange {
                what: "materials of cells",
                position,
                found: self.material[position],
                limit,
            });
        }
        check_length("materials", limit.min(1), 1)
    }

    fn material(&self, cell: usize) -> usize {
        self.material.get(cell).copied().unwrap_or(0)
    }

    /// Component `a` of a node relative to the first node of its cell.
    fn offset(&self, nodes: &[u32], node: u32, a: usize) -> f64 {
        let x = &self.points[a * self.cells.nodes()..];
        // Adding zero turns -0.0 into 0.0, for cells that are compared bit by bit.
        x[node as usize] - x[nodes[0] as usize] + 0.0
    }

    /// What equal cells have in common.
    fn key(&self, cell: usize, found: &mut Vec<u64>) {
        let nodes = self.cells.of(cell);
        found.push(self.material(cell) as u64);
        for &node in &nodes[1..] {
            found.extend((0..D).map(|a| self.offset(nodes, node, a).to_bits()));
        }
    }

    /// Matrices of the cells `cell(0)`, `cell(1)`, ….
    fn matrices(
        &self,
        matrices: &mut [f64],
        cell: impl Fn(usize) -> usize + Sync,
    ) -> Result<(), Error> {
        let size = (D * self.cells.corners()).pow(2);
        let bad = Mutex::new(None::<usize>);
        tasks::for_each_with(
            matrices.chunks_mut(16 * LANES * size),
            || {
                let corners = vec![[[0.0; LANES]; D]; self.cells.corners()];
                (Integrator::new(self.reference), corners)
            },
            |(integrator, corners), task, matrices| {
                for (k, matrices) in matrices.chunks_mut(LANES * size).enumerate() {
                    let at = 16 * task + k;
                    // The last cell fills the lanes that are left over.
                    let last = matrices.len() / size - 1;
                    let own: [usize; LANES] =
                        std::array::from_fn(|w| cell(LANES * at + w.min(last)));
                    for (w, &cell) in own.iter().enumerate() {
                        let nodes = self.cells.of(cell);
                        for (corner, &node) in corners.iter_mut().zip(nodes) {
                            for (a, x) in corner.iter_mut().enumerate() {
                                x[w] = self.offset(nodes, node, a);
                            }
                        }
                    }
                    let laws = own.map(|cell| &self.laws[self.material(cell)]);
                    let valid = integrator.matrices(corners, laws, matrices);
                    let folded = own.iter().zip(valid).filter(|(_, valid)| !valid);
                    if let Some(cell) = folded.map(|(&cell, _)| cell).min() {
                        let mut bad = tasks::lock(&bad);
                        *bad = Some(bad.map_or(cell, |other| other.min(cell)));
                    }
                }
            },
        );
        tasks::inner(bad).map_or(Ok(()), |cell| Err(Error::FoldedCell { cell }))
    }
}

/// The values of given matrices of cells, summed as in [`Elastic::values`]. `matrices` has for
/// each cell the blocks in the order (i, j, k, l).
pub fn sum_of_cells<const D: usize>(
    cells: &Cells,
    pattern: &Pattern,
    matrices: &[f64],
    stop: &AtomicBool,
) -> Result<Vec<f64>, Error> {
    let size = (D * cells.corners()).pow(2);
    check_length("matrices of cells", matrices.len(), size * cells.count())?;
    let mut values = zeros(D * D * pattern.blocks());
    let of = |cell: usize| &matrices[cell * size..][..size];
    sum::<D>(cells, pattern, of, &mut values, stop)?;
    Ok(values)
}

/// Adds matrices that exist already.
fn sum<'a, const D: usize>(
    cells: &Cells,
    pattern: &Pattern,
    matrix: impl Fn(usize) -> &'a [f64] + Sync,
    values: &mut [f64],
    stop: &AtomicBool,
) -> Result<(), Error> {
    for first in (0..cells.count()).step_by(CELLS) {
        check_running(stop)?;
        let range = first..cells.count().min(first + CELLS);
        add::<D>(pattern, cells, range, &matrix, values);
    }
    Ok(())
}
