//! Reduced problems made from seeds, held or by contact alone.
#![expect(
    clippy::cast_precision_loss,
    clippy::unwrap_used,
    reason = "small counts; a helper of a test may fail"
)]

use std::borrow::Cow;

use super::GO;
use bipot_rs::law::contact_law::ContactLaw;
use bipot_rs::linalg::small::norm;
use bipot_rs::reduced::compliance::Compliance;
use bipot_rs::reduced::reduced::{Reduced, Rigid};
use bipot_rs::solver::{Method, Settings, Solution, Start, solve};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// An elastic-like compliance: contacts on a line whose influence falls with
/// distance, normal and tangential parts coupled, positive definite by a ridge.
pub(crate) fn compliance<const D: usize>(contacts: usize, seed: u64) -> Vec<f64> {
    let mut rng = StdRng::seed_from_u64(seed);
    let m = D * contacts;
    let columns = m + 2;
    let g: Vec<f64> = (0..m * columns)
        .map(|_| rng.random_range(-1.0..1.0))
        .collect();
    let mut w = vec![0.0; m * m];
    for i in 0..m {
        for j in 0..=i {
            let product: f64 = (0..columns)
                .map(|k| g[i * columns + k] * g[j * columns + k])
                .sum();
            let distance = (i / D).abs_diff(j / D);
            let entry =
                product / columns as f64 / (1.0 + distance as f64) + if i == j { 0.5 } else { 0.0 };
            w[i * m + j] = entry;
            w[j * m + i] = entry;
        }
    }
    w
}

pub(crate) struct Case<const D: usize> {
    pub(crate) compliance: Compliance<'static, D>,
    pub(crate) q: Vec<[f64; D]>,
    pub(crate) mu: Vec<f64>,
    pub(crate) rigid: Rigid<D>,
}

impl<const D: usize> Case<D> {
    pub(crate) fn held(contacts: usize, mu: f64, seed: u64) -> Self {
        Self::of(compliance::<D>(contacts, seed), contacts, mu, seed)
    }

    /// Any loads on a given compliance.
    pub(crate) fn of(matrix: Vec<f64>, contacts: usize, mu: f64, seed: u64) -> Self {
        let mut rng = StdRng::seed_from_u64(seed + 1000);
        Self {
            compliance: Compliance::from_dense(contacts, Cow::Owned(matrix)).unwrap(),
            q: (0..contacts)
                .map(|_| std::array::from_fn(|_| rng.random_range(-1.0..0.5)))
                .collect(),
            mu: vec![mu; contacts],
            rigid: Rigid::default(),
        }
    }

    pub(crate) fn floating(contacts: usize, mu: f64, share: f64, seed: u64) -> Self {
        Self::held(contacts, mu, seed).freed(share)
    }

    /// Held by contact alone against a push along the normal and a share of the
    /// friction along the first tangent.
    pub(crate) fn freed(mut self, share: f64) -> Self {
        let contacts = self.q.len();
        let along = |k: usize| {
            let mut motion = [0.0; D];
            motion[k] = 1.0;
            vec![motion; contacts]
        };
        self.rigid = Rigid {
            modes: (0..D).map(along).collect::<Vec<_>>().into(),
            load: (0..D)
                .map(|k| match k {
                    0 => -(contacts as f64),
                    1 => share * self.mu[0] * contacts as f64,
                    _ => 0.0,
                })
                .collect(),
        };
        self
    }

    pub(crate) fn problem(&self) -> Reduced<'_, D> {
        coulomb(&self.compliance, &self.q, &self.mu, &self.rigid)
    }

    pub(crate) fn solve(&self, method: Method) -> Solution<D> {
        self.run(&settings(method, 1e-12))
    }

    /// The solution from a cold start.
    pub(crate) fn run(&self, settings: &Settings) -> Solution<D> {
        solve(&self.problem(), settings, &Start::default(), &GO).unwrap()
    }
}

/// The problem of contacts with Coulomb's law.
pub(crate) fn coulomb<'a, const D: usize>(
    compliance: &'a Compliance<'_, D>,
    q: &[[f64; D]],
    mu: &[f64],
    rigid: &Rigid<D>,
) -> Reduced<'a, D> {
    Reduced::new(compliance, q, &ContactLaw::coulomb(mu), rigid).unwrap()
}

pub(crate) fn settings(method: Method, tol: f64) -> Settings {
    Settings {
        method,
        tol,
        ..Settings::default()
    }
}

pub(crate) fn apart<const D: usize>(a: &[[f64; D]], b: &[[f64; D]]) -> Vec<f64> {
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    pairs.map(|(x, y)| x - y).collect()
}

/// `‖a − b‖ / ‖b‖`.
pub(crate) fn difference<const D: usize>(a: &[[f64; D]], b: &[[f64; D]]) -> f64 {
    norm(&apart(a, b)) / norm(b.as_flattened())
}
