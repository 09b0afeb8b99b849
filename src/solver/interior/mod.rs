//! An interior-point method for large sets of rigid bodies with more reactions than motions.
//!
//! With `z = (μ r̂_n, r̂_t)` and `s = (ṽ̂_n/μ, v̂_t)` the law (9) is `L ∋ z ⊥ s ∈ L`. Newton
//! steps follow `z ∘ s = σ e`, `σ → 0`, from inside the cones, as in convex programming with
//! the Nesterov–Todd scaling. The non-convex term `‖s_t‖` of `s₀ = v̂_n/μ + ‖s_t‖` is part of
//! the same Newton system. The points lead to the middle of the set of reactions that are
//! solutions. From there Newton and proximal points, which fail where reactions are not
//! determined, find the last digits.
//!
//! `‖s_t‖` has a kink where a contact sticks, at which steps stall. It is replaced by
//! `h(s) = √(θ s₀² + (1 − θ)‖s_t‖²)`, `0 < θ < 1`, which is smooth inside the cone. The
//! solutions stay the same: `v̂_n/μ = s₀ − h(s)` is zero if `s₀ = ‖s_t‖` and positive inside
//! the cone.

mod factors;
mod path;
mod system;

pub use path::run;
