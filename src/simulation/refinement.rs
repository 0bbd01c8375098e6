//! Special quadrature rules that a field needs.

use crate::assembly;
use crate::communicator::Communicator;
use crate::element::adaptive::{self, Integrand, Refined, Rules};
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::scene::{FieldInput, Still};

/// Largest uncertain part of a field's integral that is accepted where its refinement stopped.
const UNCERTAIN: f64 = 0.01;

/// Returns the rules of the cells that need them for the field of a key, which does not change with
/// time and is given cell by cell. Collective.
pub(super) fn rules<'f>(
    key: &str,
    mesh: &Mesh,
    field: &dyn Fn(usize) -> Option<&'f dyn Integrand>,
    comm: &impl Communicator,
) -> Result<Rules> {
    let pieces = comm.all_ok(assembly::pieces(mesh))?;
    let refined = adaptive::refine(&pieces, field, adaptive::ONCE, comm);
    accepted(key, comm.all_ok(refined)?)
}

/// Returns the rules of the cells that need them for the sum of some fields of one unit at their
/// start. Collective.
pub(super) fn rules_of(
    key: &str,
    mesh: &Mesh,
    fields: &[&FieldInput],
    comm: &impl Communicator,
) -> Result<Rules> {
    if fields.iter().all(|field| field.is_low()) {
        return Ok(Rules::new());
    }
    let still: Vec<Still> = fields.iter().map(|field| field.still(0.0)).collect();
    rules(key, mesh, &|_| Some(&still as &dyn Integrand), comm)
}

/// Returns the quadrature rules for the field of a key, or an error where too much of its integral
/// is uncertain.
pub(super) fn accepted(key: &str, refined: Refined) -> Result<Rules> {
    let Refined { rules, size, left: uncertain, .. } = refined;
    if uncertain <= UNCERTAIN * size {
        return Ok(rules);
    }
    Err(Error::Scene(format!(
        "{key}: its integral over the plate is {size:.3e}, of which {uncertain:.3e} are not certain after all refinement; expected a \
         formula whose jumps and peaks are wider, or a finer mesh"
    )))
}
