//! Effects that a scene includes beyond the plate's own elasticity and inertia.
//!
//! Each effect named costs time; effects not named cost nothing.

use super::{
    Compliance, FieldInput, InPlane, Initial, Load, Mass, Massless, Obstacle, Scene, SchemeSpec, Side,
};
use crate::contact_law::StopLaw;

impl Scene {
    /// Returns the names of the effects beyond the plate's own elasticity and inertia.
    pub fn effects(&self) -> Vec<String> {
        let mut effects = Vec::new();
        let mut add = |is_on: bool, name: &str| {
            if is_on {
                effects.push(name.to_owned());
            }
        };
        add(self.plate.thickness.is_some(), "varying thickness");
        add(self.plate.plate.orthotropy.is_some(), "orthotropic material");
        add(!self.parts.is_empty(), "parts of other material or thickness");
        add(self.prestress().is_some(), "prestress");
        add(self.stretches(), "stretching");
        add(self.supports.iter().any(|support| support.elastic.is_some()), "elastic edges");
        self.attachments.effects().iter().for_each(|(is_on, name)| add(*is_on, name));
        for (side, name) in [(Side::Below, "below"), (Side::Above, "above")] {
            let of_side = || self.obstacles.iter().filter(|obstacle| obstacle.side == side);
            let moves = of_side().any(|obstacle| obstacle.height.changes());
            let moving = if moves { ", moving" } else { "" };
            add(of_side().next().is_some(), &format!("contact {name}{moving}"));
        }
        for law in StopLaw::ALL {
            add(self.compliances().any(|(_, stop)| stop.law == law), law.spec().effect);
        }
        add(self.stop_damping().is_some(), "damping of stops");
        add(!self.sliders.is_empty(), "dry friction");
        add(self.frictional_obstacle().is_some(), "friction of obstacles");
        add(self.motions().next().is_some(), "moving supports");
        if let Some(load) = &self.load {
            add(load.gravity != 0.0, "gravity");
            add(!load.base_acceleration.is_zero(), "accelerated base (results relative to it)");
            add(load.fields().any(|given| !given.is_zero() && !given.changes()), "constant load");
            add(load.fields().any(FieldInput::changes), "load in time");
        }
        if let Some(damping) = &self.damping {
            add(damping.mass != 0.0, "damping by mass");
            add(damping.stiffness != 0.0, "damping by stiffness");
            add(!damping.modal.is_none(), "modal damping");
        }
        let Initial { deflection, velocity, from, .. } = &self.initial;
        add(self.initial.is_static(), "initial static deflection");
        add(!deflection.is_zero(), "initial deflection");
        add(!velocity.is_zero(), "initial velocity");
        add(from.is_some(), "start from another run");
        let restitution = self.time.scheme.restitution().unwrap_or(0.0);
        add(restitution > 0.0, &format!("restitution e = {restitution}"));
        let output = &self.output;
        add(output.probes.iter().any(|probe| probe.quantity.is_of_curvature()), "moments at probes");
        add(output.fields.is_some_and(|fields| fields.stresses), "stresses in snapshots");
        add(output.extremes, "largest stress of all steps");
        effects
    }

    /// Returns the forces in the plane that do not depend on the deflection, if there are any.
    pub fn prestress(&self) -> Option<&InPlane> {
        self.in_plane.as_ref().filter(|in_plane| in_plane.is_prestressed())
    }

    /// Returns whether the mid-plane of the plate stretches as it bends.
    pub fn stretches(&self) -> bool {
        self.in_plane.as_ref().is_some_and(|in_plane| in_plane.stretching)
    }

    /// Returns whether contact is possible: with obstacles or balls.
    pub fn has_contact(&self) -> bool {
        !self.obstacles.is_empty() || !self.attachments.balls.is_empty()
    }

    /// Returns whether the scene itself takes energy out of the motion: by damping, dashpots or
    /// friction.
    pub fn dissipates(&self) -> bool {
        let is_damped = |damping: &super::Damping| {
            damping.mass != 0.0 || damping.stiffness != 0.0 || !damping.modal.is_none()
        };
        self.damping.as_ref().is_some_and(is_damped) || self.dashpot().is_some() || self.has_friction()
    }

    /// Returns whether a slider or an obstacle has friction.
    pub fn has_friction(&self) -> bool {
        !self.sliders.is_empty() || self.frictional_obstacle().is_some()
    }

    /// Returns whether a scheme with a mass follows all friction of the scene, if there is any.
    pub fn is_friction_taken(&self, scheme: SchemeSpec, mass: Mass) -> bool {
        let able = scheme.capabilities();
        let rests = scheme == SchemeSpec::Midpoint { massless: Massless::Equilibrium };
        let takes_sliders = able.takes_sliders && !(rests && mass == Mass::Singular);
        let is_taken = (takes_sliders || self.sliders.is_empty())
            && (able.takes_friction || self.frictional_obstacle().is_none());
        let rebounds = scheme.restitution().is_some_and(|e| e > 0.0);
        is_taken && mass != Mass::Modal && !rebounds || !self.has_friction()
    }

    /// Returns the number of the first obstacle with friction, if any.
    pub fn frictional_obstacle(&self) -> Option<usize> {
        self.obstacles.iter().position(|obstacle| obstacle.positive_friction().is_some())
    }

    /// Returns whether each obstacle, then each ball, has friction or a dashpot.
    pub fn dissipating_obstacles(&self) -> impl Iterator<Item = bool> {
        let is_damped = |stop: Option<Compliance>| stop.is_some_and(|stop| stop.damping > 0.0);
        let obstacles = self.obstacles.iter();
        let obstacles = obstacles.map(move |on| on.positive_friction().is_some() || is_damped(on.compliance));
        obstacles.chain(self.attachments.balls.iter().map(move |ball| is_damped(ball.compliance)))
    }

    /// Returns whether a ball touches the plate without a stiffness of its own.
    pub fn has_rigid_ball(&self) -> bool {
        self.attachments.balls.iter().any(|ball| ball.compliance.is_none())
    }

    /// Returns the compliance of each compliant stop, obstacle or ball, with the key of its table.
    pub fn compliances(&self) -> impl Iterator<Item = (String, Compliance)> {
        let of_obstacles = self.obstacles.iter().map(|obstacle| obstacle.compliance).enumerate();
        let of_balls = self.attachments.balls.iter().map(|ball| ball.compliance).enumerate();
        let named = |table: &'static str| {
            move |(number, stop): (usize, Option<Compliance>)| Some((format!("{table}.{number}"), stop?))
        };
        of_obstacles.filter_map(named("obstacle")).chain(of_balls.filter_map(named("ball")))
    }

    /// Returns the law by which the bound of a stop yields, with its key, if any.
    pub fn yielding_stop(&self) -> Option<(String, StopLaw)> {
        let (table, stop) = self.compliances().find(|(_, stop)| !stop.has_tip())?;
        Some((format!("{table}.law"), stop.law))
    }

    /// Returns the key of a dashpot, to the ground or of a compliant stop, if any.
    pub fn dashpot(&self) -> Option<String> {
        let to_ground = !self.attachments.dashpots.is_empty();
        to_ground.then(|| "dashpot.0.damping".into()).or_else(|| self.stop_damping())
    }

    /// Returns the key of a compliant stop with damping, if any.
    pub fn stop_damping(&self) -> Option<String> {
        self.compliances().find(|(_, stop)| stop.damping > 0.0).map(|(table, _)| format!("{table}.damping"))
    }

    /// Returns all fields that may depend on time: loads, heights and velocities of obstacles,
    /// support motions.
    pub fn of_time(&self) -> impl Iterator<Item = &FieldInput> {
        let loads = self.load.iter().flat_map(Load::fields);
        let heights = self.obstacles.iter().map(|obstacle| &obstacle.height);
        let velocities = self.obstacles.iter().flat_map(|obstacle| obstacle.velocity.iter().flatten());
        loads.chain(heights).chain(velocities).chain(self.motions())
    }

    /// Returns the scene with all times counted from an instant (s) of this one.
    pub fn from_time(&self, start: f64) -> Scene {
        let mut later = self.clone();
        let loads = later.load.iter_mut().flat_map(Load::fields_mut);
        let heights = later.obstacles.iter_mut().flat_map(|Obstacle { height, velocity, .. }| {
            std::iter::once(height).chain(velocity.iter_mut().flatten())
        });
        let motions = later.supports.iter_mut().filter_map(|support| support.motion.as_mut());
        let changing = loads.chain(heights).chain(motions).filter(|given| given.changes());
        changing.for_each(|given| *given = given.from_time(start));
        later
    }

    /// Returns the motions of the supports.
    pub fn motions(&self) -> impl Iterator<Item = &FieldInput> {
        self.supports.iter().filter_map(|support| support.motion.as_ref())
    }

    /// Returns one key of a load, an obstacle or a support motion that changes with time, if any.
    pub fn changes(&self) -> Option<String> {
        self.of_time().find(|given| given.changes()).or(self.motions().next()).map(|given| given.key.clone())
    }
}
