//! Memory of a condensation, counted by an allocator, compared with the prediction of the
//! analysis. It is a binary of its own, because the count is of the whole process.
#![expect(clippy::unwrap_used, reason = "a test may fail")]

#[path = "common/elasticity.rs"]
#[expect(dead_code, reason = "other tests use the rest")]
mod elasticity;

use std::alloc::{GlobalAlloc, Layout, System};
use std::borrow::Cow;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use bipot_rs::bodies::basis::motions_of_nodes;
use bipot_rs::law::contact_law::ContactLaw;
use bipot_rs::linalg::amg::following::Following;
use bipot_rs::linalg::amg::nodes::LevelNodes;
use bipot_rs::linalg::amg::settings::CycleSettings;
use bipot_rs::linalg::amg::single_rows::SingleRows;
use bipot_rs::linalg::amg::symmetric_blocks::{SymmetricBlocks, UpperBlocks};
use bipot_rs::linalg::dense::{cholesky, invert_from_cholesky};
use bipot_rs::linalg::sparse::csc::Symmetric;
use bipot_rs::linalg::sparse::multifrontal::{Factor, Schur};
use bipot_rs::linalg::sparse::symbolic::{Counts, Options, Symbolic};
use bipot_rs::proof::uniqueness::{MOST_BYTES, Unique, assess, bytes};
use bipot_rs::reduced::compliance::Compliance;
use bipot_rs::reduced::reduced::{Reduced, Rigid};
use elasticity::{Assembled, Grid};

/// The system's allocator, with what is held and the most that was.
struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);
/// One measurement at a time.
static ALONE: Mutex<()> = Mutex::new(());
static GO: AtomicBool = AtomicBool::new(false);

fn grow(bytes: usize) {
    let held = HELD.fetch_add(bytes, Ordering::SeqCst) + bytes;
    MOST.fetch_max(held, Ordering::SeqCst);
}

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        grow(layout.size());
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        grow(layout.size());
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::SeqCst);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(at, layout) }
    }

    // What is made smaller stays where it is; to grow is to be copied.
    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if size > layout.size() {
            grow(size);
            HELD.fetch_sub(layout.size(), Ordering::SeqCst);
        } else {
            HELD.fetch_sub(layout.size() - size, Ordering::SeqCst);
        }
        // SAFETY: the caller's promise is passed on.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Most bytes held during `work` above those held before.
fn most<T>(work: impl FnOnce() -> T) -> (usize, T) {
    let before = HELD.load(Ordering::SeqCst);
    MOST.store(before, Ordering::SeqCst);
    let result = work();
    (MOST.load(Ordering::SeqCst) - before, result)
}

fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    bipot_rs::threads::pool(threads).unwrap().install(work)
}

/// A cube with a whole face kept: 20,577 unknowns, 1,083 of them kept.
fn cube() -> Assembled {
    Grid::cube(18).assemble()
}

fn analysed(body: &Assembled, k: &Symmetric) -> Arc<Symbolic> {
    Arc::new(Symbolic::analyse(k, &body.face(), &Options::default()).unwrap())
}

/// Both ways, a seventh: tables of each front, and what allocators round up to.
fn assert_foretold(found: usize, foretold: usize) {
    assert!(
        20 * found <= 23 * foretold && 20 * foretold <= 23 * found,
        "{found} bytes at the most, foretold {foretold}"
    );
}

fn without_analysis(counts: &Counts, bytes: usize) -> usize {
    bytes - counts.bytes_symbolic
}

#[test]
fn the_peak_is_as_predicted() {
    let _alone = ALONE.lock().unwrap();
    let body = cube();
    let k = body.view();
    let before = HELD.load(Ordering::SeqCst);
    let symbolic = analysed(&body, &k);
    let counts = symbolic.counts().clone();
    assert_foretold(HELD.load(Ordering::SeqCst) - before, counts.bytes_symbolic);
    let (bytes, factor) = with_threads(1, || {
        most(|| Factor::new(Arc::clone(&symbolic), &k, &GO).unwrap())
    });
    assert_foretold(bytes, without_analysis(&counts, counts.bytes_peak));
    drop(factor);
    let (bytes, schur) = with_threads(1, || {
        most(|| Schur::new(&symbolic, &k, &mut [], &GO).unwrap())
    });
    assert_foretold(bytes, without_analysis(&counts, counts.bytes_peak_dropped));
    drop(schur);
    // Of an analysis that holds no memory of the factor before.
    let symbolic = analysed(&body, &k);
    let (bytes, factor) = with_threads(2, || {
        most(|| Factor::new(Arc::clone(&symbolic), &k, &GO).unwrap())
    });
    assert!(counts.bytes_peak <= counts.bytes_peak_threads);
    // What two threads hold depends on who came first, within the bound and what does
    // not fit the holes that the other has left.
    let bound = without_analysis(&counts, counts.bytes_peak_threads);
    assert!(20 * bytes <= 23 * bound, "{bytes} bytes, at most {bound}");
    drop(factor);
}

#[test]
fn a_second_matrix_uses_the_memory_of_the_first() {
    let _alone = ALONE.lock().unwrap();
    let body = cube();
    let k = body.view();
    let symbolic = analysed(&body, &k);
    with_threads(1, || {
        let factored = || Factor::new(Arc::clone(&symbolic), &k, &GO).unwrap();
        assert_eq!(symbolic.bytes_spare(), 0);
        drop(factored());
        let counts = symbolic.counts();
        let square = 8 * symbolic.kept().pow(2);
        let panels = counts.bytes_factor - square;
        assert_eq!(symbolic.bytes_spare(), panels);
        let (bytes, factor) = most(factored);
        assert_eq!(symbolic.bytes_spare(), 0);
        drop(factor);
        // Updates and tables, but no second factor.
        assert!(
            bytes < without_analysis(counts, counts.bytes_peak) - counts.bytes_factor / 2,
            "{bytes} bytes"
        );
        symbolic.keep_stack(true);
        let left = symbolic.bytes_stack();
        let (bytes, factor) = most(factored);
        assert_eq!(symbolic.bytes_spare(), left);
        drop(factor);
        // Updates, S and tables, but no second factor.
        assert_foretold(bytes, left + square);
        assert_eq!(symbolic.bytes_spare(), panels + left);
        let (bytes, factor) = most(factored);
        // S and tables.
        assert_foretold(bytes, square);
        drop(factor);
        assert_eq!(symbolic.bytes_spare(), panels + left);
        // A matrix that is refused leaves what it found.
        let mut values = body.values.clone();
        for j in 0..body.n() {
            let column = body.col_ptr[j]..body.col_ptr[j + 1];
            for at in column.filter(|&at| body.row_idx[at] != j) {
                values[at] *= 3.0;
            }
        }
        let not = Symmetric::new(body.n(), &body.col_ptr, &body.row_idx, &values).unwrap();
        drop(Factor::new(Arc::clone(&symbolic), &not, &GO).unwrap_err());
        assert_eq!(symbolic.bytes_spare(), panels + left);
        symbolic.keep_stack(false);
        assert_eq!(symbolic.bytes_spare(), panels);
    });
}

#[test]
fn an_inverse_needs_no_second_matrix() {
    let _alone = ALONE.lock().unwrap();
    let n = 1500;
    let mut a: Vec<f64> = (0..n * n)
        .map(|at| if at % (n + 1) == 0 { 2.0 } else { 0.0 })
        .collect();
    let (bytes, ()) = with_threads(1, || {
        most(|| {
            assert_eq!(cholesky(&mut a, n, &GO).unwrap(), None);
            invert_from_cholesky(&mut a, n, &GO).unwrap();
        })
    });
    // Panels of 384 and 128 columns, and what products pack, some 4 MB a thread.
    assert!(bytes < 8 * n * n * 3 / 4, "{bytes} bytes");
}

/// `1 + ssᵀ` with a side for each contact, dense, in the plane.
fn coupled(contacts: usize) -> Vec<f64> {
    let n = 2 * contacts;
    let side = |i: usize| if i.is_multiple_of(3) { 0.01 } else { -0.02 };
    let entry = |k: usize| side(k / n) * side(k % n) + f64::from(u8::from(k / n == k % n));
    (0..n * n).map(entry).collect()
}

#[test]
fn the_uniqueness_proof_takes_the_predicted_memory() {
    let _alone = ALONE.lock().unwrap();
    let measured = |contacts: usize, mu: f64| {
        let w = coupled(contacts);
        let compliance = Compliance::<2>::from_dense(contacts, Cow::Borrowed(&w)).unwrap();
        let q = vec![[-1.0, 0.1]; contacts];
        let rigid = Rigid::default();
        let problem = Reduced::new(
            &compliance,
            &q,
            &ContactLaw::coulomb(&vec![mu; contacts]),
            &rigid,
        )
        .unwrap();
        let r = vec![[1.0, 0.0]; contacts];
        most(|| assess(&problem, &r, &GO).unwrap())
    };
    let limit = MOST_BYTES;
    for mu in [0.0, 0.1, 50.0] {
        let contacts = 800;
        let foretold = bytes::<2>(contacts, if mu > 0.0 { contacts } else { 0 });
        assert!(foretold < limit);
        let (found, verdict) = measured(contacts, mu);
        // And what products of matrices pack, however large they are.
        let bound = foretold + foretold / 7 + (16 << 20);
        assert!(found <= bound, "{found} bytes, foretold {foretold}");
        assert_eq!(verdict == Unique::Proved, mu < 1.0);
    }
    // Above the limit nothing is tried: a few vectors.
    let many = 2200;
    assert!(bytes::<2>(many, many) > limit);
    let (found, verdict) = measured(many, 0.1);
    assert_eq!(verdict, Unique::Unknown);
    assert!(found < 100 * many, "{found} bytes");
}

/// The iterative engine holds half of K in blocks, and a hierarchy whose set-up has no copy of K.
#[test]
fn an_unknown_of_the_iterative_engine_takes_few_bytes() {
    let _alone = ALONE.lock().unwrap();
    let body = Grid::cube(14).assemble();
    let (n, nodes) = (body.n(), body.nodes());
    let blocks = || {
        let place = (0..u32::try_from(n).unwrap()).collect();
        let mut upper = UpperBlocks::new(place, nodes, 3);
        for part in 1..=4 {
            upper.append(nodes * part / 4, |dof| body.view().column(dof));
        }
        SymmetricBlocks::new(upper, 1.0)
    };
    let before = HELD.load(Ordering::SeqCst);
    let (most_of_k, k) = with_threads(2, || most(blocks));
    // 14 blocks of 72 bytes for three unknowns, 27 columns and 14 places of 4 bytes.
    let held = HELD.load(Ordering::SeqCst) - before;
    assert!(held <= 400 * n, "{} bytes an unknown", held / n);
    assert!(most_of_k <= 600 * n, "{} bytes an unknown", most_of_k / n);
    let about = LevelNodes {
        motions: motions_of_nodes(&body.coordinates, 3, None),
        coordinates: body.coordinates.clone(),
        bodies: Vec::new(),
    };
    let before = HELD.load(Ordering::SeqCst);
    let (most_of_all, levels) = with_threads(2, || {
        most(|| {
            let rows = SingleRows::new(&k, std::iter::empty());
            let nodes = vec![0];
            Following::new(&rows, &about, nodes, &CycleSettings::default(), &GO).unwrap()
        })
    });
    let held = HELD.load(Ordering::SeqCst) - before;
    // A copy in single precision would take 300 more.
    assert!(held <= 450 * n, "{} bytes an unknown", held / n);
    assert!(
        most_of_all <= 600 * n,
        "{} bytes an unknown",
        most_of_all / n
    );
    drop(levels);
}
