//! The programmes of one group of motions, in scaled variables: columns of `R` have length 1,
//! loads are of the order of 1, and the cones are circular.

use crate::equilibrium::programme::{End, Limits, NEAR_ROUNDING, Programme};
use crate::equilibrium::proof::Witness;
use crate::equilibrium::statics::{Group, Statics};
use crate::error::Error;
use crate::linalg::small::{TURNED, norm};

/// Cohesion above this many times the loads hides them from a programme; less of it leaves fewer
/// reactions, all of them allowed, and a proof counts all of it.
const MOST_COHESION: f64 = 1e6;

struct Cone {
    /// The first unknown of the cone, and the number of its unknowns: one without friction.
    first: usize,
    count: usize,
    /// `(1, μ)/√(1 + μ²)`, so that margins are distances.
    edge: [f64; 2],
    /// `c/√(1 + μ²)` in the unit of force; negative without cohesion.
    cohesion: Option<f64>,
}

/// A group with its loads.
pub(super) struct Part<'a> {
    pub(super) statics: &'a Statics,
    group: &'a Group,
    limits: Limits<'a>,
    cones: Vec<Cone>,
    /// Row of `R` of each unknown, and the factor from the unknown to the component.
    component: Vec<(usize, f64)>,
    /// `R̃` by unknowns.
    entries: Vec<Vec<(usize, f64)>>,
    /// Length of each column of `R`.
    lengths: Vec<f64>,
    load: Vec<f64>,
    /// A load of 1.
    pub(super) force: f64,
}

impl<'a> Part<'a> {
    pub(super) fn new(
        statics: &'a Statics,
        group: &'a Group,
        load: &[f64],
        limits: Limits<'a>,
    ) -> Self {
        let (motions, place) = (&group.motions, &statics.place);
        let lengths: Vec<f64> = motions.iter().map(|&j| statics.lengths[j]).collect();
        let scaled = motions.iter().zip(&lengths);
        let scaled: Vec<f64> = scaled.map(|(&j, l)| load[j] / l).collect();
        let force = unit_of(&scaled);
        let mut part = Self {
            statics,
            group,
            limits,
            cones: Vec::with_capacity(group.contacts.len()),
            component: Vec::new(),
            entries: Vec::new(),
            lengths,
            load: scaled.iter().map(|e| e / force).collect(),
            force,
        };
        let mut moved = vec![0.0_f64; motions.len()];
        for &contact in &group.contacts {
            let mu = statics.largest_friction(contact);
            let cohesion = statics.cohesion[contact];
            let rows = statics.rows_of(contact);
            for (j, value) in rows.clone().flat_map(|row| statics.row(row)) {
                moved[place[j]] = moved[place[j]].hypot(value);
            }
            let count = if statics.rubs(contact) { rows.len() } else { 1 };
            let length = mu.hypot(1.0);
            part.cones.push(Cone {
                first: part.component.len(),
                count,
                edge: [1.0 / length, mu / length],
                cohesion: (cohesion > 0.0).then(|| cohesion / length / force),
            });
            for row in rows.clone().take(count) {
                let factor = if row == rows.start || mu == 0.0 {
                    1.0
                } else {
                    statics.friction[row] / mu
                };
                let of_row = statics.row(row).map(|(j, value)| (place[j], value));
                // A programme takes rounding for something that reactions must balance. What is
                // checked, reactions and proofs, is checked with it.
                let of_row = of_row.filter(|&(number, value)| value.abs() > TURNED * moved[number]);
                let scaled =
                    of_row.map(|(number, value)| (number, value * factor / part.lengths[number]));
                part.entries.push(scaled.collect());
                part.component.push((row, factor));
            }
            for (j, _) in rows.flat_map(|row| statics.row(row)) {
                moved[place[j]] = 0.0;
            }
        }
        part
    }

    /// How a motion acts on the contacts and a load.
    pub(super) fn witness(&self, load: &[f64], motion: &[f64]) -> Witness {
        Witness::new(self.statics, &self.group.contacts, load, motion)
    }

    /// `‖e‖`, a force.
    pub(super) fn load_size(&self) -> f64 {
        norm(&self.load) * self.force
    }

    /// The length of another load, a force.
    pub(super) fn size_of(&self, load: &[f64]) -> f64 {
        norm(&self.scale_load(load)) * self.force
    }

    /// The multiple of another load that is of the order of this one.
    pub(super) fn force_of(&self, load: &[f64]) -> f64 {
        1.0 / unit_of(&self.scale_load(load))
    }

    /// The length of an imbalance relative to the loads.
    pub(super) fn imbalance(&self, imbalance: &[f64]) -> f64 {
        norm(&self.scale_load(imbalance)) / norm(&self.load)
    }

    fn scale_load(&self, load: &[f64]) -> Vec<f64> {
        let pairs = self.group.motions.iter().zip(&self.lengths);
        pairs.map(|(&j, l)| load[j] / l / self.force).collect()
    }

    /// The reactions `x` with some columns after them, and `R̃ᵀ x + ẽ = 0` with one `more` entry in
    /// the row of each motion.
    fn balance(&self, after: usize, more: impl Fn(usize) -> Option<(usize, f64)>) -> Programme {
        let mut programme = Programme::new(self.component.len() + after);
        let mut columns = vec![Vec::new(); self.lengths.len()];
        for (unknown, entries) in self.entries.iter().enumerate() {
            for &(motion, value) in entries {
                columns[motion].push((unknown, value));
            }
        }
        for (motion, entries) in columns.into_iter().enumerate() {
            programme.push(self.load[motion], entries.into_iter().chain(more(motion)));
        }
        programme.equal(self.lengths.len());
        programme
    }

    /// Reactions in their cones, by the `margin` of a column if there is one, with `most` cohesion.
    fn confine(&self, programme: &mut Programme, margin: Option<usize>, most: f64) {
        let inside = || margin.map(|column| (column, -1.0));
        for cone in &self.cones {
            let Cone {
                first,
                count,
                edge: [normal, tangential],
                cohesion,
            } = *cone;
            let pressure = [(first, if count == 1 { 1.0 } else { tangential })];
            let constant = cohesion.unwrap_or(0.0).min(most);
            let mut rows = vec![(constant, pressure.into_iter().chain(inside()).collect())];
            rows.extend((first + 1..first + count).map(|t| (0.0, vec![(t, normal)])));
            programme.push_cone(rows);
            if cohesion.is_some() {
                programme.push(0.0, [(first, 1.0)].into_iter().chain(inside()));
                programme.nonnegative(1);
            }
        }
    }

    /// Reactions of the largest margin, at most 1; their multipliers are a motion.
    pub(super) fn find_margin(&self) -> Result<(Vec<f64>, f64, Vec<f64>), Error> {
        let margin = self.component.len();
        let mut programme = self.balance(1, |_| None);
        programme.cost[margin] = -1.0;
        self.confine(&mut programme, Some(margin), MOST_COHESION);
        programme.push(1.0, [(margin, -1.0)]);
        programme.nonnegative(1);
        let end = programme.solve(NEAR_ROUNDING, self.limits)?;
        Ok((self.reaction(&end), end.x[margin], self.motion(&end)))
    }

    /// Reactions of the least length; their multipliers, or a proof that there are none, are a
    /// motion.
    pub(super) fn find_least(&self) -> Result<(Vec<f64>, Vec<f64>), Error> {
        let mut programme = self.balance(0, |_| None);
        programme.square(0..self.component.len(), 1.0);
        self.confine(&mut programme, None, MOST_COHESION);
        let end = programme.solve(NEAR_ROUNDING, self.limits)?;
        Ok((self.reaction(&end), self.motion(&end)))
    }

    /// The shortest `R̃ᵀ x + ẽ` over reactions in the cones. It is a motion in the dual cones on
    /// which the loads work, well determined far from balance.
    pub(super) fn find_shortest(&self) -> Result<Vec<f64>, Error> {
        let (imbalance, motions) = (self.component.len(), self.lengths.len());
        let mut programme = self.balance(motions, |motion| Some((imbalance + motion, -1.0)));
        programme.square(imbalance..imbalance + motions, 1.0);
        self.confine(&mut programme, None, MOST_COHESION);
        let end = programme.solve(NEAR_ROUNDING, self.limits)?;
        Ok(self.spread(&end.x[imbalance..]))
    }

    /// The largest `λ ≥ 0` with reactions that balance `e + λ live`, and a mechanism.
    pub(super) fn find_multiplier(&self, live: &[f64]) -> Result<(f64, Vec<f64>), Error> {
        let multiplier = self.component.len();
        let live = self.scale_load(live);
        let size = unit_of(&live);
        let mut programme = self.balance(1, |motion| Some((multiplier, live[motion] / size)));
        programme.cost[multiplier] = -1.0;
        self.confine(&mut programme, None, f64::INFINITY);
        programme.push(0.0, [(multiplier, 1.0)]);
        programme.nonnegative(1);
        let end = programme.solve(NEAR_ROUNDING, self.limits)?;
        Ok((end.x[multiplier] / size, self.motion(&end)))
    }

    /// A motion with all contacts well inside their dual cones, if there is one; with `each`, as
    /// many of them as can be.
    pub(super) fn find_opening(&self, each: bool) -> Result<Vec<f64>, Error> {
        // A motion may have to be this large to open the last of many contacts by 1.
        let farthest = if each { 1e4 } else { 1.0 };
        let motions = self.lengths.len();
        let margins = if each { self.cones.len() } else { 1 };
        let mut programme = Programme::new(motions + margins);
        programme.cost[motions..].fill(-1.0);
        for (number, cone) in self.cones.iter().enumerate() {
            let Cone {
                first,
                count,
                edge: [normal, tangential],
                ..
            } = *cone;
            let margin = (motions + if each { number } else { 0 }, -1.0);
            let moved = |unknown: usize| {
                let factor = if unknown == first { normal } else { tangential };
                let entries = self.entries[unknown].iter();
                entries.map(move |&(motion, value)| (motion, factor * value))
            };
            let mut rows = vec![(0.0, moved(first).chain([margin]).collect())];
            rows.extend((first + 1..first + count).map(|t| (0.0, moved(t).collect())));
            programme.push_cone(rows);
        }
        for motion in 0..motions {
            for sign in [1.0, -1.0] {
                programme.push(farthest, [(motion, sign)]);
            }
        }
        for margin in motions..motions + if each { margins } else { 0 } {
            for (constant, sign) in [(1.0, -1.0), (0.0, 1.0)] {
                programme.push(constant, [(margin, sign)]);
            }
        }
        programme.nonnegative(2 * motions + if each { 2 * margins } else { 0 });
        let end = programme.solve(NEAR_ROUNDING, self.limits)?;
        Ok(self.spread(&end.x[..motions]))
    }

    /// The reaction of all rows, moved into the cones where rounding left it outside.
    fn reaction(&self, end: &End) -> Vec<f64> {
        let mut reaction = vec![0.0; self.statics.friction.len()];
        for cone in &self.cones {
            let unknowns = &end.x[cone.first..cone.first + cone.count];
            let [normal, tangential] = cone.edge;
            let pressure = unknowns[0].max(0.0);
            let friction = unknowns[1..].iter().fold(0.0, |sum: f64, t| sum.hypot(*t));
            let most = (tangential * pressure + cone.cohesion.unwrap_or(0.0)) / normal;
            let share = if friction > most {
                most / friction
            } else {
                1.0
            };
            let components = self.component[cone.first..].iter().zip(unknowns);
            for (&(row, factor), unknown) in components {
                reaction[row] = share * unknown * factor * self.force;
            }
            let (row, factor) = self.component[cone.first];
            reaction[row] = pressure * factor * self.force;
        }
        reaction
    }

    /// The motion of the multipliers of the balance, `R̃ d` in the dual cones.
    fn motion(&self, end: &End) -> Vec<f64> {
        let opposite = end.multipliers.iter().map(|y| -y);
        self.spread(&opposite.collect::<Vec<_>>())
    }

    /// Amounts of all motions, in the units of the caller.
    fn spread(&self, scaled: &[f64]) -> Vec<f64> {
        let mut motion = vec![0.0; self.statics.lengths.len()];
        for ((&j, length), amount) in self.group.motions.iter().zip(&self.lengths).zip(scaled) {
            motion[j] = amount / length;
        }
        motion
    }
}

/// The root mean square of numbers, or 1 if they are zero.
fn unit_of(numbers: &[f64]) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a number of motions")]
    let size = norm(numbers) / (numbers.len() as f64).sqrt();
    if size > 0.0 { size } else { 1.0 }
}
