//! The motions of a body that its supports leave free, and whether contacts can hold them.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::bodies::definite::is_interior_safe;
use crate::bodies::geometry::Geometry;
use crate::bodies::rank::{Combinations, SAME_BODY};
use crate::bodies::separation::SoftestMotions;
use crate::bodies::softest::{
    DiagonalScaling, MotionBlock, iterate_on_all, iterate_on_contact_set, measure_softest_interior,
};
use crate::bodies::tuning;
use crate::error::Error;
use crate::linalg::jacobi::combine;
use crate::linalg::small::{amax, place_of_largest};
use crate::linalg::sparse::multifrontal::Factor;
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::linalg::sparse::symbolic::Symbolic;

/// A body whose free motions are asked for. Errors name degrees of freedom of the caller.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a> {
    pub stiffness: &'a OwnedMatrix,
    /// Local numbers of the degrees of freedom that contacts touch.
    pub kept: &'a [usize],
    pub symbolic: &'a Arc<Symbolic>,
    /// Degrees of freedom in the numbering of the caller.
    pub dofs: &'a [usize],
    /// The positions of all degrees of freedom, if they are known.
    pub geometry: Option<&'a Geometry>,
    pub stop: &'a AtomicBool,
}

/// Motions without energy.
#[derive(Clone, Debug, Default)]
pub struct FreeMotions {
    /// `Z`, on all degrees of freedom of the body.
    pub whole: Vec<Vec<f64>>,
    /// `R`, the same motions on the kept unknowns, where they are orthonormal.
    pub kept: Vec<Vec<f64>>,
}

impl Question<'_> {
    /// The free motions, and `S` without their rounding, which `regularise` makes of them.
    /// `schur` is `S`, whose kept unknowns `scale` brings to order one.
    pub fn find_free_motions(
        &self,
        scale: &[f64],
        factor: &Factor,
        regularise: impl Fn(&FreeMotions) -> Vec<f64>,
    ) -> Result<(FreeMotions, Vec<f64>), Error> {
        let rigid = self.find_rigid_motions();
        let motions = self.hold_by_contacts(rigid.as_deref().unwrap_or_default())?;
        let s = regularise(&motions);
        let of = (self.stiffness, self.kept, factor);
        let on_contact_set = |width| iterate_on_contact_set(of, &s, scale, width, self.stop);
        let softest = self.find_softest(&motions.whole, on_contact_set)?;
        let softest = match softest.filter(|softest| !softest.doubtful) {
            Some(softest) => softest,
            // Motions extended from the contact set collect there the imbalance of the whole K;
            // for a stiff part on a soft one, S may be rounding. Motions found on all unknowns
            // leave the imbalance where it is.
            None => self.find_softest_of_all(&motions.whole)?,
        };
        let more = self.believe(softest, rigid.is_some())?;
        if more.is_empty() {
            return Ok((motions, s));
        }
        let motions = self.hold_by_contacts(&[motions.whole, more].concat())?;
        let s = regularise(&motions);
        Ok((motions, s))
    }

    /// Examines the softest motions of the whole body, with contact set and interior.
    pub fn check_whole(&self) -> Result<(), Error> {
        let is_bare = |&i: &usize| self.stiffness.is_empty_row(i) && !self.kept.contains(&i);
        if let Some(dof) = (0..self.dofs.len()).find(is_bare) {
            return Err(Error::FloatingBody {
                dof: self.dofs[dof],
            });
        }
        let rigid = self.find_rigid_motions();
        if let Some(motions) = &rigid {
            let _ = self.hold_by_contacts(motions)?;
        }
        let mut motions = rigid.clone().unwrap_or_default();
        let softest = self.find_softest_of_all(&motions)?;
        let more = self.believe(softest, rigid.is_some())?;
        if !more.is_empty() {
            motions.extend(more);
            let _ = self.hold_by_contacts(&motions)?;
        }
        Ok(())
    }

    /// The error after a pivot that is not positive.
    pub fn explain_pivot(&self, met: Error) -> Result<Error, Error> {
        match self.check_whole() {
            Err(Error::Interrupted) => Err(Error::Interrupted),
            Err(reason) => Ok(reason),
            Ok(()) => Ok(match met {
                // No motion has zero or negative energy: the pivot is rounding.
                Error::Indefinite { dof } | Error::FloatingBody { dof } => Error::FewDigits {
                    dof: self.dofs[dof],
                },
                other => other,
            }),
        }
    }

    /// Whether the interior is so soft that motions of it may be free.
    pub fn may_float_inside(&self, factor: &Factor) -> bool {
        if is_interior_safe(factor.weakest_pivot()) {
            return false;
        }
        let weights = DiagonalScaling::new(self.stiffness);
        measure_softest_interior(factor, &weights, self.kept) <= tuning::doubtful_energy()
    }

    /// Rigid motions that supports leave free, from the positions of the degrees of freedom, if
    /// these are known.
    fn find_rigid_motions(&self) -> Option<Vec<Vec<f64>>> {
        let geometry = self.geometry?;
        geometry.find_free_motions(self.dofs, self.stiffness)
    }

    /// Motions made orthonormal on the kept unknowns.
    fn hold_by_contacts(&self, motions: &[Vec<f64>]) -> Result<FreeMotions, Error> {
        let of_kept = |z: &Vec<f64>| self.kept.iter().map(|&i| z[i]).collect::<Vec<f64>>();
        let at_contacts = Combinations::new(motions.iter().map(of_kept).collect());
        let mut held = FreeMotions::default();
        let columns = at_contacts.columns.into_iter().zip(at_contacts.sizes);
        for ((mut z, length), amounts) in columns.zip(&at_contacts.amounts) {
            let mut motion = combine(motions, amounts);
            // Relative to the motion itself: of one that moves no contact, rounding is left.
            if !(length > SAME_BODY * amax(&motion)) {
                return Err(self.refuse_floating(&motion));
            }
            for x in z.iter_mut().chain(&mut motion) {
                *x /= length;
            }
            held.kept.push(z);
            held.whole.push(motion);
        }
        Ok(held)
    }

    fn refuse_floating(&self, motion: &[f64]) -> Error {
        Error::FloatingBody {
            dof: self.find_most_moved(motion),
        }
    }

    fn find_most_moved(&self, motion: &[f64]) -> usize {
        self.dofs[place_of_largest(motion)]
    }

    fn refuse_indefinite(&self) -> Error {
        Error::Indefinite { dof: self.dofs[0] }
    }

    fn find_softest_of_all(&self, removed: &[Vec<f64>]) -> Result<SoftestMotions, Error> {
        let of = (self.stiffness, self.kept, self.symbolic);
        let weights = DiagonalScaling::new(self.stiffness);
        let on_all = |width| iterate_on_all(of, &weights, removed.len() + width, self.stop);
        let softest = self.find_softest(removed, on_all)?;
        softest.ok_or_else(|| self.refuse_indefinite())
    }

    /// The null motions among a growing number of soft ones, until some are not null; `None` if
    /// there are no soft motions. `removed` are free motions that are known.
    fn find_softest(
        &self,
        removed: &[Vec<f64>],
        iterate: impl Fn(usize) -> Result<Option<MotionBlock>, Error>,
    ) -> Result<Option<SoftestMotions>, Error> {
        let weights = DiagonalScaling::new(self.stiffness);
        let mut width = tuning::block_width();
        loop {
            let Some(block) = iterate(width)? else {
                return Ok(None);
            };
            let all = block.columns.len() < width;
            let shift = block.shift;
            let softest = SoftestMotions::separate(self.stiffness, &weights, removed, block);
            if softest.negative {
                return Err(self.refuse_indefinite());
            }
            if all || softest.is_complete(shift) {
                return Ok(Some(softest));
            }
            width *= 2;
        }
    }

    /// The motions without energy that are free beyond doubt.
    fn believe(
        &self,
        softest: SoftestMotions,
        rigid_are_known: bool,
    ) -> Result<Vec<Vec<f64>>, Error> {
        let mut null = softest.null;
        if rigid_are_known {
            // A rigid motion that is held by the geometry is held, by any lever arm.
            null.retain(|x| !self.is_rigid(x));
            if softest.gap < tuning::mechanism_gap() {
                null.clear();
            }
        } else if let Some(motion) = null.first()
            && softest.gap < tuning::clear_gap()
        {
            let dof = self.find_most_moved(motion);
            return Err(Error::FewDigits { dof });
        }
        Ok(null)
    }

    fn is_rigid(&self, motion: &[f64]) -> bool {
        let geometry = self.geometry;
        geometry.is_some_and(|geometry| geometry.is_rigid(self.dofs, motion))
    }
}
