//! Stores the analyses of patterns for later problems: the same mesh with other materials, gaps
//! or friction needs no ordering.
//!
//! An entry is found by its whole pattern, not by a hash, so that the reused analysis is
//! exactly the one that would be made. The list is limited in bytes; the entry not used for
//! longest is removed first. Each process has its own list.

use std::sync::Arc;

use crate::error::Error;
use crate::linalg::sparse::csc::Symmetric;
use crate::linalg::sparse::symbolic::Symbolic;
use crate::per_process::PerProcess;

/// Environment variable of the limit [MB]; 0 stores nothing.
pub const VARIABLE: &str = "BIPOT_PATTERN_CACHE_MB";

/// The default limit [MB]: some hundred patterns of a thousand unknowns, or one of fifty
/// thousand in space.
const DEFAULT: usize = 64;

/// Everything that an analysis depends on.
#[derive(Debug)]
struct PatternKey {
    start: Vec<u32>,
    index: Vec<u32>,
    kept: Vec<u32>,
    /// The bits of the positions.
    places: Option<Vec<[u64; 3]>>,
}

#[derive(Debug)]
struct CachedAnalysis {
    pattern: PatternKey,
    symbolic: Symbolic,
    bytes: usize,
}

/// The last entry was used last.
static KNOWN: PerProcess<Arc<CachedAnalysis>> = PerProcess::new();

/// The pattern to look up, borrowed.
#[derive(Clone, Copy, Debug)]
pub struct Lookup<'a> {
    pub matrix: Symmetric<'a>,
    pub kept: &'a [usize],
    pub places: Option<&'a [[f64; 3]]>,
}

impl Lookup<'_> {
    /// The analysis of this pattern, if it is stored.
    pub fn find(&self) -> Option<Arc<Symbolic>> {
        // Compare without the lock, so that others may look too.
        let list: Vec<Arc<CachedAnalysis>> = KNOWN.lock()?.clone();
        let found = list.into_iter().find(|entry| self.is(&entry.pattern))?;
        let mut list = KNOWN.lock()?;
        if let Some(at) = list.iter().position(|entry| Arc::ptr_eq(entry, &found)) {
            list[at..].rotate_left(1);
        }
        drop(list);
        Some(Arc::new(found.symbolic.for_another()))
    }

    /// Stores the analysis of this pattern, within the limit.
    pub fn keep(&self, symbolic: &Symbolic) {
        let bytes = self.bytes() + symbolic.counts().bytes_symbolic;
        let Some(limit) = limit().ok().filter(|&limit| bytes <= limit) else {
            return;
        };
        let entry = Arc::new(CachedAnalysis {
            pattern: self.pattern(),
            symbolic: symbolic.for_another(),
            bytes,
        });
        let Some(mut list) = KNOWN.lock() else {
            return;
        };
        // Another thread may have analysed the same pattern.
        if list.iter().any(|known| self.is(&known.pattern)) {
            return;
        }
        list.push(entry);
        let mut held: usize = list.iter().map(|entry| entry.bytes).sum();
        let beyond = list.iter().take_while(|entry| {
            let over = held > limit;
            held -= entry.bytes;
            over
        });
        let beyond = beyond.count();
        let gone: Vec<_> = list.drain(..beyond).collect();
        drop(list);
        drop(gone);
    }

    fn is(&self, known: &PatternKey) -> bool {
        fn same(a: &[usize], b: &[u32]) -> bool {
            // By blocks: a comparison that may end anywhere works entry by entry.
            let equal = |(a, b): (&[usize], &[u32])| {
                let pairs = a.iter().zip(b);
                pairs.filter(|&(&a, &b)| a != b as usize).count() == 0
            };
            a.len() == b.len() && a.chunks(64).zip(b.chunks(64)).all(equal)
        }
        if self.matrix.row_idx().len() != known.index.len() {
            return false;
        }
        let placed = match (self.places, &known.places) {
            (Some(a), Some(b)) => {
                a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.map(f64::to_bits) == *b)
            }
            (None, None) => true,
            _ => false,
        };
        placed
            && same(self.kept, &known.kept)
            && same(self.matrix.col_ptr(), &known.start)
            && same(self.matrix.row_idx(), &known.index)
    }

    /// The pattern itself; its indices have been analysed, so they fit 32 bits.
    fn pattern(&self) -> PatternKey {
        #[expect(clippy::cast_possible_truncation, reason = "checked by the analysis")]
        let short = |list: &[usize]| list.iter().map(|&i| i as u32).collect();
        let bits = |places: &[[f64; 3]]| places.iter().map(|at| at.map(f64::to_bits)).collect();
        PatternKey {
            start: short(self.matrix.col_ptr()),
            index: short(self.matrix.row_idx()),
            kept: short(self.kept),
            places: self.places.map(bits),
        }
    }

    fn bytes(&self) -> usize {
        let short = self.matrix.col_ptr().len() + self.matrix.row_idx().len() + self.kept.len();
        4 * short + 24 * self.places.map_or(0, <[_]>::len)
    }
}

/// The limit of all entries in bytes; an empty variable counts as missing.
pub fn limit() -> Result<usize, Error> {
    let asked = std::env::var_os(VARIABLE).unwrap_or_default();
    let asked = asked.to_string_lossy();
    let megabytes = match asked.trim() {
        "" => DEFAULT,
        text => text.parse::<usize>().map_err(|_| Error::Megabytes {
            what: VARIABLE,
            found: text.to_owned(),
        })?,
    };
    Ok(megabytes.saturating_mul(1 << 20))
}
