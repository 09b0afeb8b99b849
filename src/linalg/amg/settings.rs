//! What a caller may choose.

/// Settings of a multigrid preconditioner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CycleSettings {
    /// Steps of the smoother before and after the coarser level, 1 to 4.
    pub degree: usize,
    /// A bound of the eigenvalues of `D⁻¹ A` on the finest level; `None` estimates it, which
    /// costs ten products.
    pub spectrum: Option<f64>,
}

impl Default for CycleSettings {
    fn default() -> Self {
        Self {
            degree: 2,
            spectrum: None,
        }
    }
}
