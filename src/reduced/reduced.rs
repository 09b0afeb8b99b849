//! The reduced problem (5), `v = W r + R a + q`, checked and scaled once.

use crate::error::Error;
use crate::law::contact_law::{self, ContactLaw};
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::small::{length, norm};
use crate::reduced::compliance::Compliance;
use crate::reduced::validate::{check_finite, check_length};

/// Rigid motions of bodies that only contact holds: `v = W r + R a + q` with `Rᵀ r + e = 0`.
#[derive(Clone, Debug, Default)]
pub struct Rigid<const D: usize> {
    /// Columns of `R`, one for each rigid motion, each with all contacts.
    pub modes: Vec<Vec<[f64; D]>>,
    /// `e`, the work of the loads on each rigid motion.
    pub load: Vec<f64>,
}

/// `v = W r + R a + q`, `Rᵀ r + e = 0`, and the law at each contact.
///
/// All node arrays are in the order of positions of `compliance`.
#[derive(Clone, Debug)]
pub struct Reduced<'a, const D: usize> {
    pub compliance: &'a Compliance<'a, D>,
    pub q: Vec<[f64; D]>,
    pub law: Vec<ContactLaw>,
    pub rigid: Rigid<D>,
    /// Rounding error of `e`, one number for each rigid motion; empty if `e` is exact.
    pub load_rounding: Vec<f64>,
    /// Relative rounding error of each entry of `W` and `q`, by a change of variables; zero
    /// without one.
    pub entry_rounding: f64,
    pub scaling: Scaling<D>,
    /// A contact that penetrates and that nothing can move, in the numbering of the caller, and
    /// its penetration. Then there is no solution.
    pub contradiction: Option<(usize, f64)>,
}

impl<'a, const D: usize> Reduced<'a, D> {
    /// Takes node arrays in the numbering of the caller.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`] and those of [`contact_law::check`] for wrong
    /// arguments, [`Error::DependentMotion`] for a rigid motion that moves no contact, [`Error::Range`]
    /// for numbers that cannot be scaled.
    pub fn new(
        compliance: &'a Compliance<'a, D>,
        q: &[[f64; D]],
        law: &[ContactLaw],
        rigid: &Rigid<D>,
    ) -> Result<Self, Error> {
        let contacts = compliance.contacts();
        check_length("q", q.len(), contacts)?;
        check_finite("q", q.as_flattened())?;
        check_length("rigid load e", rigid.load.len(), rigid.modes.len())?;
        check_finite("rigid load e", &rigid.load)?;
        for mode in &rigid.modes {
            check_length("rigid motion R", mode.len(), contacts)?;
            check_finite("rigid motion R", mode.as_flattened())?;
        }
        contact_law::check(law, contacts)?;
        let q = compliance.gather(q);
        let modes = rigid
            .modes
            .iter()
            .map(|mode| compliance.gather(mode))
            .collect();
        let rigid = Rigid {
            modes,
            load: rigid.load.clone(),
        };
        let mut contradiction = None;
        for (position, free) in q.iter().enumerate() {
            let held = !compliance.moves(position)
                && rigid.modes.iter().all(|mode| mode[position][0] == 0.0);
            if held && free[0] < 0.0 {
                contradiction = Some((compliance.order()[position], -free[0]));
            }
        }
        let scaling = Scaling::new(compliance, &q, &rigid)?;
        Ok(Self {
            compliance,
            q,
            law: compliance.gather(law),
            rigid,
            load_rounding: Vec::new(),
            entry_rounding: 0.0,
            scaling,
            contradiction,
        })
    }

    /// The same problem with another `e`.
    #[must_use]
    pub fn with_load(&self, load: Vec<f64>) -> Self {
        let mut other = self.clone();
        other.scaling.load = other.scaling.scale_load(&load);
        other.rigid.load = load;
        other
    }

    /// The law of a contact in scaled variables.
    #[must_use]
    pub fn scaled_law(&self, contact: usize) -> ContactLaw {
        self.law[contact].scaled(self.scaling.to_r[contact])
    }

    /// The same problem with `q = 0`.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn without_offset(&self) -> Result<Self, Error> {
        let mut other = self.clone();
        other.q.fill([0.0; D]);
        other.scaling = Scaling::new(self.compliance, &other.q, &self.rigid)?;
        other.contradiction = None;
        Ok(other)
    }

    #[must_use]
    pub fn contacts(&self) -> usize {
        self.q.len()
    }

    /// Computes `v = W r + R a + q`.
    #[must_use]
    pub fn relative_displacement(&self, r: &[[f64; D]], a: &[f64]) -> Vec<[f64; D]> {
        let mut v = vec![[0.0; D]; r.len()];
        self.compliance.product(r, &mut v);
        self.add_rest(a, &mut v);
        v
    }

    /// [`Self::relative_displacement`] with sums in twice the precision.
    #[must_use]
    pub fn exact_displacement(&self, r: &[[f64; D]], a: &[f64]) -> Vec<[f64; D]> {
        let mut v = vec![[0.0; D]; r.len()];
        for (i, value) in v.iter_mut().enumerate() {
            for k in 0..D {
                let mut sum = self.compliance.exact_row(i, k, r);
                sum.add(self.q[i][k]);
                for (mode, &amount) in self.rigid.modes.iter().zip(a) {
                    sum.add_product(mode[i][k], amount);
                }
                value[k] = sum.value();
            }
        }
        v
    }

    /// `v += R a + q`.
    pub fn add_rest(&self, a: &[f64], v: &mut [[f64; D]]) {
        for (value, free) in v.iter_mut().zip(&self.q) {
            for k in 0..D {
                value[k] += free[k];
            }
        }
        self.add_rigid(a, v);
    }

    /// `v += R a`.
    pub fn add_rigid(&self, a: &[f64], v: &mut [[f64; D]]) {
        for (mode, &amount) in self.rigid.modes.iter().zip(a) {
            for (value, motion) in v.iter_mut().zip(mode) {
                for k in 0..D {
                    value[k] += amount * motion[k];
                }
            }
        }
    }
}

/// Scaling with one number for each node: `r = D r̂`, `v = v̂ / D`, so that the mean of the
/// diagonal of each block of `Ŵ = D W D` is one. Cones and `μ‖v_t‖` keep their form, and ρ = 1
/// suits each node. A cohesion is scaled as a force.
///
/// Two powers of two, one for displacements and one for forces, are factored out first: a
/// change of units by powers of two does not change a bit of a scaled quantity, and another
/// change only its rounding.
#[derive(Clone, Debug)]
pub struct Scaling<const D: usize> {
    /// `v̂ = to_v v`.
    pub to_v: Vec<f64>,
    /// `r̂ = to_r r`.
    pub to_r: Vec<f64>,
    /// Orthonormal columns of the scaled rigid motions, `R̂ T = D R`.
    pub modes: Vec<Vec<[f64; D]>>,
    /// `ê = T⁻ᵀ e`, scaled as a force.
    pub load: Vec<f64>,
    /// `T`, upper triangular, column by column.
    triangle: Vec<Vec<f64>>,
    /// `a = T⁻¹ â · rigid_unit`.
    rigid_unit: f64,
    /// Forces are scaled by two to minus this.
    force_exponent: i32,
}

impl<const D: usize> Scaling<D> {
    fn new(compliance: &Compliance<D>, q: &[[f64; D]], rigid: &Rigid<D>) -> Result<Self, Error> {
        #[expect(clippy::cast_precision_loss, reason = "D is 2 or 3")]
        let dimension = D as f64;
        let traces: Vec<f64> = (0..compliance.contacts())
            .map(|i| compliance.block(i).trace() / dimension)
            .collect();
        let softest = traces.iter().fold(0.0_f64, |m, &t| m.max(t));
        let compliance_exponent = exponent(softest);
        let node: Vec<f64> = traces
            .iter()
            .map(|&t| {
                if t > 0.0 {
                    1.0 / times_two_to(t, -compliance_exponent).sqrt()
                } else {
                    1.0 // every component prescribed: W_ii = 0, r stays zero
                }
            })
            .collect();
        let free = q
            .iter()
            .zip(&node)
            .flat_map(|(v, d)| v.map(|c| (c * d).abs()))
            .fold(0.0_f64, f64::max);
        let force = rigid.load.iter().fold(0.0_f64, |m, e| m.max(e.abs()));
        let displacement_exponent = if free > 0.0 {
            exponent(free)
        } else if force > 0.0 {
            exponent(force) + compliance_exponent
        } else {
            0
        };
        let force_exponent = if softest > 0.0 || force == 0.0 {
            displacement_exponent - compliance_exponent
        } else {
            exponent(force) // no compliance ties forces to displacements
        };
        let to_v: Vec<f64> = node
            .iter()
            .map(|&d| times_two_to(d, -displacement_exponent))
            .collect();
        let to_r: Vec<f64> = node
            .iter()
            .map(|&d| times_two_to(1.0 / d, -force_exponent))
            .collect();

        let scaled = rigid.modes.iter().map(|mode| {
            mode.iter()
                .zip(&node)
                .map(|(m, &d)| m.map(|c| c * d))
                .collect::<Vec<_>>()
        });
        let (modes, triangle) = orthonormalise(scaled.collect())?;
        let usable = |s: &f64| s.is_finite() && *s > 0.0;
        if !to_v.iter().chain(&to_r).all(usable) {
            return Err(Error::Range { softest, free });
        }
        let mut scaling = Self {
            to_v,
            to_r,
            modes,
            load: Vec::new(),
            triangle,
            rigid_unit: times_two_to(1.0, displacement_exponent),
            force_exponent,
        };
        scaling.load = scaling.scale_load(&rigid.load);
        Ok(scaling)
    }

    /// `ê = T⁻ᵀ e`, scaled as a force.
    #[must_use]
    pub fn scale_load(&self, e: &[f64]) -> Vec<f64> {
        let mut load: Vec<f64> = Vec::with_capacity(e.len());
        for (column, e) in self.triangle.iter().zip(e) {
            // Tᵀ ê = e, forward.
            let terms = column.iter().zip(&load);
            let solved: f64 = terms.map(|(t, x)| t * x).sum();
            load.push((times_two_to(*e, -self.force_exponent) - solved) / column[load.len()]);
        }
        load
    }

    /// `a` in the units of the caller from the scaled `â = T a`.
    #[must_use]
    pub fn rigid_from_scaled(&self, scaled: &[f64]) -> Vec<f64> {
        let mut a: Vec<f64> = scaled.iter().map(|x| x * self.rigid_unit).collect();
        for j in (0..a.len()).rev() {
            a[j] /= self.triangle[j][j];
            let solved = a[j];
            for (value, t) in a.iter_mut().zip(&self.triangle[j][..j]) {
                *value -= t * solved;
            }
        }
        a
    }

    /// `â = T a`.
    #[must_use]
    pub fn rigid_to_scaled(&self, a: &[f64]) -> Vec<f64> {
        let mut scaled = vec![0.0; a.len()];
        for (column, x) in self.triangle.iter().zip(a) {
            for (value, t) in scaled.iter_mut().zip(column) {
                *value += t * x / self.rigid_unit;
            }
        }
        scaled
    }

    /// `‖r̂‖` of a reaction.
    #[must_use]
    pub fn reaction_norm(&self, r: &[[f64; D]]) -> f64 {
        let (mut squares, mut largest) = (0.0, 0.0_f64);
        for (x, s) in r.iter().zip(&self.to_r) {
            for c in x {
                squares += (c * s).powi(2);
                largest = largest.max((c * s).abs());
            }
        }
        length(squares, largest)
    }
}

/// Orthonormal columns `Q` and the columns of the upper triangle `T`, `A = Q T`.
type Factored<const D: usize> = (Vec<Vec<[f64; D]>>, Vec<Vec<f64>>);

/// Gram–Schmidt, twice.
fn orthonormalise<const D: usize>(mut columns: Vec<Vec<[f64; D]>>) -> Result<Factored<D>, Error> {
    let mut triangle: Vec<Vec<f64>> = Vec::with_capacity(columns.len());
    for j in 0..columns.len() {
        let (done, rest) = columns.split_at_mut(j);
        let column = rest[0].as_flattened_mut();
        let mut t = vec![0.0; j + 1];
        let before = norm(column);
        for _ in 0..2 {
            for (i, q) in done.iter().enumerate() {
                let along: f64 = q
                    .as_flattened()
                    .iter()
                    .zip(&*column)
                    .map(|(a, b)| a * b)
                    .sum();
                t[i] += along;
                for (value, a) in column.iter_mut().zip(q.as_flattened()) {
                    *value -= along * a;
                }
            }
        }
        t[j] = norm(column);
        // The remainder of a dependent column is rounding.
        if t[j] <= 1e-12 * before {
            return Err(Error::DependentMotion { mode: j });
        }
        for value in column.iter_mut() {
            *value /= t[j];
        }
        triangle.push(t);
    }
    Ok((columns, triangle))
}
