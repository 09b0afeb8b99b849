//! What can move: connected bodies, their motions without energy, and what holds them.
//!
//! One theorem stands behind all answers. Let `K₀` be the stiffness that is meant and `K` the
//! numbers that represent it, `|K − K₀| ≤ ω |K|` in each entry. A motion `x` is *free* if
//! `K₀ x = 0`. Then each row of `K` satisfies
//!
//! ```text
//! |K x|_i ≤ ω (|K| |x|)_i                                                              (a)
//! ```
//!
//! and conversely (a) holds in all rows only if some matrix within `ω` of `K` does not resist
//! `x` [Oettli and Prager 1964]. So `K x`, in twice the precision, decides as much as the digits
//! of `K` allow. `ω` is a few ε for an assembled stiffness.
//!
//! 1. *From geometry* ([`geometry`], [`resistance`]). All rigid motions `Z` are known, and only
//!    the rank of the few columns `K Z` is asked for. If a combination violates (a) in a row, no
//!    stiffness within `ω` leaves it free: it is held. All others are free. The rank is that of
//!    a matrix with few columns and rows of order one ([`rank`]), so that no soft bending and no
//!    condition of `K` enters. Nothing stays undecided but a resistance of the size of rounding,
//!    which counts as none. Where a row of `K` is the sum of others, as that of a rigid set, `ω`
//!    is a few ε of the terms of the sum ([`geometry::Kinematics`]).
//! 2. *From `K` alone* ([`softest`], [`separation`]). Inverse iteration finds the softest
//!    motions, (a) separates them, and their energy is compared with its rounding. A motion is
//!    free only if it passes and the next motion is stiffer by a factor. If it passes without
//!    such a distance, the digits of `K` cannot decide: [`Error::FewDigits`]. With geometry,
//!    mechanisms are found in this way, and a motion without distance counts as elastic.
//! 3. *From a factor* ([`definite`]). If the scaled energy of each motion is far above the
//!    rounding of a Cholesky factorisation, all matrices near `K` are definite: the body is held
//!    [Demmel 1989]. This is the quick way, and decides for most bodies.
//!
//! The same holds for a stiffness that was written with few digits, where `ω` is the error of its
//! entries: `contact/stiffness/digits.py` weighs the rows by the error of each entry and asks for
//! the combinations here ([`rank`]). Whether *contact* resists a free motion depends on the signs
//! of reactions and is a cone programme: `reduced/balance.rs`.
//!
//! A verdict "held" is then not given for a `K` that is exactly singular, nor "free" for one that
//! resists above rounding: what lies between is refused or counts as stated. Contacts and
//! supports of other engines are rows in the amounts of rigid motions ([`holding`]); a
//! combination that moves no row is free. A combination of free motions that moves no contact
//! can be held by nothing: [`Error::FloatingBody`].
//!
//! [`basis`] has the only rigid motions of the program, [`directions`] the meaning of each
//! degree of freedom, [`connected`] the bodies, `tuning` the thresholds that were fitted.
//!
//! [`Error::FewDigits`]: crate::error::Error::FewDigits
//! [`Error::FloatingBody`]: crate::error::Error::FloatingBody

pub mod basis;
pub mod connected;
pub mod definite;
pub mod directions;
pub mod free_motions;
pub mod geometry;
pub mod holding;
pub mod rank;
pub mod resistance;
mod separation;
mod softest;
pub(crate) mod tuning;
