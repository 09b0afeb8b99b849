//! A block of memory that is divided into pieces, from both of its ends.
//!
//! The first access to new memory costs a second for each gigabyte. During a factorisation
//! updates come and go, and larger ones replace smaller ones: an allocator would ask the system
//! for each. Here they use the same memory again.

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut, Range};
use std::sync::Mutex;

use crate::linalg::pages::{release, zeros};
use crate::tasks::lock;

/// The end of an arena from which a piece is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArenaEnd {
    Low,
    High,
}

impl ArenaEnd {
    pub fn other(self) -> Self {
        match self {
            Self::Low => Self::High,
            Self::High => Self::Low,
        }
    }

    /// The `len` numbers at this end of a range, and the rest.
    fn split(self, range: &Range<usize>, len: usize) -> (Range<usize>, Range<usize>) {
        match self {
            Self::Low => {
                let cut = range.start + len;
                (range.start..cut, cut..range.end)
            }
            Self::High => {
                let cut = range.end - len;
                (cut..range.end, range.start..cut)
            }
        }
    }
}

/// Memory that is divided into pieces.
#[derive(Debug)]
pub struct Arena<'m> {
    memory: *mut f64,
    /// The free ranges, in order; no two touch.
    gaps: Mutex<Vec<Range<usize>>>,
    borrowed: PhantomData<&'m mut [f64]>,
}

// SAFETY: `memory` is only accessed through pieces, whose ranges do not overlap. A range
// changes its owner under the lock of `gaps`.
unsafe impl Sync for Arena<'_> {}

impl<'m> Arena<'m> {
    pub fn new(memory: &'m mut [f64]) -> Self {
        let whole = 0..memory.len();
        Self {
            memory: memory.as_mut_ptr(),
            gaps: Mutex::new(Vec::from_iter((!whole.is_empty()).then_some(whole))),
            borrowed: PhantomData,
        }
    }

    /// A piece of `len` numbers with any contents, from the first gap, seen from `end`, that is
    /// large enough; without such a gap, from the system.
    pub fn take(&self, len: usize, end: ArenaEnd) -> Piece<'_> {
        let mut gaps = lock(&self.gaps);
        let fits = |gap: &Range<usize>| gap.len() >= len;
        let found = match end {
            ArenaEnd::Low => gaps.iter().position(fits),
            ArenaEnd::High => gaps.iter().rposition(fits),
        };
        let Some(at) = found else {
            drop(gaps);
            return Piece::Apart(zeros(len));
        };
        let gap = &mut gaps[at];
        let (range, rest) = end.split(gap, len);
        *gap = rest;
        if gap.start == gap.end {
            let _ = gaps.remove(at);
        }
        Piece::Part {
            arena: self,
            range,
            end,
        }
    }

    /// Makes a range free.
    fn give(&self, range: Range<usize>) {
        if range.is_empty() {
            return;
        }
        let mut gaps = lock(&self.gaps);
        let at = gaps.partition_point(|gap| gap.start < range.start);
        let after = gaps.get(at).is_some_and(|gap| gap.start == range.end);
        let before = at > 0 && gaps[at - 1].end == range.start;
        match (before, after) {
            (true, true) => gaps[at - 1].end = gaps.remove(at).end,
            (true, false) => gaps[at - 1].end = range.end,
            (false, true) => gaps[at].start = range.start,
            (false, false) => gaps.insert(at, range),
        }
    }
}

/// Numbers with one owner.
#[derive(Debug)]
pub enum Piece<'r> {
    /// A part of an arena, which returns to it.
    Part {
        arena: &'r Arena<'r>,
        range: Range<usize>,
        end: ArenaEnd,
    },
    /// Memory of the system, because the arena had no gap.
    Apart(Vec<f64>),
}

impl Piece<'_> {
    /// Whether it is part of the arena.
    pub fn is_part(&self) -> bool {
        matches!(self, Self::Part { .. }) || self.is_empty()
    }

    /// Leaves the numbers in place, outside the management of the arena.
    pub fn leave(mut self) -> Detached {
        match &mut self {
            Self::Part { range, .. } => Detached::Part(std::mem::replace(range, 0..0)),
            Self::Apart(values) => Detached::Apart(std::mem::take(values)),
        }
    }

    /// Returns all but the first `len` numbers; these may move.
    ///
    /// # Panics
    /// If there are fewer: the rest would belong to other pieces.
    pub fn keep(&mut self, len: usize) {
        assert!(len <= self.len());
        let rest = self.len() - len;
        if rest == 0 {
            return;
        }
        match self {
            Self::Part {
                end: ArenaEnd::Low, ..
            } => {}
            // Towards the end it was taken from, so that no hole is left there.
            Self::Part {
                end: ArenaEnd::High,
                ..
            } => self.copy_within(..len, rest),
            Self::Apart(values) => {
                let kept = values[..len].to_vec();
                release(std::mem::replace(values, kept));
            }
        }
        if let Self::Part { arena, range, end } = self {
            let (kept, given) = end.split(range, len);
            *range = kept;
            arena.give(given);
        }
    }
}

/// Numbers that are not returned, by their place in the memory of the arena.
#[derive(Debug)]
pub enum Detached {
    Part(Range<usize>),
    Apart(Vec<f64>),
}

impl Default for Detached {
    fn default() -> Self {
        Self::Part(0..0)
    }
}

impl Detached {
    /// Their end in the memory of the arena; 0 if there are none.
    pub fn end(&self) -> usize {
        match self {
            Self::Part(range) if range.start < range.end => range.end,
            _ => 0,
        }
    }

    /// The numbers; `memory` is that of the arena.
    pub fn within<'s>(&'s self, memory: &'s [f64]) -> &'s [f64] {
        match self {
            // `memory` may end before the place of no numbers.
            Self::Part(range) if range.is_empty() => &[],
            Self::Part(range) => &memory[range.clone()],
            Self::Apart(values) => values,
        }
    }
}

impl Deref for Piece<'_> {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        match self {
            // SAFETY: the range lies inside the memory of the arena, and belongs to this piece
            // until it is returned.
            Self::Part { arena, range, .. } => unsafe {
                std::slice::from_raw_parts(arena.memory.add(range.start), range.len())
            },
            Self::Apart(values) => values,
        }
    }
}

impl DerefMut for Piece<'_> {
    fn deref_mut(&mut self) -> &mut [f64] {
        match self {
            // SAFETY: as above, and this is the only reference to the piece.
            Self::Part { arena, range, .. } => unsafe {
                std::slice::from_raw_parts_mut(arena.memory.add(range.start), range.len())
            },
            Self::Apart(values) => values,
        }
    }
}

impl Drop for Piece<'_> {
    fn drop(&mut self) {
        match self {
            Self::Part { arena, range, .. } => arena.give(range.clone()),
            Self::Apart(values) => release(std::mem::take(values)),
        }
    }
}
