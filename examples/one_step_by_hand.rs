//! One step of Newmark's scheme by hand: K, M and B, the obstacle, and the solver of the step.
//!
//! A free plate falls flat at 2 m/s and has just reached a floor at height 0: `$U^n = 0$`, and
//! `$d = U^n - U^{n-1}$` is -2 m/s times dt everywhere. The step solves `$A x = b + G^T r$` with
//! `$A = M / dt^2 + \beta K$`, `$M = B^T C^{-1} B$`, `$b = F - K U^n$`, under the bounds
//! `$U^{n+1} = U^n + d + x \ge 0$` at the nodes, where the reactions r push. Their impulse is the
//! change of momentum.

use rebond::assembly;
use rebond::dof_map::DofMap;
use rebond::linalg::{Engine, Native};
use rebond::mesh::{Diagonal, ElementKind, Mesh};
use rebond::obstacle::Bounds;
use rebond::plate::Plate;
use rebond::vi::{Answer, CheckedSolver, Condensed, Problem};

pub(crate) fn main() -> rebond::Result<()> {
    let plate = Plate::isotropic(2e-3, 70e9, 0.33, 2700.0);
    let mesh = Mesh::rectangle(0.6, 0.3, [8, 4], ElementKind::Fvs, Diagonal::Right)?;
    let dofs = DofMap::new(&mesh, [])?;
    let cells = assembly::cells(&mesh, &dofs, &plate)?;
    let engine = Native::with_layout(dofs.layout(&mesh));
    let k = engine.form(assembly::stiffness(&cells));
    let rows = assembly::singular_mass(&cells); // one row of B and one entry of C per cell
    let c: Vec<f64> = rows.iter().map(|row| row.mass).collect();
    let m = engine.averages(rows);

    let (dt, beta) = (1e-5, 0.5);
    let nodes: Vec<usize> = dofs.deflections().map(|(dof, _)| dof).collect();
    let mut d = vec![0.0; engine.dofs()];
    nodes.iter().for_each(|&dof| d[dof] = -2.0 * dt);

    let a = &m * (1.0 / (dt * dt)) + &k * beta;
    let b = vec![0.0; engine.dofs()]; // neither load nor deflection
    let bounds = Bounds::uniform(nodes, 2.0 * dt, f64::INFINITY);
    let solver = Condensed::new(&engine, &a, bounds.len())?;
    let mut solver = CheckedSolver::new(Box::new(solver), &engine, &a)?;
    let (mut x, mut reaction) = (b.clone(), vec![0.0; bounds.len()]);
    let problem = Problem { matrix: &a, rhs: &b, bounds: &bounds, length: 2.0 * dt };
    let report = solver.solve(&engine, &problem, &mut Answer { x: &mut x, reaction: &mut reaction })?;

    // Velocities of the cells, C^-1 B d / dt, change by C^-1 B x / dt.
    let mut change = vec![0.0; c.len()];
    engine.project(&m, &x, &mut change)?;
    let momentum: f64 = c.iter().zip(&change).map(|(c, v)| c * v / dt).sum();
    let impulse: f64 = reaction.iter().map(|r| r * dt).sum();
    let touching = reaction.iter().filter(|r| **r > 0.0).count();
    println!("{touching} of {} nodes touch, KKT residual {:.1e}", bounds.len(), report.kkt);
    println!("impulse {impulse:.12} N s, change of momentum {momentum:.12} N s");
    assert!((impulse / momentum - 1.0).abs() < 1e-10);
    Ok(())
}
