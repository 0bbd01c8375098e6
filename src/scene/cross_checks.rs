//! Checks that need several tables of a scene, once all of them are read.

use super::damping::ModalRatios;
use super::document::{Document, quote};
use super::{
    ContactSolver, EngineName, FORCE_COLUMNS, InPlane, Initial, LinearSolver, Mass, Massless, Obstacle,
    Probe, ProbeQuantity, Region, Scene, SchemeName, SchemeSpec, Side, StartFrom, Support, SupportLocation,
    ordinal,
};
use crate::error::Result;
use crate::field::MOST_LOOKS;
use crate::mesh::Point;

/// Refuses contradictions between the tables of a scene, and reports the first.
pub(super) fn check(doc: &Document, scene: &Scene) -> Result<()> {
    check_edges(doc, scene)?;
    check_room(doc, scene)?;
    check_names(doc, scene)?;
    check_start(doc, scene)?;
    check_from(doc, scene)?;
    check_jumps(doc, scene)?;
    check_accelerations(doc, scene)?;
    if scene.output.probes.is_empty() && scene.sweep.as_ref().is_some_and(|sweep| sweep.basins) {
        let wrong = "has nothing to tell motions apart; expected at least one of output.probes";
        return Err(doc.fault("sweep.basins", wrong));
    }
    scene.in_plane.iter().try_for_each(|in_plane| in_plane.check(doc))?;
    check_temperature(doc, scene)?;
    check_following(doc, scene)?;
    check_equilibrium(doc, scene)?;
    check_scheme(doc, scene)
}

/// Refuses a deflection beside an equilibrium that does not depend on where its search begins.
fn check_equilibrium(doc: &Document, scene: &Scene) -> Result<()> {
    let Initial { deflection, .. } = &scene.initial;
    if deflection.is_zero() || !scene.initial.is_static() || scene.stretches() {
        return Ok(());
    }
    let wrong = "contradicts a static start; expected either initial.deflection, \
                 or initial.static_pressure and initial.equilibrium";
    Err(doc.fault("initial.deflection", wrong))
}

/// Refuses a temperature without thermal expansion, and expansion without a temperature.
fn check_temperature(doc: &Document, scene: &Scene) -> Result<()> {
    let parts = scene.parts.iter().enumerate().map(|(index, part)| (format!("part.{index}"), &part.plate));
    let mut plates = std::iter::once(("plate".to_owned(), &scene.plate.plate)).chain(parts);
    match &scene.in_plane {
        Some(InPlane { temperature: Some(_), .. }) if plates.all(|(_, plate)| plate.expansion == 0.0) => {
            Err(doc.missing("plate.expansion", "expected a thermal expansion in 1/K"))
        }
        Some(InPlane { temperature: Some(_), .. }) => Ok(()),
        _ => plates.try_for_each(|(table, _)| {
            doc.forbid(&format!("{table}.expansion"), "has no use without in_plane.temperature")
        }),
    }
}

/// Refuses what a plate that stretches does not take, and supports in the plane of one that does
/// not.
fn check_in_plane(doc: &Document, scene: &Scene) -> Result<()> {
    for (index, support) in scene.supports.iter().enumerate().filter(|(_, one)| one.in_plane.is_some()) {
        let key = format!("support.{index}.in_plane");
        if !scene.in_plane.as_ref().is_some_and(InPlane::has_equilibrium) {
            let wrong = "has no use without in_plane.stretching, temperature or traction";
            return Err(doc.fault(&key, wrong));
        }
        if !matches!(support.stand, SupportLocation::Edge { .. }) {
            let wrong = "a point has no stiffness in the plane of a plate; expected a support along an edge";
            return Err(doc.fault(&key, wrong));
        }
    }
    let is_membrane = |probe: &Probe| matches!(probe.quantity, ProbeQuantity::Membrane(_));
    if let (None, Some(index)) = (&scene.in_plane, scene.output.probes.iter().position(is_membrane)) {
        return Err(doc.fault(&format!("output.probes.{index}.quantity"), "has no use without in_plane"));
    }
    if !scene.stretches() {
        return Ok(());
    }
    let name = scene.supports.iter().position(|support| support.name.is_some());
    let is_modal = scene.time.mass == Mass::Modal;
    let is_petsc = scene.solver.engine == EngineName::Petsc;
    let refused = match (is_modal, scene.time.scheme.name()) {
        (true, SchemeName::Conserving) if is_petsc => Some(("solver.engine".to_owned(), "\"native\"")),
        (false, SchemeName::Conserving | SchemeName::Newmark | SchemeName::Midpoint) => None,
        (true, SchemeName::Conserving) => {
            name.map(|index| (format!("support.{index}.name"), "supports without names"))
        }
        _ => {
            let schemes = "\"conserving\", or \"newmark\" or \"midpoint\" with a mass that is not modal";
            Some(("time.scheme".to_owned(), schemes))
        }
    };
    let motion = scene.motions().next().map(|motion| (motion.key.clone(), "supports at rest"));
    match refused.or(motion) {
        Some((key, expected)) => {
            Err(doc.fault(&key, format!("contradicts in_plane.stretching; expected {expected}")))
        }
        None => Ok(()),
    }
}

/// Refuses what does not go with a pressure that depends on the deflection.
fn check_following(doc: &Document, scene: &Scene) -> Result<()> {
    if !scene.load.as_ref().is_some_and(|load| load.pressure.follows_deflection()) {
        return Ok(());
    }
    let why = "contradicts a load.pressure that depends on w";
    if scene.time.scheme.name() == SchemeName::Exact {
        let wrong = format!("{why}; expected \"conserving\", \"newmark\" or \"midpoint\"");
        return Err(doc.fault("time.scheme", wrong));
    }
    if scene.time.mass == Mass::Modal {
        let wrong = format!("{why}; expected \"singular\" or \"consistent\"");
        return Err(doc.fault("time.mass", wrong));
    }
    if let SchemeSpec::Midpoint { massless: Massless::Equilibrium } = scene.time.scheme {
        return Err(doc.fault("time.massless", format!("{why}; expected \"reflected\"")));
    }
    match scene.motions().next() {
        Some(motion) => Err(doc.fault(&motion.key, format!("{why}; expected supports at rest"))),
        None => Ok(()),
    }
}

/// Refuses supports along a whole edge that another support holds.
fn check_edges(doc: &Document, scene: &Scene) -> Result<()> {
    for (index, support) in scene.supports.iter().enumerate() {
        let same = |other: &Support| other.stand == support.stand;
        if let SupportLocation::Edge { part: None, .. } = support.stand
            && let Some(first) = scene.supports[..index].iter().position(same)
        {
            let holder = ordinal("support", first, scene.supports[first].name.as_deref());
            let wrong = format!("{holder} already holds this edge; expected each edge once");
            return Err(doc.fault(&format!("support.{index}.edge"), wrong));
        }
    }
    Ok(())
}

/// Refuses a second rigid obstacle on one side of the whole plate, and two that leave no room.
fn check_room(doc: &Document, scene: &Scene) -> Result<()> {
    let planes = scene.obstacles.iter().enumerate();
    let planes = planes.filter(|(_, plane)| plane.region == Region::All && plane.compliance.is_none());
    for (index, plane) in planes.clone() {
        let key = |name: &str| format!("obstacle.{index}.{name}");
        for (earlier, other) in planes.clone().take_while(|(earlier, _)| *earlier < index) {
            if other.side == plane.side {
                let other = ordinal("obstacle", earlier, other.name.as_deref());
                let wrong = format!("{other} already lies on this side of the whole plate");
                let expected =
                    "expected where, group, at, point or line, for an obstacle opposite to a part of it";
                return Err(doc.fault(&key("side"), format!("{wrong}; {expected}")));
            }
            let (Some(height), Some(limit)) = (plane.height.number(), other.height.number()) else {
                continue;
            };
            if if plane.side == Side::Below { height > limit } else { height < limit } {
                let wrong = format!("{height:?} leaves no room beside the obstacle at {limit:?} m");
                let expected = "expected the one below lower than the one above";
                return Err(doc.fault(&key("height"), format!("{wrong}; {expected}")));
            }
        }
    }
    Ok(())
}

/// Refuses names of supports, obstacles, balls and sliders that occur twice, or whose columns are
/// named as probes.
fn check_names(doc: &Document, scene: &Scene) -> Result<()> {
    let keyed = |table: &'static str| move |(k, name): (usize, _)| (format!("{table}.{k}.name"), name);
    let supports = scene.supports.iter().map(|support| &support.name).enumerate().map(keyed("support"));
    let obstacles = scene.obstacles.iter().map(|obstacle| &obstacle.name).enumerate();
    let sliders = scene.sliders.iter().map(|slider| &slider.name).enumerate().map(keyed("slider"));
    let mut taken: Vec<(String, &String)> = Vec::new();
    let balls = scene.attachments.balls.iter().map(|ball| &ball.name).enumerate().map(keyed("ball"));
    for (key, name) in supports.chain(obstacles.map(keyed("obstacle"))).chain(balls).chain(sliders) {
        let Some(name) = name else { continue };
        if let Some((first, _)) = taken.iter().find(|(_, other)| *other == name) {
            let wrong = format!("{} is already {first}; expected unique names", quote(name));
            return Err(doc.fault(&key, wrong));
        }
        let columns = FORCE_COLUMNS.map(|quantity| format!("{quantity}_{name}"));
        if let Some(probe) = scene.output.probes.iter().find(|probe| columns.contains(&probe.name)) {
            let wrong = format!("its column {} is the name of a probe", quote(&probe.name));
            return Err(doc.fault(&key, format!("{wrong}; expected another name")));
        }
        taken.push((key, name));
    }
    Ok(())
}

/// Refuses a flat start beyond an obstacle.
fn check_start(doc: &Document, scene: &Scene) -> Result<()> {
    let Initial { static_pressure, equilibrium, deflection, from, .. } = &scene.initial;
    let moves = scene.supports.iter().any(|support| support.motion.is_some());
    if moves || from.is_some() || *equilibrium || !static_pressure.is_zero() || !deflection.is_zero() {
        return Ok(());
    }
    // A compliant stop may start compressed.
    let rigid = |(_, obstacle): &(usize, &Obstacle)| obstacle.compliance.is_none();
    for (index, Obstacle { side, height, .. }) in scene.obstacles.iter().enumerate().filter(rigid) {
        let Some(height) = height.number() else { continue };
        let (is_beyond, side, limit) = match side {
            Side::Below => (height > 0.0, "above", "at most"),
            Side::Above => (height < 0.0, "below", "at least"),
        };
        if is_beyond {
            let wrong = format!("{height:?} is {side} the plate, which starts flat at 0");
            let wrong = format!("{wrong}; expected {limit} 0, or a start by initial.static_pressure");
            return Err(doc.fault(&format!("obstacle.{index}.height"), wrong));
        }
    }
    Ok(())
}

/// Refuses keys that a start from another run excludes.
fn check_from(doc: &Document, scene: &Scene) -> Result<()> {
    let Some(StartFrom { folder, motion, .. }) = &scene.initial.from else { return Ok(()) };
    let refuse = |what: &str| Err(doc.fault("initial.from", format!("{} {what}", quote(folder))));
    if !scene.attachments.balls.is_empty() {
        return refuse("does not record balls; expected a scene without [[ball]]");
    }
    if !scene.sliders.is_empty() {
        return refuse("does not record how far sliders have slipped; expected a scene without [[slider]]");
    }
    if scene.motions().next().is_some() {
        return refuse("does not record supports that move; expected a scene whose supports stand still");
    }
    if motion.supports != scene.supports_in_words() {
        return refuse("is a run with other supports; expected the same [[support]]");
    }
    Ok(())
}

/// Refuses jumps of obstacles and supports, as far as they can be found without a mesh.
fn check_jumps(doc: &Document, scene: &Scene) -> Result<()> {
    let heights = scene.obstacles.iter().map(|obstacle| &obstacle.height);
    for given in scene.motions().chain(heights).filter(|given| given.is_even() && given.changes()) {
        if let Some(wrong) = given.jump(Point::origin(), &scene.time, MOST_LOOKS) {
            return Err(doc.fault(&given.key, wrong));
        }
    }
    Ok(())
}

/// Refuses accelerations of a mass that leaves part of the deflection without inertia.
fn check_accelerations(doc: &Document, scene: &Scene) -> Result<()> {
    if scene.time.mass != Mass::Singular {
        return Ok(());
    }
    let is_acceleration = |probe: &Probe| probe.quantity == ProbeQuantity::Acceleration;
    scene.output.probes.iter().position(is_acceleration).map_or(Ok(()), |index| {
        let wrong = "\"acceleration\" has no meaning with time.mass = \"singular\", whose velocities are means over cells; \
                     expected another quantity, or time.mass = \"consistent\" or \"modal\"";
        Err(doc.fault(&format!("output.probes.{index}.quantity"), wrong))
    })
}

/// Refuses what sliders exclude.
fn check_sliders(doc: &Document, scene: &Scene) -> Result<()> {
    let wrong = match scene.time.scheme {
        scheme if !scheme.capabilities().takes_sliders => Some((
            "time.scheme",
            format!(
                "\"{}\" keeps the energy, which a [[slider]] dissipates; expected \"newmark\" or \"midpoint\"",
                scheme.name()
            ),
        )),
        SchemeSpec::Midpoint { massless: Massless::Equilibrium } if scene.time.mass == Mass::Singular => {
            let others = "expected \"reflected\", or time.scheme = \"newmark\"";
            Some(("time.massless", format!("\"equilibrium\" takes no [[slider]]; {others}")))
        }
        _ => None,
    };
    wrong.map_or(Ok(()), |(key, wrong)| Err(doc.fault(key, wrong)))?;
    check_friction(doc, scene, ["a ", "[[slider]]"])?;
    let wrong = || "contradicts [[slider]], whose anchor is the ground; expected supports at rest".to_owned();
    scene.motions().next().map_or(Ok(()), |motion| Err(doc.fault(&motion.key, wrong())))
}

/// Refuses what dry friction excludes, by a slider or by an obstacle: its table or key, with an
/// article before it.
fn check_friction(doc: &Document, scene: &Scene, [article, subject]: [&str; 2]) -> Result<()> {
    let wrong = match scene.time.scheme {
        scheme if scheme.restitution().is_some_and(|e| e > 0.0) => Some((
            "time.restitution",
            format!("makes the node of {article}{subject} rebound where it should stick; expected 0"),
        )),
        _ if scene.time.mass == Mass::Modal => Some((
            "time.mass",
            format!("\"modal\" takes no {subject}; expected \"singular\" or \"consistent\""),
        )),
        _ => None,
    };
    wrong.map_or(Ok(()), |(key, wrong)| Err(doc.fault(key, wrong)))
}

/// Refuses what the friction of obstacles excludes, and velocities that nothing feels.
fn check_friction_of_obstacles(doc: &Document, scene: &Scene) -> Result<()> {
    for (number, obstacle) in scene.obstacles.iter().enumerate() {
        if obstacle.velocity.is_some() && obstacle.friction.is_none() {
            let wrong =
                format!("has no use without obstacle.{number}.friction; expected a coefficient beside it");
            return Err(doc.fault(&format!("obstacle.{number}.velocity"), wrong));
        }
    }
    let Some(number) = scene.frictional_obstacle() else { return Ok(()) };
    let key = format!("obstacle.{number}.friction");
    if scene.stretches() {
        let wrong = "contradicts in_plane.stretching: the forces of friction in the plane would strain it, and the pair is \
                     not built; expected one of the two";
        return Err(doc.fault(&key, wrong.to_owned()));
    }
    if !scene.time.scheme.capabilities().takes_friction {
        let name = scene.time.scheme.name();
        let others = "expected \"newmark\", \"midpoint\" or \"conserving\"";
        return Err(doc.fault("time.scheme", format!("\"{name}\" takes no {key}; {others}")));
    }
    check_friction(doc, scene, ["", &key])
}

/// Refuses combinations that the scheme does not support.
fn check_scheme(doc: &Document, scene: &Scene) -> Result<()> {
    let name = scene.time.scheme.name();
    let able = scene.time.scheme.capabilities();
    let damping = scene.damping.as_ref();
    let refuse = |key: &str, what: &str, others: &str| {
        Err(doc.fault(key, format!("time.scheme = \"{name}\" {what}; expected {others}")))
    };
    if !able.is_distributed && scene.solver.engine == EngineName::Petsc {
        let others = "\"native\", or time.scheme = \"newmark\"";
        return refuse("solver.engine", "runs on the native engine, in one process", others);
    }
    if scene.solver.linear == LinearSolver::Multigrid {
        let contact = scene.solver.vi;
        if scene.solver.engine == EngineName::Native {
            let wrong = "\"multigrid\" runs on PETSc; expected \"auto\", or solver.engine = \"petsc\"";
            return Err(doc.fault("solver.linear", wrong));
        }
        if contact != ContactSolver::Condensed {
            let wrong = format!(
                "multigrid keeps the sizes of its levels, and solver.vi = \"{contact}\" changes the sizes of its matrices with \
                 the contact; expected \"auto\", or solver.vi = \"condensed\""
            );
            return Err(doc.fault("solver.linear", wrong));
        }
    }
    if !able.takes_time_dependence
        && let Some(key) = scene.changes()
    {
        let what = "takes only what does not change with time";
        return refuse(&key, what, "time.scheme = \"conserving\" or \"newmark\"");
    }
    let is_modal = scene.time.mass == Mass::Modal;
    if !scene.attachments.dashpots.is_empty() && (is_modal || !able.takes_stop_damping[0]) {
        let [key, given, others] = match is_modal {
            true => ["time.mass", "modal", "\"singular\" or \"consistent\""],
            false => ["time.scheme", able.name, "\"newmark\" or \"midpoint\""],
        };
        return Err(doc.fault(key, format!("\"{given}\" takes no [[dashpot]]; expected {others}")));
    }
    if let Some(motion) = scene.motions().next().filter(|_| !scene.attachments.dashpots.is_empty()) {
        let wrong = "contradicts [[dashpot]], whose other end is the ground; expected supports at rest";
        return Err(doc.fault(&motion.key, wrong));
    }
    if let Some(key) = scene.stop_damping()
        && !able.takes_stop_damping[usize::from(is_modal)]
    {
        let (what, others) = match is_modal {
            true => (
                "with time.mass = \"modal\" follows no damped tips",
                "0, or time.scheme = \"conserving\", or time.mass = \"singular\" with \"newmark\" or \"midpoint\"",
            ),
            false => (
                "follows no damped tips",
                "0, or time.scheme = \"newmark\" or \"midpoint\", or \"conserving\" with time.mass = \"modal\"",
            ),
        };
        return refuse(&key, what, others);
    }
    if let Some((key, law)) = scene.yielding_stop()
        && !able.takes_laws
    {
        let wrong = format!(
            "\"{law}\" contradicts time.scheme = \"{name}\", which has closed forms for linear motions only; \
             expected \"linear\", or time.scheme = \"conserving\", \"midpoint\" or \"newmark\""
        );
        return Err(doc.fault(&key, wrong));
    }
    if !scene.sliders.is_empty() {
        check_sliders(doc, scene)?;
    }
    check_friction_of_obstacles(doc, scene)?;
    check_in_plane(doc, scene)?;
    let has_tips = scene.compliances().any(|(_, compliance)| compliance.has_tip());
    let massless = [(has_tips, "tips of compliant stops"), (is_modal, "rest of time.mass = \"modal\"")];
    if let SchemeSpec::Newmark { beta: 0.25, .. } = scene.time.scheme
        && let Some((_, part)) = massless.into_iter().find(|(is_there, _)| *is_there)
    {
        let wrong = format!("0.25 lets the massless {part} oscillate more and more");
        return Err(doc.fault("time.beta", format!("{wrong}; expected more than 0.25, such as 0.5")));
    }
    if matches!(damping.map(|damping| &damping.modal), Some(ModalRatios::All(_))) && !is_modal {
        let wrong = "one ratio for all modes needs modes that carry the inertia";
        let others = "an array of the ratios of the lowest modes, or time.mass = \"modal\"";
        return Err(doc.fault("damping.modal", format!("{wrong}; expected {others}")));
    }
    // Each mode with inertia has its own damping.
    if !(able.takes_any_damping || is_modal) {
        for (key, is_on) in [
            ("damping.stiffness", damping.is_some_and(|damping| damping.stiffness > 0.0)),
            ("damping.modal", damping.is_some_and(|damping| !damping.modal.is_none())),
        ] {
            if is_on {
                let others = "damping.mass alone, or time.scheme = \"newmark\" or \"midpoint\"";
                return refuse(key, "knows damping by mass only", others);
            }
        }
    }
    Ok(())
}
