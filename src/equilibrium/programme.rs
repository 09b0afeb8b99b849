//! Convex programmes over products of cones, by the interior-point method of Clarabel.
//!
//! This file alone names the crate. Its status is not passed on: the caller checks the point and
//! the multipliers in arithmetic of its own.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SupportedConeT};

use crate::error::Error;

/// Relative residuals and gap at which steps end: near rounding. Where they stall before, the
/// best point is returned.
pub const NEAR_ROUNDING: f64 = 1e-12;

/// With fewer entries the programme ends before a signal could.
const LONG: usize = 20_000;

/// Interval at which a long programme looks whether it shall stop.
const LOOK: Duration = Duration::from_millis(50);

/// When a programme ends without a result.
#[derive(Clone, Copy, Debug)]
pub struct Limits<'a> {
    pub stop: &'a AtomicBool,
    started: Instant,
    seconds: f64,
}

impl<'a> Limits<'a> {
    /// From now on, for all programmes together.
    pub fn new(stop: &'a AtomicBool, seconds: f64) -> Self {
        let started = Instant::now();
        Self {
            stop,
            started,
            seconds,
        }
    }

    /// Zero once they are over.
    pub fn seconds_left(&self) -> f64 {
        (self.seconds - self.started.elapsed().as_secs_f64()).max(0.0)
    }
}

/// `min ½ xᵀ P x + cost·x` with `right + A x` in a product of cones.
#[derive(Debug)]
pub struct Programme {
    pub cost: Vec<f64>,
    /// Rows, columns and values of `P`, its upper triangle.
    pub quadratic: (Vec<usize>, Vec<usize>, Vec<f64>),
    row: Vec<usize>,
    column: Vec<usize>,
    value: Vec<f64>,
    right: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
}

/// The end of the search, to be checked: a point with its multipliers, or a direction that
/// proves that there is none.
#[derive(Debug)]
pub struct End {
    pub x: Vec<f64>,
    /// One for each row: `cost + P x = Aᵀ multipliers`.
    pub multipliers: Vec<f64>,
}

impl Programme {
    pub fn new(columns: usize) -> Self {
        Self {
            cost: vec![0.0; columns],
            quadratic: Default::default(),
            row: Vec::new(),
            column: Vec::new(),
            value: Vec::new(),
            right: Vec::new(),
            cones: Vec::new(),
        }
    }

    /// Adds `½ weight x²` of some columns.
    pub fn square(&mut self, columns: Range<usize>, weight: f64) {
        let (row, column, value) = &mut self.quadratic;
        value.resize(value.len() + columns.len(), weight);
        row.extend(columns.clone());
        column.extend(columns);
    }

    /// Adds a row `right + entries·x`; the cone of the rows so far follows.
    pub fn push(&mut self, right: f64, entries: impl IntoIterator<Item = (usize, f64)>) {
        for (column, value) in entries {
            // Clarabel's rows are right − A x.
            self.row.push(self.right.len());
            self.column.push(column);
            self.value.push(-value);
        }
        self.right.push(right);
    }

    /// Adds rows of which the first is at least the length of the others; two, as half-lines.
    pub fn push_cone(&mut self, rows: Vec<(f64, Vec<(usize, f64)>)>) {
        let count = rows.len();
        if let [first, second] = &rows[..] {
            for sign in [1.0, -1.0] {
                let signed = second.1.iter().map(|&(j, value)| (j, sign * value));
                let entries = first.1.iter().copied().chain(signed);
                self.push(sign.mul_add(second.0, first.0), entries);
            }
            return self.nonnegative(2);
        }
        for (right, entries) in rows {
            self.push(right, entries);
        }
        self.circular(count);
    }

    /// The first of the last rows is at least the length of the others.
    pub fn circular(&mut self, rows: usize) {
        if rows == 1 {
            self.nonnegative(1);
        } else {
            self.cones.push(SupportedConeT::SecondOrderConeT(rows));
        }
    }

    /// The last rows are zero.
    pub fn equal(&mut self, rows: usize) {
        self.cones.push(SupportedConeT::ZeroConeT(rows));
    }

    /// The last rows are not negative.
    pub fn nonnegative(&mut self, rows: usize) {
        if let Some(SupportedConeT::NonnegativeConeT(before)) = self.cones.last_mut() {
            *before += rows;
        } else {
            self.cones.push(SupportedConeT::NonnegativeConeT(rows));
        }
    }

    /// Searches until relative residuals and gap are `enough`. Every run gives the same bits, if no limit ends it.
    pub fn solve(self, enough: f64, limits: Limits) -> Result<End, Error> {
        let (rows, columns, entries) = (self.right.len(), self.cost.len(), self.value.len());
        let nothing = End {
            x: vec![f64::NAN; columns],
            multipliers: vec![f64::NAN; rows],
        };
        if limits.seconds_left() <= 0.0 {
            return Ok(nothing); // to factor it would take longer than the limit
        }
        let (row, column, value) = self.quadratic;
        let quadratic = CscMatrix::new_from_triplets(columns, columns, row, column, value);
        let matrix = CscMatrix::new_from_triplets(rows, columns, self.row, self.column, self.value);
        let settings = DefaultSettings {
            verbose: false,
            max_threads: 1,
            time_limit: limits.seconds_left(),
            tol_feas: enough,
            tol_gap_abs: enough,
            tol_gap_rel: enough,
            tol_infeas_abs: enough,
            tol_infeas_rel: enough,
            ..DefaultSettings::default()
        };
        let made = DefaultSolver::new(
            &quadratic,
            &self.cost,
            &matrix,
            &self.right,
            &self.cones,
            settings,
        );
        let Ok(mut solver) = made else {
            return Ok(nothing);
        };
        if entries < LONG {
            solver.solve();
        } else {
            solve_watched(&mut solver, limits.stop);
        }
        if limits.stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        Ok(End {
            x: solver.solution.x,
            multipliers: solver.solution.z,
        })
    }
}

/// Solves while a thread watches `stop`.
fn solve_watched(solver: &mut DefaultSolver<f64>, stop: &AtomicBool) {
    let stopped = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&stopped);
    solver.set_termination_callback(move |_| seen.load(Ordering::Relaxed));
    thread::scope(|scope| {
        let (running, ended) = channel::<()>();
        let _ = scope.spawn(move || {
            while ended.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
                if stop.load(Ordering::Relaxed) {
                    stopped.store(true, Ordering::Relaxed);
                }
            }
        });
        solver.solve();
        drop(running);
    });
}
