//! Memory pages of the system. Each page costs a fault at its first access: two microseconds
//! for four kilobytes, and little more for a large page of two megabytes.

/// A vector of zeros that the system may put on large pages. With small pages, the first access
/// to a gigabyte takes a second.
pub(crate) fn zeros<T: Clone + Default>(len: usize) -> Vec<T> {
    /// Smaller vectors gain nothing from large pages.
    #[cfg(target_os = "linux")]
    const LARGE: usize = 1 << 22;
    let values = vec![T::default(); len];
    #[cfg(target_os = "linux")]
    if std::mem::size_of_val(values.as_slice()) >= LARGE {
        let page = 1 << 21;
        let begin = values.as_ptr().addr();
        let inner = begin.next_multiple_of(page);
        let end = begin + std::mem::size_of_val(values.as_slice());
        let start = values.as_ptr().cast::<u8>().wrapping_add(inner - begin);
        // SAFETY: the range lies inside the allocation, and the advice changes neither its
        // contents nor its owner. A refusal has no effect.
        unsafe {
            let _ = libc::madvise(
                start.cast_mut().cast(),
                (end - inner) / page * page,
                libc::MADV_HUGEPAGE,
            );
        }
    }
    values
}

/// Frees a vector and its pages at once. The allocator would keep vectors below about 32 MB in
/// pieces that are too small for the next, larger one. It keeps small vectors: new pages would
/// cost more than their memory.
pub(crate) fn release(values: Vec<f64>) {
    #[cfg(not(target_os = "linux"))]
    drop(values);
    #[cfg(target_os = "linux")]
    {
        const LARGE: usize = 1 << 22;
        let mut values = values;
        let page = 1 << 12;
        let begin = values.as_mut_ptr().addr();
        let inner = begin.next_multiple_of(page);
        let end = begin + size_of_val(values.as_slice());
        if inner + LARGE <= end {
            let start = values.as_mut_ptr().cast::<u8>().wrapping_add(inner - begin);
            // SAFETY: the range lies inside the allocation, which belongs to this function and
            // is never read again; all its contents are valid numbers. A refusal, as for larger
            // pages, has no effect.
            unsafe {
                let _ = libc::madvise(
                    start.cast(),
                    (end - inner) / page * page,
                    libc::MADV_DONTNEED,
                );
            }
        }
    }
}

/// Makes the heap return freed arrays to the system. A library of MPI may have
/// set that it keeps all of them; copies of a large matrix would then add up.
///
/// No result depends on this; with another C library it has no effect.
pub fn return_heap() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        /// Larger arrays are not part of the heap [bytes]. A sixteenth: 36 cells a side take 8 % less
        /// memory, and new pages a fifth of the time of a load path.
        const APART: i32 = 1 << 22;
        /// The free end of the heap is no larger [bytes]. With half of it, a third of the page faults of a
        /// load path at 36 cells a side are those of vectors that come and go there.
        const END: i32 = 1 << 23;
        /// Number of separate arrays, the default of the allocator.
        const MOST: i32 = 1 << 16;
        // SAFETY: these calls set thresholds of the allocator, which has its own lock.
        unsafe {
            let _ = libc::mallopt(libc::M_MMAP_MAX, MOST);
            let _ = libc::mallopt(libc::M_MMAP_THRESHOLD, APART);
            let _ = libc::mallopt(libc::M_TRIM_THRESHOLD, END);
        }
    }
}
