//! Complementary pivoting on the piecewise linear law [dSF91, 75; KB88].
//!
//! The disc of friction is replaced by a segment in the plane, which is exact, and by a polygon
//! in space, which is refined around the directions of friction. Each contact is in one of a few
//! cells: open, stick, a corner or an edge of its polygon. Lemke's method follows
//! `v = W r + q + t c` from a large `t`, where `r = 0`, to `t = 0`, cell by cell; `docs/theory.md`
//! proves that it arrives.

use std::f64::consts::{FRAC_PI_2, TAU};

use crate::error::Error;
use crate::law::alart_curnier::Linearised;
use crate::law::cone::Status;
use crate::linalg::small::{
    Block, Vector, amax, dot, minus_scaled, rows_plus_scaled as plus, tangential_norm,
};
use crate::reduced::reduced::Reduced;
use crate::reduced::residual::residual;
use crate::solver::evaluated_point::EvaluatedPoint;
use crate::solver::monitor::{Monitor, NextStep};
use crate::solver::newton::compliance_form::ComplianceForm;
use crate::solver::newton::linearisation::{Linearisation, movable};
use crate::solver::outcome::Ended;
use crate::solver::settings::Start;
use crate::solver::tuning;

/// Accuracy of GMRES relative to that of a step.
const TIGHT: f64 = 1e-13;

/// The cell of a contact. Corners and edges are numbered counter-clockwise; edge `j` leads from
/// corner `j` to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cell {
    Open,
    /// Closed, without friction.
    Free,
    Stick,
    Edge(usize),
    Corner(usize),
}

/// Corners of the friction polygon of radius one, by ascending angles; in the plane the two
/// ends of a segment.
#[derive(Clone, Debug)]
struct Polygon<const D: usize> {
    angles: Vec<f64>,
}

/// A linear function that is non-negative in a cell, and the cell beyond its zero.
struct Guard<const D: usize> {
    by_r: [f64; D],
    by_v: [f64; D],
    to: Cell,
}

impl<const D: usize> Guard<D> {
    fn at(&self, r: &[f64; D], v: &[f64; D]) -> f64 {
        dot(&self.by_r, r) + dot(&self.by_v, v)
    }
}

/// The angle between corners of a regular polygon.
fn coarse_step() -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a few")]
    let corners = tuning::polygon_corners() as f64;
    TAU / corners
}

/// `(0, cos, sin)` in space.
fn unit<const D: usize>(angle: f64) -> [f64; D] {
    let (sin, cos) = angle.sin_cos();
    std::array::from_fn(|k| [0.0, cos, sin][k])
}

impl<const D: usize> Polygon<D> {
    fn coarse() -> Self {
        #[expect(clippy::cast_precision_loss, reason = "a few")]
        let angle = |k: usize| coarse_step() * k as f64;
        Self {
            angles: (0..tuning::polygon_corners()).map(angle).collect(),
        }
    }

    /// A polygon that is fine around a direction and coarse elsewhere.
    fn around(centre: f64, spacing: f64) -> Self {
        #[expect(clippy::cast_precision_loss, reason = "a few")]
        let shares = |most: usize, step: f64| {
            (1..=most).flat_map(move |k| [centre - step * k as f64, centre + step * k as f64])
        };
        // Half of the coarse corners on each side.
        let (half, coarse) = (tuning::polygon_corners() / 2, coarse_step());
        let mut angles = vec![centre];
        angles.extend(shares(tuning::fan_corners(), spacing));
        angles.extend(shares(half, coarse));
        angles.sort_by(f64::total_cmp);
        let _ = angles.remove(0); // half a turn to either side is the same corner
        Self { angles }
    }

    fn corners(&self) -> usize {
        if D == 2 { 2 } else { self.angles.len() }
    }

    fn corner(&self, j: usize) -> [f64; D] {
        if D == 2 {
            let end = if j == 0 { 1.0 } else { -1.0 };
            return std::array::from_fn(|k| if k == 1 { end } else { 0.0 });
        }
        unit(self.angles[j])
    }

    fn before(&self, j: usize) -> usize {
        (j + self.corners() - 1) % self.corners()
    }

    fn after(&self, j: usize) -> usize {
        (j + 1) % self.corners()
    }

    /// Angle of the middle of an edge, and half of its angle.
    fn edge(&self, e: usize) -> (f64, f64) {
        let from = self.angles[e];
        let to = if e + 1 < self.angles.len() {
            self.angles[e + 1]
        } else {
            self.angles[0] + TAU
        };
        let half = 0.5 * (to - from);
        (from + half, half)
    }

    /// `a` and `a × n`, where the polygon satisfies `a·r_t ≤ μ r_n` at this edge.
    fn side(&self, e: usize) -> ([f64; D], [f64; D], f64) {
        let (middle, half) = self.edge(e);
        let along = unit(middle + FRAC_PI_2);
        let normal = unit::<D>(middle).map(|c| c / half.cos());
        (normal, along, half.sin())
    }

    /// The corner of the friction that opposes `v_t`.
    fn against(&self, v: &[f64; D]) -> usize {
        let worth = |j: usize| -dot(&self.corner(j), v);
        (1..self.corners()).fold(0, |best, j| if worth(j) > worth(best) { j } else { best })
    }

    /// Calls `tell` with each guard of a cell.
    fn guards(&self, cell: Cell, mu: f64, mut tell: impl FnMut(Guard<D>)) {
        let nothing = [0.0; D];
        let normal: [f64; D] = std::array::from_fn(|k| if k == 0 { 1.0 } else { 0.0 });
        let mut guard = |by_r, by_v, to| tell(Guard { by_r, by_v, to });
        let negative = |x: [f64; D]| x.map(|c| -c);
        // μ r_n − a·r_t, with a share of μ r_n.
        let below = |a: [f64; D], share: f64| {
            let mut x = negative(a);
            x[0] = mu * share;
            x
        };
        match cell {
            // The cell of a closing contact is decided when it closes.
            Cell::Open => guard(nothing, normal, Cell::Open),
            Cell::Free => guard(normal, nothing, Cell::Open),
            Cell::Stick => {
                for j in 0..self.corners() {
                    if D == 2 {
                        guard(below(self.corner(j), 1.0), nothing, Cell::Corner(j));
                    } else {
                        guard(below(self.side(j).0, 1.0), nothing, Cell::Edge(j));
                    }
                }
            }
            Cell::Edge(e) => {
                let (a, along, half) = self.side(e);
                guard(nothing, negative(a), Cell::Stick);
                guard(below(along, half), nothing, Cell::Corner(self.after(e)));
                guard(below(negative(along), half), nothing, Cell::Corner(e));
            }
            Cell::Corner(j) => {
                guard(normal, nothing, Cell::Open);
                if D == 2 {
                    guard(nothing, negative(self.corner(j)), Cell::Stick);
                } else {
                    let (next, last) = (j, self.before(j));
                    guard(nothing, self.side(next).1, Cell::Edge(next));
                    guard(nothing, negative(self.side(last).1), Cell::Edge(last));
                }
            }
        }
    }

    /// The linear law of a cell, without `value`.
    fn rows(&self, cell: Cell, mu: f64) -> Linearised<D> {
        let mut rows = Linearised::empty();
        rows.by_v[(0, 0)] = 1.0;
        match cell {
            Cell::Open => {
                rows.status = Status::Open;
                rows.by_v[(0, 0)] = 0.0;
                rows.by_r = Block::identity();
            }
            Cell::Free => (1..D).for_each(|k| rows.by_r[(k, k)] = 1.0),
            Cell::Stick => {
                rows.status = Status::Stick;
                rows.by_v = Block::identity();
            }
            Cell::Edge(e) => {
                let (a, along, _) = self.side(e);
                for k in 1..D {
                    rows.by_v[(1, k)] = along[k];
                    rows.by_r[(D - 1, k)] = a[k];
                }
                rows.by_r[(D - 1, 0)] = -mu;
            }
            Cell::Corner(j) => {
                for (k, c) in self.corner(j).iter().enumerate().skip(1) {
                    rows.by_r[(k, k)] = 1.0;
                    rows.by_r[(k, 0)] = -mu * c;
                }
            }
        }
        rows
    }
}

/// A path at one of its points. All but the cells is in the units of the caller.
struct PivotingPath<'p, const D: usize> {
    problem: &'p Reduced<'p, D>,
    polygons: Vec<Polygon<D>>,
    cells: Vec<Cell>,
    r: Vec<[f64; D]>,
    /// `W r + q + t c`.
    v: Vec<[f64; D]>,
    c: Vec<[f64; D]>,
    t: f64,
    /// A path beyond this `t` has failed.
    most: f64,
}

/// Runs until the monitor stops it or no path continues.
pub fn run<const D: usize>(
    problem: &Reduced<D>,
    start: &Start<D>,
    monitor: &mut Monitor<D>,
) -> Result<(), Ended> {
    let begin = EvaluatedPoint::begin(problem, start, monitor);
    let _ = begin.look(monitor, false)?;
    let (mut r, mut v) = (begin.r, begin.v);
    // Direction and spacing of the corners of contacts that slide.
    let mut fans: Vec<Option<(f64, f64)>> = vec![None; r.len()];
    let mut known = !start.reaction.is_empty();
    let (mut best, mut waited) = (f64::INFINITY, 0);
    for _ in 0..tuning::refinements() {
        let polygons: Vec<Polygon<D>> = fans
            .iter()
            .map(|fan| match *fan {
                Some((centre, spacing)) if D == 3 => Polygon::around(centre, spacing),
                _ => Polygon::coarse(),
            })
            .collect();
        let mut path = if known {
            monitor.count(1.0);
            PivotingPath::near(problem, polygons.clone(), &r, &v)
        } else {
            PivotingPath::far(problem, polygons.clone())
        };
        let mut arrived = path.follow(monitor)?;
        if known && !arrived {
            path = PivotingPath::far(problem, polygons);
            arrived = path.follow(monitor)?;
        }
        if !arrived {
            return Ok(());
        }
        path.correct(monitor)?;
        for (i, fan) in fans.iter_mut().enumerate() {
            *fan = path.direction(i, fan.is_some()).map(|centre| {
                let spacing = fan.map_or(tuning::widest_spacing(), |(last, spacing)| {
                    let turn = (centre - last).rem_euclid(TAU);
                    let moved = turn.min(TAU - turn);
                    #[expect(clippy::cast_precision_loss, reason = "a few")]
                    let across = moved / tuning::fan_corners() as f64;
                    across
                        .max(tuning::finest_refinement() * spacing)
                        .clamp(f64::EPSILON, tuning::widest_spacing())
                });
                (centre, spacing)
            });
        }
        (r, v, known) = (path.r, path.v, true);
        let eta = residual(problem, &r, &v, &[]);
        if eta > 0.5 * best {
            monitor.measure_floor(&r, &[]);
            waited += 1;
            if waited > tuning::refinement_patience() || D == 2 {
                break; // in the plane the law is linear by pieces: rounding is left
            }
        } else {
            (best, waited) = (eta, 0);
        }
    }
    Ok(())
}

/// `r̂ − v̂` of a contact.
fn trial<const D: usize>(problem: &Reduced<D>, i: usize, r: &[f64; D], v: &[f64; D]) -> [f64; D] {
    let (r, v) = problem.scaling.scale(i, r, v);
    minus_scaled(&r, 1.0, &v)
}

/// An irregular fraction between 0 and 1: multiples of the golden ratio.
fn fraction(k: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let turns = (k + 1) as f64 * 0.618_033_988_749_894_9;
    turns.fract()
}

impl<'p, const D: usize> PivotingPath<'p, D> {
    /// Starts at a large `t`, where all contacts are open.
    fn far(problem: &'p Reduced<'p, D>, polygons: Vec<Polygon<D>>) -> Self {
        let scaling = &problem.scaling;
        let of_node = |i: usize| -> [f64; D] {
            std::array::from_fn(|k| {
                let part = fraction(D * i + k);
                let share = if k == 0 {
                    1.0 + part
                } else if movable(problem, i, k) {
                    // Inside the dual cone: c_n > μ ‖c_t‖.
                    0.1 * (part - 0.5) / (1.0 + problem.law[i].mu)
                } else {
                    0.0
                };
                share / scaling.to_v[i]
            })
        };
        let c: Vec<[f64; D]> = (0..problem.contacts()).map(of_node).collect();
        let closes = problem.q.iter().zip(&c).map(|(q, c)| -q[0] / c[0]);
        // Slightly before the first contact closes.
        let t = 1.01 * closes.fold(0.0, f64::max);
        Self {
            problem,
            polygons,
            cells: vec![Cell::Open; problem.contacts()],
            r: vec![[0.0; D]; problem.contacts()],
            v: plus(&problem.q, t, &c),
            c,
            t,
            most: f64::INFINITY,
        }
    }

    /// Starts at a nearby point, which is a solution for another `q`.
    fn near(
        problem: &'p Reduced<'p, D>,
        polygons: Vec<Polygon<D>>,
        r: &[[f64; D]],
        v: &[[f64; D]],
    ) -> Self {
        let scaling = &problem.scaling;
        let (mut cells, mut to_r, mut to_v) = (Vec::new(), r.to_vec(), v.to_vec());
        for (i, polygon) in polygons.iter().enumerate() {
            let (x, mu) = (trial(problem, i, &r[i], &v[i]), problem.law[i].mu);
            let size = amax(&x);
            let least = tuning::off_boundary() * (1.0 + fraction(i)) * size;
            let (least_r, least_v) = (least / scaling.to_r[i], least / scaling.to_v[i]);
            if x[0] <= 0.0 {
                cells.push(Cell::Open);
                to_r[i] = [0.0; D];
                to_v[i][0] = to_v[i][0].max(least_v);
                continue;
            }
            to_r[i][0] = to_r[i][0].max(least_r);
            to_v[i][0] = 0.0;
            if mu == 0.0 {
                cells.push(Cell::Free);
                to_r[i][1..].fill(0.0);
            } else if tangential_norm(&x) <= mu * x[0] {
                cells.push(Cell::Stick);
                to_v[i][1..].fill(0.0);
                // Inside the polygon, which lies in the disc.
                let mut over = 0.0_f64;
                polygon.guards(Cell::Stick, mu, |guard| {
                    let mut tangential = to_r[i];
                    tangential[0] = 0.0;
                    over = over.max(-dot(&guard.by_r, &tangential) / (mu * to_r[i][0]));
                });
                let inside = 1.0 - tuning::off_boundary() * (1.0 + fraction(i));
                if over > inside {
                    for c in &mut to_r[i][1..] {
                        *c *= inside / over;
                    }
                }
            } else {
                let j = polygon.against(&x.map(|c| -c));
                cells.push(Cell::Corner(j));
                let slip = tangential_norm(&v[i]).max(least_v);
                let corner = polygon.corner(j);
                for k in 1..D {
                    to_r[i][k] = mu * to_r[i][0] * corner[k];
                    to_v[i][k] = -slip * corner[k];
                }
            }
        }
        let own = problem.relative_displacement(&to_r, &[]);
        let c = plus(&to_v, -1.0, &own);
        Self {
            problem,
            polygons,
            cells,
            r: to_r,
            v: to_v,
            c,
            t: 1.0,
            most: tuning::turned_back(),
        }
    }

    /// `v` of the problem without `t c`.
    fn own_displacement(&self) -> Vec<[f64; D]> {
        plus(&self.v, -self.t, &self.c)
    }

    /// The angle of friction of a contact that slides, or did so (`slid`): that of
    /// `r̂_t − v̂_t`. It lies between the reaction and the direction opposite to the slip,
    /// nearer to the larger of the two.
    ///
    /// A contact that slides on a polygon may stick on the disc around it, so both are checked.
    fn direction(&self, i: usize, slid: bool) -> Option<f64> {
        let x = trial(self.problem, i, &self.r[i], &self.v[i]);
        let mu = self.problem.law[i].mu;
        let slides = match self.cells[i] {
            Cell::Open | Cell::Free => false,
            Cell::Stick => slid || tangential_norm(&x) > mu * x[0],
            Cell::Edge(_) | Cell::Corner(_) => true,
        };
        slides.then(|| x[D - 1].atan2(x[1]))
    }

    /// The law of the cells, with `by_r r + by_v v` of a field as its value.
    fn law(&self, r: &[[f64; D]], v: &[[f64; D]]) -> Linearisation<D> {
        let scaling = &self.problem.scaling;
        let of_node = |i: usize| {
            let mut rows = self.polygons[i].rows(self.cells[i], self.problem.law[i].mu);
            if self.cells[i] == Cell::Stick {
                for k in 1..D {
                    if !movable(self.problem, i, k) {
                        (rows.by_v[(k, k)], rows.by_r[(k, k)]) = (0.0, 1.0);
                    }
                }
            }
            let (r, v) = scaling.scale(i, &r[i], &v[i]);
            rows.value = rows.by_r * Vector::from(r) + rows.by_v * Vector::from(v);
            rows
        };
        Linearisation {
            at: (0..self.cells.len()).map(of_node).collect(),
            shift: 0.0,
            by_status: false,
        }
    }

    /// `dr` that solves the law from a point; `None` if the law is singular.
    fn solve(
        &self,
        law: &Linearisation<D>,
        r: &[[f64; D]],
        monitor: &mut Monitor<D>,
    ) -> Result<Option<Vec<[f64; D]>>, Error> {
        let form = ComplianceForm::new(self.problem, law);
        if form.order() == 0 {
            return Ok(Some(vec![[0.0; D]; r.len()]));
        }
        let stop = monitor.stop();
        let mut count = |products| monitor.count(products);
        let solved = form.solve((r, &[]), &[], &|| TIGHT, &mut count, stop)?;
        Ok(solved.map(|solved| solved.r))
    }

    /// Makes pivots until the path ends: at `t = 0`, or lost, on a ray, at its start again or at
    /// a singular law. Returns whether it arrived.
    fn follow(&mut self, monitor: &mut Monitor<D>) -> Result<bool, Ended> {
        let nothing = vec![[0.0; D]; self.r.len()];
        // The last contact that changed, and its earlier cell.
        let mut entered: Option<(usize, Cell)> = None;
        for pivot in 1.. {
            let against: Vec<[f64; D]> = self.c.iter().map(|c| c.map(|c| -c)).collect();
            let law = self.law(&nothing, &against);
            let Some(mut dr) = self.solve(&law, &nothing, monitor)? else {
                return Ok(false);
            };
            let mut effect = nothing.clone();
            self.problem.compliance.product(&dr, &mut effect);
            monitor.count(1.0);
            let mut dv = plus(&against, 1.0, &effect);
            let mut dt = -1.0;
            if entered.is_some_and(|(i, from)| self.leaves(i, from, &dr[i], &dv[i])) {
                dt = 1.0;
                let fields = dr.as_flattened_mut().iter_mut();
                fields.chain(dv.as_flattened_mut()).for_each(|x| *x = -*x);
            }
            let (step, event) = self.next(entered, &dr, &dv, dt);
            if !step.is_finite() {
                return Ok(false);
            }
            self.r = plus(&self.r, step, &dr);
            self.v = plus(&self.v, step, &dv);
            self.t += step * dt;
            entered = event.map(|(i, to)| (i, self.enter(i, to)));
            if entered.is_none() {
                self.t = 0.0;
            }
            if pivot % tuning::pivot_refresh() == 0 || entered.is_none() {
                self.refresh(monitor);
            }
            let next = monitor.look(&self.r, &self.own_displacement(), &[], true)?;
            if next == NextStep::Refresh {
                self.refresh(monitor);
            }
            if entered.is_none() {
                return Ok(true);
            }
            if self.t > self.most {
                return Ok(false);
            }
        }
        Ok(false)
    }

    fn refresh(&mut self, monitor: &mut Monitor<D>) {
        let own = self.problem.relative_displacement(&self.r, &[]);
        self.v = plus(&own, self.t, &self.c);
        monitor.count(1.0);
    }

    /// Whether a contact that moves by `(dr, dv)` returns to its earlier cell.
    fn leaves(&self, i: usize, from: Cell, dr: &[f64; D], dv: &[f64; D]) -> bool {
        let mut slope = 0.0;
        let cell = self.cells[i];
        self.polygons[i].guards(cell, self.problem.law[i].mu, |guard| {
            if cell == Cell::Open || guard.to == from {
                let (dr, dv) = self.problem.scaling.scale(i, dr, dv);
                slope = guard.at(&dr, &dv);
            }
        });
        slope < 0.0
    }

    /// The length of the step to the next boundary, with its contact and the cell beyond it; or
    /// to `t = 0`.
    fn next(
        &self,
        entered: Option<(usize, Cell)>,
        dr: &[[f64; D]],
        dv: &[[f64; D]],
        dt: f64,
    ) -> (f64, Option<(usize, Cell)>) {
        let mut step = if dt < 0.0 { self.t } else { f64::INFINITY };
        let mut event = None;
        for (i, &cell) in self.cells.iter().enumerate() {
            let (r, v) = self.problem.scaling.scale(i, &self.r[i], &self.v[i]);
            let (dr, dv) = self.problem.scaling.scale(i, &dr[i], &dv[i]);
            self.polygons[i].guards(cell, self.problem.law[i].mu, |guard| {
                // The boundary crossed last lies behind the point.
                let back = |(j, from)| j == i && (cell == Cell::Open || guard.to == from);
                let slope = guard.at(&dr, &dv);
                if slope < 0.0 && !entered.is_some_and(back) {
                    let reached = guard.at(&r, &v).max(0.0) / -slope;
                    if reached < step {
                        step = reached;
                        event = Some((i, guard.to));
                    }
                }
            });
        }
        (step, event)
    }

    /// Moves a contact to another cell; returns its earlier cell.
    fn enter(&mut self, i: usize, to: Cell) -> Cell {
        let from = self.cells[i];
        self.cells[i] = if from == Cell::Open {
            self.v[i][0] = 0.0;
            if self.problem.law[i].mu > 0.0 {
                Cell::Corner(self.polygons[i].against(&self.v[i]))
            } else {
                Cell::Free
            }
        } else {
            to
        };
        if self.cells[i] == Cell::Open {
            self.r[i] = [0.0; D];
        }
        from
    }

    /// Removes the rounding error of the linear law at `t = 0`.
    fn correct(&mut self, monitor: &mut Monitor<D>) -> Result<(), Ended> {
        let rounds = if D == 2 {
            tuning::cell_corrections()
        } else {
            1
        };
        for _ in 0..rounds {
            let law = self.law(&self.r, &self.v);
            let Some(next) = self.solve(&law, &self.r, monitor)? else {
                break;
            };
            self.r = next;
            self.refresh(monitor);
            let _ = monitor.look(&self.r, &self.v, &[], true)?;
        }
        Ok(())
    }
}
