//! Local basis `(n, t1[, t2])` of a contact, from its normal.

use crate::error::Error;

/// Orthonormal basis whose first row is the normal; rows are `n, t1[, t2]`.
///
/// The tangents are the coordinate axes, in their order, made orthogonal to
/// the normal, leaving out the axis nearest to it: for a normal along a
/// coordinate axis they are the other axes themselves, exact to the bit.
///
/// # Errors
/// [`Error::Setting`] for a zero, non-finite or non-unit normal (to 1e-6):
/// a normal of another length would scale reactions silently.
pub fn from_normal<const D: usize>(normal: &[f64; D]) -> Result<[[f64; D]; D], Error> {
    let scale = normal.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
    let length = scale
        * normal
            .iter()
            .map(|c| (c / scale).powi(2))
            .sum::<f64>()
            .sqrt();
    // Written so that a NaN fails it.
    if !((length - 1.0).abs() <= 1e-6) {
        return Err(Error::Setting {
            what: "length of the normal",
            found: length,
            expected: "1: give a unit normal",
        });
    }
    let mut frame = [[0.0; D]; D];
    frame[0] = normal.map(|c| c / length);
    let nearest = (0..D).fold(0, |best, k| {
        if normal[k].abs() > normal[best].abs() {
            k
        } else {
            best
        }
    });
    for (row, axis) in (1..D).zip((0..D).filter(|&k| k != nearest)) {
        let mut tangent = [0.0; D];
        tangent[axis] = 1.0;
        // Twice: one pass leaves an error of ε/sin of the angle between them.
        for _ in 0..2 {
            for done in frame.iter().take(row) {
                let along: f64 = done.iter().zip(&tangent).map(|(a, b)| a * b).sum();
                for (component, d) in tangent.iter_mut().zip(done) {
                    *component -= along * d;
                }
            }
        }
        let size = tangent.iter().map(|c| c * c).sum::<f64>().sqrt();
        frame[row] = tangent.map(|c| c / size);
    }
    Ok(frame)
}
