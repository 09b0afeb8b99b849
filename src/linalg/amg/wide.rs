//! Loops compiled for the widest registers of the processor.
//!
//! The package is compiled for every processor of its family, whose registers hold four single
//! numbers. Newer ones hold eight, and multiply and add in one instruction: the set-up takes
//! half the time.

/// A loop over numbers. `FMA` says whether the processor multiplies and adds in one instruction.
pub(super) trait WideWork {
    fn run<const FMA: bool>(self);
}

/// Runs `work` with the instructions that this processor has.
pub(super) fn widest(work: impl WideWork) {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
        {
            // SAFETY: the processor has the instructions.
            unsafe { with_avx2(work) }
        } else {
            work.run::<false>();
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    work.run::<{ cfg!(target_arch = "aarch64") }>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn with_avx2(work: impl WideWork) {
    work.run::<true>();
}
