//! Products with blocks of sixteen-bit numbers in the registers of AVX2: the compiler fills half of
//! them.
//!
//! The sums and their order are those of the portable loop, [`super::block_rows`], with an
//! instruction that multiplies and adds: the bits are the same.

use std::ops::Range;

use crate::linalg::amg::scaled_blocks::ScaledBlocks;

/// Calls `finish` with the number and the product of each row. Returns `false` and does nothing if
/// the processor has not the instructions, or for blocks of two.
#[inline(always)]
pub(super) fn rows<const B: usize>(
    matrix: &ScaledBlocks,
    x: &[f32],
    nodes: Range<usize>,
    finish: impl FnMut(usize, &[f32; B]),
) -> bool {
    #[cfg(target_arch = "x86_64")]
    if B > 2
        && std::arch::is_x86_feature_detected!("avx2")
        && std::arch::is_x86_feature_detected!("fma")
    {
        // SAFETY: the processor has the instructions.
        unsafe {
            if B == 3 {
                x86::rows_of_three(matrix, x, nodes, finish);
            } else {
                x86::rows_of_columns(matrix, x, nodes, finish);
            }
        }
        return true;
    }
    let _ = (matrix, x, nodes, finish);
    false
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::{
        __m256, _mm_add_ps, _mm_cvtepi16_epi32, _mm_cvtepi32_ps, _mm_cvtsi32_si128, _mm_fmadd_ps,
        _mm_loadu_ps, _mm_loadu_si128, _mm_movehdup_ps, _mm_setzero_ps, _mm_storeu_ps,
        _mm256_add_ps, _mm256_cvtepi16_epi32, _mm256_cvtepi32_ps, _mm256_extractf128_ps,
        _mm256_fmadd_ps, _mm256_mul_ps, _mm256_permutevar_ps, _mm256_set_m128, _mm256_set1_ps,
        _mm256_setr_epi32, _mm256_setzero_ps, _mm256_storeu_ps, _mm256_unpackhi_ps,
    };
    use std::ops::Range;

    use crate::linalg::amg::block_rows::Blocks as _;
    use crate::linalg::amg::scaled_blocks::{ScaledBlocks, two_to};

    /// Eight numbers of sixteen bits.
    ///
    /// # Safety
    /// They must follow `from`.
    #[inline]
    #[target_feature(enable = "avx2,fma")]
    unsafe fn eight(from: *const i16) -> __m256 {
        // SAFETY: the caller has them.
        let values = unsafe { _mm_loadu_si128(from.cast()) };
        _mm256_cvtepi32_ps(_mm256_cvtepi16_epi32(values))
    }

    /// One register holds eight of the nine numbers of a block, and another the ninth of two blocks.
    #[target_feature(enable = "avx2,fma")]
    pub(super) fn rows_of_three<const B: usize>(
        matrix: &ScaledBlocks,
        x: &[f32],
        nodes: Range<usize>,
        mut finish: impl FnMut(usize, &[f32; B]),
    ) {
        let (x, _) = x.as_chunks::<3>();
        // Four numbers are read at once, also of the last node.
        let mut last = [0.0; 4];
        last[..3].copy_from_slice(x.last().unwrap_or(&[0.0; 3]));
        let entries = _mm256_setr_epi32(0, 0, 0, 1, 1, 1, 2, 2);
        let scaled = |j: u32, exponent: i8| {
            let own = &x[j as usize];
            let from = if j as usize + 1 == x.len() {
                last.as_ptr()
            } else {
                own.as_ptr()
            };
            // SAFETY: another node or the end of `last` follows the three numbers.
            let x = unsafe { _mm_loadu_ps(from) };
            let x = _mm256_permutevar_ps(_mm256_set_m128(x, x), entries);
            _mm256_mul_ps(x, _mm256_set1_ps(two_to(i32::from(exponent))))
        };
        for i in nodes {
            let row = matrix.row(i);
            let (columns, last_column) = matrix.column()[row.clone()].as_chunks::<2>();
            let (exponents, last_exponent) = matrix.exponent[row.clone()].as_chunks::<2>();
            let (blocks, last_block) =
                matrix.values()[9 * row.start..9 * row.end].as_chunks::<18>();
            let (mut even, mut odd) = (_mm256_setzero_ps(), _mm256_setzero_ps());
            let mut ninths = _mm_setzero_ps();
            for ((j, exponent), block) in columns.iter().zip(exponents).zip(blocks) {
                let xs = [scaled(j[0], exponent[0]), scaled(j[1], exponent[1])];
                // SAFETY: eight of the eighteen numbers follow each place.
                let values = unsafe { [eight(block.as_ptr()), eight(block.as_ptr().add(9))] };
                even = _mm256_fmadd_ps(values[0], xs[0], even);
                odd = _mm256_fmadd_ps(values[1], xs[1], odd);
                let both = i32::from(block[8].cast_unsigned()) | i32::from(block[17]) << 16;
                let values = _mm_cvtepi32_ps(_mm_cvtepi16_epi32(_mm_cvtsi32_si128(both)));
                let xs = _mm256_extractf128_ps::<1>(_mm256_unpackhi_ps(xs[0], xs[1]));
                ninths = _mm_fmadd_ps(values, xs, ninths);
            }
            if let ([j], [exponent], [.., ninth]) = (last_column, last_exponent, last_block) {
                let x = scaled(*j, *exponent);
                // SAFETY: `last_block` has nine numbers.
                even = _mm256_fmadd_ps(unsafe { eight(last_block.as_ptr()) }, x, even);
                let value = _mm_cvtepi32_ps(_mm_cvtsi32_si128(i32::from(*ninth)));
                let x = _mm256_unpackhi_ps(x, _mm256_setzero_ps());
                ninths = _mm_fmadd_ps(value, _mm256_extractf128_ps::<1>(x), ninths);
            }
            let (mut sums, mut ninth) = ([0.0_f32; 8], [0.0; 4]);
            let both = _mm_add_ps(ninths, _mm_movehdup_ps(ninths));
            // SAFETY: registers of eight and of four numbers.
            unsafe {
                _mm256_storeu_ps(sums.as_mut_ptr(), _mm256_add_ps(even, odd));
                _mm_storeu_ps(ninth.as_mut_ptr(), both);
            }
            let product = [
                0.0 + sums[0] + sums[3] + sums[6],
                0.0 + sums[1] + sums[4] + sums[7],
                0.0 + sums[2] + sums[5] + ninth[0],
            ];
            finish(i, product.first_chunk().unwrap_or(&[0.0; B]));
        }
    }

    /// One register holds a column.
    #[target_feature(enable = "avx2,fma")]
    pub(super) fn rows_of_columns<const B: usize>(
        matrix: &ScaledBlocks,
        x: &[f32],
        nodes: Range<usize>,
        mut finish: impl FnMut(usize, &[f32; B]),
    ) {
        const { assert!(B <= 8) };
        let (x, _) = x.as_chunks::<B>();
        for i in nodes {
            let row = matrix.row(i);
            // A register ends so far behind the last block.
            let values = &matrix.values()[row.start * B * B..row.end * B * B + 8 - B];
            let mut sums = [[_mm256_setzero_ps(); B]; 2];
            let add = |k: usize, j: u32, exponent: i8, sums: &mut [__m256; B]| {
                let (x, scale) = (&x[j as usize], two_to(i32::from(exponent)));
                for c in 0..B {
                    // SAFETY: `k` is a block of the row, and the slice has a register behind the
                    // start of its columns.
                    let column = unsafe { eight(values.as_ptr().add((k * B + c) * B)) };
                    sums[c] = _mm256_fmadd_ps(column, _mm256_set1_ps(x[c] * scale), sums[c]);
                }
            };
            let (columns, last_column) = matrix.column()[row.clone()].as_chunks::<2>();
            let (exponents, last_exponent) = matrix.exponent[row].as_chunks::<2>();
            for (pair, (j, exponent)) in columns.iter().zip(exponents).enumerate() {
                add(2 * pair, j[0], exponent[0], &mut sums[0]);
                add(2 * pair + 1, j[1], exponent[1], &mut sums[1]);
            }
            if let ([j], [exponent]) = (last_column, last_exponent) {
                add(2 * columns.len(), *j, *exponent, &mut sums[0]);
            }
            let mut sum = _mm256_setzero_ps();
            for (even, odd) in sums[0].into_iter().zip(sums[1]) {
                sum = _mm256_add_ps(sum, _mm256_add_ps(even, odd));
            }
            let mut product = [0.0; 8];
            // SAFETY: a register of eight numbers.
            unsafe { _mm256_storeu_ps(product.as_mut_ptr(), sum) };
            finish(i, product.first_chunk().unwrap_or(&[0.0; B]));
        }
    }
}
