//! Sparse matrices of blocks, and their LU front by front.

#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]

use std::sync::atomic::AtomicBool;

use crate::common::{GO, with_threads};
use bipot_rs::bodies::connected::free_part;
use bipot_rs::error::Error;
use bipot_rs::linalg::lu::Lu;
use bipot_rs::linalg::small::{Block, norm};
use bipot_rs::linalg::sparse::arena::{Arena, ArenaEnd, Piece};
use bipot_rs::linalg::sparse::blocks::Blocks;
use bipot_rs::linalg::sparse::csc::{Symmetric, Symmetry};
use bipot_rs::linalg::sparse::sparse_lu::{Analysis, SparseLu};
use bipot_rs::linalg::sparse::supervariables::SupervariableGraph;
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// Pairs of rows and columns of a matrix, in any order.
struct Triplets<const D: usize> {
    rows: Vec<Vec<(usize, Block<D>)>>,
}

impl<const D: usize> Triplets<D> {
    /// A grid whose neighbours are coupled, one way or both, with a diagonal that
    /// outweighs the rest `weight` times.
    fn grid(side: usize, weight: f64, rng: &mut StdRng) -> Self {
        let mut rows = vec![Vec::new(); side * side];
        let mut random = || Block::<D>::from_fn(|_, _| rng.random_range(-1.0..1.0));
        for i in 0..side * side {
            let mut near = Vec::new();
            if i % side > 0 {
                near.push(i - 1);
            }
            if i >= side {
                near.push(i - side);
            }
            for j in near {
                rows[i].push((j, random()));
                if (i + j) % 3 > 0 {
                    rows[j].push((i, random()));
                }
            }
            rows[i].push((i, random() + Block::identity() * weight));
        }
        Self { rows }
    }

    fn blocks(&self) -> Blocks<D> {
        let mut start = vec![0];
        let (mut column, mut values) = (Vec::new(), Vec::new());
        for row in &self.rows {
            for (j, block) in row {
                column.push(*j);
                values.extend(block.transpose().as_slice()); // by rows
            }
            start.push(column.len());
        }
        Blocks::new(&start, &column, &values).unwrap()
    }

    fn dense(&self) -> Vec<f64> {
        let n = D * self.rows.len();
        let mut dense = vec![0.0; n * n];
        for (i, row) in self.rows.iter().enumerate() {
            for (j, block) in row {
                for k in 0..D {
                    for l in 0..D {
                        dense[(D * i + k) * n + D * j + l] += block[(k, l)];
                    }
                }
            }
        }
        dense
    }
}

fn solved<const D: usize>(matrix: &Blocks<D>, b: &[f64]) -> Option<Vec<f64>> {
    let analysis = Analysis::new(matrix).unwrap();
    let lu = SparseLu::new(&analysis, matrix, &GO).unwrap()?;
    let mut x = b.to_vec();
    lu.solve(&mut x);
    Some(x)
}

fn agrees<const D: usize>(case: &Triplets<D>, rng: &mut StdRng) {
    let n = D * case.rows.len();
    let b: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
    let found = solved(&case.blocks(), &b).unwrap();
    let dense = case.dense();
    let left: Vec<f64> = dense
        .chunks_exact(n.max(1))
        .zip(&b)
        .map(|(row, b)| b - row.iter().zip(&found).map(|(a, x)| a * x).sum::<f64>())
        .collect();
    // Pivots grow by less than ten beside such diagonals; a sum of n terms adds √n.
    #[expect(clippy::cast_precision_loss, reason = "an order")]
    let rounding = 10.0 * (n as f64).sqrt() * f64::EPSILON * norm(&dense) * norm(&found);
    assert!(norm(&left) <= rounding, "{} > {rounding}", norm(&left));
}

#[test]
fn solutions_leave_a_residual_of_rounding() {
    let mut rng = StdRng::seed_from_u64(1);
    for side in [1, 2, 3, 7, 20] {
        agrees(&Triplets::<2>::grid(side, 4.0, &mut rng), &mut rng);
        agrees(&Triplets::<3>::grid(side, 4.0, &mut rng), &mut rng);
    }
}

/// Diagonals that do not outweigh the rest: pivots of either sign, rows exchanged.
#[test]
fn the_sign_is_that_of_the_determinant() {
    fn agrees<const D: usize>(seed: u64, side: usize) -> f64 {
        let mut rng = StdRng::seed_from_u64(seed);
        let case = Triplets::<D>::grid(side, 0.0, &mut rng);
        let blocks = case.blocks();
        let analysis = Analysis::new(&blocks).unwrap();
        let sparse = SparseLu::new(&analysis, &blocks, &GO).unwrap().unwrap();
        let dense = Lu::new(case.dense(), D * side * side, &GO).unwrap();
        assert!(sparse.sign() * dense.unwrap().sign() > 0.0, "seed {seed}");
        sparse.sign()
    }
    let signs = (0..40).map(|seed| agrees::<2>(seed, 5) + agrees::<3>(seed, 4));
    let signs: Vec<f64> = signs.collect();
    for both in [-2.0, 0.0, 2.0] {
        assert!(signs.contains(&both));
    }
}

#[test]
fn rows_are_exchanged_where_a_diagonal_is_zero() {
    let mut rng = StdRng::seed_from_u64(2);
    let mut case = Triplets::<2>::grid(6, 4.0, &mut rng);
    for row in &mut case.rows {
        let (_, own) = row.last_mut().unwrap();
        *own = Block::<2>::new(0.0, 4.0, 4.0, 0.0);
    }
    agrees(&case, &mut rng);
}

#[test]
fn disconnected_pieces_and_an_empty_matrix() {
    let mut rng = StdRng::seed_from_u64(3);
    let mut case = Triplets::<3>::grid(4, 4.0, &mut rng);
    for (i, row) in case.rows.iter_mut().enumerate() {
        row.retain(|(j, _)| i / 4 == j / 4);
    }
    agrees(&case, &mut rng);
    agrees(&Triplets::<3> { rows: Vec::new() }, &mut rng);
}

#[test]
fn a_singular_matrix_has_no_factors() {
    let mut rng = StdRng::seed_from_u64(4);
    let mut case = Triplets::<3>::grid(5, 4.0, &mut rng);
    case.rows[7].clear();
    assert!(solved(&case.blocks(), &[1.0; 75]).is_none());
    // A row that is the sum of two others, up to rounding.
    let mut case = Triplets::<2>::grid(3, 4.0, &mut rng);
    let sum = case.rows[3].iter().chain(&case.rows[4]).copied().collect();
    case.rows[5] = sum;
    assert!(solved(&case.blocks(), &[1.0; 18]).is_none());
}

#[test]
fn rows_columns_and_mirror_images_are_those_of_the_dense_matrix() {
    let mut rng = StdRng::seed_from_u64(5);
    let case = Triplets::<3>::grid(4, 4.0, &mut rng);
    let (blocks, dense) = (case.blocks(), case.dense());
    let entry = |i: usize, j: usize| dense[i * 48 + j];
    let block = |i: usize, j: usize| Block::<3>::from_fn(|k, l| entry(3 * i + k, 3 * j + l));
    for i in 0..16 {
        let own = blocks.in_row(i).find(|&(j, _)| j == i).unwrap();
        assert_eq!(own.1, &block(i, i));
        for j in 0..16 {
            assert_eq!(blocks.at(i, j), block(i, j));
        }
        for (j, found) in blocks.in_row(i) {
            assert_eq!(found, &block(i, j));
        }
        for (j, found) in blocks.in_column(i) {
            assert_eq!(found, &block(j, i));
        }
    }
    let pairs = (0..48).flat_map(|i| (0..48).map(move |j| (i, j)));
    let apart = pairs.map(|(i, j)| (entry(i, j) - entry(j, i)).abs());
    assert!((blocks.asymmetry() - apart.fold(0.0, f64::max)).abs() <= 0.0);
    assert!(!blocks.is_symmetric());
    let sum = &|i: usize, j: usize| block(i, j) + block(j, i).transpose();
    let symmetric = Triplets::<3> {
        rows: (0..16)
            .map(|i| (0..16).map(move |j| (j, sum(i, j))))
            .map(Iterator::collect)
            .collect(),
    };
    assert!(symmetric.blocks().is_symmetric());
}

#[test]
fn broken_patterns_are_named() {
    let (ones, mut wrong) = ([1.0; 8], [1.0; 8]);
    wrong[6] = f64::NAN;
    let named = |start: [usize; 3], column: &[usize], values: &[f64], words: &str| {
        let refused = Blocks::<2>::new(&start, column, values).unwrap_err();
        assert!(refused.to_string().contains(words), "{refused}: {words}");
    };
    named([0, 1, 2], &[0, 2], &ones, "expected less than 2");
    named([0, 2, 1], &[0], &ones[..4], "row 1");
    named([0, 1, 2], &[0, 1], &ones[..4], "has length 1, expected 2");
    named([0, 1, 2], &[0, 1], &wrong, "row 3, column 2");
}

#[test]
fn it_can_be_stopped() {
    let mut rng = StdRng::seed_from_u64(6);
    let blocks = Triplets::<2>::grid(3, 4.0, &mut rng).blocks();
    let analysis = Analysis::new(&blocks).unwrap();
    let stopped = SparseLu::new(&analysis, &blocks, &AtomicBool::new(true));
    assert!(matches!(stopped, Err(Error::Interrupted)));
}

/// Pointers, rows and values of a symmetric matrix of nodes of three, some entries zero.
fn symmetric(nodes: usize, rng: &mut StdRng) -> (Vec<usize>, Vec<usize>, Vec<f64>) {
    let n = 3 * nodes;
    let mut dense = vec![vec![None; n]; n];
    for i in 0..nodes {
        for j in 0..=i {
            if i != j && rng.random_bool(0.6) {
                continue;
            }
            let empty = i != j && rng.random_bool(0.2);
            for (k, l) in (0..9).map(|k| (3 * i + k / 3, 3 * j + k % 3)) {
                let zero = empty || k != l && rng.random_bool(0.3);
                let value = if zero {
                    0.0
                } else {
                    rng.random_range(-1.0..1.0)
                };
                dense[k][l] = Some(value);
                dense[l][k] = Some(value);
            }
        }
    }
    let (mut start, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for column in &dense {
        for (i, value) in column.iter().enumerate() {
            if let Some(value) = value {
                rows.push(i);
                values.push(*value);
            }
        }
        start.push(rows.len());
    }
    (start, rows, values)
}

#[test]
fn a_bitwise_symmetric_matrix_is_not_mirrored() {
    let mut rng = StdRng::seed_from_u64(7);
    for nodes in [1, 2, 5, 20] {
        let (start, rows, values) = symmetric(nodes, &mut rng);
        let n = 3 * nodes;
        let k = Symmetric::new(n, &start, &rows, &values).unwrap();
        assert_eq!(k.check_symmetry(), Ok(Symmetry::Exact));
        for fixed in [0.0, 0.4, 1.0] {
            let draw = |_| rng.random_bool(fixed).then_some(0);
            let fixed: Vec<Option<usize>> = (0..n).map(draw).collect();
            let (quick, of_quick) = free_part(&k, Symmetry::Exact, &fixed);
            let (slow, of_slow) = free_part(&k, Symmetry::Rounded, &fixed);
            assert_eq!(of_quick, of_slow);
            assert_eq!(quick.pointer, slow.pointer);
            assert_eq!(quick.index, slow.index);
            assert_eq!(quick.values, slow.values);
        }
    }
}

#[test]
fn different_triangles_are_detected() {
    let mut rng = StdRng::seed_from_u64(8);
    let (start, rows, values) = symmetric(4, &mut rng);
    for at in 0..values.len() {
        let column = start.partition_point(|&s| s <= at) - 1;
        let mut moved = values.clone();
        moved[at] = f64::from_bits(moved[at].to_bits() ^ 1);
        let k = Symmetric::new(12, &start, &rows, &moved).unwrap();
        let wanted = if rows[at] == column {
            Symmetry::Exact
        } else {
            Symmetry::Rounded
        };
        assert_eq!(k.check_symmetry(), Ok(wanted));
    }
    // A stored zero on either side without its partner, and no diagonal.
    let k = |rows: &[usize], start: &[usize]| {
        let zeros = vec![0.0; rows.len()];
        Symmetric::new(2, start, rows, &zeros)
            .unwrap()
            .check_symmetry()
    };
    assert_eq!(k(&[1], &[0, 1, 1]), Ok(Symmetry::Rounded));
    assert_eq!(k(&[0], &[0, 0, 1]), Ok(Symmetry::Rounded));
    assert_eq!(k(&[1, 0], &[0, 1, 2]), Ok(Symmetry::Exact));
}

/// Each task compares some columns; partners may belong to another one.
#[test]
fn a_missing_partner_is_detected_in_any_task() {
    // A chain with a tiny entry between unknowns that are far apart.
    let n: usize = 40_000;
    let chain = |left_out: Option<(usize, usize)>, far: (usize, usize)| {
        let (mut start, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        for j in 0..n {
            let mut column = vec![j];
            column.extend(j.checked_sub(1));
            column.extend((j + 1 < n).then_some(j + 1));
            column.extend((j == far.0).then_some(far.1));
            column.extend((j == far.1).then_some(far.0));
            column.sort_unstable();
            for i in column.into_iter().filter(|&i| Some((i, j)) != left_out) {
                rows.push(i);
                values.push(if i == j { 2.0 } else { 1e-14 });
            }
            start.push(rows.len());
        }
        let k = Symmetric::new(n, &start, &rows, &values).unwrap();
        k.check_symmetry()
    };
    for threads in [1, 2] {
        with_threads(threads, || {
            for far in [(3, 39_990), (16_000, 17_000), (20_000, 39_999), (5, 8)] {
                assert_eq!(chain(None, far), Ok(Symmetry::Exact));
                for left_out in [far, (far.1, far.0), (16_384, 16_383), (16_383, 16_384)] {
                    assert_eq!(chain(Some(left_out), far), Ok(Symmetry::Rounded));
                }
            }
        });
    }
}

/// Pieces come from the requested end and return in any order; then there is one gap again.
#[test]
fn what_is_given_back_joins() {
    let mut memory = vec![0.0; 100];
    let arena = Arena::new(&mut memory);
    let range = |piece: &Piece| match piece {
        Piece::Part { range, .. } => range.clone(),
        Piece::Apart(_) => panic!("there was room"),
    };
    let ends = [
        (30, ArenaEnd::Low),
        (20, ArenaEnd::High),
        (10, ArenaEnd::Low),
    ];
    let mut pieces: Vec<Piece> = ends.map(|(len, end)| arena.take(len, end)).into();
    assert_eq!(
        [0, 1, 2].map(|k| range(&pieces[k])),
        [0..30, 80..100, 30..40]
    );
    for (mark, piece) in [0.0, 1.0, 2.0].into_iter().zip(&mut pieces) {
        piece.fill(mark);
    }
    pieces[0].keep(12);
    pieces[1][0] = 7.0;
    pieces[1].keep(5);
    assert_eq!([0, 1].map(|k| range(&pieces[k])), [0..12, 95..100]);
    assert_eq!(*pieces[1], [7.0, 1.0, 1.0, 1.0, 1.0]);
    assert_eq!(*pieces[0], [0.0; 12]);
    assert_eq!(*pieces[2], [2.0; 10]);
    // The first gap that is large enough, from each end.
    assert_eq!(range(&arena.take(18, ArenaEnd::Low)), 12..30);
    assert_eq!(range(&arena.take(19, ArenaEnd::Low)), 40..59);
    assert_eq!(range(&arena.take(19, ArenaEnd::High)), 76..95);
    let large = arena.take(56, ArenaEnd::High);
    assert!(!large.is_part() && large.len() == 56);
    assert_eq!(arena.take(0, ArenaEnd::Low).len(), 0);
    let _ = pieces.swap_remove(0);
    pieces.clear();
    assert_eq!(range(&arena.take(100, ArenaEnd::Low)), 0..100);
    // Without memory every piece is apart.
    let arena = Arena::new(&mut []);
    let mut piece = arena.take(4, ArenaEnd::Low);
    piece.fill(3.0);
    piece.keep(2);
    assert_eq!(*piece, [3.0; 2]);
    assert_eq!(arena.take(0, ArenaEnd::High).len(), 0);
}

/// The graph of nodes of three unknowns along a line, each joined to the neighbouring nodes,
/// except for the pairs of unknowns in `missing`; no pair is joined twice.
fn line(
    nodes: usize,
    kept: &[usize],
    missing: impl Fn(usize, usize) -> bool,
) -> SupervariableGraph {
    let (mut start, mut rows) = (vec![0], Vec::new());
    for j in 0..3 * nodes {
        let near = (3 * (j / 3)).saturating_sub(3)..(3 * (j / 3) + 6).min(3 * nodes);
        rows.extend(near.filter(|&i| i == j || !missing(i.min(j), i.max(j))));
        start.push(rows.len());
    }
    let place = |j| kept.iter().position(|&k| k == j);
    let place: Vec<Option<usize>> = (0..3 * nodes).map(place).collect();
    SupervariableGraph::new(&start, &rows, kept, &place)
}

#[test]
fn entries_that_vanish_leave_the_nodes() {
    let nodes = 40;
    let kept: Vec<usize> = (3 * nodes - 6..3 * nodes).collect();
    let whole = line(nodes, &kept, |_, _| false);
    // Within a node the directions are not coupled, nor the first to the last of every
    // other node.
    let apart = |i: usize, j: usize| i / 3 == j / 3 || i.is_multiple_of(6) && j == i + 5;
    let some = line(nodes, &kept, apart);
    assert_eq!([whole.kept().end, some.kept().end], [40; 2]);
    for v in 0..nodes {
        assert_eq!(some.members(v), whole.members(v));
        let [some, whole] = [&some, &whole].map(|graph| {
            let mut list = graph.neighbours(v).to_vec();
            list.sort_unstable();
            list
        });
        assert_eq!(some, whole);
    }
    assert_eq!(some.kept(), whole.kept());
    // Three parallel lines with consecutive unknowns: they are lines, not nodes. Nor are
    // unknowns that share half of their neighbours.
    assert_eq!(line(30, &[], |i, j| i % 3 != j % 3).kept().end, 90);
    assert_eq!(line(10, &[], |i, j| j > i + 1).kept().end, 30);
}
