//! Products with blocks of sixteen-bit numbers in the registers of AVX-512. One of them holds the
//! nine numbers of a block, which the compiler does not see.
//!
//! The sums and their order are those of the portable loop, [`super::block_rows`], with an
//! instruction that multiplies and adds: the bits are the same.

use std::ops::Range;

use crate::linalg::amg::scaled_blocks::ScaledBlocks;

/// Calls `finish` with the number and the product of each row; `R` registers hold a block.
/// Returns `false` and does nothing if the processor has not the instructions.
#[inline(always)]
pub(super) fn rows<const B: usize, const R: usize>(
    matrix: &ScaledBlocks,
    x: &[f32],
    nodes: Range<usize>,
    finish: impl FnMut(usize, &[f32; B]),
) -> bool {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx512vl") {
        // SAFETY: the processor has the instructions, and those of AVX2 and FMA.
        unsafe { x86::rows::<B, R>(matrix, x, nodes, finish) };
        return true;
    }
    let _ = (matrix, x, nodes, finish);
    false
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::{
        __m512, __m512i, _mm256_add_ps, _mm256_loadu_si256, _mm256_maskz_loadu_ps,
        _mm256_setzero_ps, _mm256_storeu_ps, _mm512_add_ps, _mm512_castps256_ps512,
        _mm512_castps512_ps256, _mm512_cvtepi16_epi32, _mm512_cvtepi32_ps, _mm512_fmadd_ps,
        _mm512_loadu_si512, _mm512_mul_ps, _mm512_permutexvar_ps, _mm512_set1_ps,
        _mm512_setzero_ps,
    };
    use std::array;
    use std::ops::Range;

    use crate::linalg::amg::block_rows::Blocks as _;
    use crate::linalg::amg::scaled_blocks::{ScaledBlocks, two_to};
    use crate::linalg::sparse::csc::narrow;

    #[target_feature(enable = "avx512vl")]
    pub(super) fn rows<const B: usize, const R: usize>(
        matrix: &ScaledBlocks,
        x: &[f32],
        nodes: Range<usize>,
        mut finish: impl FnMut(usize, &[f32; B]),
    ) {
        const { assert!(B / R * B <= 16 && B <= 8) };
        let columns = B / R;
        // The entry of x for each lane. Lanes after the columns have the zero behind the entries.
        let entries: [__m512i; R] = array::from_fn(|r| {
            lanes(|lane| {
                if lane < columns * B {
                    r * columns + lane / B
                } else {
                    B
                }
            })
        });
        // Each column of a register in the first lanes.
        let shifts: [__m512i; 3] = array::from_fn(|c| lanes(|lane| (c * B + lane) % 16));
        let (x, _) = x.as_chunks::<B>();
        for i in nodes {
            let row = matrix.row(i);
            // A register ends so far behind the last block.
            let behind = 16 - columns * B;
            let values = &matrix.values()[row.start * B * B..row.end * B * B + behind];
            let mut sums = [[_mm512_setzero_ps(); R]; 2];
            let add = |k: usize, j: u32, exponent: i8, sums: &mut [__m512; R]| {
                // SAFETY: it reads the `B` entries.
                let x = unsafe { _mm256_maskz_loadu_ps((1 << B) - 1, x[j as usize].as_ptr()) };
                let scale = _mm512_set1_ps(two_to(i32::from(exponent)));
                for r in 0..R {
                    // SAFETY: `k` is a block of the row, and the slice has a register behind the
                    // start of its columns.
                    let block = unsafe {
                        let start = values.as_ptr().add(k * B * B + r * columns * B);
                        _mm256_loadu_si256(start.cast())
                    };
                    let block = _mm512_cvtepi32_ps(_mm512_cvtepi16_epi32(block));
                    let x = _mm512_permutexvar_ps(entries[r], _mm512_castps256_ps512(x));
                    sums[r] = _mm512_fmadd_ps(block, _mm512_mul_ps(x, scale), sums[r]);
                }
            };
            let (columns_of, last_column) = matrix.column()[row.clone()].as_chunks::<2>();
            let (exponents, last_exponent) = matrix.exponent[row].as_chunks::<2>();
            for (pair, (j, exponent)) in columns_of.iter().zip(exponents).enumerate() {
                add(2 * pair, j[0], exponent[0], &mut sums[0]);
                add(2 * pair + 1, j[1], exponent[1], &mut sums[1]);
            }
            if let ([j], [exponent]) = (last_column, last_exponent) {
                add(2 * columns_of.len(), *j, *exponent, &mut sums[0]);
            }
            let mut sum = _mm256_setzero_ps();
            for (even, odd) in sums[0].into_iter().zip(sums[1]) {
                let both = _mm512_add_ps(even, odd);
                for shift in &shifts[..columns] {
                    let column = _mm512_castps512_ps256(_mm512_permutexvar_ps(*shift, both));
                    sum = _mm256_add_ps(sum, column);
                }
            }
            let mut product = [0.0; 8];
            // SAFETY: a register of eight numbers.
            unsafe { _mm256_storeu_ps(product.as_mut_ptr(), sum) };
            finish(i, product.first_chunk().unwrap_or(&[0.0; B]));
        }
    }

    /// A register of indices.
    #[target_feature(enable = "avx512vl")]
    fn lanes(of: impl Fn(usize) -> usize) -> __m512i {
        let lanes: [i32; 16] = array::from_fn(|lane| narrow(of(lane)).cast_signed());
        // SAFETY: a register of sixteen numbers.
        unsafe { _mm512_loadu_si512(lanes.as_ptr().cast()) }
    }
}
