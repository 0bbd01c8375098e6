//! Memory of a factor, known before the factorisation.

use super::supernodes;
use crate::error::Result;
use crate::memory;
use faer::Par;
use faer::sparse::linalg::cholesky::SymbolicCholesky;

/// Memory and work of a factor, known from its pattern.
#[derive(Debug, Clone, Copy, Default)]
pub struct Size {
    /// Number of stored entries of L.
    pub entries: usize,
    /// Number of multiplications of the factorisation, and of a solve with one right-hand side.
    pub multiplications: [u64; 2],
    /// Memory that the factor keeps in addition to the matrix, in bytes.
    pub kept: u64,
    /// Additional memory needed only during the factorisation, in bytes.
    pub passing: u64,
}

impl Size {
    pub(super) fn of(symbolic: &SymbolicCholesky<usize>, contact_dofs: usize, twice: bool) -> Size {
        let (entries, dofs) = (symbolic.len_val(), symbolic.ncols());
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, faer::Spec::default());
        let tail = 2 * contact_dofs * contact_dofs;
        let kept = size_of::<f64>() * (entries + tail + 4 * dofs);
        let passing = if twice { size_of::<f64>() * entries } else { scratch.unaligned_bytes_required() };
        let (supernodes, _) = supernodes::layout(symbolic).unwrap_or_default();
        let heights = supernodes.iter().flat_map(|s| s.rows + 1..=s.rows + s.end - s.start);
        let multiplications = heights.fold([0, 0], |[factor, solve], height| {
            let height = height as u64;
            [factor + height * height / 2, solve + 2 * height]
        });
        Size { entries, multiplications, kept: kept as u64, passing: passing as u64 }
    }
}

/// Checks that some factors of one size fit into memory together.
///
/// # Errors
/// Returns [`crate::Error::Memory`] where they do not.
pub fn require(size: &Size, factors: u64, dofs: usize) -> Result<()> {
    let number = if factors > 1 { format!("{factors} times ") } else { String::new() };
    let what = format!("factoring the matrix of {dofs} dofs {number}({} entries)", size.entries);
    memory::require(factors * size.kept + size.passing, &what, |part| would_fit(part, dofs))
}

/// Describes how many dofs would fit into a part of the memory that `dofs` dofs need.
pub fn would_fit(part: f64, dofs: usize) -> String {
    // The entries per row of the factor grow with the logarithm of the number of rows.
    let fits = (dofs as f64 * part.powf(0.9)) as usize;
    let digit = 10_usize.pow(fits.max(10).ilog10() - 1);
    format!("a mesh of about {} dofs would fit", fits / digit * digit)
}
