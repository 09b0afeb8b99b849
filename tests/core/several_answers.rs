//! All solutions of small plane problems compared with a plain enumeration, and verdicts on
//! uniqueness compared with their number.

#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]

use std::borrow::Cow;
use std::sync::atomic::AtomicBool;

use crate::common::GO;
use crate::common::cases::coulomb;
use bipot_rs::error::Error;
use bipot_rs::proof::uniqueness::{Unique, assess, assess_plane};
use bipot_rs::reduced::compliance::Compliance;
use bipot_rs::reduced::reduced::{Reduced, Rigid};
use bipot_rs::solver::enumerate::{Enumeration, answers};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// `W`, `q`, `μ` and rigid motions of a plane problem.
struct Case {
    w: Vec<f64>,
    q: Vec<[f64; 2]>,
    mu: Vec<f64>,
    rigid: Rigid<2>,
}

impl Case {
    /// `W = G Gᵀ + ridge`, friction from none to far above what is unique.
    fn random(seed: u64) -> Self {
        let mut rng = StdRng::seed_from_u64(seed);
        let contacts = rng.random_range(1..=4);
        Self::of(contacts, &mut rng)
    }

    fn of(contacts: usize, rng: &mut StdRng) -> Self {
        let n = 2 * contacts;
        let g: Vec<f64> = (0..n * n).map(|_| rng.random_range(-1.0..1.0)).collect();
        let mut w = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                let product: f64 = (0..n).map(|k| g[i * n + k] * g[j * n + k]).sum();
                let entry = product + if i == j { 0.05 } else { 0.0 };
                (w[i * n + j], w[j * n + i]) = (entry, entry);
            }
        }
        let most = [0.0, 0.2, 0.8, 3.0, 12.0][rng.random_range(0..5)];
        Self {
            w,
            q: (0..contacts)
                .map(|_| [rng.random_range(-1.0..0.5), rng.random_range(-1.0..1.0)])
                .collect(),
            mu: (0..contacts)
                .map(|_| most * rng.random_range(0.5..1.0))
                .collect(),
            rigid: Rigid::default(),
        }
    }

    /// Held by contact alone: one rigid motion over all contacts.
    fn floating(seed: u64) -> Self {
        let mut case = Self::random(seed);
        let mut rng = StdRng::seed_from_u64(seed + 7_000_000);
        let side: f64 = rng.random_range(-1.0..1.0);
        case.rigid = Rigid {
            modes: vec![vec![[1.0, side]; case.q.len()]].into(),
            load: vec![rng.random_range(-1.5..0.2)],
        };
        case
    }

    fn with<T>(&self, use_it: impl FnOnce(&Reduced<2>) -> T) -> T {
        let compliance = Compliance::from_dense(self.q.len(), Cow::Borrowed(&self.w)).unwrap();
        use_it(&coulomb(&compliance, &self.q, &self.mu, &self.rigid))
    }

    fn all(&self) -> Enumeration<2> {
        self.with(|problem| answers(problem, &GO).unwrap())
    }

    /// The same by dense elimination of all unknowns `r, v, a` for every choice of
    /// statuses: reactions, of each answer once.
    fn plainly(&self) -> Vec<Vec<f64>> {
        let contacts = self.q.len();
        let modes = self.rigid.modes.len();
        let m = 2 * contacts;
        let n = 2 * m + modes;
        let mut found: Vec<Vec<f64>> = Vec::new();
        for code in 0..4_usize.pow(u32::try_from(contacts).unwrap()) {
            // Unknowns r, v, a; rows v - W r - R a = q, Rᵀ r = -e, two a contact.
            let mut rows = vec![vec![0.0; n + 1]; n];
            for (i, row) in rows.iter_mut().enumerate().take(m) {
                row[m + i] = 1.0;
                for (entry, w) in row.iter_mut().zip(&self.w[i * m..(i + 1) * m]) {
                    *entry = -w;
                }
                row[n] = self.q[i / 2][i % 2];
                for (c, mode) in self.rigid.modes.at(i / 2) {
                    row[2 * m + c] = -mode[i % 2];
                }
            }
            for (c, mode) in self.rigid.modes.columns().iter().enumerate() {
                rows[m + c][..m].copy_from_slice(mode.as_flattened());
            }
            for (c, load) in self.rigid.load.iter().enumerate() {
                rows[m + c][n] = -load;
            }
            let label = |i: usize| code / 4_usize.pow(u32::try_from(i).unwrap()) % 4;
            for i in 0..contacts {
                let at = m + modes + 2 * i;
                let (r_n, r_t, v_n, v_t) = (2 * i, 2 * i + 1, m + 2 * i, m + 2 * i + 1);
                let mut put = |k: usize, unknown: usize, value: f64| rows[at + k][unknown] = value;
                match label(i) {
                    0 => {
                        put(0, r_n, 1.0);
                        put(1, r_t, 1.0);
                    }
                    1 => {
                        put(0, v_n, 1.0);
                        put(1, v_t, 1.0);
                    }
                    side => {
                        put(0, v_n, 1.0);
                        put(1, r_t, 1.0);
                        put(1, r_n, if side == 2 { self.mu[i] } else { -self.mu[i] });
                    }
                }
            }
            let Some(x) = eliminate(rows) else { continue };
            let size = x[..2 * m].iter().fold(1.0_f64, |s, c| s.max(c.abs()));
            // Condition numbers of random matrices of this size stay below 1e6.
            let least = -1e-9 * size;
            let lawful = (0..contacts).all(|i| {
                let (r_n, r_t, v_n, v_t) = (x[2 * i], x[2 * i + 1], x[m + 2 * i], x[m + 2 * i + 1]);
                let slip = self.mu[i] == 0.0;
                match label(i) {
                    0 => v_n >= least,
                    1 => r_n >= least && self.mu[i] * r_n - r_t.abs() >= least,
                    2 => r_n >= least && (slip || v_t >= least),
                    _ => r_n >= least && (slip || -v_t >= least),
                }
            });
            let r = x[..m].to_vec();
            if lawful && !found.iter().any(|other| near(other, &r)) {
                found.push(r);
            }
        }
        found
    }
}

/// The same to the accuracy of either enumeration.
fn near(x: &[f64], y: &[f64]) -> bool {
    let size = x.iter().fold(1.0_f64, |m, c| m.max(c.abs()));
    x.iter().zip(y).all(|(a, b)| (a - b).abs() <= 1e-7 * size)
}

/// Gauss's elimination with partial pivoting of an augmented matrix.
fn eliminate(mut rows: Vec<Vec<f64>>) -> Option<Vec<f64>> {
    let n = rows.len();
    for k in 0..n {
        let best = (k..n).max_by(|&i, &j| rows[i][k].abs().total_cmp(&rows[j][k].abs()))?;
        rows.swap(k, best);
        if rows[k][k].abs() < 1e-10 {
            return None;
        }
        let pivots = rows[k].clone();
        for row in &mut rows[k + 1..] {
            let factor = row[k] / pivots[k];
            for (value, p) in row.iter_mut().zip(&pivots) {
                *value -= factor * p;
            }
        }
    }
    let mut x = vec![0.0; n];
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| rows[k][j] * x[j]).sum();
        x[k] = (rows[k][n] - known) / rows[k][k];
    }
    Some(x)
}

fn agree(case: &Case, seed: u64) {
    let (all, plainly) = (case.all(), case.plainly());
    assert!(all.complete, "seed {seed}");
    assert_eq!(all.answers.len(), plainly.len(), "seed {seed}");
    for (r, _) in &all.answers {
        let r = r.as_flattened();
        assert!(plainly.iter().any(|other| near(other, r)), "seed {seed}");
    }
}

#[test]
fn all_answers_are_those_of_a_plain_enumeration() {
    let mut several = 0;
    for seed in 0..600 {
        let case = Case::random(seed);
        agree(&case, seed);
        let count = case.all().answers.len();
        // W is definite: the degree is odd, and so is the number of answers.
        assert_eq!(count % 2, 1, "seed {seed}");
        several += usize::from(count > 1);
    }
    assert!(several > 15, "{several}"); // the seeds hold both kinds
}

#[test]
fn all_answers_of_bodies_that_contact_alone_holds() {
    let (mut none, mut one) = (0, 0);
    for seed in 0..600 {
        let case = Case::floating(seed);
        agree(&case, seed);
        match case.all().answers.len() {
            0 => none += 1,
            _ => one += 1,
        }
    }
    assert!(none > 30 && one > 30, "{none} {one}"); // the seeds hold both kinds
}

/// As many contacts as a plain enumeration takes a second for, of one kind or another.
fn several(seed: u64, contacts: usize) -> Case {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut case = Case::of(contacts, &mut rng);
    let n = 2 * contacts;
    match seed % 4 {
        0 => {}
        // Indefinite, and not symmetric.
        1 => case
            .w
            .iter_mut()
            .for_each(|w| *w += rng.random_range(-1.0..1.0)),
        // Contacts in two groups that do not feel each other.
        2 => {
            let group = |k: usize| k / 2 % 2;
            let apart = |k: usize| group(k / n) != group(k % n);
            let entries = case.w.iter_mut().enumerate();
            for (_, w) in entries.filter(|(k, _)| apart(*k)) {
                *w = 0.0;
            }
        }
        _ => {
            case.rigid = Rigid {
                modes: vec![
                    case.q
                        .iter()
                        .map(|_| [1.0, rng.random_range(-1.0..1.0)])
                        .collect::<Vec<_>>(),
                ]
                .into(),
                load: vec![rng.random_range(-1.5..0.2)],
            };
        }
    }
    case
}

#[test]
fn all_answers_of_more_contacts() {
    for seed in 0..48 {
        agree(&several(seed, 5), seed);
    }
}

#[test]
fn few_choices_of_twelve_contacts_are_visited() {
    let (mut most, mut sum) = (0, 0);
    for seed in 0..12 {
        let found = several(seed, 12).with(|problem| answers(problem, &GO).unwrap());
        most = most.max(found.visited);
        sum += found.visited;
    }
    // Of 4¹² leaves: some seconds' work at the worst.
    assert!(most < 100_000, "{most}");
    assert!(sum < 12 * 30_000, "{sum}");
}

#[test]
fn uniqueness_is_never_claimed_wrongly() {
    let mut said = [0; 3];
    for seed in 0..1500 {
        let case = Case::random(seed);
        let all = case.all();
        for (r, _) in &all.answers {
            case.with(|problem| {
                let verdict = assess(problem, r, &GO).unwrap();
                match verdict {
                    Unique::Proved => assert_eq!(all.answers.len(), 1, "seed {seed}"),
                    Unique::OthersExist => assert!(all.answers.len() > 1, "seed {seed}"),
                    Unique::Unknown => {}
                }
                said[verdict as usize] += 1;
                // Exhausting so few contacts leaves nothing unknown.
                let decided = if all.answers.len() == 1 {
                    Unique::Proved
                } else {
                    Unique::OthersExist
                };
                assert_eq!(assess_plane(problem, r, &GO).unwrap(), decided);
            });
        }
    }
    assert!(said.iter().all(|&count| count > 40), "{said:?}"); // all three occur
}

/// A plane answer in space: a second tangent that nothing couples to or pushes.
fn in_space(case: &Case, r: &[[f64; 2]], use_it: impl FnOnce(&Reduced<3>, &[[f64; 3]])) {
    let contacts = case.q.len();
    let (m, n) = (2 * contacts, 3 * contacts);
    let mut w = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..n {
            w[i * n + j] = match (i % 3, j % 3) {
                (2, 2) if i == j => 0.3,
                (2, _) | (_, 2) => 0.0,
                (k, l) => case.w[(2 * (i / 3) + k) * m + 2 * (j / 3) + l],
            };
        }
    }
    let wider = |x: &[[f64; 2]]| x.iter().map(|x| [x[0], x[1], 0.0]).collect::<Vec<_>>();
    let compliance = Compliance::from_dense(contacts, Cow::Borrowed(&w)).unwrap();
    let problem = coulomb(&compliance, &wider(&case.q), &case.mu, &Rigid::default());
    use_it(&problem, &wider(r));
}

#[test]
fn an_answer_has_the_same_index_in_space() {
    let mut others = 0;
    for seed in 0..1500 {
        let case = Case::random(seed);
        let all = case.all();
        for (r, _) in &all.answers {
            let plane = case.with(|problem| assess(problem, r, &GO).unwrap());
            in_space(&case, r, |problem, r| {
                let space = assess(problem, r, &GO).unwrap();
                // The new row, (1 - g) + 0.3 g with 0 < g < 1, changes no sign.
                assert_eq!(space == Unique::OthersExist, plane == Unique::OthersExist);
                assert!(space != Unique::Proved || all.answers.len() == 1);
                others += usize::from(space == Unique::OthersExist);
            });
        }
    }
    assert!(others > 40, "{others}"); // the case occurs
}

#[test]
fn a_change_of_units_changes_no_answer() {
    for seed in 0..50 {
        let case = Case::random(seed);
        // Lengths by 2⁻³⁰, forces by 2²⁰: exact in binary, and so are the answers.
        let (length, force) = (2.0_f64.powi(-30), 2.0_f64.powi(20));
        let other = Case {
            w: case.w.iter().map(|w| w * length / force).collect(),
            q: case.q.iter().map(|q| q.map(|c| c * length)).collect(),
            mu: case.mu.clone(),
            rigid: Rigid::default(),
        };
        let (all, others) = (case.all().answers, other.all().answers);
        assert_eq!(all.len(), others.len());
        for ((r, _), (other, _)) in all.iter().zip(&others) {
            let scaled: Vec<f64> = r.as_flattened().iter().map(|c| c * force).collect();
            assert_eq!(scaled, other.as_flattened());
        }
    }
}

#[test]
fn a_long_enumeration_is_interrupted() {
    // Twelve contacts that hardly feel each other: almost no branch is cut.
    let n = 24;
    let mut w = vec![1e-3; n * n];
    for i in 0..n {
        w[i * (n + 1)] = 1.0;
    }
    let case = Case {
        w,
        q: vec![[-1.0, 0.1]; 12],
        mu: vec![5.0; 12],
        rigid: Rigid::default(),
    };
    let raised = AtomicBool::new(true);
    let stopped = case.with(|problem| answers(problem, &raised).map(|all| all.answers.len()));
    assert_eq!(stopped, Err(Error::Interrupted));
}
