//! A body on its way to a condensed one: ordered and counted, then factored.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use crate::bodies::definite::is_interior_safe;
use crate::bodies::free_motions::Question;
use crate::bodies::geometry::Geometry;
use crate::condensation::body::{Body, DIGITS, Interior};
use crate::condensation::contact_stiffness::ContactStiffness;
use crate::condensation::ordered::OrderedBody;
use crate::condensation::pattern_cache::Lookup;
use crate::error::Error;
use crate::linalg::power_of_two::{exponent, times_two_to};
use crate::linalg::sparse::csc::Symmetric;
use crate::linalg::sparse::multifrontal::{Factor, Schur};
use crate::linalg::sparse::rows::OwnedMatrix;
use crate::linalg::sparse::symbolic::{Counts, Options, Symbolic};

/// A body before its factorisation: the costs of the condensation are known.
#[derive(Debug)]
pub struct AnalysedBody {
    body: OrderedBody,
    /// Whether the analysis is that of the same body with other values.
    again: bool,
}

impl AnalysedBody {
    /// Orders and counts. It uses the analysis of the same body with other values, or else the
    /// analysis `of_pattern` of its pattern. `kept` are local numbers; `stiffest` is the size of
    /// the stiffness.
    pub fn new(
        dofs: Vec<usize>,
        mut stiffness: OwnedMatrix,
        kept: Vec<usize>,
        geometry: Option<Arc<Geometry>>,
        before: Option<&Body>,
        of_pattern: Option<Arc<Symbolic>>,
        stiffest: f64,
    ) -> Result<Self, Error> {
        let unit = times_two_to(1.0, -exponent(stiffest).clamp(-1000, 1000));
        for value in &mut stiffness.values {
            *value *= unit;
        }
        let view = stiffness.view();
        let before = before.map(Body::ordered).filter(|body| {
            body.dofs == dofs && body.kept == kept && body.symbolic.check_pattern(&view).is_ok()
        });
        let again = before.is_some();
        let analysed = before.map(|body| Arc::clone(&body.symbolic)).or(of_pattern);
        let was_ordered = analysed.is_none();
        let symbolic = match analysed {
            Some(symbolic) => symbolic,
            None => analyse(&view, &dofs, &kept, geometry.as_deref())?,
        };
        let body = OrderedBody {
            dofs,
            stiffness,
            unit,
            kept,
            geometry,
            symbolic,
            was_ordered,
        };
        Ok(Self { body, again })
    }

    /// Stores an analysis made here for other problems with its pattern.
    pub fn share(&self) {
        let body = &self.body;
        if body.was_ordered {
            let geometry = body.geometry.as_ref();
            let places = geometry.map(|geometry| geometry.list_places(&body.dofs));
            let asked = Lookup {
                matrix: body.stiffness.view(),
                kept: &body.kept,
                places: places.as_deref(),
            };
            asked.keep(&body.symbolic);
        }
    }

    /// The same body with other kept unknowns.
    pub fn again(body: &OrderedBody, kept: Vec<usize>) -> Result<Self, Error> {
        let (view, geometry) = (body.stiffness.view(), body.geometry.as_deref());
        let body = OrderedBody {
            symbolic: analyse(&view, &body.dofs, &kept, geometry)?,
            kept,
            was_ordered: true,
            ..body.clone()
        };
        Ok(Self { body, again: false })
    }

    /// Bytes that it holds besides those of the factorisation.
    pub fn bytes(&self) -> u128 {
        let (k, dofs) = (&self.body.stiffness, self.body.dofs.len());
        let places = self.body.geometry.as_ref().map_or(0, |_| 24 * dofs);
        let numbers = k.pointer.len() + k.index.len() + k.values.len() + 2 * dofs;
        // Memory that earlier steps leave in the heap, as measured.
        let lists = 160 * dofs;
        (8 * numbers + places + lists) as u128
    }

    /// Bytes that it holds for the factor, from an earlier one of the same pattern.
    pub fn bytes_spare(&self) -> u128 {
        self.body.symbolic.bytes_spare() as u128
    }

    /// Further bytes of a repeated factorisation that leaves its stack to the next one: S is
    /// then made beside it. 0 for the first factorisation of an analysis.
    pub fn bytes_left(&self) -> u128 {
        if self.again {
            self.body.symbolic.bytes_stack() as u128 + 8 * (self.counts().kept as u128).pow(2)
        } else {
            0
        }
    }

    /// Whether it does so: after two matrices, more are expected.
    pub fn leave_stack(&self, leave: bool) {
        self.body.symbolic.keep_stack(leave && self.again);
    }

    /// The cost of the factorisation.
    pub fn counts(&self) -> &Counts {
        self.body.counts()
    }

    /// Condenses the body. If supports hold it and `loads` are given, it keeps the condensed
    /// loads and drops the factor. `loads` are forces on all degrees of freedom.
    pub fn condense(self, loads: Option<&[Vec<f64>]>, stop: &AtomicBool) -> Result<Body, Error> {
        let begin = Instant::now();
        if let Some(loads) = loads
            && let Some((contact, interior, until_s)) = self.without_factor(loads, stop)?
            // Otherwise solutions will be corrected with K itself, by the factor.
            && contact.amplification <= DIGITS
        {
            return Ok(Body::new(self.body, contact, interior, [begin, until_s]));
        }
        let body = &self.body;
        let question = self.ask(stop);
        let view = body.stiffness.view();
        let mut factor = match Factor::new(Arc::clone(&body.symbolic), &view, stop) {
            Ok(factor) => factor,
            Err(error @ (Error::Indefinite { .. } | Error::FloatingBody { .. })) => {
                return Err(question.explain_pivot(error)?);
            }
            Err(other) => return Err(other),
        };
        if question.may_float_inside(&factor) {
            drop(factor);
            question.check_whole()?;
            factor = Factor::new(Arc::clone(&body.symbolic), &view, stop)?;
        }
        let schur = factor.take_schur();
        let until_s = Instant::now();
        let weakest = factor.weakest_pivot();
        let contact = match ContactStiffness::of_held_body(body, &schur, weakest, stop)? {
            Some(contact) => contact,
            None => ContactStiffness::of_loose_body(body, &schur, &factor, &question)?,
        };
        drop(schur);
        let interior = Interior::Factored(factor);
        Ok(Body::new(self.body, contact, interior, [begin, until_s]))
    }

    /// What can move.
    fn ask<'a>(&'a self, stop: &'a AtomicBool) -> Question<'a> {
        Question {
            stiffness: &self.body.stiffness,
            kept: &self.body.kept,
            symbolic: &self.body.symbolic,
            dofs: &self.body.dofs,
            geometry: self.body.geometry.as_deref(),
            stop,
        }
    }

    /// `S`, the kept part of the loads, and the time at which S was made, if supports hold the
    /// body beyond doubt. Otherwise the decision needs the factor.
    fn without_factor(
        &self,
        loads: &[Vec<f64>],
        stop: &AtomicBool,
    ) -> Result<Option<(ContactStiffness, Interior, Instant)>, Error> {
        let body = &self.body;
        let mut local: Vec<f64> = loads.iter().flat_map(|f| body.scale_forces(f)).collect();
        let schur = match Schur::new(&body.symbolic, &body.stiffness.view(), &mut local, stop) {
            Ok(schur) => schur,
            Err(Error::Indefinite { .. } | Error::FloatingBody { .. }) => return Ok(None),
            Err(other) => return Err(other),
        };
        let weakest = schur.weakest_pivot();
        if !is_interior_safe(weakest) {
            return Ok(None);
        }
        let until_s = Instant::now();
        let contact = ContactStiffness::of_held_body(body, schur.values(), weakest, stop)?;
        let columns = local.chunks_exact(body.dofs.len().max(1));
        let loads = columns.map(|column| body.at_contacts(column)).collect();
        Ok(contact.map(|contact| (contact, Interior::OfKnownLoads(loads), until_s)))
    }
}

fn analyse(
    view: &Symmetric,
    dofs: &[usize],
    kept: &[usize],
    geometry: Option<&Geometry>,
) -> Result<Arc<Symbolic>, Error> {
    let places = geometry.map(|geometry| geometry.list_places(dofs));
    let coordinates = places.as_deref();
    Ok(Arc::new(Symbolic::analyse(
        view,
        kept,
        &Options { coordinates },
    )?))
}
