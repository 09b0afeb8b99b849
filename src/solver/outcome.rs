//! The outcome of a solve, and how it ends a method.

use crate::error::Error;

/// Why a solver stopped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Outcome {
    Converged,
    #[default]
    Stalled,
    IterationLimit,
    TimeLimit,
    NoEquilibrium,
}

impl Outcome {
    pub fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Stalled => "stalled",
            Self::IterationLimit => "iteration_limit",
            Self::TimeLimit => "time_limit",
            Self::NoEquilibrium => "no_equilibrium",
        }
    }
}

/// The end of a method from outside: `?` passes it on through all that the method calls. A
/// method that returns `Ok` has stalled.
#[derive(Debug)]
pub enum Ended {
    /// The monitor stopped it, with a solution or at a limit.
    Stopped(Outcome),
    /// The caller interrupted it, or the problem is at fault.
    Failed(Error),
}

pub fn outcome_of(ended: Result<(), Ended>) -> Result<Outcome, Error> {
    match ended {
        Ok(()) => Ok(Outcome::Stalled),
        Err(Ended::Stopped(outcome)) => Ok(outcome),
        Err(Ended::Failed(error)) => Err(error),
    }
}

impl From<Error> for Ended {
    fn from(error: Error) -> Self {
        Self::Failed(error)
    }
}
