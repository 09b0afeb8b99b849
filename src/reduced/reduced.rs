//! The reduced problem (5), `v = W r + R a + q`, checked and scaled once.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use crate::error::{Error, check_finite, check_length};
use crate::law::bipotential::law_step;
use crate::law::contact_law::{self, ContactLaw};
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::small::{add_scaled, amax, length, norm, norm_of, scale_rows};
use crate::linalg::sparse::blocks::Blocks;
use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::sparse_lu::Analysis;
use crate::reduced::compliance::{Compliance, Whole};
use crate::reduced::gram::factor_gram;
use crate::reduced::rigid_motions::{RigidMotions, border_block};
use crate::reduced::tuning;

/// Rigid motions of bodies that only contact holds: `v = W r + R a + q` with `Rᵀ r + e = 0`.
#[derive(Clone, Debug, Default)]
pub struct Rigid<const D: usize> {
    /// `R`.
    pub modes: RigidMotions<D>,
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
    /// [`Reduced::whole`] with rows and columns of the rigid motions, made on first use.
    bordered: OnceLock<Arc<Whole<D>>>,
    /// [`Reduced::free_size`], made on first use.
    free_size: OnceLock<f64>,
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
        if !rigid.modes.is_empty() {
            check_length("rigid motion R", rigid.modes.contacts(), contacts)?;
            check_finite("rigid motion R", rigid.modes.values().as_flattened())?;
        }
        contact_law::check(law, contacts)?;
        let q = compliance.gather(q);
        let rigid = Rigid {
            modes: rigid.modes.gather(compliance.order()),
            load: rigid.load.clone(),
        };
        let mut contradiction = None;
        for (position, free) in q.iter().enumerate() {
            let held = !compliance.moves(position)
                && rigid.modes.at(position).all(|(_, motion)| motion[0] == 0.0);
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
            bordered: OnceLock::new(),
            free_size: OnceLock::new(),
        })
    }

    pub fn with_load(&self, load: Vec<f64>) -> Self {
        let mut other = self.clone();
        other.scaling.load = other.scaling.scale_load(&load);
        other.rigid.load = load;
        other
    }

    pub fn scaled_law(&self, contact: usize) -> ContactLaw {
        self.law[contact].scaled(self.scaling.to_r[contact])
    }

    /// The same problem with `q = 0`.
    pub fn without_offset(&self) -> Result<Self, Error> {
        let mut other = self.clone();
        other.q.fill([0.0; D]);
        other.scaling = Scaling::new(self.compliance, &other.q, &self.rigid)?;
        other.contradiction = None;
        other.free_size = OnceLock::new();
        Ok(other)
    }

    pub fn contacts(&self) -> usize {
        self.q.len()
    }

    /// Whether only rigid motions displace the contacts.
    pub fn moves_rigidly(&self) -> bool {
        !self.rigid.modes.is_empty()
            && (0..self.contacts()).all(|i| self.compliance.block(i).amax() == 0.0)
    }

    /// [`Compliance::whole`]; with many rigid motions the matrix `(W, R̂; R̂ᵀ, 0)`, its motions in
    /// blocks of `D` after the contacts.
    pub fn whole(&self) -> Result<Option<&Whole<D>>, Error> {
        let Some(whole) = self.compliance.whole()? else {
            return Ok(None);
        };
        if !self.scaling.is_sparse() {
            return Ok(Some(whole));
        }
        if self.bordered.get().is_none() {
            let (n, modes) = (self.contacts(), &self.scaling.modes);
            let mut moved = vec![Vec::new(); modes.len().div_ceil(D)];
            for contact in 0..n {
                for (c, motion) in modes.at(contact) {
                    moved[c / D].push((contact, border_block(c, motion).transpose()));
                }
            }
            let blocks = Blocks::from_rows(n + moved.len(), |i, add| {
                if i >= n {
                    moved[i - n].iter().for_each(|(j, block)| add(*j, *block));
                    return;
                }
                whole.blocks.in_row(i).for_each(|(j, w)| add(j, *w));
                for (c, motion) in modes.at(i) {
                    add(n + c / D, border_block(c, motion));
                }
            });
            let analysis = Analysis::new(&blocks)?;
            let _ = self.bordered.set(Arc::new(Whole { blocks, analysis }));
        }
        Ok(self.bordered.get().map(Arc::as_ref))
    }

    pub fn relative_displacement(&self, r: &[[f64; D]], a: &[f64]) -> Vec<[f64; D]> {
        let mut v = vec![[0.0; D]; r.len()];
        self.compliance.product(r, &mut v);
        self.add_rest(a, &mut v);
        v
    }

    /// [`Self::relative_displacement`] with sums in twice the precision.
    pub fn exact_displacement(&self, r: &[[f64; D]], a: &[f64]) -> Vec<[f64; D]> {
        let mut v = vec![[0.0; D]; r.len()];
        for (i, value) in v.iter_mut().enumerate() {
            for k in 0..D {
                let mut sum = self.compliance.exact_row(i, k, r);
                sum.add(self.q[i][k]);
                for (c, motion) in self.rigid.modes.at(i) {
                    sum.add_product(motion[k], a[c]);
                }
                value[k] = sum.value();
            }
        }
        v
    }

    /// `‖F(0)‖` with the rigid motion `a`, which is always the same if there are none.
    pub fn free_size(&self, a: &[f64]) -> f64 {
        let find = || {
            let mut free = vec![[0.0; D]; self.contacts()];
            self.add_rest(a, &mut free);
            let of_contact = |(i, v): (usize, &[f64; D])| {
                let v = v.map(|c| c * self.scaling.to_v[i]);
                let (projected, _) = law_step(&[0.0; D], &v, 1.0, self.scaled_law(i));
                projected.iter().map(|c| c * c).sum::<f64>()
            };
            free.iter().enumerate().map(of_contact).sum::<f64>().sqrt()
        };
        if self.rigid.modes.is_empty() {
            *self.free_size.get_or_init(find)
        } else {
            find()
        }
    }

    /// `v += R a + q`.
    pub fn add_rest(&self, a: &[f64], v: &mut [[f64; D]]) {
        add_scaled(v.as_flattened_mut(), 1.0, self.q.as_flattened());
        self.add_rigid(a, v);
    }

    /// `v += R a`.
    pub fn add_rigid(&self, a: &[f64], v: &mut [[f64; D]]) {
        self.rigid.modes.add_product(a, v);
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
    /// Columns of the scaled rigid motions, `R̂ T = D R`: orthonormal, of many of length 1.
    pub modes: RigidMotions<D>,
    /// `ê = T⁻ᵀ e`, scaled as a force.
    pub load: Vec<f64>,
    basis: Basis,
    /// `a = T⁻¹ â · rigid_unit`.
    rigid_unit: f64,
    /// Forces are scaled by two to minus this.
    force_exponent: i32,
}

/// `T`.
#[derive(Clone, Debug)]
enum Basis {
    /// Upper triangular, column by column.
    Triangle(Vec<Vec<f64>>),
    /// The lengths of the columns of `D R`, and the factor of `R̂ᵀ R̂`, by which lengths are those
    /// with orthonormal columns: these would fill `R̂`.
    Lengths(Vec<f64>, Arc<Factor>),
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
        let free = amax(scale_rows(q, &node).as_flattened());
        let force = amax(&rigid.load);
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
        let to_v = node
            .iter()
            .map(|&d| times_two_to(d, -displacement_exponent));
        let to_r = node.iter().map(|&d| times_two_to(1.0 / d, -force_exponent));
        let (to_v, to_r): (Vec<f64>, Vec<f64>) = (to_v.collect(), to_r.collect());
        let mut modes = rigid.modes.map(|i, _, motion| motion.map(|c| c * node[i]));
        // Also if R is dense: factors of W alone lose the digits of motions that deform nothing.
        let basis = if modes.len() >= tuning::sparse_contacts() && compliance.is_sparse() {
            let lengths = modes.lengths();
            if let Some(mode) = lengths.iter().position(|&length| length == 0.0) {
                return Err(Error::DependentMotion { mode });
            }
            modes = modes.map(|_, c, motion| motion.map(|x| x / lengths[c]));
            let rows = |row: usize, add: &mut dyn FnMut(usize, f64)| {
                modes
                    .at(row / D)
                    .for_each(|(c, motion)| add(c, motion[row % D]));
            };
            let never = AtomicBool::new(false);
            let gram = factor_gram(D * compliance.contacts(), lengths.len(), rows, &never)?;
            Basis::Lengths(lengths, Arc::new(gram))
        } else {
            let (columns, triangle) = orthonormalise(modes.columns())?;
            modes = columns.into();
            Basis::Triangle(triangle)
        };
        let usable = |s: &f64| s.is_finite() && *s > 0.0;
        if !to_v.iter().chain(&to_r).all(usable) {
            return Err(Error::Range { softest, free });
        }
        let mut scaling = Self {
            to_v,
            to_r,
            modes,
            load: Vec::new(),
            basis,
            rigid_unit: times_two_to(1.0, displacement_exponent),
            force_exponent,
        };
        scaling.load = scaling.scale_load(&rigid.load);
        Ok(scaling)
    }

    /// `ê = T⁻ᵀ e`, scaled as a force.
    pub fn scale_load(&self, e: &[f64]) -> Vec<f64> {
        let triangle = match &self.basis {
            Basis::Triangle(triangle) => triangle,
            Basis::Lengths(lengths, _) => {
                let scaled = e.iter().zip(lengths);
                return scaled
                    .map(|(e, length)| times_two_to(*e, -self.force_exponent) / length)
                    .collect();
            }
        };
        let mut load: Vec<f64> = Vec::with_capacity(e.len());
        for (column, e) in triangle.iter().zip(e) {
            // Tᵀ ê = e, forward.
            let terms = column.iter().zip(&load);
            let solved: f64 = terms.map(|(t, x)| t * x).sum();
            load.push((times_two_to(*e, -self.force_exponent) - solved) / column[load.len()]);
        }
        load
    }

    /// `a` in the units of the caller from the scaled `â = T a`.
    pub fn rigid_from_scaled(&self, scaled: &[f64]) -> Vec<f64> {
        let mut a: Vec<f64> = scaled.iter().map(|x| x * self.rigid_unit).collect();
        let triangle = match &self.basis {
            Basis::Triangle(triangle) => triangle,
            Basis::Lengths(lengths, _) => {
                a.iter_mut()
                    .zip(lengths)
                    .for_each(|(a, length)| *a /= length);
                return a;
            }
        };
        for j in (0..a.len()).rev() {
            a[j] /= triangle[j][j];
            let solved = a[j];
            add_scaled(&mut a[..j], -solved, &triangle[j]);
        }
        a
    }

    /// `â = T a`.
    pub fn rigid_to_scaled(&self, a: &[f64]) -> Vec<f64> {
        let triangle = match &self.basis {
            Basis::Triangle(triangle) => triangle,
            Basis::Lengths(lengths, _) => {
                let pairs = a.iter().zip(lengths);
                return pairs
                    .map(|(a, length)| a / self.rigid_unit * length)
                    .collect();
            }
        };
        let mut scaled = vec![0.0; a.len()];
        for (column, x) in triangle.iter().zip(a) {
            for (value, t) in scaled.iter_mut().zip(column) {
                *value += t * x / self.rigid_unit;
            }
        }
        scaled
    }

    /// Whether `R̂` is sparse, and its columns not orthonormal.
    pub fn is_sparse(&self) -> bool {
        matches!(self.basis, Basis::Lengths(..))
    }

    /// The length of forces on the rigid motions, that with orthonormal columns.
    pub fn force_norm(&self, forces: &[f64]) -> f64 {
        match &self.basis {
            Basis::Triangle(_) => norm(forces),
            Basis::Lengths(_, gram) => {
                let mut scaled = forces.to_vec();
                gram.condense(&mut scaled, 1);
                norm(&scaled)
            }
        }
    }

    /// The `â` for which `R̂ â` is nearest to `v̂`.
    pub fn fit(&self, v: &[[f64; D]]) -> Vec<f64> {
        let mut fitted = self.modes.work(v, &vec![1.0; v.len()]);
        if let Basis::Lengths(_, gram) = &self.basis {
            gram.condense(&mut fitted, 1);
            gram.recover(&mut fitted, 1);
        }
        fitted
    }

    /// The length of `R̂ â`.
    pub fn motion_norm(&self, scaled: &[f64]) -> f64 {
        if !self.is_sparse() {
            return norm(scaled);
        }
        let mut v = vec![[0.0; D]; self.to_v.len()];
        self.modes.add_product(scaled, &mut v);
        norm(v.as_flattened())
    }

    /// `r̂` and `v̂` of a contact.
    pub fn scale(&self, contact: usize, r: &[f64; D], v: &[f64; D]) -> ([f64; D], [f64; D]) {
        let (to_r, to_v) = (self.to_r[contact], self.to_v[contact]);
        (r.map(|c| c * to_r), v.map(|c| c * to_v))
    }

    /// `‖v̂‖` of a displacement.
    pub fn displacement_norm(&self, v: &[[f64; D]]) -> f64 {
        let scaled = v.iter().zip(&self.to_v);
        norm_of(scaled.flat_map(|(v, s)| v.map(|c| c * s)))
    }

    /// `‖r̂‖` of a reaction.
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
                let terms = q.as_flattened().iter().zip(&*column);
                let along: f64 = terms.map(|(a, b)| a * b).sum();
                t[i] += along;
                add_scaled(column, -along, q.as_flattened());
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
