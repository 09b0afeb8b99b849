//! Elimination orders: METIS, and bisection by coordinates.
//!
//! Both are nested dissections of the node graph. METIS needs no coordinates and is better on
//! most meshes. Cutting at coordinate planes takes a tenth of its time and is equal on boxes
//! along the axes. The caller counts and keeps the better order (`symbolic`).

use std::ptr;

use metis_sys as metis;

use crate::error::Error;
use crate::linalg::sparse::tuning;
use crate::per_process::PerProcess;

/// A graph in METIS's form: the neighbours of vertex `v` are
/// `neighbours[start[v]..start[v + 1]]`, in both directions, without loops.
#[derive(Debug)]
pub(crate) struct Graph {
    start: Vec<i32>,
    neighbours: Vec<i32>,
    weight: Vec<i32>,
}

impl Graph {
    /// Makes it from the neighbour lists of the vertices; `weight` is the number of unknowns of
    /// a vertex.
    pub(crate) fn new(start: &[usize], neighbours: &[u32], weight: &[u32]) -> Result<Self, Error> {
        let narrow = |what, position, found: usize| {
            i32::try_from(found).map_err(|_| Error::IndexRange {
                what,
                position,
                found,
                limit: i32::MAX as usize,
            })
        };
        let unknowns: usize = weight.iter().map(|&w| w as usize).sum();
        let _ = narrow("list of unknowns to order", 0, unknowns)?;
        let index = |(at, &v): (usize, &u32)| narrow("node graph of K", at, v as usize);
        Ok(Self {
            start: start
                .iter()
                .enumerate()
                .map(|(at, &s)| narrow("node graph of K", at, s))
                .collect::<Result<_, _>>()?,
            neighbours: neighbours
                .iter()
                .enumerate()
                .map(index)
                .collect::<Result<_, _>>()?,
            weight: weight
                .iter()
                .enumerate()
                .map(index)
                .collect::<Result<_, _>>()?,
        })
    }

    fn len(&self) -> usize {
        self.weight.len()
    }

    #[expect(
        clippy::cast_sign_loss,
        reason = "built from non-negative numbers in `new`"
    )]
    fn of(&self, v: usize) -> impl Iterator<Item = usize> + '_ {
        self.neighbours[self.start[v] as usize..self.start[v + 1] as usize]
            .iter()
            .map(|&w| w as usize)
    }
}

/// METIS uses libc's `rand`, one sequence for the process: simultaneous calls would mix their
/// numbers, and the same K would give other bits.
static METIS: PerProcess<()> = PerProcess::new();

/// Replaces METIS's `gk_sigtrap` and `gk_siguntrap` in the linker (`build.rs`): calls these,
/// and restores the earlier signal handlers.
#[cfg(all(feature = "python", target_os = "linux"))]
mod handlers {
    use std::ffi::c_int;
    use std::mem::MaybeUninit;
    use std::ptr;

    unsafe extern "C" {
        fn __real_gk_sigtrap() -> c_int;
        fn __real_gk_siguntrap() -> c_int;
    }

    /// Runs `call` and restores the handlers of these signals.
    fn keeping<const N: usize>(
        signals: [c_int; N],
        call: unsafe extern "C" fn() -> c_int,
    ) -> c_int {
        let before = signals.map(|signal| {
            let mut action = MaybeUninit::<libc::sigaction>::uninit();
            // SAFETY: reads the action of a signal into memory for one action, which is used
            // only if it was written.
            unsafe {
                (libc::sigaction(signal, ptr::null(), action.as_mut_ptr()) == 0)
                    .then(|| action.assume_init())
            }
        });
        // SAFETY: METIS itself calls these two in pairs, where it now calls this function.
        let done = unsafe { call() };
        for (signal, action) in signals.into_iter().zip(&before) {
            if let Some(action) = action {
                // SAFETY: the action belonged to this signal just before.
                let _ = unsafe { libc::sigaction(signal, action, ptr::null_mut()) };
            }
        }
        done
    }

    // METIS keeps SIGABRT, which it raises if memory runs out.
    #[unsafe(no_mangle)]
    extern "C" fn __wrap_gk_sigtrap() -> c_int {
        keeping([libc::SIGTERM], __real_gk_sigtrap)
    }

    // METIS restores both by `signal`, which loses the flags of a handler. For SIGABRT its own
    // handler is set here, so it may restore that one.
    #[unsafe(no_mangle)]
    extern "C" fn __wrap_gk_siguntrap() -> c_int {
        keeping([libc::SIGTERM], __real_gk_siguntrap)
    }
}

/// Nested dissection by METIS: `order[new] = old`. `None` if METIS fails or does not return a
/// permutation.
pub(crate) fn by_metis(graph: &Graph) -> Option<Vec<u32>> {
    let n = graph.len();
    if graph.neighbours.is_empty() {
        // Nothing to dissect; METIS is not made for graphs without edges.
        return Some(
            (0..graph.weight.len())
                .filter_map(|v| u32::try_from(v).ok())
                .collect(),
        );
    }
    let mut vertices = i32::try_from(n).ok()?;
    // METIS needs mutable arrays, and others read the graph at the same time.
    let (mut start, mut neighbours) = (graph.start.clone(), graph.neighbours.clone());
    let mut weight = graph.weight.clone();
    let mut order = vec![0_i32; n];
    let mut inverse = vec![0_i32; n];
    let mut options = [0_i32; metis::METIS_NOPTIONS as usize];
    let status = {
        let _one_at_a_time = METIS.lock()?;
        // SAFETY: `options` has METIS_NOPTIONS entries; `start` has n + 1
        // increasing entries, the last the length of `neighbours`, whose entries
        // are below n; `weight`, `order` and `inverse` have n entries. METIS
        // keeps no pointer after it returns.
        unsafe {
            let _ = metis::METIS_SetDefaultOptions(options.as_mut_ptr());
            options[metis::moptions_et_METIS_OPTION_SEED as usize] = 2;
            // METIS's default imbalance of 1.2 gives smaller separators first and more work
            // later. Over six seeds, 1.1 is up to one per cent better on cubes and bars, and
            // equal on squares and plates.
            options[metis::moptions_et_METIS_OPTION_UFACTOR as usize] = 100;
            // Equal patterns are grouped before.
            options[metis::moptions_et_METIS_OPTION_COMPRESS as usize] = 0;
            metis::METIS_NodeND(
                ptr::from_mut(&mut vertices),
                start.as_mut_ptr(),
                neighbours.as_mut_ptr(),
                weight.as_mut_ptr(),
                options.as_mut_ptr(),
                order.as_mut_ptr(),
                inverse.as_mut_ptr(),
            )
        }
    };
    if status != metis::rstatus_et_METIS_OK {
        return None;
    }
    let mut seen = vec![false; n];
    order
        .into_iter()
        .map(|v| {
            let v = u32::try_from(v).ok()?;
            let seen = seen.get_mut(v as usize)?;
            (!std::mem::replace(seen, true)).then_some(v)
        })
        .collect()
}

/// Nested dissection at coordinate planes: `order[new] = old`.
///
/// A set is cut across its longest side at the median; the nodes on the upper side with
/// neighbours on the lower side separate the two and come last.
pub(crate) fn by_coordinates(graph: &Graph, at: &[[f64; 3]]) -> Vec<u32> {
    enum MetisTask {
        Cut(Vec<u32>),
        Emit(Vec<u32>),
    }
    let n = graph.len();
    let mut order = Vec::with_capacity(n);
    let mut side = vec![0_u32; n];
    let mut label = 0;
    let all = (0..n).filter_map(|v| u32::try_from(v).ok()).collect();
    let mut steps = vec![MetisTask::Cut(all)];
    while let Some(step) = steps.pop() {
        let mut set = match step {
            MetisTask::Emit(set) => {
                order.extend(set);
                continue;
            }
            MetisTask::Cut(set) => set,
        };
        let extent = |axis: usize| {
            let range = set
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| {
                    let x = at[v as usize][axis];
                    (a.min(x), b.max(x))
                });
            range.1 - range.0
        };
        let sides = [extent(0), extent(1), extent(2)];
        let axis = (1..3).fold(0, |best, k| if sides[k] > sides[best] { k } else { best });
        if set.len() <= tuning::leaf_nodes() || sides[axis].is_nan() || sides[axis] <= 0.0 {
            order.extend(set);
            continue;
        }
        let along = |v: u32| at[v as usize][axis];
        let middle = set.len() / 2;
        let _ = set.select_nth_unstable_by(middle, |&a, &b| {
            along(a).total_cmp(&along(b)).then(a.cmp(&b))
        });
        let plane = along(set[middle]);
        // Nodes on the plane stay together; if the whole lower half is on it, the plane moves
        // above them.
        let below = |v: u32| along(v) < plane;
        let low_is_empty = !set.iter().any(|&v| below(v));
        let (mut low, high): (Vec<u32>, Vec<u32>) = set.into_iter().partition(|&v| {
            if low_is_empty {
                along(v) <= plane
            } else {
                below(v)
            }
        });
        low.sort_unstable();
        label += 1;
        for &v in &low {
            side[v as usize] = label;
        }
        let touches = |v: u32| graph.of(v as usize).any(|w| side[w] == label);
        let (mut separator, mut high): (Vec<u32>, Vec<u32>) =
            high.into_iter().partition(|&v| touches(v));
        separator.sort_unstable();
        high.sort_unstable();
        steps.push(MetisTask::Emit(separator));
        steps.push(MetisTask::Cut(high));
        steps.push(MetisTask::Cut(low));
    }
    order
}
