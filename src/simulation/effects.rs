//! What a scene calls for, composed once into the semi-discrete problem: forms, loads, bounds, and what of them changes with time.
//!
//! Supports that move carry the plate's frame with them: U is the deflection beyond the one that their motion makes by itself, the
//! *lift*. In that frame supports stand still, obstacles move by less the lift, and inertia is a load (the pseudo-static
//! decomposition of earthquake engineering: Clough and Penzien, *Dynamics of Structures*, section 26-1).

use super::Site;
use super::body::{self, Team};
use crate::assembly::{self, CellArrays, Pressure, Probe};
use crate::error::{Error, Result};
use crate::linalg::{Average, BARE, Block, Engine, Form, Native};
use crate::mesh::{Mesh, Point};
use crate::obstacle::Bounds;
use crate::scene::{self, Given, Mass, Scene, Side};
use crate::scheme::{self, Damping, Drive, Start, System};
use crate::space::{Hold, PER_NODE, Place, Rigid, Space, Support};
use crate::vi::Verdict;
use std::rc::Rc;
use std::time::Instant;

/// Adds up what all processes have over their spaces, on the engine's dofs. Collective.
pub(super) type AddUp = dyn Fn(&[f64]) -> Result<Vec<f64>>;

/// Where a model is built: this process's part of the mesh, and how it and the engine's dofs belong together.
pub(super) struct Ground<'g, T: Team> {
    pub scene: &'g Scene,
    pub team: &'g T,
    pub mesh: &'g Mesh,
    /// What supports hold at the nodes.
    pub holds: &'g [Hold],
    /// Dofs of the part of the mesh, and the gaps of balls.
    pub space: &'g Space,
    /// The dof of each ball's gap, on the process that has it.
    pub gaps: &'g [Option<usize>],
    pub cells: &'g [CellArrays],
    /// The engine's number of one of the space's dofs, if this process owns it.
    pub own: &'g dyn Fn(usize) -> Option<usize>,
    /// See there.
    pub add_up: Rc<AddUp>,
    /// Whether this process owns each node.
    pub owns: &'g dyn Fn(usize) -> bool,
}

/// How supports move, and the deflection and slopes that a motion of 1 m makes at each node (three a node of this process).
#[derive(Debug, Clone)]
pub(super) struct Lift {
    pub motion: Rc<Given>,
    pub shape: Vec<f64>,
}

/// A ball, in the dofs.
struct Rider<'s> {
    number: usize,
    ball: &'s scene::Ball,
    /// The deflection under it.
    probe: Probe,
    /// The dof of its gap: its height over the plate.
    gap: usize,
}

/// A mass fixed on the plate, or a ball, that this process has: m kg that move as the probe does.
struct Burden {
    probe: Probe,
    mass: f64,
    at: [f64; 2],
}

/// The matrices of a scene, piece by piece.
pub struct Matrices {
    /// K.
    pub stiffness: Vec<Block>,
    /// M_r.
    pub consistent: Vec<Block>,
    /// The rows of B and entries of C.
    pub singular: Vec<Average>,
    /// F of `initial.static_pressure` or, where that is 0, of what does not change with time in `[load]`, in N.
    pub load: Vec<f64>,
    /// Dofs that something bounds, ascending.
    pub bounded: Vec<usize>,
}

/// What a scene's effects make of a plate.
pub(super) struct Effects<E: Engine> {
    pub system: System<E>,
    pub start: Start,
    pub lifts: Vec<Lift>,
    /// The engine's deflections; the bounded ones come first, in the order of the bounds.
    pub sites: Vec<Site>,
    /// Seconds that the static start took.
    pub seconds: f64,
}

impl<T: Team> Ground<'_, T> {
    /// What this process's dofs add to the deflection at a point; `None` if another process says it. Collective.
    pub fn probe(&self, key: &str, [x, y]: [f64; 2]) -> Result<Option<Probe>> {
        let at = Point::new(x, y);
        let here = self.mesh.locate(at).is_some();
        let ranks = self.team.gather(&[f64::from(u8::from(here))]);
        match ranks.iter().position(|&here| here == 1.0) {
            Some(first) if first == self.team.rank() => Probe::new(self.mesh, self.space, at).map(Some),
            Some(_) => Ok(None),
            None => Err(Error::Mesh(format!("{key}: the point ({x}, {y}) lies outside the plate"))),
        }
    }

    /// The probe as numbers on the engine's dofs. Collective.
    pub fn own_probe(&self, key: &str, at: [f64; 2]) -> Result<Probe> {
        let mut local = vec![0.0; self.space.dofs()];
        if let Some(probe) = self.probe(key, at)? {
            probe.add_weights(&mut local);
        }
        Ok(Probe::from_weights(&(self.add_up)(&local)?))
    }

    /// The shape's deflection at a point of this process's cells, held dofs included.
    fn shape_at(&self, shape: &[f64], [x, y]: [f64; 2]) -> Result<f64> {
        let all = Space::unsupported(self.mesh);
        Ok(Probe::new(self.mesh, &all, Point::new(x, y))?.deflection(shape))
    }

    /// As [`Ground::shape_at`] on the process that says it, 0 on the others. Collective.
    pub fn share_at(&self, shape: &[f64], at: [f64; 2]) -> Result<f64> {
        self.probe("a probe", at)?.map_or(Ok(0.0), |_| self.shape_at(shape, at))
    }

    /// Deflection and slopes of a formula of place at all nodes, three a node.
    fn shape_of(&self, given: &Given) -> Result<Vec<f64>> {
        let nodes = &self.mesh.nodes;
        let mut shape = vec![0.0; PER_NODE * nodes.len()];
        if let Some(value) = given.number() {
            shape.iter_mut().step_by(PER_NODE).for_each(|w| *w = value);
            return Ok(shape);
        }
        let (mut low, mut high) = (Point::new(f64::MAX, f64::MAX), Point::new(f64::MIN, f64::MIN));
        for p in nodes {
            (low, high) = (low.inf(p), high.sup(p));
        }
        // Slopes by differences of order 4; this step leaves some 1e-12 of the slope's size.
        let h = STENCIL * (high - low).amax();
        for (node, &at) in nodes.iter().enumerate() {
            let w = |dx: f64, dy: f64| given.at(Point::new(at.x + dx * h, at.y + dy * h), 0.0);
            let slope = |[a, b, c, d]: [f64; 4]| (8.0 * (c - b) - (d - a)) / (12.0 * h);
            shape[PER_NODE * node] = w(0.0, 0.0)?;
            shape[PER_NODE * node + 1] = slope([w(-2.0, 0.0)?, w(-1.0, 0.0)?, w(1.0, 0.0)?, w(2.0, 0.0)?]);
            shape[PER_NODE * node + 2] = slope([w(0.0, -2.0)?, w(0.0, -1.0)?, w(0.0, 1.0)?, w(0.0, 2.0)?]);
        }
        Ok(shape)
    }

    /// Values over the space's dofs as those of the engine's that this process owns.
    fn owned(&self, local: &[f64], dofs: usize) -> Vec<f64> {
        let mut own = vec![0.0; dofs];
        for (dof, value) in local.iter().enumerate() {
            if let Some(dof) = (self.own)(dof) {
                own[dof] = *value;
            }
        }
        own
    }

    /// The balls of this process. Collective.
    fn riders(&self) -> Result<Vec<Rider<'_>>> {
        let mut riders = Vec::new();
        for (number, (ball, gap)) in self.scene.balls.iter().zip(self.gaps).enumerate() {
            let probe = self.probe(&format!("ball.{number}.at"), ball.at)?;
            riders.extend(probe.zip(*gap).map(|(probe, gap)| Rider { number, ball, probe, gap }));
        }
        Ok(riders)
    }

    /// The foundations' contributions to K, each with its cell. Collective.
    pub fn foundations(&self) -> Result<Vec<(usize, Block)>> {
        let foundations = &self.scene.foundations;
        if foundations.is_empty() {
            return Ok(Vec::new());
        }
        let reach = |(number, of): (usize, &scene::Foundation)| {
            body::cells_in(&of.region, self.mesh, self.team, &format!("foundation.{number}"))
        };
        let reaches: Vec<Vec<bool>> = foundations.iter().enumerate().map(reach).collect::<Result<_>>()?;
        assembly::foundation(self.mesh, self.cells, &|cell, at| {
            let mut sum = 0.0;
            for (of, _) in foundations.iter().zip(&reaches).filter(|(_, reach)| reach[cell]) {
                let stiffness = of.stiffness.at(at, 0.0)?;
                if stiffness < 0.0 {
                    let wrong = format!("{stiffness:?} N/m3 at ({}, {}); expected at least 0", at.x, at.y);
                    return Err(Error::Scene(format!("{}: {wrong}", of.stiffness.key)));
                }
                sum += stiffness;
            }
            Ok(sum)
        })
    }

    /// K: the plate, foundations and springs. Collective.
    pub fn stiffness(&self, foundations: &[(usize, Block)]) -> Result<Vec<Block>> {
        let mut blocks = assembly::stiffness(self.cells);
        blocks.extend(foundations.iter().map(|(_, block)| block.clone()));
        for (number, spring) in self.scene.springs.iter().enumerate() {
            let probe = self.probe(&format!("spring.{number}.at"), spring.at)?;
            blocks.extend(probe.map(|probe| probe.spring(spring.stiffness, self.class(number))));
        }
        Ok(blocks)
    }

    /// A class of its own for what is no cell.
    fn class(&self, number: usize) -> usize {
        BARE + 2 * self.cells.len() + number
    }

    /// What the plate carries, as far as this process has it. Collective.
    fn burdens(&self, riders: &[Rider]) -> Result<Vec<Burden>> {
        let mut burdens = Vec::new();
        for (number, &scene::PointMass { at, mass }) in self.scene.masses.iter().enumerate() {
            let probe = self.probe(&format!("mass.{number}.at"), at)?;
            burdens.extend(probe.map(|probe| Burden { probe, mass, at }));
        }
        for &Rider { ball: &scene::Ball { at, mass, .. }, ref probe, gap, .. } in riders {
            burdens.push(Burden { probe: probe.clone().with(gap, 1.0), mass, at });
        }
        Ok(burdens)
    }

    /// B and C: the plate and what it carries.
    fn singular_mass(&self, burdens: &[Burden]) -> Vec<Average> {
        let mut rows = assembly::singular_mass(self.cells);
        let row = |(k, Burden { probe, mass, .. }): (usize, &Burden)| probe.rider(*mass, self.class(k));
        rows.extend(burdens.iter().enumerate().map(row));
        rows
    }

    /// M_r: the plate and what it carries.
    fn consistent_mass(&self, burdens: &[Burden]) -> Vec<Block> {
        let mut blocks = assembly::consistent_mass(self.cells);
        let block = |(k, Burden { probe, mass, .. }): (usize, &Burden)| probe.spring(*mass, self.class(k));
        blocks.extend(burdens.iter().enumerate().map(block));
        blocks
    }

    /// All matrices.
    ///
    /// # Errors
    /// What the scene's formulas and regions say of the mesh.
    pub fn matrices(&self) -> Result<Matrices> {
        let riders = self.riders()?;
        let burdens = self.burdens(&riders)?;
        let initial = &self.scene.initial.static_pressure;
        let load = if initial.is_zero() {
            Pushes::new(self, &burdens)?.constant
        } else {
            Some(self.pressed(initial)?)
        };
        let reaches = reaches(self)?;
        let (sites, bounded) = sites(self, &reaches, &riders);
        Ok(Matrices {
            stiffness: self.stiffness(&self.foundations()?)?,
            consistent: self.consistent_mass(&burdens),
            singular: self.singular_mass(&burdens),
            load: load.unwrap_or_else(|| vec![0.0; self.space.dofs()]),
            bounded: sites[..bounded].iter().map(|site| site.dof).collect(),
        })
    }

    /// The load of a pressure that does not change with time, on the space's dofs.
    fn pressed(&self, pressure: &Given) -> Result<Vec<f64>> {
        let dofs = self.space.dofs();
        if let Some(pressure) = pressure.number() {
            return Ok(assembly::uniform_load(self.cells, dofs, pressure));
        }
        let points = Pressure::new(self.mesh, self.cells)?;
        let mut values = vec![0.0; points.points().len()];
        pressure.values(points.points(), 0.0, &mut values)?;
        let mut load = vec![0.0; dofs];
        points.add(&values, &mut load);
        Ok(load)
    }

    /// The rigid motions that nothing holds, in words. Collective.
    pub fn mechanism(&self, foundations: &[(usize, Block)]) -> Result<Option<&'static str>> {
        self.loose(foundations, &[])
    }

    /// The rigid motions that nothing holds, and that the singular mass does not feel either: the means over all cells vanish, as where a
    /// single row of cells turns about its middle. Collective.
    fn weightless(&self, foundations: &[(usize, Block)]) -> Result<Option<&'static str>> {
        let masses = self.scene.masses.iter().map(|mass| mass.at.into());
        let centres = (0..self.mesh.cells.len()).map(|cell| self.mesh.centroid(cell));
        self.loose(foundations, &masses.chain(centres).collect::<Vec<_>>())
    }

    /// The rigid motions left by what holds the plate and by some points at rest.
    fn loose(&self, foundations: &[(usize, Block)], at_rest: &[Point]) -> Result<Option<&'static str>> {
        let nodes = &self.mesh.nodes;
        let corner = |sign: f64, axis: usize| nodes.iter().map(|p| sign * p[axis]).fold(f64::MIN, f64::max);
        let corners = self.team.gather(&[corner(1.0, 0), corner(1.0, 1), corner(-1.0, 0), corner(-1.0, 1)]);
        let [right, top, left, bottom] =
            std::array::from_fn(|k| corners.iter().skip(k).step_by(4).copied().fold(f64::MIN, f64::max));
        let centre = Point::new(0.5 * (right - left), 0.5 * (top - bottom));
        let mut rigid = Rigid::new(centre, 0.5 * (right + left).hypot(top + bottom));
        for (node, hold) in self.holds.iter().enumerate().filter(|(_, hold)| hold.is_any()) {
            if (self.owns)(node) {
                rigid.hold(nodes[node], hold);
            }
        }
        for (number, spring) in self.scene.springs.iter().enumerate() {
            if self.probe(&format!("spring.{number}.at"), spring.at)?.is_some() {
                rigid.hold_deflection(spring.at.into());
            }
        }
        for (cell, _) in foundations {
            self.mesh.vertices(*cell).into_iter().for_each(|vertex| rigid.hold_deflection(vertex));
        }
        at_rest.iter().for_each(|&point| rigid.hold_deflection(point));
        let all = self.team.gather(rigid.seen());
        let sum: Vec<f64> = (0..9).map(|k| all.iter().skip(k).step_by(9).sum()).collect();
        rigid.see(&sum);
        Ok(rigid.mechanism())
    }
}

/// Step of the differences that give a formula's slopes, relative to the plate's size.
const STENCIL: f64 = 1e-3;

/// Composes the problem of a scene. Collective.
///
/// # Errors
/// What the scene's formulas and regions say of the mesh; [`Error::Singular`] where a static start is asked of a mechanism.
pub(super) fn compose<E: Engine<Form = Form> + 'static, T: Team>(
    engine: E,
    native: impl Fn(&E) -> &Native,
    ground: &Ground<T>,
) -> Result<Effects<E>>
where
    E::Factor: 'static,
{
    let Ground { scene, .. } = *ground;
    let riders = ground.riders()?;
    let foundations = ground.foundations()?;
    let mechanism = ground.mechanism(&foundations)?;
    if scene.time.mass == Mass::Singular
        && mechanism.is_some()
        && let Some(motion) = ground.weightless(&foundations)?
    {
        return Err(Error::Singular(format!(
            "a rigid motion has neither stiffness nor inertia: {motion}, and the mean velocity of no cell tells; \
             take more rows of cells, hold the plate, or set time.mass = \"consistent\""
        )));
    }
    let burdens = ground.burdens(&riders)?;
    let stiffness = native(&engine).form(ground.stiffness(&foundations)?);
    let mass = match scene.time.mass {
        Mass::Singular => native(&engine).averages(ground.singular_mass(&burdens)),
        Mass::Consistent => native(&engine).form(ground.consistent_mass(&burdens)),
    };
    let damping = scene
        .damping
        .as_ref()
        .map_or(Damping::default(), |damping| Damping { mass: damping.mass, stiffness: damping.stiffness });
    let mut system = System {
        engine,
        stiffness,
        mass,
        damping,
        load: None,
        bounds: Bounds::default(),
        drive: Drive::default(),
    };

    let lifts = lifts(&system, &native, ground, mechanism, &riders)?;
    let pushes = Pushes::new(ground, &burdens)?;
    system.load = pushes.constant.clone();
    let inertia = inertia(&system, ground, &lifts, &foundations, &burdens)?;
    if !(pushes.terms.is_empty() && pushes.waves.is_empty() && inertia.is_empty()) {
        system.drive.load = Some(Box::new(move |t, load: &mut [f64]| {
            pushes.add(t, load)?;
            for Inertia { motion, force, momentum } in &inertia {
                let jet = motion.jet(t)?;
                for ((load, k), m) in load.iter_mut().zip(force).zip(momentum) {
                    *load -= jet.value * k + jet.second * m;
                }
            }
            Ok(())
        }));
    }

    let reaches = reaches(ground)?;
    let (sites, bounded) = sites(ground, &reaches, &riders);
    let heights = Heights::new(ground, &reaches, &sites[..bounded], &lifts);
    let dofs = sites[..bounded].iter().map(|site| site.dof).collect();
    system.bounds = Bounds::uniform(dofs, f64::NEG_INFINITY, f64::INFINITY);
    // A ball's gap is bounded by 0, and small as long as it lies on the plate.
    let falls = scene.balls.iter().map(|ball| ball.height.abs().max(scene.plate.plate.thickness));
    system.bounds.size = falls.fold(0.0, f64::max);
    heights.set(0.0, &mut system.bounds)?;
    if scene.time.scheme == scene::Scheme::Conserving || scene.time.scheme == scene::Scheme::Exact {
        refuse_bounded_masses(scene, &burdens, &system.bounds, ground)?;
    }
    let moves = !lifts.is_empty() || scene.obstacles.iter().any(|obstacle| obstacle.height.changes());
    if moves && !system.bounds.is_empty() {
        system.drive.bounds = Some(Box::new(move |t, bounds: &mut Bounds| heights.set(t, bounds)));
    }
    let clock = Instant::now();
    let start = start(&system, &native, ground, mechanism, &riders, &lifts)?;
    Ok(Effects { system, start, lifts, sites, seconds: clock.elapsed().as_secs_f64() })
}

/// A mass where a node can be stopped has a velocity that must jump.
fn refuse_bounded_masses<T: Team>(
    scene: &Scene,
    burdens: &[Burden],
    bounds: &Bounds,
    ground: &Ground<T>,
) -> Result<()> {
    let stopped = |load: &Burden| match load.probe.weights() {
        [(dof, _)] => (ground.own)(*dof).is_some_and(|dof| bounds.dofs.binary_search(&dof).is_ok()),
        _ => false,
    };
    let any = ground.team.gather(&[f64::from(u8::from(burdens.iter().any(stopped)))]).contains(&1.0);
    if any {
        return Err(Error::Usage(format!(
            "time.scheme = \"{}\" needs velocities that do not jump, and a [[mass]] sits on a node that an obstacle can stop; \
             set time.scheme = \"newmark\"",
            scene.time.scheme.name()
        )));
    }
    Ok(())
}

/// Loads on the engine's dofs.
struct Pushes {
    /// What does not change with time.
    constant: Option<Vec<f64>>,
    /// g(t) times a load.
    terms: Vec<(Rc<Given>, Vec<f64>)>,
    /// Pressures that are no sum of such products: integrated anew each time.
    waves: Vec<Given>,
    pressure: Option<Pressure>,
    dofs: usize,
    add_up: Rc<AddUp>,
}

impl Pushes {
    fn new<T: Team>(ground: &Ground<T>, burdens: &[Burden]) -> Result<Pushes> {
        let Ground { scene, mesh, cells, space, add_up, .. } = ground;
        let dofs = space.dofs();
        let mut pushes = Pushes {
            constant: None,
            terms: Vec::new(),
            waves: Vec::new(),
            pressure: None,
            dofs,
            add_up: add_up.clone(),
        };
        let Some(load) = &scene.load else { return Ok(pushes) };
        let mut constant = vec![0.0; dofs];
        let add = |to: &mut [f64], what: &[f64]| to.iter_mut().zip(what).for_each(|(to, what)| *to += what);
        if load.gravity != 0.0 {
            add(&mut constant, &assembly::weight(cells, dofs, load.gravity));
            for Burden { probe, mass, .. } in burdens {
                probe
                    .weights()
                    .iter()
                    .for_each(|(dof, weight)| constant[*dof] -= mass * load.gravity * weight);
            }
        }
        if let Some(pressure) = load.pressure.number() {
            add(&mut constant, &assembly::uniform_load(cells, dofs, pressure));
        } else {
            let pressure = pushes.pressure.insert(Pressure::new(mesh, cells)?);
            let integral = |of: &Given| {
                let mut values = vec![0.0; pressure.points().len()];
                of.values(pressure.points(), 0.0, &mut values)?;
                let mut load = vec![0.0; dofs];
                pressure.add(&values, &mut load);
                Ok::<_, Error>(load)
            };
            match load.pressure.terms() {
                _ if !load.pressure.changes() => add(&mut constant, &integral(&load.pressure)?),
                None => pushes.waves.push(load.pressure.clone()),
                Some(terms) => {
                    for [time, place] in terms {
                        let load = integral(&place)?;
                        match time.number() {
                            Some(factor) => {
                                add(&mut constant, &load.iter().map(|f| factor * f).collect::<Vec<_>>());
                            }
                            None => pushes.terms.push((Rc::new(time), add_up(&load)?)),
                        }
                    }
                }
            }
        }
        for (number, force) in load.forces.iter().enumerate() {
            let mut unit = vec![0.0; dofs];
            if let Some(probe) = ground.probe(&format!("load.force.{number}.at"), force.at)? {
                probe.add_weights(&mut unit);
            }
            match force.value.number() {
                Some(value) => add(&mut constant, &unit.iter().map(|f| value * f).collect::<Vec<_>>()),
                None => pushes.terms.push((Rc::new(force.value.clone()), add_up(&unit)?)),
            }
        }
        let constant = add_up(&constant)?;
        let any = ground.team.gather(&[constant.iter().fold(0.0, |m: f64, f| m.max(f.abs()))]);
        pushes.constant = any.iter().any(|m| *m != 0.0).then_some(constant);
        Ok(pushes)
    }

    /// Adds the loads of an instant that change with time.
    fn add(&self, t: f64, load: &mut [f64]) -> Result<()> {
        for (factor, of) in &self.terms {
            let factor = factor.at(Point::origin(), t)?;
            load.iter_mut().zip(of).for_each(|(load, f)| *load += factor * f);
        }
        if let (false, Some(pressure)) = (self.waves.is_empty(), &self.pressure) {
            let mut values = vec![0.0; pressure.points().len()];
            let mut local = vec![0.0; self.dofs];
            for wave in &self.waves {
                wave.values(pressure.points(), t, &mut values)?;
                pressure.add(&values, &mut local);
            }
            load.iter_mut().zip((self.add_up)(&local)?).for_each(|(load, f)| *load += f);
        }
        Ok(())
    }
}

/// How the supports move: each motion with its lift. Collective.
fn lifts<E: Engine<Form = Form> + 'static, T: Team>(
    system: &System<E>,
    native: &impl Fn(&E) -> &Native,
    ground: &Ground<T>,
    mechanism: Option<&str>,
    riders: &[Rider],
) -> Result<Vec<Lift>>
where
    E::Factor: 'static,
{
    let Ground { scene, mesh, .. } = ground;
    let motions: Vec<Option<&Given>> = scene.supports.iter().map(|support| support.motion.as_ref()).collect();
    let mut different: Vec<&Given> = Vec::new();
    for motion in motions.iter().flatten() {
        if different.iter().all(|known| known.value != motion.value) {
            different.push(motion);
        }
    }
    let nodes = mesh.nodes.len();
    if let ([motion], true) = (&different[..], motions.iter().all(Option::is_some)) {
        // All move together: the plate with them, rigidly.
        let shape = [1.0, 0.0, 0.0].repeat(nodes);
        return Ok(vec![Lift { motion: Rc::new((*motion).clone()), shape }]);
    }
    if different.is_empty() {
        return Ok(Vec::new());
    }
    if let Some(motion) = mechanism {
        return Err(Error::Singular(format!(
            "support.motion: supports that move differently leave the plate a mechanism: {motion}"
        )));
    }
    let places = body::supports(scene, mesh, ground.team)?;
    let lift = |motion: &Given| {
        // The plate bends statically from held nodes that move to those that stand still.
        let mut moved = vec![0.0; nodes];
        for ((place, kind), own) in places.iter().zip(&motions) {
            if *kind != Support::Guided && own.is_some_and(|own| own.value == motion.value) {
                let held = match place {
                    Place::Edges(edges) => edges.concat(),
                    Place::Nodes(nodes) => nodes.clone(),
                };
                held.into_iter().for_each(|node| moved[node] = 1.0);
            }
        }
        let moved = ground.team.spread(&moved)?;
        let mut shape: Vec<f64> = moved.iter().flat_map(|&w| [w.min(1.0), 0.0, 0.0]).collect();
        let [force, _] = assembly::on_shape(mesh, ground.cells, ground.space.dofs(), &shape, false);
        let mut load = (ground.add_up)(&force)?;
        load.iter_mut().for_each(|f| *f = -*f);
        let (u, _, verdict) = statically(system, &native, ground, riders, &load, &Bounds::default())?;
        super::judge(0, 0.0, verdict.kkt, scene.solver.tolerance)?;
        let free = ground.space.shape(&system.engine.on_cells(&u)?);
        for (node, w) in moved.iter().enumerate() {
            for (k, value) in shape[PER_NODE * node..][..PER_NODE].iter_mut().enumerate() {
                if k > 0 || *w == 0.0 {
                    *value = free[PER_NODE * node + k];
                }
            }
        }
        Ok(Lift { motion: Rc::new(motion.clone()), shape })
    };
    different.into_iter().map(lift).collect()
}

/// What a motion of the supports does to the plate in their frame: K and M of its lift, on the engine's dofs.
struct Inertia {
    motion: Rc<Given>,
    force: Vec<f64>,
    momentum: Vec<f64>,
}

/// The inertia of each lift. Collective.
fn inertia<E: Engine, T: Team>(
    system: &System<E>,
    ground: &Ground<T>,
    lifts: &[Lift],
    foundations: &[(usize, Block)],
    burdens: &[Burden],
) -> Result<Vec<Inertia>> {
    let Ground { scene, mesh, cells, space, .. } = ground;
    let dofs = space.dofs();
    let load = |lift: &Lift| {
        let consistent = scene.time.mass == Mass::Consistent;
        let [mut force, mut momentum] = assembly::on_shape(mesh, cells, dofs, &lift.shape, consistent);
        for (cell, block) in foundations {
            let nodes = mesh.cells[*cell].nodes();
            let values: Vec<f64> =
                nodes.iter().flat_map(|&n| lift.shape[3 * n..3 * n + 3].to_vec()).collect();
            for (row, dof) in block.matrix.chunks_exact(values.len()).zip(block.dofs.iter()) {
                if let Some(dof) = dof {
                    force[*dof] += row.iter().zip(&values).map(|(a, x)| a * x).sum::<f64>();
                }
            }
        }
        for (number, spring) in scene.springs.iter().enumerate() {
            if let Some(probe) = ground.probe(&format!("spring.{number}.at"), spring.at)? {
                let pull = spring.stiffness * ground.shape_at(&lift.shape, spring.at)?;
                probe.weights().iter().for_each(|(dof, weight)| force[*dof] += pull * weight);
            }
        }
        for Burden { probe, mass, at } in burdens {
            let inert = mass * ground.shape_at(&lift.shape, *at)?;
            probe.weights().iter().for_each(|(dof, weight)| momentum[*dof] += inert * weight);
        }
        // A lift in equilibrium pulls by rounding only.
        let mut force = (ground.add_up)(&force)?;
        if system.engine.maximum(force.iter().fold(0.0, |m: f64, f| m.max(f.abs())))?
            <= STILL * scale(system)?
        {
            force.fill(0.0);
        }
        Ok(Inertia { motion: lift.motion.clone(), force, momentum: (ground.add_up)(&momentum)? })
    };
    lifts.iter().map(load).collect()
}

/// Forces below this part of the largest entry of K times a metre are none.
const STILL: f64 = 1e-9;

fn scale<E: Engine>(system: &System<E>) -> Result<f64> {
    let diagonal = system.engine.diagonal(&[(1.0, &system.stiffness)])?;
    system.engine.maximum(diagonal.into_iter().fold(0.0, f64::max))
}

/// An obstacle and the nodes of this process that it is opposite to.
struct Reach {
    side: Side,
    height: Rc<Given>,
    nodes: Vec<usize>,
}

fn reaches<T: Team>(ground: &Ground<T>) -> Result<Vec<Reach>> {
    let reach = |(number, obstacle): (usize, &scene::Obstacle)| {
        let key = format!("obstacle.{number}");
        let nodes = body::nodes_in(&obstacle.region, ground.mesh, ground.team, &key)?;
        Ok(Reach { side: obstacle.side, height: Rc::new(obstacle.height.clone()), nodes })
    };
    ground.scene.obstacles.iter().enumerate().map(reach).collect()
}

/// The engine's deflections: first those that something bounds, ascending dofs, then the others; and how many are bounded. The gap of
/// ball k goes as that of a node, the k-th past the mesh's last.
fn sites<T: Team>(ground: &Ground<T>, reaches: &[Reach], riders: &[Rider]) -> (Vec<Site>, usize) {
    let mesh = ground.mesh;
    let mut reached = vec![false; mesh.nodes.len()];
    reaches.iter().flat_map(|reach| &reach.nodes).for_each(|&node| reached[node] = true);
    let site = |node: usize| {
        let dof = (ground.own)(ground.space.deflection(node)?)?;
        (ground.owns)(node).then(|| (!reached[node], Site { dof, node, at: mesh.nodes[node].into() }))
    };
    let mut sites: Vec<(bool, Site)> = (0..mesh.nodes.len()).filter_map(site).collect();
    for rider in riders {
        let node = mesh.nodes.len() + rider.number;
        sites.extend((ground.own)(rider.gap).map(|dof| (false, Site { dof, node, at: rider.ball.at })));
    }
    sites.sort_by_key(|(free, site)| (*free, site.dof));
    let bounded = sites.iter().filter(|(free, _)| !free).count();
    (sites.into_iter().map(|(_, site)| site).collect(), bounded)
}

/// An obstacle, the bounds that it concerns, and where these are.
struct Opposite {
    side: Side,
    height: Rc<Given>,
    bounds: Vec<usize>,
    points: Vec<Point>,
}

/// Where the obstacles are at the bounded dofs of this process.
struct Heights {
    obstacles: Vec<Opposite>,
    /// Bounds of balls, with the side on which they are.
    balls: Vec<(usize, Side)>,
    /// Motions of the supports, with their lift at each bound.
    lifts: Vec<(Rc<Given>, Vec<f64>)>,
    places: Vec<[f64; 2]>,
}

impl Heights {
    fn new<T: Team>(ground: &Ground<T>, reaches: &[Reach], bounded: &[Site], lifts: &[Lift]) -> Heights {
        let nodes = ground.mesh.nodes.len();
        let mut bound_of = vec![None; nodes];
        let mut balls = Vec::new();
        for (bound, site) in bounded.iter().enumerate() {
            match site.node.checked_sub(nodes) {
                None => bound_of[site.node] = Some(bound),
                Some(ball) => balls.push((bound, ground.scene.balls[ball].side)),
            }
        }
        let obstacle = |reach: &Reach| {
            let bounds: Vec<usize> = reach.nodes.iter().filter_map(|&node| bound_of[node]).collect();
            let points = bounds.iter().map(|&bound| bounded[bound].at.into()).collect();
            Opposite { side: reach.side, height: reach.height.clone(), bounds, points }
        };
        let lift = |lift: &Lift| {
            let at = |site: &Site| lift.shape.get(PER_NODE * site.node).copied().unwrap_or(0.0);
            (lift.motion.clone(), bounded.iter().map(at).collect())
        };
        Heights {
            obstacles: reaches.iter().map(obstacle).collect(),
            balls,
            lifts: lifts.iter().map(lift).collect(),
            places: bounded.iter().map(|site| site.at).collect(),
        }
    }

    /// Sets the bounds of an instant, in the frame of the supports.
    fn set(&self, t: f64, bounds: &mut Bounds) -> Result<()> {
        bounds.lower.fill(f64::NEG_INFINITY);
        bounds.upper.fill(f64::INFINITY);
        for Opposite { side, height, bounds: members, points } in &self.obstacles {
            let mut values = vec![0.0; points.len()];
            height.values(points, t, &mut values)?;
            for (&bound, value) in members.iter().zip(values) {
                match side {
                    Side::Below => bounds.lower[bound] = bounds.lower[bound].max(value),
                    Side::Above => bounds.upper[bound] = bounds.upper[bound].min(value),
                }
            }
        }
        for (motion, lift) in &self.lifts {
            let moved = motion.at(Point::origin(), t)?;
            for ((lower, upper), lift) in bounds.lower.iter_mut().zip(&mut bounds.upper).zip(lift) {
                *lower -= lift * moved;
                *upper -= lift * moved;
            }
        }
        for (bound, side) in &self.balls {
            (bounds.lower[*bound], bounds.upper[*bound]) = match side {
                Side::Above => (0.0, f64::INFINITY),
                Side::Below => (f64::NEG_INFINITY, 0.0),
            };
        }
        let crossed = bounds.lower.iter().zip(&bounds.upper).position(|(lower, upper)| lower > upper);
        match crossed {
            None => Ok(()),
            Some(bound) => {
                let [x, y] = self.places[bound];
                Err(Error::Scene(format!(
                    "obstacle: at ({x}, {y}) those below and above leave no room at t = {t:?} s"
                )))
            }
        }
    }
}

/// The start under `[initial]`. Collective.
fn start<E: Engine<Form = Form> + 'static, T: Team>(
    system: &System<E>,
    native: &impl Fn(&E) -> &Native,
    ground: &Ground<T>,
    mechanism: Option<&str>,
    riders: &[Rider],
    lifts: &[Lift],
) -> Result<Start>
where
    E::Factor: 'static,
{
    let Ground { scene, space, .. } = ground;
    let initial = &scene.initial;
    let engine = &system.engine;
    let dofs = engine.dofs();
    let mut velocity = space.interpolate(&ground.shape_of(&initial.velocity)?);
    for Lift { motion, shape } in lifts {
        let rate = motion.jet(0.0)?.first;
        velocity.iter_mut().zip(space.interpolate(shape)).for_each(|(v, lift)| *v -= rate * lift);
    }
    let mut velocity = ground.owned(&velocity, dofs);
    let is_static = initial.equilibrium || !initial.static_pressure.is_zero();
    let mut displacement = if is_static {
        if let Some(motion) = mechanism {
            let key = if initial.equilibrium { "equilibrium" } else { "static_pressure" };
            return Err(Error::Singular(format!(
                "initial.{key}: the plate has no equilibrium, for its supports leave it a mechanism: {motion}"
            )));
        }
        at_rest(system, native, ground, riders)?
    } else {
        let shape = ground.shape_of(&initial.deflection)?;
        refuse_torn(ground, &shape)?;
        ground.owned(&space.interpolate(&shape), dofs)
    };
    // Balls: their gaps over the plate, and the rates of these.
    let (u, v) = (engine.on_cells(&displacement)?, engine.on_cells(&velocity)?);
    for Rider { ball, probe, gap, .. } in riders {
        let Some(dof) = (ground.own)(*gap) else { continue };
        let (mut height, mut rate) = (ball.height, ball.velocity);
        for Lift { motion, shape } in lifts {
            let (jet, lift) = (motion.jet(0.0)?, ground.shape_at(shape, ball.at)?);
            (height, rate) = (height - lift * jet.value, rate - lift * jet.first);
        }
        displacement[dof] = height - probe.deflection(&u);
        velocity[dof] = rate - probe.deflection(&v);
    }
    let violation = engine.maximum(system.bounds.violation(&displacement))?;
    let length =
        engine.maximum(displacement.iter().fold(system.bounds.magnitude(), |m, u| m.max(u.abs())))?;
    if violation > BEYOND * length {
        return Err(Error::Scene(format!(
            "initial: the plate starts {violation:.3e} m beyond an obstacle; expected a start within all of them"
        )));
    }
    Ok(Start { displacement, velocity })
}

/// A start counts as within the obstacles to this part of the deflection.
const BEYOND: f64 = 1e-9;

/// A deflection must be such as the supports allow.
fn refuse_torn<T: Team>(ground: &Ground<T>, shape: &[f64]) -> Result<()> {
    let largest = shape.iter().step_by(PER_NODE).fold(0.0, |m: f64, w| m.max(w.abs()));
    for (node, hold) in ground.holds.iter().enumerate() {
        let w = shape[PER_NODE * node];
        if hold.deflection > 0.0 && w.abs() > BEYOND * largest {
            let Point { coords } = ground.mesh.nodes[node];
            let wrong =
                format!("{w:?} m at ({}, {}), where a support holds the plate at 0", coords.x, coords.y);
            return Err(Error::Scene(format!("initial.deflection: {wrong}")));
        }
    }
    Ok(())
}

/// The equilibrium that the scene starts from; balls stay where they are.
fn at_rest<E: Engine<Form = Form> + 'static, T: Team>(
    system: &System<E>,
    native: &impl Fn(&E) -> &Native,
    ground: &Ground<T>,
    riders: &[Rider],
) -> Result<Vec<f64>>
where
    E::Factor: 'static,
{
    let Ground { scene, .. } = ground;
    let initial = &scene.initial;
    let local = ground.pressed(&initial.static_pressure)?;
    let mut load = (ground.add_up)(&local)?;
    if initial.equilibrium {
        let constant = system.load.iter().flatten();
        load.iter_mut().zip(constant).for_each(|(load, f)| *load += f);
        if let Some(drive) = &system.drive.load {
            drive(0.0, &mut load)?;
        }
    }
    // Nothing bounds or pushes a gap here.
    let mut bounds = system.bounds.clone();
    let gaps: Vec<usize> = riders.iter().filter_map(|rider| (ground.own)(rider.gap)).collect();
    let keep: Vec<bool> = bounds.dofs.iter().map(|dof| !gaps.contains(dof)).collect();
    for of in [&mut bounds.lower, &mut bounds.upper] {
        let mut keep = keep.iter();
        of.retain(|_| *keep.next().unwrap_or(&true));
    }
    bounds.dofs.retain(|dof| !gaps.contains(dof));
    gaps.iter().for_each(|&dof| load[dof] = 0.0);
    let (displacement, _, verdict) = statically(system, native, ground, riders, &load, &bounds)?;
    super::judge(0, 0.0, verdict.kkt, scene.solver.tolerance)?;
    Ok(displacement)
}

/// Equilibrium of the plate; balls stay where they are, for their gaps have a stiffness here. Collective.
fn statically<E: Engine<Form = Form> + 'static, T: Team>(
    system: &System<E>,
    native: &impl Fn(&E) -> &Native,
    ground: &Ground<T>,
    riders: &[Rider],
    load: &[f64],
    bounds: &Bounds,
) -> Result<(Vec<f64>, Vec<f64>, Verdict)>
where
    E::Factor: 'static,
{
    let held = (!ground.scene.balls.is_empty()).then(|| {
        let mut blocks = match &system.stiffness {
            Form::Cells(cells) => cells.blocks().to_vec(),
            Form::Averages(_) => Vec::new(),
        };
        blocks.extend(riders.iter().map(|rider| Block {
            dofs: [Some(rider.gap)].into(),
            matrix: [1.0].into(),
            arms: None,
            class: ground.class(ground.scene.springs.len() + rider.number),
        }));
        native(&system.engine).form(blocks)
    });
    let stiffness = held.as_ref().unwrap_or(&system.stiffness);
    scheme::equilibrium(&system.engine, stiffness, load, bounds)
}
