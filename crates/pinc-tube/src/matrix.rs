//! Products of small matrices, row by row.

/// out = A B for `[rows, inner]` times `[inner, columns]`.
pub(crate) fn multiply(a: &[f64], b: &[f64], inner: usize, columns: usize, out: &mut [f64]) {
    for (row, out) in a.chunks_exact(inner).zip(out.chunks_exact_mut(columns)) {
        out.fill(0.0);
        for (a, b) in row.iter().zip(b.chunks_exact(columns)) {
            out.iter_mut().zip(b).for_each(|(out, b)| *out += a * b);
        }
    }
}

/// out = A' B for `[inner, rows]` and `[inner, columns]`.
pub(crate) fn multiply_transposed(
    a: &[f64],
    b: &[f64],
    [rows, columns]: [usize; 2],
    out: &mut [f64],
) {
    out.fill(0.0);
    for (a, b) in a.chunks_exact(rows).zip(b.chunks_exact(columns)) {
        for (a, out) in a.iter().zip(out.chunks_exact_mut(columns)) {
            out.iter_mut().zip(b).for_each(|(out, b)| *out += a * b);
        }
    }
}

/// out = A P A' for a symmetric P, `[n, n]`.
pub(crate) fn congruence(a: &[f64], p: &[f64], n: usize, work: &mut [f64], out: &mut [f64]) {
    multiply(a, p, n, n, work);
    for i in 0..n {
        let row = &work[i * n..(i + 1) * n];
        for j in 0..=i {
            let entry = dot(row, &a[j * n..(j + 1) * n]);
            (out[i * n + j], out[j * n + i]) = (entry, entry);
        }
    }
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// h' P h for P, `[n, n]`.
pub(crate) fn quadratic(h: &[f64], p: &[f64]) -> f64 {
    h.iter().zip(p.chunks_exact(h.len())).map(|(of, row)| of * dot(row, h)).sum()
}
