//! Exact answers of small matrices of whole numbers.

use crate::common::double_double::Double;

/// A fraction; the denominator is positive or the numerator of no meaning.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fraction {
    pub(crate) over: i128,
    pub(crate) under: i128,
}

impl Fraction {
    pub(crate) fn rounded(self) -> Double {
        whole(self.over) / whole(self.under)
    }
}

/// A whole number below 2¹⁰⁶ without rounding.
pub(crate) fn whole(value: i128) -> Double {
    #[expect(clippy::cast_possible_truncation, reason = "the rest is taken up")]
    let rest = value - (value as f64) as i128;
    Double::from(value as f64) + Double::from(rest as f64)
}

/// Schur complement of the unknowns not in `kept`, by Bareiss' elimination
/// without fractions: after p steps every entry is a minor of order p + 1, and
/// its quotient by the last pivot is the entry of S. Nothing but divisions that
/// leave no rest. The minors of the interior must not vanish.
pub(crate) fn schur(n: usize, dense: &[i64], kept: &[usize]) -> Vec<Fraction> {
    let mut a: Vec<i128> = dense.iter().map(|&v| i128::from(v)).collect();
    let mut left = vec![true; n];
    let mut last = 1;
    for p in (0..n).filter(|p| !kept.contains(p)) {
        left[p] = false;
        let pivot = a[p * n + p];
        assert_ne!(pivot, 0);
        let rows: Vec<usize> = (0..n).filter(|&i| left[i]).collect();
        for &i in &rows {
            for &j in &rows {
                let minor = a[i * n + j] * pivot - a[i * n + p] * a[p * n + j];
                assert_eq!(minor % last, 0);
                // Row and column p keep their values for the other entries.
                a[i * n + j] = minor / last;
            }
        }
        last = pivot;
    }
    kept.iter()
        .flat_map(|&i| kept.iter().map(move |&j| (i, j)))
        .map(|(i, j)| Fraction {
            over: a[i * n + j],
            under: last,
        })
        .collect()
}

/// Determinant of the rows and columns `of`, by its first row.
pub(crate) fn minor(n: usize, dense: &[i64], of: &[usize]) -> i128 {
    fn expand(n: usize, dense: &[i64], rows: &[usize], columns: &[usize]) -> i128 {
        let Some((&row, rest)) = rows.split_first() else {
            return 1;
        };
        let mut sum = 0;
        for (at, &column) in columns.iter().enumerate() {
            let others: Vec<usize> = columns.iter().copied().filter(|&c| c != column).collect();
            let term = i128::from(dense[row * n + column]) * expand(n, dense, rest, &others);
            sum += if at % 2 == 0 { term } else { -term };
        }
        sum
    }
    expand(n, dense, of, of)
}

/// Whole numbers as they are.
pub(crate) fn as_floats(dense: &[i64]) -> Vec<f64> {
    dense.iter().map(|&v| v as f64).collect()
}

/// The members of a set of the first `n` numbers, by the bits of `set`.
pub(crate) fn members(n: usize, set: usize) -> Vec<usize> {
    (0..n).filter(|i| set >> i & 1 == 1).collect()
}
