//! Memory as the system gives it: a page costs a fault when it is first touched, two
//! microseconds for four kilobytes, and a large page of two megabytes hardly more.

/// A vector of zeros that the system may back with large pages: memory touched
/// for the first time costs a fault a page, a second a gigabyte with small ones.
pub(crate) fn zeros(len: usize) -> Vec<f64> {
    /// Below this, large pages have nothing to gain.
    #[cfg(target_os = "linux")]
    const LARGE: usize = 1 << 22;
    let values = vec![0.0; len];
    #[cfg(target_os = "linux")]
    if std::mem::size_of_val(values.as_slice()) >= LARGE {
        let page = 1 << 21;
        let begin = values.as_ptr().addr();
        let inner = begin.next_multiple_of(page);
        let end = begin + std::mem::size_of_val(values.as_slice());
        let start = values.as_ptr().cast::<u8>().wrapping_add(inner - begin);
        // SAFETY: the range lies inside the allocation, and the advice changes
        // neither its contents nor who may use it. Refusal does no harm.
        unsafe {
            libc::madvise(
                start.cast_mut().cast(),
                (end - inner) / page * page,
                libc::MADV_HUGEPAGE,
            );
        }
    }
    values
}

/// Frees a vector, and its pages at once: the allocator would keep those of
/// vectors below some 32 MB, in pieces that the next, larger one does not fit.
/// Small ones it may keep: to touch their like anew costs more than they hold.
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
            // SAFETY: the range lies inside the allocation, which is ours alone
            // and never read again; it holds numbers, and zeros are numbers.
            // Refusal, as where pages are larger, does no harm.
            unsafe {
                libc::madvise(
                    start.cast(),
                    (end - inner) / page * page,
                    libc::MADV_DONTNEED,
                );
            }
        }
    }
}

/// Makes the heap of this process one that keeps what is freed: for a program of our
/// own, whose arrays of some megabytes come and go, and are touched anew each time
/// otherwise.
///
/// Arrays above some megabytes come from the system and go back to it as ever. No
/// result depends on it; where the C library is another, nothing happens.
pub fn keep_heap() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        /// What the heap grows by.
        const GROWTH: i32 = 1 << 24;
        /// Arrays above this are no part of the heap [bytes].
        const APART: i32 = 1 << 23;
        // SAFETY: these set thresholds of the allocator, which it locks itself.
        unsafe {
            // One heap for all threads: what one has freed serves the others.
            libc::mallopt(libc::M_ARENA_MAX, 1);
            libc::mallopt(libc::M_MMAP_THRESHOLD, APART);
            libc::mallopt(libc::M_TRIM_THRESHOLD, 8 * GROWTH);
            libc::mallopt(libc::M_TOP_PAD, GROWTH);
        }
        if crate::threads::count(None).is_ok_and(|threads| threads > 1) {
            // Where there is no thread to be had, pages are touched when they are needed.
            let _ = std::thread::Builder::new().spawn(touch_heap);
        }
    }
}

/// Takes from the heap what a job of some thousand unknowns will want, writes a byte
/// into each page, and gives it back: by a thread beside imports, which leave other
/// cores idle, so that the job itself meets pages that are there.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn touch_heap() {
    const PAGE: usize = 1 << 12;
    /// Below what the heap gives away as arrays apart [bytes].
    const PIECE: usize = 1 << 22;
    const PIECES: usize = 10;
    let touched = |_| {
        let mut piece = Vec::<u8>::new();
        // Where memory is short, it is for the job.
        piece.try_reserve_exact(PIECE).ok()?;
        for page in piece.spare_capacity_mut().chunks_mut(PAGE) {
            page[0].write(1);
        }
        // Else nobody would see the writes, and they would be left out.
        Some(std::hint::black_box(piece))
    };
    let all: Vec<Vec<u8>> = (0..PIECES).map_while(touched).collect();
    drop(all);
}
