//! Why there is no answer: one enum for the whole crate.
//!
//! Three kinds, never mixed: the caller's mistake (found at the border, before
//! any work), a problem that has no answer, and an interruption. A solver that
//! has not converged is none of these: it returns its [`Outcome`].
//!
//! [`Outcome`]: crate::solver::Outcome

/// What went wrong, with the place.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An array has the wrong length.
    #[error("{what} has length {found}, expected {expected}")]
    Shape {
        what: &'static str,
        expected: usize,
        found: usize,
    },
    /// A NaN or an infinity in an argument.
    #[error("{what} is not finite at index {index}: {value}")]
    NotFinite {
        what: &'static str,
        index: usize,
        value: f64,
    },
    /// A NaN or an infinity in a matrix.
    #[error("{what} is not finite at row {row}, column {column}: {value}")]
    EntryNotFinite {
        what: &'static str,
        row: usize,
        column: usize,
        value: f64,
    },
    /// An index that is out of range.
    #[error("{what} holds index {found} at position {position}, expected less than {limit}")]
    IndexRange {
        what: &'static str,
        position: usize,
        found: usize,
        limit: usize,
    },
    /// The same index twice in a list of distinct ones.
    #[error("{what} holds index {index} twice, at positions {first} and {second}")]
    Repeated {
        what: &'static str,
        index: usize,
        first: usize,
        second: usize,
    },
    /// Row pointers or column indices that do not describe a sparse matrix.
    #[error("{what} is not a valid sparse matrix: its structure breaks at row {row}")]
    SparseStructure { what: &'static str, row: usize },
    /// A friction coefficient that is negative or not finite.
    #[error("mu of contact {node} is {mu}, expected a finite number, zero or positive")]
    Friction { node: usize, mu: f64 },
    /// Friction coefficients along two tangents that no solve can tell apart from
    /// friction along one of them only.
    #[error(
        "mu of contact {node} is ({}, {}), expected two positive numbers within a factor \
         of {ratio:e} of each other, or twice zero", mu[0], mu[1]
    )]
    EllipticFriction {
        node: usize,
        mu: [f64; 2],
        ratio: f64,
    },
    /// A setting out of its range.
    #[error("{what} is {found}, expected {expected}")]
    Setting {
        what: &'static str,
        found: f64,
        expected: &'static str,
    },
    /// A method that cannot balance the loads on a body that contact alone holds.
    #[error(
        "method '{method}' needs bodies that supports hold, and contact alone holds one here: \
         expected 'auto' or another method that balances rigid motions"
    )]
    NotHeld { method: &'static str },
    /// A stiffness matrix that is not symmetric to rounding.
    #[error(
        "stiffness K is not symmetric: K[{row}, {column}] = {upper:e} but K[{column}, {row}] = {lower:e}"
    )]
    Asymmetric {
        row: usize,
        column: usize,
        upper: f64,
        lower: f64,
    },
    /// A stiffness matrix with a direction of negative energy.
    #[error(
        "stiffness K is indefinite: elimination meets a negative pivot at degree of freedom {dof}; \
         K must be symmetric positive semidefinite"
    )]
    Indefinite { dof: usize },
    /// A free motion that the contact set does not feel.
    #[error(
        "the stiffness leaves a motion free that no contact feels, at degree of freedom {dof}: \
         is a body, or a part of one, free to move? Add supports, or contacts that pin it"
    )]
    FloatingBody { dof: usize },
    /// A stiffness of which rounding leaves no digit of the softest motions.
    #[error(
        "the stiffness K has too few digits: the energy of the softest motion of the body at \
         degree of freedom {dof} is smaller than the rounding of the entries of K. Use longer \
         elements, which are fewer and less slender; and without `coordinates` give these: \
         with them rigid motions are known exactly"
    )]
    FewDigits { dof: usize },
    /// Displacements that are not in equilibrium with the loads and the reactions.
    #[error(
        "K u = f + Bᵀ r does not hold at degree of freedom {dof}: it is off by {by_row:.1e} of its \
         terms, and all rows by {of_forces:.1e} of the forces. The stiffness K has too few digits \
         for these loads: use elements that are less slender, or supports that are less soft"
    )]
    NotBalanced {
        dof: usize,
        by_row: f64,
        of_forces: f64,
    },
    /// Displacements that do not give the relative displacements of the contacts.
    #[error(
        "B u + gap is off at contact {contact} by {off:e}, beside relative displacements of \
         {size:e}: the compliance W has too few digits. Use elements that are less slender, or \
         supports that are less soft"
    )]
    NotConfirmed { contact: usize, off: f64, size: f64 },
    /// A contact whose gap cannot be closed or opened by any motion.
    #[error(
        "contact {node} penetrates by {penetration:e} and no free degree of freedom can move it: \
         its normal displacement is prescribed"
    )]
    ContradictoryContact { node: usize, penetration: f64 },
    /// A rigid motion that no contact feels.
    #[error(
        "rigid motion {mode} of R moves no contact that the motions before it leave still: \
         contact cannot hold it"
    )]
    DependentMotion { mode: usize },
    /// Numbers so large or small that scaling them leaves the range of doubles.
    #[error(
        "W and q cannot be scaled: their largest entries are {softest:e} and {free:e}; \
         choose units in which neither leaves 1e-150 to 1e150"
    )]
    Range { softest: f64, free: f64 },
    /// More memory than the machine has.
    #[error(
        "{what} needs {bytes} bytes, more than the {available} this machine has free: a coarser \
         mesh or fewer contact candidates need less, and so does giving all loads at once as \
         `loads=`, which keeps no factor"
    )]
    Memory {
        what: &'static str,
        bytes: u128,
        available: u128,
    },
    /// More memory than the caller allows.
    #[error(
        "{what} needs {bytes} bytes, more than the {limit} of memory_limit: allow more, or give \
         all loads at once as `loads=`, which keeps no factor"
    )]
    MemoryLimit {
        what: &'static str,
        bytes: u128,
        limit: u128,
    },
    /// A displacement asked for after the factor was dropped.
    #[error(
        "displacements need the factor of K, which was dropped because all loads were known: \
         leave `loads=` out to keep it"
    )]
    FactorDropped,
    /// Loads that were not among those known when the factor was dropped.
    #[error(
        "load and prescribed are not among the loads given as `loads=`: the factor of K was \
         dropped, and no others can be condensed"
    )]
    UnknownLoads,
    /// A number of threads that is none, or out of all proportion.
    #[error("{what} is {found:?}, expected a whole number from 1 to {most}")]
    ThreadCount {
        what: &'static str,
        found: String,
        most: usize,
    },
    /// A bound on what is kept in memory that is no number.
    #[error("{what} is {found:?}, expected a whole number of megabytes, 0 to keep nothing")]
    Megabytes { what: &'static str, found: String },
    /// The threads could not be started.
    #[error("the thread pool of {threads} threads could not be started")]
    Threads { threads: usize },
    /// The caller asked for a stop.
    #[error("interrupted")]
    Interrupted,
}
