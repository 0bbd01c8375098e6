//! Sliders: dry friction of given normal forces, with memory of where each has slipped to.
//!
//! A slider resists the motion of its dof by [dry friction](crate::contact_law::DryFriction) about
//! an anchor `$a^n$`, in the bounded configuration of the step: `$U^{n+1}$` for Newmark with e = 0,
//! `$U^{n+1/2}$` for the midpoint rule. With the force r of the step and the stiffness k of its
//! spring, the anchor there is `$a = U + r / k$`, and over the whole step it moves by
//!
//! ```math
//! a^{n+1} - a^n = \rho\,(a - a^n), \qquad D^{n+1} = D^n - r\,(a^{n+1} - a^n) \ge D^n ,
//! ```
//!
//! with `$\rho = 1$` for Newmark and 2 for the midpoint rule. With the midpoint rule the energy of
//! the plate, that of the springs and the dissipated energy D add up to a constant. With Newmark
//! the sum never rises by more than `$\tfrac12 F |a^{n+1} - a^n|$`, and what it loses is of first
//! order in the step, as for [bounds that yield](super::newmark).

use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::obstacle::Bounds;

/// BoundSlider at a bounded dof of this rank, whose bounds are infinite but in the steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundSlider {
    /// Number of the slider in the scene.
    pub number: usize,
    /// Index of its bound.
    pub bound: usize,
    /// Stiffness of its spring, in N/m; infinite without one.
    pub stiffness: f64,
}

/// Force and dissipated energy of a slider at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction {
    /// Number of the slider in the scene.
    pub number: usize,
    /// Force on the plate, in N, positive upwards.
    pub force: f64,
    /// Energy dissipated since the start, in J.
    pub dissipated: f64,
}

/// Memory of a slider.
#[derive(Debug, Clone, Copy, Default)]
struct Memory {
    /// Place of the anchor, in m.
    anchor: f64,
    /// Force on the plate in the last step, in N.
    force: f64,
    /// Energy dissipated since the start, in J, and until the step before.
    dissipated: [f64; 2],
    /// Energy stored in the spring, in J.
    stored: f64,
}

/// Sliders of this rank with their memories.
pub(super) struct Sliding {
    sliders: Vec<BoundSlider>,
    memories: Vec<Memory>,
    /// Way of the anchors over a step, in multiples of their way to the bounded configuration.
    extent: f64,
}

impl Sliding {
    /// Creates relaxed sliders, anchored at displacements (m), for a scheme whose steps end at a
    /// multiple `extent` of the way to the bounded configuration.
    pub fn new(sliders: &[BoundSlider], bounds: &Bounds, u: &[f64], extent: f64) -> Sliding {
        let memory =
            |slider: &BoundSlider| Memory { anchor: u[bounds.dofs[slider.bound]], ..Memory::default() };
        Sliding { memories: sliders.iter().map(memory).collect(), sliders: sliders.to_vec(), extent }
    }

    /// Sets the bounds of the sliders to their anchors, relative to the known part u of the bounded
    /// configuration u + c x.
    pub fn bound(&self, bounds: &mut Bounds, u: impl Fn(usize) -> f64, c: f64) {
        for (BoundSlider { bound, .. }, memory) in self.sliders.iter().zip(&self.memories) {
            let place = (memory.anchor - u(bounds.dofs[*bound])) / c;
            (bounds.lower[*bound], bounds.upper[*bound]) = (place, place);
        }
    }

    /// Takes the forces of a step out of the reactions, and moves the anchors, given the bounded
    /// configuration and the displacement before the step (m), by dof.
    pub fn slip(
        &mut self,
        bounds: &Bounds,
        reaction: &mut [f64],
        configuration: impl Fn(usize) -> f64,
        before: impl Fn(usize) -> f64,
    ) {
        for (&BoundSlider { bound, stiffness, .. }, memory) in self.sliders.iter().zip(&mut self.memories) {
            let (dof, force) = (bounds.dofs[bound], std::mem::take(&mut reaction[bound]));
            let place = configuration(dof);
            let way = self.extent * (place + force / stiffness - memory.anchor);
            let end = before(dof) + self.extent * (place - before(dof));
            memory.anchor += way;
            memory.force = force;
            memory.dissipated = [memory.dissipated[0] - force * way, memory.dissipated[0]];
            let stretch = end - memory.anchor;
            memory.stored = if stiffness.is_finite() { 0.5 * stiffness * stretch * stretch } else { 0.0 };
        }
    }

    /// Returns this rank's part of the energy stored in the springs, in J.
    pub fn stored(&self) -> f64 {
        self.memories.iter().map(|memory| memory.stored).sum()
    }

    /// Returns forces and energies at an instant that lies `ago` (0 or 1) steps before the last
    /// step's end.
    pub fn friction(&self, ago: usize) -> Vec<Friction> {
        let friction = |(slider, memory): (&BoundSlider, &Memory)| Friction {
            number: slider.number,
            force: memory.force,
            dissipated: memory.dissipated[ago],
        };
        self.sliders.iter().zip(&self.memories).map(friction).collect()
    }

    /// Saves or restores the memories, one per bound.
    pub fn archive(&mut self, bounds: usize, archive: &mut Archive) -> Result<()> {
        let mut memories = vec![Memory::default(); bounds];
        let places = || self.sliders.iter().map(|slider| slider.bound);
        places().zip(&self.memories).for_each(|(bound, memory)| memories[bound] = *memory);
        archive.items(
            VectorKind::Bounds,
            &mut memories,
            |&Memory { anchor, force, dissipated: [now, before], stored }| {
                [anchor, force, now, before, stored]
            },
            |[anchor, force, now, before, stored]| Memory {
                anchor,
                force,
                dissipated: [now, before],
                stored,
            },
        )?;
        self.memories = places().map(|bound| memories[bound]).collect();
        Ok(())
    }
}
