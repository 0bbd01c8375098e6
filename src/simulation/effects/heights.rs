//! Heights of the obstacles as bounds on deflections.

use super::contributions::{Body, Link};
use super::ground::BuildContext;
use super::motion::Lift;
use super::sliders::SliderDof;
use crate::communicator::Communicator;
use crate::contact_law::{ContactLaw, LawNumbers, Laws, RIGID};
use crate::error::{Error, Result};
use crate::field::MOST_LOOKS;
use crate::mesh::Point;
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scene::{self, Compliance, FieldInput, Scene, Side};
use crate::scheme::ViscousTip;
use crate::simulation::DeflectionDof;
use crate::simulation::regions::nodes_in;
use std::sync::Arc;

/// Returns the engine's dofs that each obstacle bounds, on the process that owns them: deflections
/// of nodes, or the tips of a compliant stop. Collective.
pub(super) fn opposite<P: Partition>(ground: &BuildContext<P>) -> Result<Vec<Vec<usize>>> {
    let mut tips = vec![Vec::new(); ground.scene.obstacles.len()];
    for (stop, dof) in ground.tips() {
        tips[stop.obstacle].extend(ground.partition.own_dof(dof));
    }
    let deflection = |node: usize| ground.partition.own_dof(ground.space.deflection(node)?);
    let dofs = |(number, obstacle): (usize, &scene::Obstacle)| {
        if obstacle.compliance.is_some_and(|stop| stop.has_tip()) {
            return Ok(std::mem::take(&mut tips[number]));
        }
        let key = format!("obstacle.{number}");
        let nodes = nodes_in(&obstacle.region, ground.mesh, ground.partition, &key)?;
        Ok(nodes.into_iter().filter_map(deflection).collect())
    };
    ground.scene.obstacles.iter().enumerate().map(dofs).collect()
}

/// Returns the engine's deflections and the tips of compliant stops, first the bounded ones in
/// ascending order of dofs, then the others; and the number of bounded ones. The gap of ball k, or
/// its tip, counts as the deflection of a node k places past the mesh's last.
pub(super) fn sites<P: Partition>(
    ground: &BuildContext<P>,
    opposite: &[Vec<usize>],
    sliders: &[SliderDof],
) -> (Vec<DeflectionDof>, usize) {
    let BuildContext { mesh, space, partition, .. } = ground;
    let mut bounded: Vec<usize> = opposite.iter().flatten().copied().collect();
    bounded.extend(sliders.iter().map(|slider| slider.dof));
    let bodies = || ground.terms.bodies.iter().map(|body| (body.tip.unwrap_or(body.gap), body));
    bounded.extend(bodies().filter_map(|(dof, _)| partition.own_dof(dof)));
    bounded.sort_unstable();
    let site = |dof: usize, node: usize, at: [f64; 2], is_tip: bool| {
        let dof = partition.own_dof(dof)?;
        Some((bounded.binary_search(&dof).is_err(), DeflectionDof { dof, node, at, is_tip }))
    };
    let nodes = (0..mesh.nodes.len()).filter_map(|node| Some((space.deflection(node)?, node)));
    let nodes = nodes.filter_map(|(dof, node)| site(dof, node, mesh.nodes[node].into(), false));
    let gaps = bodies()
        .filter_map(|(dof, body)| site(dof, mesh.nodes.len() + body.number, body.mass.point.into(), false));
    let tips = space.tips.iter();
    let tips = tips.filter_map(|&(dof, node)| site(dof, node, mesh.nodes[node].into(), true));
    let mut sites: Vec<(bool, DeflectionDof)> = nodes.chain(gaps).chain(tips).collect();
    sites.sort_by_key(|(is_free, site)| (*is_free, site.dof));
    let bounded = sites.iter().filter(|(is_free, _)| !is_free).count();
    (sites.into_iter().map(|(_, site)| site).collect(), bounded)
}

/// Returns the damped tips that this process has; `None` where no process has any. Collective.
pub(super) fn viscous_tips<P: Partition>(
    ground: &BuildContext<P>,
    bounded: &[DeflectionDof],
) -> Option<Vec<ViscousTip>> {
    let tip = |&Link { body, tip, obstacle, stiffness, damping }: &Link| {
        let [body, tip] = [body, tip].map(|dof| ground.partition.own_dof(dof));
        let bound = bounded.binary_search_by_key(&tip?, |site| site.dof).ok()?;
        Some(ViscousTip { bound, dofs: [body?, tip?], obstacle, stiffness, damping })
    };
    Some(ground.terms.damped_links(ground.comm())?.filter_map(tip).collect())
}

/// Obstacle with the bounds that it affects, and their positions.
#[derive(Clone)]
pub(super) struct Opposite {
    pub side: Side,
    pub height: FieldInput,
    pub bounds: Vec<usize>,
    pub points: Vec<Point>,
}

/// Returns each obstacle with the bounds of this process that it affects, given its dofs.
pub(super) fn opposites<'o>(
    scene: &'o Scene,
    opposite: &'o [Vec<usize>],
    bounded: &'o [DeflectionDof],
) -> impl Iterator<Item = Opposite> + 'o {
    let bound_of = |dof: &usize| bounded.binary_search_by_key(dof, |site| site.dof).ok();
    scene.obstacles.iter().zip(opposite).map(move |(obstacle, opposite)| {
        let bounds: Vec<usize> = opposite.iter().filter_map(bound_of).collect();
        let points = bounds.iter().map(|&bound| bounded[bound].at.into()).collect();
        Opposite { side: obstacle.side, height: obstacle.height.clone(), bounds, points }
    })
}

/// Returns the key of the height that bounds a deflection from a side: the height of the nearest
/// obstacle at the first instant, with its name, or of a ball.
pub(super) fn bounding<P: Partition>(
    ground: &BuildContext<P>,
    opposite: &[Vec<usize>],
    site: &DeflectionDof,
    side: Side,
) -> Result<String> {
    if let Some(ball) = site.node.checked_sub(ground.mesh.nodes.len()) {
        return Ok(format!("ball.{ball}.height"));
    }
    let sign = if side == Side::Below { 1.0 } else { -1.0 };
    let mut nearest: Option<(f64, &scene::Obstacle)> = None;
    for (obstacle, dofs) in ground.scene.obstacles.iter().zip(opposite) {
        if obstacle.side == side && dofs.contains(&site.dof) {
            let height = sign * obstacle.height.at(site.at.into(), 0.0)?;
            if nearest.is_none_or(|(other, _)| height > other) {
                nearest = Some((height, obstacle));
            }
        }
    }
    Ok(nearest.map_or_else(String::new, |(_, obstacle)| match &obstacle.name {
        Some(name) => format!("{} of \"{name}\"", obstacle.height.key),
        None => obstacle.height.key.clone(),
    }))
}

/// Bounds from the obstacles at the bounded dofs of this process.
pub(super) struct Heights<C: Communicator> {
    /// Bounds from fixed obstacles, and 0 at the gaps of balls.
    still: Bounds,
    /// Moving obstacles.
    moving: Vec<Opposite>,
    /// Whether supports move, which shifts the bounds.
    carried: bool,
    places: Vec<[f64; 2]>,
    comm: C,
}

impl<C: Communicator> Heights<C> {
    /// Evaluates the fixed obstacles once. Collective.
    pub fn new<P: Partition<Comm = C>>(
        ground: &BuildContext<P>,
        opposite: &[Vec<usize>],
        bounded: &[DeflectionDof],
        sliders: &[SliderDof],
        lifts: &[Lift],
    ) -> Result<Heights<C>> {
        let BuildContext { scene, mesh, .. } = ground;
        let nodes = mesh.nodes.len();
        let dofs = bounded.iter().map(|site| site.dof).collect();
        let mut still = Bounds::uniform(dofs, f64::NEG_INFINITY, f64::INFINITY);
        // A gap is small while the ball lies on the plate.
        let falls =
            scene.attachments.balls.iter().map(|ball| ball.height.abs().max(scene.plate.plate.thickness));
        still.size = falls.fold(0.0, f64::max);
        for (bound, site) in bounded.iter().enumerate() {
            match site.node.checked_sub(nodes).map(|ball| scene.attachments.balls[ball].side) {
                None => {}
                Some(Side::Above) => still.lower[bound] = 0.0,
                Some(Side::Below) => still.upper[bound] = 0.0,
            }
        }
        let laws = laws(scene, opposite, bounded, sliders, nodes);
        let mut result = laws.map(|laws| still.laws = laws);
        let mut moving = Vec::new();
        for opposite in opposites(scene, opposite, bounded) {
            if opposite.height.changes() {
                result = result.and_then(|()| opposite.refuse_jumps(&scene.time));
                moving.push(opposite);
            } else {
                result = result.and_then(|()| opposite.narrow(0.0, &mut still));
            }
        }
        ground.comm().all_ok(result)?;
        Ok(Heights {
            still,
            moving,
            carried: !lifts.is_empty(),
            places: bounded.iter().map(|site| site.at).collect(),
            comm: ground.comm().clone(),
        })
    }

    /// Returns whether any bound depends on time.
    pub fn vary(&self) -> bool {
        !self.moving.is_empty() || self.carried
    }

    /// Returns the bounds at the first instant, before support motions are subtracted, in m.
    /// Collective.
    pub fn at_start(&self) -> Result<Bounds> {
        let mut bounds = self.still.clone();
        self.comm.all_ok(self.place(0.0, &mut bounds))?;
        Ok(bounds)
    }

    /// Sets the bounds at an instant (s), before support motions are subtracted, in m. Collective.
    pub fn set(&self, t: f64, bounds: &mut Bounds) -> Result<()> {
        let placed = self.place(t, bounds);
        // Support motions alone are the same on all processes.
        if self.moving.is_empty() { placed } else { self.comm.all_ok(placed) }
    }

    fn place(&self, t: f64, bounds: &mut Bounds) -> Result<()> {
        bounds.lower.copy_from_slice(&self.still.lower);
        bounds.upper.copy_from_slice(&self.still.upper);
        for opposite in &self.moving {
            opposite.narrow(t, bounds)?;
        }
        let crossed = bounds.lower.iter().zip(&bounds.upper).position(|(lower, upper)| lower > upper);
        crossed.map_or(Ok(()), |bound| {
            let [x, y] = self.places[bound];
            Err(Error::Scene(format!(
                "obstacle: at ({x}, {y}) those below and above leave no room at t = {t:?} s"
            )))
        })
    }
}

/// Returns the laws by which the bounds yield; the sites of balls have numbers from `nodes` on. The
/// table has the laws of all obstacles, balls and sliders of the scene, in their order.
///
/// # Errors
/// Returns [`Error::Scene`] where a stop shares a side of a node with another obstacle.
fn laws(
    scene: &Scene,
    opposite: &[Vec<usize>],
    bounded: &[DeflectionDof],
    sliders: &[SliderDof],
    nodes: usize,
) -> Result<Laws> {
    let mut table = Vec::new();
    let mut add = |compliance: Option<Compliance>| {
        let law = compliance.and_then(|stop| stop.contact_law())?;
        table.push(law);
        Some(table.len() as u32 - 1)
    };
    let of_obstacles: Vec<_> = scene.obstacles.iter().map(|obstacle| add(obstacle.compliance)).collect();
    let of_balls: Vec<_> = scene.attachments.balls.iter().map(|ball| add(ball.compliance)).collect();
    let first_slider = table.len() as u32;
    table.extend(scene.sliders.iter().map(|slider| Arc::new(slider.law()) as Arc<dyn ContactLaw>));
    let of_site = |site: &DeflectionDof| {
        let mut numbers = [RIGID; 2];
        if let Some(ball) = site.node.checked_sub(nodes) {
            let side = usize::from(scene.attachments.balls[ball].side == Side::Below);
            numbers[side] = of_balls[ball].unwrap_or(RIGID);
        }
        numbers
    };
    let mut numbers: Vec<LawNumbers> = bounded.iter().map(of_site).collect();
    for slider in sliders {
        if let Ok(bound) = bounded.binary_search_by_key(&slider.dof, |site| site.dof) {
            numbers[bound] = [first_slider + slider.number as u32; 2];
        }
    }
    let mut owners = vec![[None; 2]; bounded.len()];
    for (number, faced) in opposites(scene, opposite, bounded).enumerate() {
        let law = of_obstacles[number];
        let side = usize::from(faced.side == Side::Above);
        for bound in faced.bounds {
            if let Some((first, other)) = owners[bound][side].replace((number, law))
                && (law.is_some() || other.is_some())
            {
                let ([x, y], key) = (bounded[bound].at, if law.is_some() { number } else { first });
                let beside = number + first - key;
                let law = scene.obstacles[key].compliance.map_or("rigid".into(), |stop| stop.law.to_string());
                let [position, other] = [key, beside].map(|number| &scene.obstacles[number].position.0);
                return Err(Error::Scene(format!(
                    "{position}: obstacle.{key}.law: \"{law}\" needs a side of its node for itself, and obstacle.{beside} ({other}) \
                     is at ({x}, {y}) too; expected another place or side, or law = \"linear\""
                )));
            }
            if let Some(law) = law {
                numbers[bound][side] = law;
            }
        }
    }
    Ok(Laws::new(table, numbers))
}

/// Returns an error where a rigid ball can hit a held point of the plate, since its velocity would
/// jump. Collective.
pub(super) fn refuse_stopped<P: Partition>(ground: &BuildContext<P>, bounds: &Bounds) -> Result<()> {
    let stops = |dof: usize| {
        let bound = ground.partition.own_dof(dof).and_then(|dof| bounds.dofs.binary_search(&dof).ok());
        bound.is_some_and(|bound| {
            !bounds.laws.has(bound) || bounds.rigid(bound).iter().any(|limit| limit.is_finite())
        })
    };
    let is_stopped = |body: &Body| body.spot.free.weights().is_empty() && stops(body.gap);
    if ground.comm().all_reduce_any(ground.terms.bodies.iter().any(is_stopped)) {
        return Err(Error::Usage(format!(
            "time.scheme = \"{}\" needs velocities that do not jump, and a [[ball]] is above a point that supports \
             hold; give the ball a stiffness, or set time.scheme = \"newmark\"",
            ground.scene.time.scheme.name()
        )));
    }
    Ok(())
}

/// Number of points of an obstacle at which jumps of its height are detected.
const WATCHED: usize = 64;

impl Opposite {
    /// Returns an error where the height jumps in time, at one of some points spread over the
    /// obstacle. Heights that do not depend on the place were checked when the scene was read.
    fn refuse_jumps(&self, time: &scene::Time) -> Result<()> {
        let watched = if self.height.is_even() { 0 } else { self.points.len().min(WATCHED) };
        for k in 0..watched {
            let point = self.points[k * self.points.len() / watched];
            if let Some(wrong) = self.height.jump(point, time, MOST_LOOKS / watched) {
                return Err(Error::Scene(format!("{}: {wrong}", self.height.key)));
            }
        }
        Ok(())
    }

    /// Restricts the bounds to the height of this obstacle at an instant (s): of several obstacles
    /// on one side the nearest counts.
    fn narrow(&self, t: f64, bounds: &mut Bounds) -> Result<()> {
        let mut heights = vec![0.0; self.points.len()];
        self.height.values(&self.points, t, &mut heights)?;
        for (&bound, height) in self.bounds.iter().zip(heights) {
            match self.side {
                Side::Below => bounds.lower[bound] = bounds.lower[bound].max(height),
                Side::Above => bounds.upper[bound] = bounds.upper[bound].min(height),
            }
        }
        Ok(())
    }
}
