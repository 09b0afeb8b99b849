//! The outcome of a solve.

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
    #[must_use]
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
