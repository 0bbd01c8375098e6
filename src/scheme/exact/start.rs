//! Active set at the start, and a check of the rigid part of the initial state.

use super::event_resolution;
use super::modes::Modes;
use super::reduction::ReducedModel;
use crate::error::{Error, Result};
use crate::linalg::{Engine, LinearCombination};
use crate::obstacle::Bounds;
use crate::scheme::System;
use crate::vi::{Answer, BoundStatus, DenseProblem};
use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side as Triangle};

/// Strain of a motion, relative to that of its parts, below which it is rigid to rounding.
const RIGID_STRAIN: f64 = 1e-12;
/// Largest part of the initial elastic energy that may lie in motions taken for rigid.
const MAX_HIDDEN_ENERGY: f64 = 1e-6;

/// Checks that the rigid part of the initial state has no strain: the slowest modes of a strip ten
/// thousand times longer than wide are lost in the rounding error of the fastest. The parts of the
/// strain are those of K + s M: a ball has no stiffness, and its motion no strain but rounding.
pub(super) fn check_rigid<E: Engine>(
    system: &System<E>,
    with_mass: &LinearCombination,
    reduction: &ReducedModel,
    modes: &Modes,
    state: &Mat<f64>,
    start: &[f64],
) -> Result<()> {
    let System { engine, stiffness, .. } = system;
    let rigid = modes.spectrum.vectors.get(.., ..modes.rigid) * state.get(..modes.rigid, ..1);
    let shape = &reduction.lift * rigid;
    let x = shape.col_as_slice(0);
    let (mut force, mut sizes) = (vec![0.0; x.len()], vec![0.0; x.len()]);
    engine.multiply_with_magnitude(with_mass, x, [&mut force, &mut sizes])?;
    let size = engine.dot(&sizes, &x.iter().map(|x| x.abs()).collect::<Vec<_>>())?;
    let energy = engine.multiply(stiffness, x, &mut force)?;
    let whole = engine.multiply(stiffness, start, &mut force)?;
    if energy > RIGID_STRAIN.powi(2) * size && energy > MAX_HIDDEN_ENERGY * whole {
        return Err(Error::Singular(
            "time.scheme = \"exact\": the slowest motions are lost in the rounding of the fastest; \
             set time.scheme = \"conserving\", or take cells that are less slender"
                .into(),
        ));
    }
    Ok(())
}

/// Returns the active set at the start: that of the minimiser U(p), and for nodes just in contact,
/// the side to which they move next.
pub(super) fn first_sides(reduction: &ReducedModel, state: &Mat<f64>, roundings: f64) -> Vec<BoundStatus> {
    let bounds = &reduction.bounds;
    let position = state.get(.., ..1);
    let free = &reduction.rest_at + &reduction.lift_at * position;
    let mut sides = vec![BoundStatus::Free; bounds.len()];
    let mut values = free.col_as_slice(0).to_vec();
    let mut reactions = vec![0.0; bounds.len()];
    let inside = |i: usize, value: f64| (bounds.lower[i]..=bounds.upper[i]).contains(&value);
    let mut scale: Vec<f64> = (0..bounds.len()).map(|_| 0.0).collect();
    if !values.iter().enumerate().all(|(i, &value)| inside(i, value)) {
        // The compliance is positive definite: checked by the reduction.
        if let Ok(llt) = reduction.compliance.llt(Triangle::Lower) {
            let stiffness = &llt.inverse();
            let wanted = stiffness * &free;
            for (i, scale) in scale.iter_mut().enumerate() {
                *scale = (0..bounds.len()).map(|j| (stiffness[(i, j)] * free[(j, 0)]).abs()).sum();
            }
            let (rhs, Bounds { lower, upper, .. }) = (wanted.col_as_slice(0), bounds);
            let mut answer = Answer { x: &mut values, reaction: &mut reactions };
            DenseProblem { matrix: stiffness, rhs, lower, upper }.solve(&mut sides, &mut answer);
        }
    }
    let near = |a: f64, b: f64, scale: f64| (a - b).abs() <= roundings * f64::EPSILON * scale;
    let mut undecided = Vec::new();
    for i in 0..bounds.len() {
        if bounds.holds(i) {
            sides[i] = BoundStatus::Lower;
            continue;
        }
        let size: f64 = (0..state.nrows()).map(|k| (reduction.lift_at[(i, k)] * state[(k, 0)]).abs()).sum();
        let size = size + reduction.rest_at[(i, 0)].abs();
        match sides[i] {
            BoundStatus::Free if near(values[i], bounds.lower[i], size) => {
                undecided.push((i, BoundStatus::Lower))
            }
            BoundStatus::Free if near(values[i], bounds.upper[i], size) => {
                undecided.push((i, BoundStatus::Upper))
            }
            BoundStatus::Free => {}
            side if near(reactions[i], 0.0, scale[i]) => undecided.push((i, side)),
            _ => {}
        }
    }
    event_resolution::next_sides(reduction, &sides, &undecided, state, &reactions, roundings)
}
