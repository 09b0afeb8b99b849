//! The errors of the whole crate, in one enum.
//!
//! There are three kinds: a mistake of the caller, found before any work; a problem that has
//! no solution; and an interruption. A solver that has not converged gives no error: it
//! returns its [`Outcome`].
//!
//! A function with a flag `stop` returns [`Error::Interrupted`] once it is set, a method of
//! solution `Ended`, and what calls an engine the errors of that engine. The text of a function
//! names an error only to say a condition that is not said here.
//!
//! [`Outcome`]: crate::solver::Outcome

use std::sync::atomic::{AtomicBool, Ordering};

/// What is wrong, and where.
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
    /// An index that occurs twice.
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
    /// A friction coefficient that is negative, not a number or too large.
    #[error("mu of contact {node} is {mu:?}, expected zero or positive, at most {largest:e}")]
    Friction { node: usize, mu: f64, largest: f64 },
    /// A cohesion that is negative, not a number or too large.
    #[error(
        "cohesion of contact {node} is {cohesion:?}, expected zero or positive, at most {largest:e}"
    )]
    Cohesion {
        node: usize,
        cohesion: f64,
        largest: f64,
    },
    /// A dilatancy that is negative, not a number or larger than the friction coefficient.
    #[error("dilatancy of contact {node} is {dilatancy:?}, expected zero to mu, which is {mu:?}")]
    Dilatancy {
        node: usize,
        dilatancy: f64,
        mu: f64,
    },
    /// A law with a number that a method or a function does not take.
    #[error(
        "{what} does not solve contacts with {argument}, which is {value:?} at contact {node}: \
         set it to zero"
    )]
    NotCoulomb {
        what: &'static str,
        argument: &'static str,
        node: usize,
        value: f64,
    },
    /// Two friction coefficients of a contact that differ by too large a factor.
    #[error(
        "mu of contact {node} is ({}, {}), expected two positive numbers within a factor \
         of {ratio:e} of each other, or both zero", mu[0], mu[1]
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
    /// A method that cannot balance the loads on a body that only contact holds.
    #[error(
        "method '{method}' needs supports that hold every body, but only contact holds a body \
         here: use 'auto' or another method that balances rigid motions"
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
        "stiffness K is indefinite: the pivot at degree of freedom {dof} is negative; \
         K must be symmetric positive semidefinite"
    )]
    Indefinite { dof: usize },
    /// A motion that neither the stiffness nor a contact resists.
    #[error(
        "neither the stiffness nor a contact resists a motion at degree of freedom {dof}: \
         is a body, or a part of a body, free to move? Add supports or contacts that hold it"
    )]
    FloatingBody { dof: usize },
    /// A stiffness whose rounding hides the energy of the softest motions.
    #[error(
        "it cannot be decided whether a motion at degree of freedom {dof} is free: K has too few \
         digits, and the energy of this motion is smaller than the rounding of its entries. Add a \
         support that holds it, or use less slender cells"
    )]
    FewDigits { dof: usize },
    /// Displacements that are not in equilibrium with the loads and the reactions.
    #[error(
        "K u = f + Bᵀ r does not hold at degree of freedom {dof}: the error is {by_row:.1e} of the \
         terms of this row, and {of_forces:.1e} of the forces over all rows. The stiffness K has \
         too few digits for these loads: use less slender elements or stiffer supports"
    )]
    NotBalanced {
        dof: usize,
        by_row: f64,
        of_forces: f64,
    },
    /// Displacements that do not give the relative displacements of the contacts.
    #[error(
        "B u + gap has an error of {off:e} at contact {contact}, where relative displacements \
         are {size:e}: the compliance W has too few digits. Use less slender elements or stiffer \
         supports"
    )]
    NotConfirmed { contact: usize, off: f64, size: f64 },
    /// A contact that penetrates and that nothing can move along its normal.
    #[error(
        "contact {node} penetrates by {penetration:e} and no free degree of freedom can move it: \
         its normal displacement is prescribed; change its gap or the prescribed displacements"
    )]
    ContradictoryContact { node: usize, penetration: f64 },
    /// A rigid motion that depends on the earlier ones at all contacts.
    #[error(
        "rigid motion {mode} of R is zero, or a sum of the motions before it, at all contacts: \
         contact cannot hold it; remove this column of R or add contacts"
    )]
    DependentMotion { mode: usize },
    /// Numbers so large or small that scaling them leaves the range of doubles.
    #[error(
        "W and q cannot be scaled: their largest entries are {softest:e} and {free:e}; \
         choose units in which both are between 1e-150 and 1e150"
    )]
    Range { softest: f64, free: f64 },
    /// More memory than is free.
    #[error(
        "{what} needs {bytes} bytes, more than the {available} bytes of free memory: use a \
         coarser mesh or fewer contact candidates, or give all loads at once as `loads=`, so \
         that the factor of K is not kept"
    )]
    Memory {
        what: &'static str,
        bytes: u128,
        available: u128,
    },
    /// More memory than the caller allows.
    #[error(
        "{what} needs {bytes} bytes, more than the {limit} of memory_limit: raise it, or give \
         all loads at once as `loads=`, so that the factor of K is not kept"
    )]
    MemoryLimit {
        what: &'static str,
        bytes: u128,
        limit: u128,
    },
    /// Displacements were requested after the factor was dropped.
    #[error(
        "displacements need the factor of K, which was dropped because all loads were given \
         as `loads=`: omit `loads=` to keep it"
    )]
    FactorDropped,
    /// Loads that were not given before the factor was dropped.
    #[error(
        "load and prescribed are not among the loads given as `loads=`: the factor of K was \
         dropped, and other loads cannot be condensed"
    )]
    UnknownLoads,
    /// A number of threads that is zero, too large, or not a number.
    #[error("{what} is {found:?}, expected a whole number from 1 to {most}")]
    ThreadCount {
        what: &'static str,
        found: String,
        most: usize,
    },
    /// A limit of kept memory that is not a number.
    #[error("{what} is {found:?}, expected a whole number of megabytes, 0 to keep nothing")]
    Megabytes { what: &'static str, found: String },
    /// The threads could not be started.
    #[error("the pool of {threads} threads could not be started: use fewer threads")]
    Threads { threads: usize },
    /// A problem that the engine in the displacements cannot solve.
    #[error("engine 'iterative' cannot solve this problem: {reason}. Use engine='direct'")]
    NotIterative {
        reason: &'static str,
        /// A degree of freedom of the body that it is about.
        dof: Option<usize>,
    },
    /// Contacts for which the engine in the displacements has no variables; `contact` is the first.
    /// A support holds it along another direction than its normal and tangents if it is `oblique`.
    #[error(
        "engine 'iterative' cannot solve this problem: contact {contact} {}. Use engine='direct'",
        if *oblique {
            "is held along a direction that is neither its normal nor a tangent"
        } else {
            "shares each of its nodes with other contacts"
        }
    )]
    NoOwnNode {
        contact: usize,
        oblique: bool,
        contacts: Vec<usize>,
    },
    /// A matrix for which no multigrid preconditioner can be built.
    #[error(
        "the multigrid preconditioner cannot be built: {reason}. Use a direct factorisation of K"
    )]
    Multigrid { reason: &'static str },
    /// A cell whose mapping from the reference cell is not invertible.
    #[error("cell {cell} is folded or flat: mesh anew there")]
    FoldedCell { cell: usize },
    /// The caller stopped the work.
    #[error("interrupted")]
    Interrupted,
}

/// Stops if `stop` is set.
pub fn check_running(stop: &AtomicBool) -> Result<(), Error> {
    if stop.load(Ordering::Relaxed) {
        return Err(Error::Interrupted);
    }
    Ok(())
}

/// Checks the number of values of an argument.
pub fn check_length(what: &'static str, found: usize, expected: usize) -> Result<(), Error> {
    if found == expected {
        Ok(())
    } else {
        Err(Error::Shape {
            what,
            expected,
            found,
        })
    }
}

/// Checks that the values of an argument are numbers.
pub fn check_finite(what: &'static str, values: &[f64]) -> Result<(), Error> {
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(index) => Err(Error::NotFinite {
            what,
            index,
            value: values[index],
        }),
    }
}
