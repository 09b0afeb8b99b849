//! Near-null vectors, cut into aggregates and made orthonormal in each.

use rayon::prelude::*;

use crate::linalg::amg::aggregates::Aggregates;
use crate::linalg::real::Real;

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
    /// `vectors` are `b × m` by rows for each node.
    pub(super) fn new(aggregates: &Aggregates, vectors: &[f64], b: usize, m: usize) -> Self {
        let count = aggregates.count();
        let parts: Vec<Self> = (0..count.div_ceil(TASK))
            .into_par_iter()
            .map(|task| {
                let mut part = Self {
                    rows: Vec::new(),
                    coarse: Vec::new(),
                    dead: Vec::new(),
                    m,
                };
                for g in task * TASK..count.min((task + 1) * TASK) {
                    let range = aggregates.start[g] as usize..aggregates.start[g + 1] as usize;
                    part.aggregate(&aggregates.members[range], vectors, b, m);
                }
                part
            })
            .collect();
        let mut whole = Self {
            rows: Vec::with_capacity(aggregates.members.len() * b),
            coarse: Vec::with_capacity(count * m * m),
            dead: Vec::with_capacity(count * m),
            m,
        };
        for part in parts {
            whole.rows.extend(part.rows);
            whole.coarse.extend(part.coarse);
            whole.dead.extend(part.dead);
        }
        whole
    }

    /// The rows of `T` that node `j` would have in another aggregate: `B_j C⁻¹`. `vectors` are
    /// those of [`Tentative::new`].
    pub(super) fn extended<const B: usize>(
        &self,
        aggregate: u32,
        j: usize,
        vectors: &[f64],
    ) -> [[f32; LANES]; B] {
        /// A larger one is that of a motion that the aggregate hardly has.
        const LARGEST: f64 = 64.0;
        let (m, g) = (self.m, aggregate as usize);
        let coarse = &self.coarse[g * m * m..][..m * m];
        let dead = &self.dead[g * m..][..m];
        let mut rows = [[0.0; LANES]; B];
        for (row, own) in rows.iter_mut().zip(vectors[j * B * m..].chunks_exact(m)) {
            let mut x = [0.0; LANES];
            for c in (0..m).filter(|&c| !dead[c]) {
                let before: f64 = (0..c).map(|e| x[e] * coarse[e * m + c]).sum();
                let value = (own[c] - before) / coarse[c * m + c];
                if value.abs() <= LARGEST {
                    x[c] = value;
                }
            }
            *row = x.map(f32::rounded);
        }
        rows
    }

    /// Gram and Schmidt in the rows of `members`, in double precision.
    fn aggregate(&mut self, members: &[u32], vectors: &[f64], b: usize, m: usize) {
        /// A vector that loses all but this part to the earlier ones depends on them.
        const DEPENDENT: f64 = 1e-7;
        let count = members.len() * b;
        let rows = members
            .iter()
            .flat_map(|&i| vectors[i as usize * b * m..][..b * m].chunks_exact(m));
        let mut columns = vec![0.0; m * count];
        for (r, row) in rows.enumerate() {
            for (c, &value) in row.iter().enumerate() {
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
