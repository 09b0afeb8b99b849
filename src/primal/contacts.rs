//! What all engines know of the contacts: variables, gaps, friction, and a scale for each.

use std::sync::Arc;

use crate::error::{Error, check_finite, check_length};
use crate::law::contact_law::ContactLaw;
use crate::linalg::small::Block;
use crate::primal::frames::Frames;
use crate::primal::own_nodes::Frame;
use crate::primal::tuning;
use crate::reduced::compliance::{Compliance, Part};

/// The contacts of a problem.
#[derive(Clone, Debug)]
pub struct Contacts<const D: usize> {
    pub frames: Arc<Frames<D>>,
    pub gap: Vec<[f64; D]>,
    pub law: Vec<ContactLaw>,
    /// Estimates of the blocks `W_ii`, diagonal.
    pub compliance: Arc<Compliance<'static, D>>,
}

impl<const D: usize> Contacts<D> {
    /// `block` is the diagonal block of `K` of a node.
    pub fn new(
        frames: Frames<D>,
        gap: Vec<[f64; D]>,
        law: Vec<ContactLaw>,
        block: &dyn Fn(usize) -> Block<D>,
    ) -> Result<Self, Error> {
        let compliance = Arc::new(node_compliance(&frames, block)?);
        Ok(Self {
            frames: Arc::new(frames),
            gap,
            law,
            compliance,
        })
    }

    /// Number of contacts.
    pub fn count(&self) -> usize {
        self.gap.len()
    }

    /// The same contacts with other gaps.
    pub fn with_gap(&self, gap: Vec<[f64; D]>) -> Result<Self, Error> {
        check_length("gap", gap.len(), self.count())?;
        check_finite("gap", gap.as_flattened())?;
        Ok(Self {
            gap,
            ..self.clone()
        })
    }

    /// The contacts of each body that is not `held`; `bodies` is the body of each node.
    pub fn floating(&self, bodies: &[u32], held: &[bool]) -> Vec<Vec<usize>> {
        let mut contacts = vec![Vec::new(); held.len()];
        for (i, frame) in self.frames.with_node() {
            let masters = self.frames.masters(i).iter().map(|(node, _)| *node);
            for node in std::iter::once(frame.node).chain(masters) {
                let body = bodies[node] as usize;
                if !held[body] && contacts[body].last() != Some(&i) {
                    contacts[body].push(i);
                }
            }
        }
        contacts.retain(|contacts| !contacts.is_empty());
        contacts
    }
}

/// Estimates of `W_ii` from the diagonal of `K`, of all bodies.
fn node_compliance<const D: usize>(
    frames: &Frames<D>,
    own: &dyn Fn(usize) -> Block<D>,
) -> Result<Compliance<'static, D>, Error> {
    let of_contact = |(i, frame): (usize, &Frame<D>)| {
        let mut block = vec![0.0; D * D];
        if frame.node != usize::MAX {
            let local = frame
                .from_local
                .tr_mul(&(own(frame.node) * frame.from_local));
            let mut sum = [0.0; D];
            for k in (0..D).filter(|&k| frame.free[k]) {
                sum[k] = local[(k, k)].recip();
            }
            for (node, columns) in frames.masters(i) {
                let master = own(*node);
                for (k, sum) in sum.iter_mut().enumerate() {
                    let parts = (0..D).map(|c| columns[(k, c)].powi(2) / master[(c, c)]);
                    *sum += parts.sum::<f64>();
                }
            }
            for (k, sum) in sum.into_iter().enumerate() {
                block[k * D + k] = tuning::compliance_of_node() * sum;
            }
        }
        (vec![i], Part::Dense(block.into()))
    };
    Compliance::new(frames.list.iter().enumerate().map(of_contact).collect())
}
