//! What a caller may choose.

/// How often a cycle visits the coarser levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cycle {
    /// Once.
    V,
    /// By two steps of conjugate gradients on each coarser level [Notay & Vassilevski 2008]. The
    /// preconditioner then depends on its argument: use a flexible method.
    K,
}

/// CycleSettings of a multigrid preconditioner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CycleSettings {
    /// Steps of the smoother before and after the coarser level, 1 to 4.
    pub degree: usize,
    /// A bound of the eigenvalues of `D⁻¹ A` on the finest level; `None` estimates it, which
    /// costs ten products.
    pub spectrum: Option<f64>,
    pub cycle: Cycle,
}

impl Default for CycleSettings {
    fn default() -> Self {
        Self {
            degree: 2,
            spectrum: None,
            cycle: Cycle::V,
        }
    }
}
