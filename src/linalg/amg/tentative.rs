//! Near-null vectors, cut into aggregates and made orthonormal in each.

use crate::linalg::amg::aggregates::Aggregates;
use crate::linalg::amg::tuning;
use crate::linalg::real::Real;
use crate::linalg::sparse::csc::narrow;
use crate::tasks;

/// Numbers of a row of `T`, six or fewer near-null vectors and zeros.
pub(super) const LANES: usize = 8;

/// The tentative prolongation `T`: `B = T C`, with `Tᵀ T = I` but for vectors that depend on
/// others in their aggregate.
#[derive(Clone, Debug)]
pub(super) struct Tentative {
    /// Rows of `T` in the order of the members of aggregates.
    pub(super) rows: Vec<[f32; LANES]>,
    /// The near-null vectors of the coarse level, `m × m` by rows for each aggregate.
    pub(super) coarse: Vec<f64>,
    /// Coarse unknowns whose column of `T` is zero.
    pub(super) dead: Vec<bool>,
    /// Number of near-null vectors.
    m: usize,
}

/// Aggregates in one task.
const TASK: usize = 64;

impl Tentative {
    /// `vectors` are `b × m` by rows for each node; they count as zero at `held` unknowns.
    pub(super) fn new(
        aggregates: &Aggregates,
        vectors: &[f64],
        held: &[bool],
        b: usize,
        m: usize,
    ) -> Self {
        let count = aggregates.count();
        let all: Vec<u32> = (0..narrow(count)).collect();
        let mut whole = Self {
            rows: Vec::with_capacity(aggregates.members.len() * b),
            coarse: Vec::with_capacity(count * m * m),
            dead: Vec::with_capacity(count * m),
            m,
        };
        for part in Self::parts(&all, aggregates, vectors, held, b, m) {
            whole.rows.extend(part.rows);
            whole.coarse.extend(part.coarse);
            whole.dead.extend(part.dead);
        }
        whole
    }

    /// Makes the rows of some aggregates anew, for other `held` unknowns.
    pub(super) fn update(
        &mut self,
        which: &[u32],
        aggregates: &Aggregates,
        vectors: &[f64],
        held: &[bool],
        b: usize,
    ) {
        let m = self.m;
        let parts = Self::parts(which, aggregates, vectors, held, b, m);
        for (of, part) in which.chunks(TASK).zip(parts) {
            let mut rows = &part.rows[..];
            let all = part
                .coarse
                .chunks_exact(m * m)
                .zip(part.dead.chunks_exact(m));
            for (&g, (coarse, dead)) in of.iter().zip(all) {
                let g = g as usize;
                let first = b * aggregates.start[g] as usize;
                let (own, later) = rows.split_at(b * aggregates.members_of(g).len());
                rows = later;
                self.rows[first..first + own.len()].copy_from_slice(own);
                self.coarse[g * m * m..(g + 1) * m * m].copy_from_slice(coarse);
                self.dead[g * m..(g + 1) * m].copy_from_slice(dead);
            }
        }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.rows.as_slice()) + 8 * self.coarse.len() + self.dead.len()
    }

    /// The parts of some aggregates, in tasks of [`TASK`].
    fn parts(
        which: &[u32],
        aggregates: &Aggregates,
        vectors: &[f64],
        held: &[bool],
        b: usize,
        m: usize,
    ) -> Vec<Self> {
        tasks::map(which.chunks(TASK), |_, which| {
            let mut part = Self {
                rows: Vec::new(),
                coarse: Vec::new(),
                dead: Vec::new(),
                m,
            };
            for &g in which {
                part.aggregate(aggregates.members_of(g as usize), vectors, held, b, m);
            }
            part
        })
    }

    /// The rows of `T` that node `j` would have in another aggregate: `B_j C⁻¹`. `vectors` are
    /// those of [`Tentative::new`].
    pub(super) fn extended<const B: usize>(
        &self,
        aggregate: u32,
        j: usize,
        vectors: &[f64],
    ) -> [[f32; LANES]; B] {
        let (m, g) = (self.m, aggregate as usize);
        let coarse = &self.coarse[g * m * m..][..m * m];
        let dead = &self.dead[g * m..][..m];
        let mut rows = [[0.0; LANES]; B];
        for (row, own) in rows.iter_mut().zip(vectors[j * B * m..].chunks_exact(m)) {
            let mut x = [0.0; LANES];
            for c in (0..m).filter(|&c| !dead[c]) {
                let before: f64 = (0..c).map(|e| x[e] * coarse[e * m + c]).sum();
                let value = (own[c] - before) / coarse[c * m + c];
                if value.abs() <= tuning::largest_extension() {
                    x[c] = value;
                }
            }
            *row = x.map(f32::rounded);
        }
        rows
    }

    /// Gram and Schmidt in the rows of `members`, in double precision.
    fn aggregate(&mut self, members: &[u32], vectors: &[f64], held: &[bool], b: usize, m: usize) {
        /// A vector that loses all but this part to the earlier ones depends on them.
        const DEPENDENT: f64 = 1e-7;
        let count = members.len() * b;
        let unknowns = members
            .iter()
            .flat_map(|&i| i as usize * b..(i as usize + 1) * b);
        let mut columns = vec![0.0; m * count];
        for (r, at) in unknowns.enumerate().filter(|&(_, at)| !held[at]) {
            for (c, &value) in vectors[at * m..(at + 1) * m].iter().enumerate() {
                columns[c * count + r] = value;
            }
        }
        let mut coarse = [0.0; 36];
        for c in 0..m {
            let (earlier, own) = columns.split_at_mut(c * count);
            let own = &mut own[..count];
            let before = length(own);
            // The second pass removes what rounding of the first has left.
            for _ in 0..2 {
                for (e, earlier) in earlier.chunks_exact(count).enumerate() {
                    let along: f64 = earlier.iter().zip(&*own).map(|(x, y)| x * y).sum();
                    for (y, x) in own.iter_mut().zip(earlier) {
                        *y -= along * x;
                    }
                    coarse[e * m + c] += along;
                }
            }
            let after = length(own);
            let dead = !(after > DEPENDENT * before);
            self.dead.push(dead);
            if dead {
                own.fill(0.0);
            } else {
                coarse[c * m + c] = after;
                for value in own.iter_mut() {
                    *value /= after;
                }
            }
        }
        self.coarse.extend_from_slice(&coarse[..m * m]);
        for r in 0..count {
            let mut row = [0.0; LANES];
            for c in 0..m {
                row[c] = f32::rounded(columns[c * count + r]);
            }
            self.rows.push(row);
        }
    }
}

fn length(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}
