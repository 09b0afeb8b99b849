//! Stiffness of meshes: the pattern, the sums, and what does not depend on threads.

#![expect(
    clippy::cast_possible_wrap,
    clippy::cast_precision_loss,
    clippy::unwrap_used,
    reason = "counts are small; a helper of a test may fail"
)]

use std::collections::BTreeSet;
use std::sync::atomic::AtomicBool;

use bipot_rs::Error;
use bipot_rs::assembly::cells::Cells;
use bipot_rs::assembly::element::{Law, Reference};
use bipot_rs::assembly::inspection::{self, Rows};
use bipot_rs::assembly::pattern::Pattern;
use bipot_rs::assembly::stiffness::{Elastic, sum_of_cells};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

use crate::common::elasticity::Grid;
use crate::common::{GO, with_threads};
use crate::precision::matrices::{Entries, shuffle};

/// Linear triangles of a square of `n` × `n` cells, each cut in two; nodes are renumbered at
/// random, so that neighbours are far apart. `moved` is the distance by which nodes are moved,
/// as a share of the cells.
struct Mesh {
    cells: Cells,
    points: Vec<f64>,
}

impl Mesh {
    fn new(n: usize, moved: f64) -> Self {
        let mut random = StdRng::seed_from_u64(5);
        let nodes = (n + 1) * (n + 1);
        let mut number: Vec<usize> = (0..nodes).collect();
        shuffle(&mut number, &mut random);
        let mut points = vec![0.0; 2 * nodes];
        for x in 0..=n {
            for y in 0..=n {
                let node = number[x * (n + 1) + y];
                for (a, at) in [(0, x), (1, y)] {
                    let off = moved * random.random_range(-0.2..0.2);
                    points[a * nodes + node] = at as f64 + off;
                }
            }
        }
        let mut corners = vec![Vec::new(); 3];
        for x in 0..n {
            for y in 0..n {
                let at = |p: usize, q: usize| number[(x + p) * (n + 1) + y + q] as i64;
                for triangle in [
                    [at(0, 0), at(1, 0), at(0, 1)],
                    [at(1, 1), at(0, 1), at(1, 0)],
                ] {
                    for (to, node) in corners.iter_mut().zip(triangle) {
                        to.push(node);
                    }
                }
            }
        }
        let cells = Cells::new(&corners.concat(), 3, nodes).unwrap();
        Self { cells, points }
    }

    fn values(&self, laws: &[Law], material: &[usize], workers: usize) -> Result<Vec<f64>, Error> {
        with_threads(workers, || {
            Elastic::<2> {
                cells: &self.cells,
                points: &self.points,
                reference: &triangle(),
                laws,
                material,
            }
            .values(&Pattern::new(&self.cells, None), &GO)
        })
    }
}

fn triangle() -> Reference<2> {
    let slopes = [-1.0, 1.0, 0.0, -1.0, 0.0, 1.0];
    Reference::new(&slopes, &[0.5], 3, 1.0).unwrap()
}

fn steel() -> Law {
    Law::Isotropic(1.5, 1.0)
}

/// `K` as rows, from its pattern and values.
fn dense(pattern: &Pattern, values: &[f64]) -> Vec<Vec<f64>> {
    let (pointer, index) = pattern.csr::<2, i64>();
    let long = |values: Vec<i64>| -> Vec<usize> {
        values
            .into_iter()
            .map(|v| usize::try_from(v).unwrap())
            .collect()
    };
    let (pointer, index) = (long(pointer), long(index));
    let n = pointer.len() - 1;
    let mut rows = vec![vec![0.0; n]; n];
    for (row, found) in rows.iter_mut().enumerate() {
        for at in pointer[row]..pointer[row + 1] {
            found[index[at]] += values[at];
        }
    }
    rows
}

#[test]
fn rows_of_the_pattern_are_the_nodes_that_share_a_cell() {
    let mesh = Mesh::new(40, 0.0);
    for workers in [1, 2, 5] {
        let pattern = with_threads(workers, || Pattern::new(&mesh.cells, None));
        let mut rows = vec![BTreeSet::<u32>::new(); mesh.cells.nodes()];
        for cell in 0..mesh.cells.count() {
            for &i in mesh.cells.of(cell) {
                rows[i as usize].extend(mesh.cells.of(cell).iter().copied());
            }
        }
        for (node, row) in rows.iter().enumerate() {
            assert!(pattern.row(node).iter().eq(row));
        }
    }
}

#[test]
fn a_node_of_no_cell_has_an_empty_row() {
    let cells = Cells::new(&[0_i32, 3, 1], 3, 5).unwrap();
    let (pointer, index) = Pattern::new(&cells, None).csr::<2, i64>();
    assert_eq!(pointer, [0, 6, 12, 18, 24, 24, 24, 30, 36, 36, 36]);
    assert_eq!(index[..6], [0, 1, 2, 3, 6, 7]);
}

/// The linear triangle (0, 0), (1, 0), (0, 1) by hand: gradients are (-1, -1), (1, 0), (0, 1)
/// and the area is 1/2.
#[test]
fn stiffness_of_one_triangle_by_hand() {
    let cells = Cells::new(&[0_i64, 1, 2], 3, 3).unwrap();
    let points = [7.0, 8.0, 7.0, 9.0, 9.0, 10.0];
    let mesh = Elastic::<2> {
        cells: &cells,
        points: &points,
        reference: &triangle(),
        laws: &[steel()],
        material: &[],
    };
    let pattern = Pattern::new(&cells, None);
    let rows = dense(&pattern, &mesh.values(&pattern, &GO).unwrap());
    // Node 1 moves along x: strain ε_xx = 1, so σ = diag(λ + 2μ, λ) = diag(3.5, 1.5), and node
    // i carries half of σ times its gradient. All numbers are short, hence exact up to √½.
    let expected = [-1.75, -0.75, 1.75, 0.0, 0.0, 0.75];
    for (row, value) in rows.iter().zip(expected) {
        assert!((row[2] - value).abs() <= 4.0 * f64::EPSILON, "{row:?}");
    }
}

#[test]
fn stiffness_is_symmetric_and_has_the_same_bits_for_any_number_of_threads() {
    for moved in [0.0, 1.0] {
        let mesh = Mesh::new(60, moved);
        let one = mesh.values(&[steel()], &[], 1).unwrap();
        for workers in [2, 3, 7] {
            assert_eq!(one, mesh.values(&[steel()], &[], workers).unwrap());
        }
        let pattern = Pattern::new(&mesh.cells, None);
        let rows = dense(&pattern, &one);
        for (i, row) in rows.iter().enumerate() {
            for j in 0..i {
                assert_eq!(row[j].to_bits(), rows[j][i].to_bits());
            }
        }
    }
}

/// The grid has two different cells, which share matrices. With a material for each cell no
/// two are equal; the materials are the same in fact.
#[test]
fn shared_matrices_change_no_bit() {
    let mesh = Mesh::new(30, 0.0);
    let shared = mesh.values(&[steel()], &[], 2).unwrap();
    let count = mesh.cells.count();
    let laws = vec![steel(); count];
    let each: Vec<usize> = (0..count).collect();
    assert_eq!(shared, mesh.values(&laws, &each, 2).unwrap());
}

#[test]
fn a_general_law_with_isotropic_entries_gives_the_same_stiffness() {
    let mesh = Mesh::new(20, 1.0);
    let mut tensor = [0.0; 16];
    let unit = |i: usize, j: usize| if i == j { 1.0 } else { 0.0 };
    for (at, entry) in tensor.iter_mut().enumerate() {
        let (k, a, l, b) = (at / 8, at / 4 % 2, at / 2 % 2, at % 2);
        *entry = 1.5 * unit(k, a) * unit(l, b) + unit(k, l) * unit(a, b) + unit(k, b) * unit(a, l);
    }
    let law = Law::general::<2>(&tensor).unwrap();
    let general = mesh.values(&[law], &[], 2).unwrap();
    let isotropic = mesh.values(&[steel()], &[], 2).unwrap();
    let largest = isotropic.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    for (a, b) in general.iter().zip(&isotropic) {
        // Sums of some ten products of similar size.
        assert!((a - b).abs() <= 20.0 * f64::EPSILON * largest);
    }
}

#[test]
fn the_first_folded_cell_is_named() {
    for workers in [1, 2] {
        let mut mesh = Mesh::new(40, 1.0);
        // Two cells become flat: their second node goes to the first.
        for cell in [3100, 1700] {
            let &[first, second, _] = mesh.cells.of(cell) else {
                panic!()
            };
            for a in 0..2 {
                let from = mesh.points[a * mesh.cells.nodes() + first as usize];
                mesh.points[a * mesh.cells.nodes() + second as usize] = from;
            }
        }
        let flat = (0..mesh.cells.count()).find(|&cell| {
            let nodes = mesh.cells.of(cell);
            let x = |i: usize, a: usize| {
                let at = |node: u32| mesh.points[a * mesh.cells.nodes() + node as usize];
                at(nodes[i]) - at(nodes[0])
            };
            x(1, 0) * x(2, 1) - x(1, 1) * x(2, 0) == 0.0
        });
        let Err(Error::FoldedCell { cell }) = mesh.values(&[steel()], &[], workers) else {
            panic!("a flat cell has no stiffness")
        };
        assert_eq!(Some(cell), flat);
    }
}

#[test]
fn mistakes_are_named() {
    let wrong = |nodes: [i64; 3]| Cells::new(&nodes, 3, 3).unwrap_err();
    for nodes in [[0, 1, 3], [0, 1, -1]] {
        assert!(matches!(
            wrong(nodes),
            Error::IndexRange {
                what: "cells",
                position: 2,
                limit: 3,
                ..
            }
        ));
    }
    assert!(matches!(
        Cells::new(&[0_i64; 4], 3, 3),
        Err(Error::Shape { what: "cells", .. })
    ));
    let mesh = Mesh::new(2, 0.0);
    let found = mesh.values(&[steel()], &[0, 0, 1, 0, 0, 0, 0, 0], 1);
    assert!(matches!(
        found,
        Err(Error::IndexRange {
            position: 2,
            found: 1,
            limit: 1,
            ..
        })
    ));
    let pattern = Pattern::new(&mesh.cells, None);
    let short = sum_of_cells::<2>(&mesh.cells, &pattern, &[0.0; 35], &GO);
    assert!(matches!(short, Err(Error::Shape { found: 35, .. })));
}

#[test]
fn it_can_be_interrupted() {
    let mesh = Mesh::new(4, 1.0);
    let found = Elastic::<2> {
        cells: &mesh.cells,
        points: &mesh.points,
        reference: &triangle(),
        laws: &[steel()],
        material: &[],
    }
    .values(&Pattern::new(&mesh.cells, None), &AtomicBool::new(true));
    assert_eq!(found, Err(Error::Interrupted));
}

/// A dilation and shears of two blocks of `E` = 1, from K alone: the work of each is the modulus
/// times the volume, and forces of the dilation act on the surface only.
#[test]
fn k_shows_bodies_their_surfaces_and_their_moduli() {
    let (poisson, cells) = (0.3, 4);
    let one = Grid::cube(cells).floating().assemble();
    let both = one.clone().beside(&one, 100.0);
    let (nodes, _) = both.coordinates.as_chunks::<3>();
    let places: Vec<[f64; 3]> = nodes.iter().flat_map(|x| [*x; 3]).collect();
    let found = inspection::bodies(
        Rows {
            pointer: &both.col_ptr[..],
            index: &both.row_idx,
            values: &both.values,
            by_node: true,
        },
        &places,
    );
    // Sums of 1e3 terms of size 1e2.
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-11 * b.abs();
    let volume = (cells * cells * cells) as f64;
    let shear = 0.5 / (1.0 + poisson);
    assert_eq!(found.work.len(), 2);
    for body in 0..2 {
        assert!(close(found.work[body], 6.0 * shear * volume), "{found:?}");
        assert_eq!(found.all[body], one.n() as i64);
        assert_eq!(found.free[body], one.n() as i64);
        assert!(close(
            found.high[body][2] - found.low[body][2],
            cells as f64
        ));
    }
    let mut work = 0.0;
    for (dof, &force) in found.outward.iter().enumerate() {
        let (node, component) = (dof / 3, dof % 3);
        let first = usize::from(node >= one.nodes()) * one.nodes();
        assert_eq!(found.body[dof], i64::from(first > 0));
        let own = one.coordinates[3 * (node - first) + component];
        let outer = if own == 0.0 {
            -1.0
        } else {
            f64::from(u8::from(own >= cells as f64))
        };
        // The force of a face points outwards and is zero elsewhere.
        assert!(
            force * outer > 0.0 || (force == 0.0 && outer == 0.0),
            "{dof}: {force}"
        );
        work += force * own;
    }
    assert!(
        close(work, 2.0 * 3.0 * volume / (1.0 - 2.0 * poisson)),
        "{work}"
    );
}

/// Chains of springs whose nodes are numbered at random, so that tasks share every chain: any
/// number of threads finds the same bodies, numbered by their first nodes.
#[test]
fn any_number_of_threads_finds_the_same_bodies() {
    let (chains, length) = (7, 3000);
    let nodes = chains * length;
    let mut number: Vec<usize> = (0..nodes).collect();
    shuffle(&mut number, &mut StdRng::seed_from_u64(8));
    let (mut entries, mut chain) = (Entries::default(), vec![0; nodes]);
    for k in 0..nodes {
        chain[number[k]] = k / length;
        if k % length > 0 {
            let (p, q) = (2 * number[k - 1], 2 * number[k]);
            (0..2).for_each(|a| entries.spring(p + a, q + a, 1.0));
        }
    }
    let matrix = entries.matrix(2 * nodes);
    let stiffness = matrix.view().diagonal();
    let k = Rows {
        pointer: &matrix.col_ptr[..],
        index: &matrix.row_idx,
        values: &matrix.values,
        by_node: true,
    };
    let places = vec![[0.0; 2]; 2 * nodes];
    let mut order: Vec<usize> = Vec::new();
    let expected: Vec<i64> = (0..2 * nodes)
        .map(|dof| {
            let own = chain[dof / 2];
            let place = order.iter().position(|&other| other == own);
            place.unwrap_or_else(|| {
                order.push(own);
                order.len() - 1
            }) as i64
        })
        .collect();
    for workers in [1, 2, 5] {
        let (found, diagonal) = with_threads(workers, || {
            (inspection::bodies(k, &places), inspection::diagonal(&k, 0))
        });
        assert_eq!(found.body, expected);
        assert_eq!(diagonal, stiffness);
    }
}
