//! What pushes the plate: pressure, point forces, gravity.

use super::attached::Attached;
use super::ground::{AddUp, Agree, Ground, Team};
use crate::assembly::{self, Pressure};
use crate::error::Result;
use crate::mesh::Point;
use crate::scene::Given;
use std::rc::Rc;

/// Loads on the engine's dofs.
pub(super) struct Loads {
    /// What does not change with time, in N; `None` where that is nothing.
    pub constant: Option<Vec<f64>>,
    /// g(t) times a load.
    terms: Vec<(Given, Vec<f64>)>,
    wave: Option<Wave>,
}

/// A pressure that is no sum of products g(t) h(x, y): integrated anew each time.
struct Wave {
    pressure: Given,
    points: Pressure,
    /// Dofs of the space.
    dofs: usize,
    add_up: Rc<AddUp>,
    agree: Rc<Agree>,
}

impl Loads {
    /// Integrates what can be integrated once. Collective.
    pub fn new<T: Team>(ground: &Ground<T>, attached: &Attached) -> Result<Loads> {
        let Ground { scene, mesh, cells, space, add_up, agree, .. } = ground;
        let dofs = space.dofs();
        let mut loads = Loads { constant: None, terms: Vec::new(), wave: None };
        let Some(load) = &scene.load else { return Ok(loads) };
        let mut constant = vec![0.0; dofs];
        if load.gravity != 0.0 {
            add(1.0, &assembly::weight(cells, dofs, load.gravity), &mut constant);
            attached.weigh(load.gravity, &mut constant);
        }
        if !load.pressure.changes() {
            add(1.0, &ground.pressed(&load.pressure)?, &mut constant);
        } else if let Some(terms) = load.pressure.terms() {
            for [time, place] in terms {
                let load = ground.pressed(&place)?;
                match time.number() {
                    Some(factor) => add(factor, &load, &mut constant),
                    None => loads.terms.push((time, add_up(&load)?)),
                }
            }
        } else {
            let points = ground.team.together(Pressure::new(mesh, cells))?;
            let (add_up, agree) = (add_up.clone(), agree.clone());
            loads.wave = Some(Wave { pressure: load.pressure.clone(), points, dofs, add_up, agree });
        }
        for (number, force) in load.forces.iter().enumerate() {
            let mut unit = vec![0.0; dofs];
            if let Some(spot) = ground.spot(&format!("load.force.{number}.at"), force.at)? {
                spot.free.push(1.0, &mut unit);
            }
            match force.value.number() {
                Some(value) => add(value, &unit, &mut constant),
                None => loads.terms.push((force.value.clone(), add_up(&unit)?)),
            }
        }
        let constant = add_up(&constant)?;
        let largest = ground.team.gather(&[constant.iter().fold(0.0, |m: f64, f| m.max(f.abs()))]);
        loads.constant = largest.iter().any(|largest| *largest != 0.0).then_some(constant);
        Ok(loads)
    }

    /// Whether any changes with time.
    pub fn vary(&self) -> bool {
        !self.terms.is_empty() || self.wave.is_some()
    }

    /// Adds the loads of an instant that change with time. Collective.
    pub fn add(&self, t: f64, load: &mut [f64]) -> Result<()> {
        for (factor, of) in &self.terms {
            add(factor.at(Point::origin(), t)?, of, load);
        }
        if let Some(Wave { pressure, points, dofs, add_up, agree }) = &self.wave {
            let mut local = vec![0.0; *dofs];
            agree(points.load(|points, values| pressure.values(points, t, values), &mut local))?;
            add(1.0, &add_up(&local)?, load);
        }
        Ok(())
    }
}

fn add(factor: f64, of: &[f64], to: &mut [f64]) {
    to.iter_mut().zip(of).for_each(|(to, of)| *to += factor * of);
}
