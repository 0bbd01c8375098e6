//! Loads of the table `[load]`: gravity, acceleration of the base, pressure, forces and moments at
//! points.

use crate::assembly::Probe;
use crate::communicator::Communicator;
use crate::element::BasisFunction;
use crate::error::Result;
use crate::partition::Partition;
use crate::scene::{self, FieldInput, RotationAxis};
use crate::simulation::effects::contributions::{Contributions, Load, LoadLaw};
use crate::simulation::effects::ground::BuildContext;

/// Adds the loads of `[load]`. Collective.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    let Some(load) = &ground.scene.load else {
        return Ok(());
    };
    let scene::Load { pressure, gravity, base_acceleration, forces, moments } = load;
    let mut add = |key: &str, law| sum.loads.push(Load { key: key.into(), law });
    if *gravity != 0.0 {
        add("load.gravity", LoadLaw::Weight(FieldInput::new("load.gravity", *gravity)));
    }
    // In the frame of the base everything is as heavy as if it fell the other way.
    if !base_acceleration.is_zero() {
        add(&base_acceleration.key, LoadLaw::Weight(base_acceleration.clone()));
    }
    if !pressure.is_zero() && !pressure.follows_deflection() {
        add(&pressure.key, LoadLaw::Pressure(pressure.clone()));
    }
    for (number, force) in forces.iter().enumerate() {
        let key = format!("load.force.{number}");
        let spot = ground.spot(&format!("{key}.at"), force.at)?;
        add(&key, LoadLaw::Force(force.value.clone(), spot.map(|spot| spot.of_shape)));
    }
    for (number, moment) in moments.iter().enumerate() {
        let key = format!("load.moment.{number}");
        let spot = ground.spot(&format!("{key}.at"), moment.at)?;
        // A moment works on the rotation w_y about x, or -w_x about y.
        let rotation = |basis: &BasisFunction| match moment.about {
            RotationAxis::X => basis.gradient[1],
            RotationAxis::Y => -basis.gradient[0],
        };
        let rotation = spot.map(|_| Probe::of_derivative(ground.mesh, moment.at.into(), rotation));
        let rotation = ground.comm().all_ok(rotation.transpose())?;
        add(&key, LoadLaw::Force(moment.value.clone(), rotation));
    }
    Ok(())
}
