//! Nodes of the mesh, each as seen from one part of the plate, and sums over the ranks that share
//! them.

use crate::error::Result;
use crate::partition::Partition;

/// Node of the mesh as seen from one part of the plate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RecoverySite {
    /// Number of the part.
    pub part: usize,
    /// Number of the node.
    pub node: usize,
}

/// Sums values at sites over the ranks that have them. Collective.
///
/// # Errors
/// Returns the errors of communication.
pub fn sum_over_ranks<P: Partition, const N: usize>(
    sites: &[RecoverySite],
    parts: usize,
    partition: &P,
    values: &mut [[f64; N]],
) -> Result<()> {
    if !P::DIVIDES {
        return Ok(());
    }
    let nodes = sites.iter().map(|site| site.node + 1).max().unwrap_or(0);
    for part in 0..parts {
        for entry in 0..N {
            let part_sites = || sites.iter().enumerate().filter(|(_, site)| site.part == part);
            let mut nodal = vec![0.0; nodes];
            part_sites().for_each(|(number, site)| nodal[site.node] = values[number][entry]);
            let sums = partition.sum_at_nodes(&nodal)?;
            part_sites().for_each(|(number, site)| values[number][entry] = sums[site.node]);
        }
    }
    Ok(())
}
