//! Condensation: S, loads and recovered unknowns, compared with elimination in twice the
//! precision, a dense Cholesky and dense algebra; edge cases and errors.
#![expect(
    clippy::many_single_char_names,
    clippy::cast_precision_loss,
    clippy::float_cmp,
    clippy::unwrap_used,
    reason = "the letters of the matrices; bits are compared on purpose"
)]

use crate::common::double_double;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::common::bodies::{Body, Make};
use bipot_rs::error::Error;
use bipot_rs::linalg::dense::{self, Op};
use bipot_rs::linalg::sparse::csc::Symmetric;
use bipot_rs::linalg::sparse::multifrontal::Factor;
use bipot_rs::linalg::sparse::symbolic::{Options, Symbolic};
use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng, rngs::StdRng};

static GO: AtomicBool = AtomicBool::new(false);

impl Body {
    fn matrix(&self) -> Symmetric<'_> {
        Symmetric::new(self.n, &self.col_ptr, &self.row_idx, &self.values).unwrap()
    }

    fn dense(&self) -> Vec<f64> {
        let mut dense = vec![0.0; self.n * self.n];
        for j in 0..self.n {
            for (i, value) in self.matrix().column(j) {
                dense[j * self.n + i] = value;
            }
        }
        dense
    }

    /// From a dense symmetric matrix; zeros are not stored.
    fn from_dense(n: usize, dense: &[f64]) -> Self {
        let mut body = Self {
            n,
            col_ptr: vec![0],
            row_idx: Vec::new(),
            values: Vec::new(),
            at: vec![[0.0; 3]; n],
            face: Vec::new(),
        };
        for j in 0..n {
            for i in (0..n).filter(|&i| dense[j * n + i] != 0.0) {
                body.row_idx.push(i);
                body.values.push(dense[j * n + i]);
            }
            body.col_ptr.push(body.row_idx.len());
        }
        body
    }

    /// A chain of unit springs, both ends held.
    fn chain(n: usize) -> Self {
        let mut body = Self::from_dense(0, &[]);
        body.n = n;
        for j in 0..n {
            for i in j.saturating_sub(1)..n.min(j + 2) {
                body.row_idx.push(i);
                body.values.push(if i == j { 2.0 } else { -1.0 });
            }
            body.col_ptr.push(body.row_idx.len());
        }
        body
    }
}

/// Nodes of some unknowns on a grid, a tenth of the entries missing: S is the Schur
/// complement, in any order of the kept unknowns, however nodes are made of them.
#[test]
fn nodes_whose_entries_vanish() {
    let mut random = StdRng::seed_from_u64(11);
    for (unknowns, grid) in [(3, [5, 4, 3]), (2, [8, 7, 1]), (1, [9, 9, 1])] {
        let nodes: usize = grid.iter().product();
        let n = unknowns * nodes;
        let at = |v: usize| [v % grid[0], v / grid[0] % grid[1], v / grid[0] / grid[1]];
        let mut dense = vec![0.0_f64; n * n];
        for j in 0..n {
            for i in 0..j {
                let (p, q) = (at(i / unknowns), at(j / unknowns));
                let near = (0..3).all(|k| p[k].abs_diff(q[k]) <= 1);
                if near && random.random_bool(0.9) {
                    let value = random.random_range(-1.0..1.0);
                    (dense[j * n + i], dense[i * n + j]) = (value, value);
                }
            }
        }
        for j in 0..n {
            dense[j * n + j] = 1.0 + (0..n).map(|i| dense[j * n + i].abs()).sum::<f64>();
        }
        let body = Body::from_dense(n, &dense);
        let k = body.matrix();
        for share in [0.1, 0.4] {
            let mut kept: Vec<usize> = (0..n).filter(|_| random.random_bool(share)).collect();
            for i in (1..kept.len()).rev() {
                kept.swap(i, random.random_range(0..=i));
            }
            let whole: Vec<usize> = (n - n / 6..n).collect();
            for kept in [kept, whole] {
                let found = factor(&k, &kept).unwrap();
                let reference: Vec<f64> = double_double::schur(n, &dense, &kept)
                    .iter()
                    .map(|d| d.high)
                    .collect();
                assert!(symmetric_to_the_bit(found.schur(), kept.len()));
                // Some tens of roundings.
                assert!(distance(found.schur(), &reference) < 1e-14);
            }
        }
    }
}

fn factor(k: &Symmetric, kept: &[usize]) -> Result<Factor, Error> {
    let symbolic = Symbolic::analyse(k, kept, &Options::default())?;
    Factor::new(Arc::new(symbolic), k, &GO)
}

fn norm(a: impl IntoIterator<Item = f64>) -> f64 {
    a.into_iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    norm(a.iter().zip(b).map(|(a, b)| a - b)) / norm(b.iter().copied())
}

fn symmetric_to_the_bit(s: &[f64], m: usize) -> bool {
    (0..m).all(|i| (0..i).all(|j| s[i * m + j].to_bits() == s[j * m + i].to_bits()))
}

/// A symmetric positive definite matrix, random but for a fixed seed.
fn random_definite(n: usize, filled: f64, seed: u64) -> Vec<f64> {
    let mut random = StdRng::seed_from_u64(seed);
    let mut a = vec![0.0_f64; n * n];
    for j in 0..n {
        for i in 0..j {
            if random.random_bool(filled) {
                let value = random.random_range(-1.0..1.0);
                (a[j * n + i], a[i * n + j]) = (value, value);
            }
        }
    }
    for j in 0..n {
        // Rows sum to less than the diagonal: positive definite.
        a[j * n + j] = 1.0 + (0..n).map(|i| a[j * n + i].abs()).sum::<f64>();
    }
    a
}

/// The five bodies that S is held to 1e-14 on, and how many motions each leaves
/// free.
fn five_bodies(dim: usize) -> Vec<(&'static str, Body, usize)> {
    let cells = if dim == 3 { [4, 5, 6] } else { [14, 12, 1] };
    let make = |change: fn(&mut Make)| {
        let mut make = Make {
            cells,
            dim,
            ..Make::cube(1)
        };
        change(&mut make);
        make.build()
    };
    vec![
        ("nu = 0.3", make(|_| {}), 0),
        ("nu = 0.4999", make(|m| m.poisson = 0.4999), 0),
        ("half 1e8 stiffer", make(|m| m.far_half = 1e8), 0),
        ("half 1e8 softer", make(|m| m.far_half = 1e-8), 0),
        (
            "floating",
            make(|m| m.held = false),
            if dim == 3 { 6 } else { 3 },
        ),
    ]
}

#[test]
fn schur_complement_holds_fourteen_digits() {
    for dim in [2, 3] {
        for (name, body, free) in five_bodies(dim) {
            let m = body.face.len();
            let factor = factor(&body.matrix(), &body.face).unwrap();
            let s = factor.schur();
            assert!(symmetric_to_the_bit(s, m), "{name}, {dim}D");
            let reference: Vec<f64> = double_double::schur(body.n, &body.dense(), &body.face)
                .iter()
                .map(|d| d.high)
                .collect();
            // The figure promised: 45 roundings of 2.2e-16, where entries are
            // sums of some hundred terms.
            let error = distance(s, &reference);
            assert!(error <= 1e-14, "{name}, {dim}D: {error:e}");

            let mut vectors = s.to_vec();
            let mut values = vec![0.0; m];
            dense::symmetric_eigen(&mut vectors, m, &mut values);
            let largest = values[m - 1];
            // Null to rounding: m terms of 2.2e-16 of the largest. The softest
            // motion that is not rigid is that of a stiff half on one 1e8 times
            // softer, 1e-10 and above.
            let null = values.iter().filter(|v| v.abs() < 1e-13 * largest).count();
            assert_eq!(null, free, "{name}, {dim}D: {:?}", &values[..8]);
            assert!(
                values[free] > 1e-11 * largest,
                "{name}, {dim}D: {:?}",
                &values[..8]
            );
        }
    }
}

#[test]
fn loads_condense_and_unknowns_come_back() {
    let body = Make {
        cells: [5, 6, 4],
        ..Make::cube(1)
    }
    .build();
    let k = body.matrix();
    let factor = factor(&k, &body.face).unwrap();
    let (n, m) = (body.n, body.face.len());
    for columns in [1, 3] {
        let mut random = StdRng::seed_from_u64(columns as u64);
        let load: Vec<f64> = (0..n * columns)
            .map(|_| random.random_range(-1.0..1.0))
            .collect();
        let mut x = load.clone();
        factor.condense(&mut x, columns);
        // Solve S u_c = f_c − K_ci K_ii⁻¹ f_i, then back.
        let mut l = factor.schur().to_vec();
        dense::cholesky(&mut l, m, &GO).unwrap();
        for x in x.chunks_exact_mut(n) {
            let mut u: Vec<f64> = body.face.iter().map(|&dof| x[dof]).collect();
            dense::solve_lower(&l, m, &mut u, 1);
            dense::solve_lower_transpose(&l, m, &mut u, 1);
            body.face.iter().zip(u).for_each(|(&dof, u)| x[dof] = u);
        }
        factor.recover(&mut x, columns);
        for (x, load) in x.chunks_exact(n).zip(load.chunks_exact(n)) {
            let mut back = vec![0.0; n];
            k.product(x, &mut back);
            // Backward stable: the residual is some roundings of ‖K‖‖u‖, which
            // a cube held on a face has within a hundred times ‖f‖.
            assert!(distance(&back, load) < 1e-12, "{:e}", distance(&back, load));
        }
    }
}

#[test]
fn several_right_hand_sides_equal_one_at_a_time() {
    let body = Make::square(9).build();
    let factor = factor(&body.matrix(), &body.face).unwrap();
    let load: Vec<f64> = (0..2 * body.n)
        .map(|i| ((i * 37) % 101) as f64 - 50.0)
        .collect();
    let mut together = load.clone();
    factor.condense(&mut together, 2);
    let mut alone = load;
    alone
        .chunks_exact_mut(body.n)
        .for_each(|f| factor.condense(f, 1));
    // The same sums in another order.
    assert!(distance(&together, &alone) < 1e-14);
    factor.recover(&mut together, 2);
    alone
        .chunks_exact_mut(body.n)
        .for_each(|f| factor.recover(f, 1));
    assert!(distance(&together, &alone) < 1e-13);
}

/// A dense Cholesky of `K + σ I_c`: the contact block of its inverse is `(S + σ I)⁻¹`.
#[test]
fn a_dense_cholesky_agrees() {
    let body = Make {
        held: false,
        ..Make::cube(6)
    }
    .build();
    let m = body.face.len();
    let sigma = 1.0;
    let mut shifted = DMatrix::from_vec(body.n, body.n, body.dense());
    body.face
        .iter()
        .for_each(|&dof| shifted[(dof, dof)] += sigma);
    let mut columns = DMatrix::zeros(body.n, m);
    body.face
        .iter()
        .enumerate()
        .for_each(|(k, &dof)| columns[(dof, k)] = 1.0);
    shifted.cholesky().unwrap().solve_mut(&mut columns);
    let block: Vec<f64> = (0..m)
        .flat_map(|k| body.face.iter().map(move |&dof| (dof, k)))
        .map(|place| columns[place])
        .collect();

    let mut s = factor(&body.matrix(), &body.face).unwrap().schur().to_vec();
    (0..m).for_each(|k| s[k * m + k] += sigma);
    let mut product = vec![0.0; m * m];
    dense::matmul(
        &mut product,
        (m, m, m),
        1.0,
        &s,
        Op::Plain,
        &block,
        Op::Plain,
        0.0,
    );
    (0..m).for_each(|k| product[k * m + k] -= 1.0);
    // cond(S + σI) is about 10 here, and m = 147 terms are summed.
    assert!(norm(product) / (m as f64).sqrt() < 1e-13);
}

#[test]
fn edges_of_the_kept_set() {
    let n = 40;
    let dense = random_definite(n, 0.15, 1);
    let body = Body::from_dense(n, &dense);
    let k = body.matrix();

    let all: Vec<usize> = (0..n).rev().collect();
    let factor_all = factor(&k, &all).unwrap();
    for (q, &j) in all.iter().enumerate() {
        for (p, &i) in all.iter().enumerate() {
            assert_eq!(factor_all.schur()[q * n + p], dense[j * n + i]);
        }
    }
    assert_eq!(factor_all.weakest_pivot(), None);
    let mut f = vec![1.0; n];
    factor_all.condense(&mut f, 1);
    factor_all.recover(&mut f, 1);
    assert_eq!(f, vec![1.0; n]);

    let none = factor(&k, &[]).unwrap();
    assert!(none.schur().is_empty());
    let mut u = vec![1.0; n];
    none.condense(&mut u, 1);
    none.recover(&mut u, 1);
    let mut back = vec![0.0; n];
    k.product(&u, &mut back);
    // Diagonally dominant: cond(K) is small.
    assert!(distance(&back, &vec![1.0; n]) < 1e-14);

    let empty = Body::from_dense(0, &[]);
    let nothing = factor(&empty.matrix(), &[]).unwrap();
    assert!(nothing.schur().is_empty());
    nothing.condense(&mut [], 1);
    nothing.recover(&mut [], 1);
}

/// Whatever the pattern and the order of the kept unknowns, S is the Schur
/// complement.
#[test]
fn any_pattern_any_kept_order() {
    let mut random = StdRng::seed_from_u64(7);
    for (n, filled) in [
        (1, 0.5),
        (2, 0.5),
        (17, 0.0),
        (30, 0.05),
        (60, 0.1),
        (90, 0.04),
        (50, 0.9),
    ] {
        let dense = random_definite(n, filled, n as u64);
        let body = Body::from_dense(n, &dense);
        for share in [0.0, 0.2, 0.6] {
            let mut kept: Vec<usize> = (0..n).filter(|_| random.random_bool(share)).collect();
            for i in (1..kept.len()).rev() {
                kept.swap(i, random.random_range(0..=i));
            }
            let coordinates: Vec<[f64; 3]> = (0..n)
                .map(|_| std::array::from_fn(|_| random.random_range(0.0..1.0)))
                .collect();
            let options = Options {
                coordinates: Some(&coordinates),
            };
            let k = body.matrix();
            let symbolic = Arc::new(Symbolic::analyse(&k, &kept, &options).unwrap());
            let factor = Factor::new(symbolic, &k, &GO).unwrap();
            let reference: Vec<f64> = double_double::schur(n, &dense, &kept)
                .iter()
                .map(|d| d.high)
                .collect();
            assert!(symmetric_to_the_bit(factor.schur(), kept.len()));
            if !kept.is_empty() {
                // Some tens of roundings.
                assert!(distance(factor.schur(), &reference) < 1e-14);
            }
        }
    }
}

#[test]
fn pieces_and_a_dense_row() {
    // Four bodies on one contact set, and an unknown that all others touch.
    let n = 2000;
    let mut body = Body::from_dense(0, &[]);
    body.n = n;
    let hub = 700;
    for j in 0..n {
        let mut rows: Vec<usize> = if j == hub {
            (0..n).collect()
        } else {
            let piece = j / 500;
            (j.saturating_sub(2)..n.min(j + 3))
                .filter(|i| i / 500 == piece)
                .collect()
        };
        if !rows.contains(&hub) {
            rows.push(hub);
        }
        rows.sort_unstable();
        for i in rows {
            body.row_idx.push(i);
            body.values.push(match (i == j, i == hub || j == hub) {
                (true, true) => n as f64,
                (true, false) => 8.0,
                (false, true) => -0.5,
                (false, false) => -1.0,
            });
        }
        body.col_ptr.push(body.row_idx.len());
    }
    let k = body.matrix();
    let kept: Vec<usize> = (0..n).step_by(97).collect();
    let factor = factor(&k, &kept).unwrap();
    // The hub is eliminated last: nothing fills but bands.
    assert!(factor.symbolic().counts().nnz_factor < 40 * n);
    let mut load = vec![1.0; n];
    factor.condense(&mut load, 1);
    let m = kept.len();
    let mut l = factor.schur().to_vec();
    dense::cholesky(&mut l, m, &GO).unwrap();
    let mut u: Vec<f64> = kept.iter().map(|&dof| load[dof]).collect();
    dense::solve_lower(&l, m, &mut u, 1);
    dense::solve_lower_transpose(&l, m, &mut u, 1);
    kept.iter().zip(u).for_each(|(&dof, u)| load[dof] = u);
    factor.recover(&mut load, 1);
    let mut back = vec![0.0; n];
    k.product(&load, &mut back);
    // cond(K) is below 1e4.
    assert!(distance(&back, &vec![1.0; n]) < 1e-12);
}

/// Springs in a row between two kept ends: S is known, and the elimination tree
/// may be as deep as the chain is long.
#[test]
fn chain_of_springs() {
    let n = 30_001;
    let body = Body::chain(n);
    let factor = factor(&body.matrix(), &[0, n - 1]).unwrap();
    // n − 1 springs in series between the ends, one more at each end.
    let link = 1.0 / (n - 1) as f64;
    let s = factor.schur();
    for (found, exact) in s.iter().zip([1.0 + link, -link, -link, 1.0 + link]) {
        // A rounding for each spring taken away, all alike, add up.
        assert!((found - exact).abs() < n as f64 * f64::EPSILON);
    }
}

#[test]
fn same_bits_for_one_and_two_threads() {
    let body = Make::cube(11).build();
    let k = body.matrix();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let factor = factor(&k, &body.face).unwrap();
            let mut x = vec![1.0; 2 * body.n];
            factor.condense(&mut x, 2);
            factor.recover(&mut x, 2);
            let m = body.face.len();
            let mut l = factor.schur().to_vec();
            dense::cholesky(&mut l, m, &GO).unwrap();
            let mut inverse = l;
            dense::invert_from_cholesky(&mut inverse, m, &GO).unwrap();
            assert!(symmetric_to_the_bit(&inverse, m));
            let bits: Vec<u64> = factor
                .schur()
                .iter()
                .chain(&x)
                .chain(&inverse)
                .map(|v| v.to_bits())
                .collect();
            (bits, factor.weakest_pivot())
        })
    };
    // Large enough to be shared out: several tasks, tiled fronts above them.
    assert_eq!(run(1), run(2));
}

#[test]
fn one_analysis_serves_every_matrix_of_its_pattern() {
    let soft = Make::square(8).build();
    let stiff = Make {
        far_half: 3.0,
        ..Make::square(8)
    }
    .build();
    let symbolic =
        Arc::new(Symbolic::analyse(&soft.matrix(), &soft.face, &Options::default()).unwrap());
    let reused = Factor::new(Arc::clone(&symbolic), &stiff.matrix(), &GO).unwrap();
    let fresh = factor(&stiff.matrix(), &stiff.face).unwrap();
    assert_eq!(reused.schur(), fresh.schur());

    let other = Make::square(7).build();
    let error = Factor::new(Arc::clone(&symbolic), &other.matrix(), &GO).unwrap_err();
    assert!(matches!(error, Error::Shape { what: "K", .. }));
    // Same order, another pattern.
    let other = Make {
        cells: [4, 18, 1],
        ..Make::square(1)
    }
    .build();
    if other.n == soft.n {
        let error = Factor::new(symbolic, &other.matrix(), &GO).unwrap_err();
        assert!(matches!(error, Error::SparseStructure { .. }));
    }
}

#[test]
fn units_do_not_matter() {
    let body = Make::square(10).build();
    let first = factor(&body.matrix(), &body.face).unwrap();
    let mut scaled = body.clone();
    // A power of two: every operation scales exactly.
    let unit = 2.0_f64.powi(-70);
    scaled.values.iter_mut().for_each(|v| *v *= unit);
    let second = factor(&scaled.matrix(), &scaled.face).unwrap();
    assert!(
        first
            .schur()
            .iter()
            .zip(second.schur())
            .all(|(a, b)| a * unit == *b)
    );
    assert_eq!(first.weakest_pivot(), second.weakest_pivot());
}

#[test]
fn only_the_lower_triangle_is_read() {
    let body = Make::cube(3).build();
    let mut spoilt = body.clone();
    for j in 0..body.n {
        for at in body.col_ptr[j]..body.col_ptr[j + 1] {
            if body.row_idx[at] < j {
                spoilt.values[at] = 1e3;
            }
        }
    }
    let (a, b) = (
        factor(&body.matrix(), &body.face).unwrap(),
        factor(&spoilt.matrix(), &body.face).unwrap(),
    );
    assert_eq!(a.schur(), b.schur());
}

#[test]
fn a_pattern_with_one_side_missing_is_completed() {
    // Entry (0, 2) was cancelled on one side only.
    let k = Symmetric::new(
        3,
        &[0, 3, 5, 7],
        &[0, 1, 2, 0, 1, 1, 2],
        &[4.0, 1.0, 0.0, 1.0, 4.0, 0.0, 4.0],
    )
    .unwrap();
    assert!(k.check_symmetry().is_ok());
    let s = factor(&k, &[2, 0]).unwrap();
    assert_eq!(s.schur(), [4.0, 0.0, 0.0, 4.0 - 0.25]);
}

#[test]
fn a_stop_is_obeyed() {
    let body = Make::square(12).build();
    let k = body.matrix();
    let symbolic = Arc::new(Symbolic::analyse(&k, &body.face, &Options::default()).unwrap());
    let error = Factor::new(symbolic, &k, &AtomicBool::new(true)).unwrap_err();
    assert_eq!(error, Error::Interrupted);
}

#[test]
fn an_indefinite_matrix_is_refused_at_its_unknown() {
    let n = 30;
    for spoilt in [3, 17, 29] {
        let mut dense = random_definite(n, 0.2, 5);
        dense[spoilt * n + spoilt] = -1.0;
        let body = Body::from_dense(n, &dense);
        let error = factor(&body.matrix(), &[0]).unwrap_err();
        assert_eq!(error, Error::Indefinite { dof: spoilt });
    }
    // Positive diagonal, negative pivot: seen in elimination only.
    let body = Body::from_dense(2, &[1.0, 2.0, 2.0, 1.0]);
    assert!(matches!(
        factor(&body.matrix(), &[]),
        Err(Error::Indefinite { .. })
    ));
    // A zero on the diagonal with entries beside it is a saddle, not a motion.
    let body = Body::from_dense(2, &[0.0, 1.0, 1.0, 1.0]);
    assert_eq!(
        factor(&body.matrix(), &[]).unwrap_err(),
        Error::Indefinite { dof: 0 }
    );
}

#[test]
fn a_floating_body_is_refused_or_found_at_one_of_its_unknowns() {
    // Whether a body is soft or free is not for a pivot to say, but it is to be seen.
    let seen = |found: Result<Factor, Error>| match found {
        Ok(factor) => factor
            .weakest_pivot()
            .filter(|(_, ratio)| *ratio < 1e-8)
            .map(|(dof, _)| dof),
        Err(Error::FloatingBody { dof }) => Some(dof),
        Err(_) => None,
    };
    // Two squares; the second is free and touches nothing.
    let held = Make::square(6).build();
    let free = Make {
        held: false,
        ..Make::square(6)
    }
    .build();
    let mut both = held.clone();
    both.n += free.n;
    let entries = held.values.len();
    both.col_ptr
        .extend(free.col_ptr[1..].iter().map(|p| p + entries));
    both.row_idx.extend(free.row_idx.iter().map(|i| i + held.n));
    both.values.extend(&free.values);
    let Some(dof) = seen(factor(&both.matrix(), &held.face)) else {
        panic!("a free body passed");
    };
    assert!((held.n..both.n).contains(&dof), "{dof}");

    // One corner does not hold a square against rotation.
    for dim in [2, 3] {
        let body = Make {
            held: false,
            dim,
            ..Make::cube(5)
        }
        .build();
        let corner: Vec<usize> = (0..dim).collect();
        assert!(seen(factor(&body.matrix(), &corner)).is_some());
    }
    // Alike cells round alike: nothing of K's entries cancels, and the pivots of
    // a free motion grow with the number of unknowns to 1e-12 of the diagonal.
    let plate = Make {
        held: false,
        poisson: 0.4999,
        ..Make::square(60)
    }
    .build();
    for kept in [&[][..], &[0, 1]] {
        assert!(seen(factor(&plate.matrix(), kept)).is_some());
    }
    // A stiff half on a soft one, free as a whole: negative, but no more than
    // what the stiff half has lost.
    let contrast = Make {
        held: false,
        far_half: 1e8,
        ..Make::square(8)
    }
    .build();
    assert!(seen(factor(&contrast.matrix(), &[0, 1])).is_some());
    // Nothing at all at an unknown.
    let body = Body::from_dense(3, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(
        factor(&body.matrix(), &[]).unwrap_err(),
        Error::FloatingBody { dof: 1 }
    );
}

#[test]
fn bad_input_is_named() {
    let shape = |n, p: &[usize], r: &[usize], v: &[f64]| Symmetric::new(n, p, r, v).unwrap_err();
    assert_eq!(
        shape(2, &[0, 1], &[0], &[1.0]),
        Error::Shape {
            what: "column pointers of K",
            expected: 3,
            found: 2
        }
    );
    assert!(matches!(
        shape(1, &[0, 1], &[0], &[1.0, 2.0]),
        Error::Shape { .. }
    ));
    assert!(matches!(
        shape(2, &[0, 1, 2], &[0, 2], &[1.0, 1.0]),
        Error::IndexRange {
            position: 1,
            found: 2,
            limit: 2,
            ..
        }
    ));
    assert!(matches!(
        shape(2, &[0, 2, 3], &[1, 0, 1], &[1.0; 3]),
        Error::SparseStructure { row: 0, .. }
    ));
    assert!(matches!(
        shape(2, &[0, 2, 1], &[0, 1], &[1.0; 2]),
        Error::SparseStructure { row: 1, .. }
    ));
    assert!(matches!(
        shape(2, &[0, 1, 2], &[0, 1], &[1.0, f64::NAN]),
        Error::EntryNotFinite {
            row: 1,
            column: 1,
            ..
        }
    ));

    let body = Make::square(3).build();
    let k = body.matrix();
    let analyse = |kept: &[usize], options| Symbolic::analyse(&k, kept, &options).unwrap_err();
    assert!(matches!(
        analyse(&[0, 99], Options::default()),
        Error::IndexRange {
            position: 1,
            found: 99,
            ..
        }
    ));
    assert!(matches!(
        analyse(&[5, 2, 5], Options::default()),
        Error::Repeated {
            index: 5,
            first: 0,
            second: 2,
            ..
        }
    ));
    let mut at = body.at.clone();
    at[4][1] = f64::INFINITY;
    let options = Options {
        coordinates: Some(&at),
    };
    assert!(matches!(
        analyse(&[], options),
        Error::NotFinite { index: 4, .. }
    ));
}

#[test]
fn asymmetry_names_the_largest_pair() {
    let mut body = Make::square(4).build();
    let k = body.matrix();
    assert!(k.check_symmetry().is_ok());
    let at = |body: &Body, i: usize, j: usize| {
        body.col_ptr[j]
            + body.row_idx[body.col_ptr[j]..body.col_ptr[j + 1]]
                .binary_search(&i)
                .unwrap()
    };
    let (small, large) = (at(&body, 2, 0), at(&body, 3, 13));
    body.values[small] += 1e-6;
    body.values[large] += 1e-3;
    assert!(matches!(
        body.matrix().check_symmetry(),
        Err(Error::Asymmetric {
            row: 3,
            column: 13,
            ..
        })
    ));
    // An entry without partner.
    let k = Symmetric::new(2, &[0, 1, 3], &[0, 0, 1], &[1.0, 0.5, 1.0]).unwrap();
    assert_eq!(
        k.check_symmetry().unwrap_err(),
        Error::Asymmetric {
            row: 0,
            column: 1,
            upper: 0.5,
            lower: 0.0
        }
    );
}

#[test]
fn components_count_values_not_storage() {
    let k = Symmetric::new(
        4,
        &[0, 2, 4, 6, 8],
        &[0, 3, 1, 2, 1, 2, 0, 3],
        &[1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0],
    )
    .unwrap();
    assert_eq!(k.components(), [0, 1, 2, 0]);
}

#[test]
fn dense_kernels_across_tile_borders() {
    // One more than a tile of pivots, of an inverse, of a product.
    for n in [1, 5, 129, 257, 530] {
        let a = random_definite(n, 0.5, n as u64);
        let mut l = a.clone();
        dense::cholesky(&mut l, n, &GO).unwrap();
        assert!((0..n).all(|j| (0..j).all(|i| l[j * n + i] == 0.0)));
        let mut product = vec![0.0; n * n];
        dense::matmul(
            &mut product,
            (n, n, n),
            1.0,
            &l,
            Op::Plain,
            &l,
            Op::Transposed,
            0.0,
        );
        // Sums of n terms that round to √n · 1e-16 of the diagonal.
        assert!(distance(&product, &a) < 1e-14);
        let mut inverse = l.clone();
        (0..n).for_each(|j| inverse[j * n..][..j].fill(f64::NAN));
        dense::invert_from_cholesky(&mut inverse, n, &GO).unwrap();
        assert!(symmetric_to_the_bit(&inverse, n));
        let mut identity = vec![0.0; n * n];
        (0..n).for_each(|k| identity[k * n + k] = 1.0);
        let exact = identity.clone();
        dense::matmul(
            &mut identity,
            (n, n, n),
            -1.0,
            &a,
            Op::Transposed,
            &inverse,
            Op::Plain,
            1.0,
        );
        // A⁻¹ A − I: rounding times the condition, below 10 by dominance.
        assert!(norm(identity.iter().copied()) / norm(exact) < 1e-14);
    }
    let mut broken = random_definite(150, 0.5, 3);
    broken[140 * 150 + 140] = -1.0;
    assert_eq!(dense::cholesky(&mut broken, 150, &GO), Ok(Some(140)));
}
