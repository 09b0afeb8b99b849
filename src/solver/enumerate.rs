//! Finds every solution of a small plane problem, or proves that there is none, by trying all
//! statuses: open, stick, slip to either side, as in section 10 of `docs/theory.md`.
//!
//! The search decides one contact after the other, depth first, on a tableau of scaled variables,
//! whose rows are affine functions of the reactions of undecided contacts. A pivot that is small
//! now may be large later. So equations and unknowns wait for a safe pivot, from the start those
//! of rigid motions. If `W` is definite, reactions are bounded: the law implies `r·v ≤ 0`, and
//! `rᵀW r + qᵀr ≤ 0` is an ellipsoid.

use std::borrow::Cow;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::Error;
use crate::law::contact_law::ContactLaw;
use crate::linalg::dense;
use crate::linalg::small::{add_scaled, amax, norm, plus_scaled, scale_rows};
use crate::linalg::verified_cholesky::VerifiedCholesky;
use crate::reduced::compliance::Compliance;
use crate::reduced::reduced::{Reduced, Rigid};
use crate::reduced::residual::Certificate;
use crate::solver::farkas::Inequalities;
use crate::solver::tuning;

/// With at most this many contacts, 4¹² leaves, all solutions take seconds.
pub const MOST_CONTACTS: usize = 12;

/// A pivot above this share of its column is used at once: it magnifies rounding by at most a
/// hundred.
const SAFE_PIVOT: f64 = 1e-2;

/// Smaller entries are rounding; blocks have a mean diagonal of one.
const RANK: f64 = 1e-12;

/// A test fails if its value is below minus this share of the largest value, divided by the
/// weakest pivot. This exceeds the rounding of thirty eliminations.
const ROUNDING: f64 = 1e-12;

/// In a search for a contradiction, coefficients are increased by this. The sums of a
/// contradiction are then clearly negative, see [`RANK`].
const NUDGE: f64 = 1e-10;

/// Reactions and displacements that differ by a smaller share are the same solution. A residual
/// between rounding and this decides nothing.
const SAME: f64 = 1e-9;

/// Limit of η of a solution, or its rounding floor.
const TOLERANCE: f64 = 1e-12;

/// Nodes of the tree between two checks of the stop flag.
const LOOK: usize = 4096;

/// Number of choices of statuses for contacts with these coefficients.
pub fn statuses(laws: &[ContactLaw]) -> u64 {
    let of = |law: &ContactLaw| labels(law.mu).len() as u64;
    laws.iter().map(of).fold(1, u64::saturating_mul)
}

/// Result of trying all statuses.
#[derive(Clone, Debug)]
pub struct Enumeration<const D: usize> {
    /// Reactions in the order of positions, and rigid motions.
    pub answers: Vec<(Vec<[f64; D]>, Vec<f64>)>,
    /// Whether no other solution exists. False if a choice of statuses does not determine the
    /// reactions, or fails a test only by rounding.
    pub complete: bool,
    /// Number of choices visited, for some of the contacts or for all.
    pub visited: usize,
}

/// Whether all contacts have Coulomb's law: only its statuses are tried.
pub fn is_coulomb<const D: usize>(problem: &Reduced<D>) -> bool {
    problem.law.iter().all(ContactLaw::is_coulomb)
}

/// Finds all solutions of a plane problem of up to [`MOST_CONTACTS`] contacts with Coulomb's law.
///
/// An empty list with `complete` proves that the problem has no solution.
pub fn answers(problem: &Reduced<2>, stop: &AtomicBool) -> Result<Enumeration<2>, Error> {
    within(problem, usize::MAX, stop)
}

/// [`answers`], incomplete if it needs more than `nodes` nodes of the tree.
fn within(problem: &Reduced<2>, nodes: usize, stop: &AtomicBool) -> Result<Enumeration<2>, Error> {
    let mut search = Search::new(problem, nodes, stop);
    if problem.contradiction.is_none() {
        search.bound()?;
        search.visit(0)?;
        // With a definite W a solution exists: rounding has hidden it.
        if search.found.answers.is_empty() && problem.rigid.modes.is_empty() {
            let mut whole = problem.compliance.to_dense();
            let order = 2 * problem.contacts();
            search.found.complete &= dense::cholesky(&mut whole, order, stop)?.is_some();
        }
    }
    Ok(search.found)
}

impl<const D: usize> Enumeration<D> {
    /// Whether this proves that the problem has no solution. With a definite `W` a solution
    /// exists for any μ, and an empty list is due to rounding. Only bodies that only contact
    /// holds may have no solution.
    pub fn proves_none(&self, problem: &Reduced<D>) -> bool {
        self.complete && self.answers.is_empty() && !problem.rigid.modes.is_empty()
    }
}

/// [`answers`] in the positions of the problem, if it is plane and has few contacts with
/// Coulomb's law; else `None`.
pub fn few<const D: usize>(
    problem: &Reduced<D>,
    stop: &AtomicBool,
) -> Result<Option<Enumeration<D>>, Error> {
    if D != 2 || problem.contacts() > MOST_CONTACTS || !is_coulomb(problem) {
        return Ok(None);
    }
    let plane = |nodes: &[[f64; D]]| nodes.iter().map(|x| [x[0], x[1]]).collect::<Vec<_>>();
    let whole = &problem.compliance;
    let dense = Cow::Owned(whole.to_dense());
    let compliance = Compliance::<2>::from_dense(problem.contacts(), dense)?;
    // Numbering of the caller for the copy, positions for the results.
    let modes = problem.rigid.modes.columns();
    let modes: Vec<_> = modes
        .iter()
        .map(|mode| plane(&whole.scatter(mode)))
        .collect();
    let rigid = Rigid {
        modes: modes.into(),
        load: problem.rigid.load.clone(),
    };
    let q = plane(&whole.scatter(&problem.q));
    let copy = Reduced::new(&compliance, &q, &whole.scatter(&problem.law), &rigid)?;
    let found = within(&copy, tuning::most_nodes(), stop)?;
    let own = |(r, rigid): (Vec<[f64; 2]>, Vec<f64>)| {
        let r = whole.gather(&r);
        let r = r.iter().map(|r| std::array::from_fn(|k| r[k.min(1)]));
        (r.collect(), rigid)
    };
    Ok(Some(Enumeration {
        answers: found.answers.into_iter().map(own).collect(),
        complete: found.complete,
        visited: found.visited,
    }))
}

/// A status; for slip with the sign `s` of `r_t = −s μ r_n`.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Label {
    Open,
    Stick,
    Slip(f64),
}

/// Without friction a pressed contact has one status for both directions of slip.
const SMOOTH: [Label; 2] = [Label::Open, Label::Slip(1.0)];
const ROUGH: [Label; 4] = [
    Label::Open,
    Label::Stick,
    Label::Slip(1.0),
    Label::Slip(-1.0),
];

fn labels(mu: f64) -> &'static [Label] {
    if mu > 0.0 { &ROUGH } else { &SMOOTH }
}

const NOWHERE: usize = usize::MAX;

/// Affine functions of unknowns, one in each row.
///
/// Unknowns are `r_n, r_t` of each contact and the amounts of rigid motions. At the start, the
/// rows are `v_n, v_t` of each contact and the balance of forces.
#[derive(Clone, Debug, Default)]
struct Tableau {
    height: usize,
    /// By columns: the constants, then one column for each of `unknowns`.
    entries: Vec<f64>,
    unknowns: Vec<usize>,
    /// The column of each unknown, if it has one.
    place: Vec<usize>,
    /// The row of each unknown, once an equation is solved for it.
    row_of: Vec<usize>,
    /// Rows that must be zero, and the unknowns that they are to be solved for.
    equations: Vec<usize>,
    waiting: Vec<usize>,
    /// Smallest pivot so far, relative to its column and to one.
    weakest: f64,
}

impl Tableau {
    fn new(problem: &Reduced<2>) -> Self {
        let contacts = problem.contacts();
        let scaling = &problem.scaling;
        let height = 2 * contacts + scaling.modes.len();
        let mut entries = vec![0.0; height * (height + 1)];
        let (constants, columns) = entries.split_at_mut(height);
        for (i, free) in problem.q.iter().enumerate() {
            for k in 0..2 {
                constants[2 * i + k] = free[k] * scaling.to_v[i];
            }
            for j in 0..contacts {
                let w = problem.compliance.pair(i, j) * (scaling.to_v[i] / scaling.to_r[j]);
                for k in 0..2 {
                    for l in 0..2 {
                        columns[(2 * j + l) * height + 2 * i + k] = w[(k, l)];
                    }
                }
            }
        }
        constants[2 * contacts..].copy_from_slice(&scaling.load);
        for (c, mode) in scaling.modes.columns().iter().enumerate() {
            let place = 2 * contacts + c;
            for (i, &motion) in mode.as_flattened().iter().enumerate() {
                columns[place * height + i] = motion;
                columns[i * height + place] = motion;
            }
        }
        let border: Vec<usize> = (2 * contacts..height).collect();
        Self {
            height,
            entries,
            unknowns: (0..height).collect(),
            place: (1..=height).collect(),
            row_of: vec![NOWHERE; height],
            equations: border.clone(),
            waiting: border,
            weakest: 1.0,
        }
    }

    /// `*self = other.clone()` without a new allocation.
    fn copy_from(&mut self, other: &Self) {
        self.height = other.height;
        self.entries.clone_from(&other.entries);
        self.unknowns.clone_from(&other.unknowns);
        self.place.clone_from(&other.place);
        self.row_of.clone_from(&other.row_of);
        self.equations.clone_from(&other.equations);
        self.waiting.clone_from(&other.waiting);
        self.weakest = other.weakest;
    }

    fn constants(&self) -> &[f64] {
        &self.entries[..self.height]
    }

    /// Largest constant.
    fn size(&self) -> f64 {
        amax(self.constants())
    }

    fn column(&self, place: usize) -> &[f64] {
        &self.entries[place * self.height..(place + 1) * self.height]
    }

    /// Moves a column to the end, so that it can be removed.
    fn last(&mut self, unknown: usize) {
        let (place, last) = (self.place[unknown], self.unknowns.len());
        if place < last {
            let (head, tail) = self.entries.split_at_mut(last * self.height);
            head[place * self.height..(place + 1) * self.height].swap_with_slice(tail);
            self.unknowns.swap(place - 1, last - 1);
            self.place[self.unknowns[place - 1]] = place;
            self.place[unknown] = last;
        }
    }

    /// Removes the column of an unknown that is zero, or given by another one.
    fn remove(&mut self, unknown: usize) {
        self.last(unknown);
        let _ = self.unknowns.pop();
        self.entries
            .truncate((self.unknowns.len() + 1) * self.height);
    }

    /// Chooses the status of a contact.
    fn decide(&mut self, contact: usize, label: Label, mu: f64) {
        let (n, t) = (2 * contact, 2 * contact + 1);
        match label {
            Label::Open => {
                self.remove(n);
                self.remove(t);
            }
            Label::Stick => {
                self.equations.extend([n, t]);
                self.waiting.extend([n, t]);
            }
            Label::Slip(side) => {
                let (to, from) = (self.place[n] * self.height, self.place[t] * self.height);
                for i in 0..self.height {
                    self.entries[to + i] -= side * mu * self.entries[from + i];
                }
                self.remove(t);
                self.equations.push(n);
                self.waiting.push(n);
            }
        }
    }

    /// Solves waiting equations for waiting unknowns, as long as a pivot is at least `share` of
    /// its column, and above rounding.
    fn reduce(&mut self, share: f64) {
        while !self.waiting.is_empty() {
            let mut best = (0.0, 0, 0, 0.0);
            for (k, &unknown) in self.waiting.iter().enumerate() {
                let column = self.column(self.place[unknown]);
                let whole = amax(column).max(RANK);
                for (e, &row) in self.equations.iter().enumerate() {
                    let pivot = column[row].abs();
                    if pivot > RANK && pivot / whole > best.0 {
                        best = (pivot / whole, e, k, pivot / whole.max(1.0));
                    }
                }
            }
            let (quality, equation, unknown, pivot) = best;
            if quality == 0.0 || quality < share {
                return;
            }
            self.weakest = self.weakest.min(pivot);
            let row = self.equations.swap_remove(equation);
            let unknown = self.waiting.swap_remove(unknown);
            self.pivot(row, unknown);
        }
    }

    /// Solves the equation of a row for an unknown. The row then holds its value.
    fn pivot(&mut self, row: usize, unknown: usize) {
        self.last(unknown);
        let last = self.unknowns.len();
        let (others, pivots) = self.entries.split_at_mut(last * self.height);
        let pivot = pivots[row];
        for column in others.chunks_exact_mut(self.height) {
            let factor = column[row] / pivot;
            if factor != 0.0 {
                add_scaled(column, -factor, pivots);
            }
            column[row] = -factor;
        }
        self.entries.truncate(last * self.height);
        let _ = self.unknowns.pop();
        self.row_of[unknown] = row;
    }

    /// Values of all unknowns with every status chosen; `None` if they are not determined.
    fn solve(&self, labels: &[Label], laws: &[ContactLaw]) -> Option<Vec<f64>> {
        let mut tableau = self.clone();
        for (contact, (&label, law)) in labels.iter().zip(laws).enumerate() {
            tableau.decide(contact, label, law.mu);
        }
        tableau.reduce(0.0);
        if !tableau.waiting.is_empty() {
            return None;
        }
        let constants = tableau.constants();
        let of_row = |&row: &usize| if row == NOWHERE { 0.0 } else { constants[row] };
        let mut x: Vec<f64> = tableau.row_of.iter().map(of_row).collect();
        for (i, label) in labels.iter().enumerate() {
            if let Label::Slip(side) = label {
                x[2 * i + 1] = -side * laws[i].mu * x[2 * i];
            }
        }
        Some(x)
    }

    /// Values of all rows at a point.
    fn at(&self, x: &[f64]) -> Vec<f64> {
        let mut rows = self.constants().to_vec();
        for (c, &unknown) in self.unknowns.iter().enumerate() {
            add_scaled(&mut rows, x[unknown], self.column(c + 1));
        }
        rows
    }
}

/// A test of the law, `Σ share · row ≥ 0` with two rows.
type Test = [(usize, f64); 2];

struct Search<'p> {
    problem: &'p Reduced<'p, 2>,
    stop: &'p AtomicBool,
    /// Nodes that remain to be visited.
    most: usize,
    /// The tableau for each number of decided contacts.
    levels: Vec<Tableau>,
    labels: Vec<Label>,
    together: Inequalities,
    /// Upper bounds of scaled normal reactions; infinite without a bound.
    limits: Vec<f64>,
    /// Scaled `(r̂, v̂)` of the solutions found so far.
    points: Vec<Vec<f64>>,
    found: Enumeration<2>,
}

impl<'p> Search<'p> {
    fn new(problem: &'p Reduced<'p, 2>, most: usize, stop: &'p AtomicBool) -> Self {
        let mut levels = vec![Tableau::default(); problem.contacts() + 1];
        levels[0] = Tableau::new(problem);
        Self {
            problem,
            stop,
            most,
            levels,
            labels: Vec::with_capacity(problem.contacts()),
            together: Inequalities::default(),
            limits: vec![f64::INFINITY; problem.contacts()],
            points: Vec::new(),
            found: Enumeration {
                answers: Vec::new(),
                complete: true,
                visited: 0,
            },
        }
    }

    /// Bounds the reactions by `rᵀW r + qᵀr ≤ 0`, if supports hold all bodies.
    fn bound(&mut self) -> Result<(), Error> {
        if !self.problem.rigid.modes.is_empty() {
            return Ok(());
        }
        let root = &self.levels[0];
        let n = root.height;
        let entry = |i: usize, j: usize| root.column(j + 1)[i];
        let half: Vec<f64> = (0..n * n)
            .map(|k| 0.5 * (entry(k / n, k % n) + entry(k % n, k / n)))
            .collect();
        let rounding = 4.0 * f64::EPSILON * norm(&half);
        let Some(cholesky) = VerifiedCholesky::new(half, n, rounding, self.stop)? else {
            return Ok(());
        };
        let free = root.constants();
        let error: Vec<f64> = free.iter().map(|q| 4.0 * f64::EPSILON * q.abs()).collect();
        let reach = cholesky.ellipsoid(free, &error);
        let widths = cholesky.widths();
        for (contact, limit) in self.limits.iter_mut().enumerate() {
            let k = 2 * contact;
            let most = reach.radius * widths[k] - reach.centre[k];
            *limit = (most * (1.0 + SAME)).max(0.0);
        }
        Ok(())
    }

    fn visit(&mut self, depth: usize) -> Result<(), Error> {
        self.found.visited += 1;
        if self.found.visited > self.most {
            self.found.complete = false;
            return Ok(());
        }
        if self.found.visited.is_multiple_of(LOOK) && self.stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        if depth == self.problem.contacts() {
            self.leaf();
            return Ok(());
        }
        let mu = self.problem.law[depth].mu;
        for &label in labels(mu) {
            let (above, below) = self.levels.split_at_mut(depth + 1);
            below[0].copy_from(&above[depth]);
            below[0].decide(depth, label, mu);
            below[0].reduce(SAFE_PIVOT);
            self.labels.push(label);
            let tableau = &self.levels[depth + 1];
            let slack = ROUNDING * tableau.size() / tableau.weakest;
            if !self.fails(depth + 1, slack, 0.0) && !self.contradicts(depth + 1, slack) {
                self.visit(depth + 1)?;
            }
            let _ = self.labels.pop();
        }
        Ok(())
    }

    /// Whether a sum of tests fails for all reactions of the undecided contacts.
    fn contradicts(&mut self, depth: usize, slack: f64) -> bool {
        let contacts = self.problem.contacts();
        if depth == contacts {
            return false;
        }
        let tableau = &self.levels[depth];
        let column = |unknown: usize| tableau.column(tableau.place[unknown]);
        let value = |test: &Test, column: &[f64]| -> f64 {
            test.iter().map(|&(row, share)| share * column[row]).sum()
        };
        let of_decided = (0..depth).flat_map(|contact| self.tests(tableau, contact));
        let opening = |contact: usize| Some([(2 * contact, 1.0), (2 * contact, 0.0)]);
        let settled = |test: &Test| {
            let waiting = tableau.waiting.iter();
            waiting.copied().all(|w| value(test, column(w)) == 0.0)
        };
        let tests: Vec<Test> = of_decided
            .chain((depth..contacts).map(opening))
            .flatten()
            .filter(settled)
            .collect();
        // A reaction is a sum of two on the edges of its cone.
        let sides = |test: &Test, contact: usize| {
            let mu = self.problem.law[contact].mu;
            let along = value(test, column(2 * contact));
            let across = mu * value(test, column(2 * contact + 1));
            [along + across, along - across]
        };
        self.together.clear(2 * (contacts - depth));
        for test in &tests {
            let coefficients = (depth..contacts).flat_map(|contact| {
                let nudge = if self.limits[contact].is_finite() {
                    0.0
                } else {
                    NUDGE
                };
                sides(test, contact).map(|t| if t == 0.0 { t } else { t + nudge })
            });
            let constant = value(test, tableau.constants());
            self.together
                .push(std::iter::once(constant).chain(coefficients));
        }
        for (k, &limit) in self.limits[depth..].iter().enumerate() {
            if limit.is_finite() {
                let taken =
                    (0..2 * (contacts - depth)).map(|l| if l / 2 == k { -1.0 } else { 0.0 });
                self.together.push(std::iter::once(limit).chain(taken));
            }
        }
        let Some(shares) = self.together.contradiction() else {
            return false;
        };
        // The shares are checked with the tests themselves.
        let shares = &shares[..tests.len()];
        let total: f64 = shares.iter().sum();
        let shared = || tests.iter().zip(shares).filter(|&(_, share)| *share > 0.0);
        let mut sum: f64 = shared()
            .map(|(test, share)| share * value(test, tableau.constants()))
            .sum();
        for contact in depth..contacts {
            let [mut one, mut other, mut size] = [0.0; 3];
            for (test, share) in shared() {
                let [a, b] = sides(test, contact);
                one += share * a;
                other += share * b;
                size += share * (a.abs() + b.abs());
            }
            let best = one.max(other);
            let limit = self.limits[contact];
            if limit.is_finite() {
                sum += limit * (best + ROUNDING * size).max(0.0);
            } else if best >= -RANK * total && size > 0.0 {
                return false;
            }
        }
        sum < -slack * total
    }

    /// Whether a test of a decided contact, or an equation, fails for all reactions of the
    /// undecided contacts. Entries up to `rounding` count as zero.
    fn fails(&self, depth: usize, slack: f64, rounding: f64) -> bool {
        let contacts = self.problem.contacts();
        let tableau = &self.levels[depth];
        let nothing = |value: f64| value.abs() <= rounding;
        let equation_fails = |&row: &usize| {
            let columns = 1..=tableau.unknowns.len();
            tableau.constants()[row].abs() > slack.max(SAME * tableau.size())
                && columns.into_iter().all(|c| nothing(tableau.column(c)[row]))
        };
        let test_fails = |test: Test| {
            let value = |column: &[f64]| -> f64 {
                test.iter().map(|&(row, share)| share * column[row]).sum()
            };
            let of = |unknown: usize| value(tableau.column(tableau.place[unknown]));
            value(tableau.constants()) < -slack
                // Waiting unknowns may have any sign; undecided reactions lie in their cones.
                && tableau.waiting.iter().all(|&unknown| nothing(of(unknown)))
                && (depth..contacts).all(|contact| {
                    let (along, across) = (of(2 * contact), of(2 * contact + 1));
                    let best = along + self.problem.law[contact].mu * across.abs();
                    best < -RANK || (along == 0.0 && across == 0.0)
                })
        };
        let tests = |contact| self.tests(tableau, contact).into_iter().flatten();
        tableau.equations.iter().any(equation_fails) || (0..depth).flat_map(tests).any(test_fails)
    }

    /// The inequalities of a decided contact, as far as its unknowns are solved for.
    fn tests(&self, tableau: &Tableau, contact: usize) -> [Option<Test>; 2] {
        let (n, t) = (2 * contact, 2 * contact + 1);
        let mu = self.problem.law[contact].mu;
        let (normal, tangent) = (tableau.row_of[n], tableau.row_of[t]);
        match self.labels[contact] {
            Label::Open => [Some([(n, 1.0), (n, 0.0)]), None],
            Label::Stick if normal == NOWHERE || tangent == NOWHERE => [None, None],
            // Together they imply r_n ≥ 0.
            Label::Stick => [-1.0, 1.0].map(|side| Some([(normal, mu), (tangent, side)])),
            Label::Slip(side) => [
                (normal != NOWHERE).then_some([(normal, 1.0), (normal, 0.0)]),
                (mu > 0.0).then_some([(t, side), (t, 0.0)]),
            ],
        }
    }

    /// Handles a leaf: all statuses are chosen.
    fn leaf(&mut self) {
        let depth = self.labels.len();
        let tableau = &mut self.levels[depth];
        tableau.reduce(0.0);
        let size = tableau.size();
        if !tableau.waiting.is_empty() {
            // The equations are dependent: they contradict each other, or a test fails for all
            // their solutions, or nothing is proved here.
            let constants = tableau.constants();
            let contradict = |&row: &usize| constants[row].abs() > SAME * size;
            if !tableau.equations.iter().any(contradict) && !self.fails(depth, SAME * size, RANK) {
                self.found.complete = false;
            }
            return;
        }
        let slack = ROUNDING * size / tableau.weakest;
        if !self.fails(depth, slack, 0.0) {
            self.confirm();
        }
    }

    /// Solves the chosen statuses from the original numbers, and computes the certificate.
    fn confirm(&mut self) {
        let problem = self.problem;
        let root = &self.levels[0];
        let Some(mut x) = root.solve(&self.labels, &problem.law) else {
            return; // a leaf has seen that there is a solution
        };
        // One step of iterative refinement.
        let mut rest = root.clone();
        rest.entries[..root.height].copy_from_slice(&root.at(&x));
        if let Some(correction) = rest.solve(&self.labels, &problem.law) {
            add_scaled(&mut x, 1.0, &correction);
        }
        let scaling = &problem.scaling;
        let contacts = problem.contacts();
        let r: Vec<[f64; 2]> = (0..contacts)
            .map(|i| [x[2 * i], x[2 * i + 1]].map(|c| c / scaling.to_r[i]))
            .collect();
        let a = scaling.rigid_from_scaled(&x[2 * contacts..]);
        let certificate = Certificate::new(problem, &r, &a);
        if !certificate.converged(TOLERANCE) {
            // Within its rounding, a point proves nothing.
            let close = SAME.max(10.0 * certificate.floor);
            self.found.complete &= certificate.sound && certificate.residual > close;
            return;
        }
        let mut point = x;
        point.extend(scale_rows(&certificate.v, &scaling.to_v).as_flattened());
        // At the boundary between two statuses, both give the same solution.
        let same =
            |other: &Vec<f64>| amax(&plus_scaled(&point, -1.0, other)) <= SAME * amax(&point);
        if !self.points.iter().any(same) {
            self.points.push(point);
            self.found.answers.push((r, a));
        }
    }
}
