//! Table `[time]`: scheme, mass matrix, step and end.

use super::document::{Document, Value, join, spell};
use super::entry::{Kind, table, via};
use super::given::FieldInput;
use super::kinds::{count, positive, within, word};
use super::{Mass, Massless, SchemeName, SchemeSpec};
use crate::error::Result;
use crate::field::{Break, Missed};
use crate::mesh::Point;
use crate::modes::ModeRange;
use crate::scheme::registry::{Capabilities, SchemeOptions};

/// Limit on the number of steps: all smaller integers are exact floating-point numbers.
const TOO_MANY_STEPS: f64 = (1_u64 << 53) as f64;

/// Relative distance of the end from a whole number of steps that rounding of decimals explains.
const WHOLE: f64 = 1e-9;

table! {
    /// Time scheme and its steps.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Time {
        /// Time scheme.
        scheme: SchemeSpec,
        /// Mass matrix.
        mass: Mass,
        /// Modes that carry the inertia with the modal mass; `None` for a number that suits the
        /// mesh.
        modes: Option<ModeRange> = via(chosen, method);
        /// Time step; greater than 0.
        step: f64 = step();
        /// End time, a whole number of steps, with a relative tolerance of 1e-9; the error
        /// otherwise names the two nearest steps and ends that fit. Less than 2^53 steps.
        end: f64 = positive("an end time", "s");
    } then stepped
}

table! {
    /// Scheme, mass and their options, as a scene gives them.
    struct Method {
        /// Time scheme: `"newmark"`, `"midpoint"`, `"conserving"`, which keeps the energy at any
        /// step, or `"exact"`.
        scheme: SchemeName = word();
        /// Mass matrix: `"singular"`, `"consistent"` (`newmark` and `midpoint`), or `"modal"`: the
        /// lowest modes carry all inertia, see [schemes](schemes.md).
        mass: Mass = word();
        /// `"modal"`: number of modes, rigid motions included, by default 200, or a third of the
        /// dofs; at most half of the dofs, compliant stops not counted. They are [kept between
        /// runs](running.md#kept-modes).
        modes: Option<usize> = count("a number of modes", 1).says("number of modes with inertia").optional();
        /// `"modal"`, instead of `modes`: all modes up to this frequency.
        up_to: Option<f64> = positive("a frequency", "Hz")
            .says("Hz, highest frequency with inertia").optional();
        /// `newmark`: at least 0.25, and more than that with `"modal"`; by default 0.5.
        beta: Option<f64> = within("Newmark's beta", "", &[("minimum", 0.25)]).optional();
        /// `newmark`: the paper's e, from 0 to 1; by default 0.
        restitution: Option<f64> = restitution().says("0 to 1").optional();
        /// `midpoint`: `"equilibrium"` (the default for the singular mass without stiffness
        /// damping, and only for it; the only choice with `"modal"`) or `"reflected"`.
        massless: Option<Massless> = word().optional();
    }
}

/// Time step.
pub(super) fn step() -> Kind<f64> {
    positive("a time step", "s")
}

/// Coefficient of restitution e.
pub(super) fn restitution() -> Kind<f64> {
    within("a restitution coefficient", "", &[("minimum", 0.0), ("maximum", 1.0)])
}

impl Time {
    /// Returns the number of factors, all of the same size, that the scheme holds at once.
    pub fn factors(&self) -> usize {
        let [singular, consistent] = self.scheme.capabilities().factors;
        match self.mass {
            Mass::Singular => singular,
            Mass::Consistent => consistent,
            // The factor of K serves the modes and the compliance of the rest.
            Mass::Modal => 1,
        }
    }

    /// Returns the number of steps, `end / step` rounded to the nearest integer.
    pub fn steps(&self) -> u64 {
        (self.end / self.step).round() as u64
    }
}

impl Mass {
    /// Returns whether the mass leaves part of the displacement without inertia.
    pub fn is_singular(self) -> bool {
        self != Mass::Consistent
    }

    /// Returns the midpoint scheme's default treatment of the massless part of the displacement.
    pub fn massless(self) -> Massless {
        match self {
            Mass::Singular | Mass::Modal => Massless::Equilibrium,
            Mass::Consistent => Massless::Reflected,
        }
    }
}

impl FieldInput {
    /// Describes the first jump at a place (m) before the end, with a remedy; `None` without one.
    ///
    /// The search takes at most `looks` evaluations.
    pub fn jump(&self, place: Point, time: &Time, looks: usize) -> Option<String> {
        let breaks = self.breaks(place, time.end, looks);
        let Break { time: instant, jump, .. } = breaks.found.into_iter().find(|entry| entry.jump != 0.0)?;
        let place = if self.is_even() { String::new() } else { format!(" at ({}, {})", place.x, place.y) };
        let [jump, ramp] = [jump, 10.0 * time.step].map(|x| format!("{x:.5e}").parse().unwrap_or(x));
        Some(format!(
            "jumps by {jump:?} m at t = {instant:?} s{place}, which nothing rigid can do; expected no jump, such as a ramp over 10 \
             steps: {jump:?}*clamp((t - {instant:?})/{ramp:?}, 0, 1)"
        ))
    }

    /// Returns where steps miss most of the field less a constant, at a place (m); see
    /// [`Field::missed`](crate::field::Field::missed).
    pub fn missed(&self, place: Point, less: f64, time: &Time) -> Option<Missed> {
        let (step, steps) = (time.step, time.steps());
        let Some(table) = &self.table else { return self.formula.missed(place, less, step, steps) };
        table.rows.missed(less / self.formula.value(place, 0.0).ok()?, step, steps)
    }
}

/// Refuses an end that is no whole number of steps, and suggests values that fit.
fn stepped(time: Time, doc: &Document, _: &str) -> Result<Time> {
    let Time { step, end, .. } = time;
    let steps = end / step;
    if end < step {
        let wrong = format!("{end:?} is before the first step; expected at least time.step = {step:?} s");
        return Err(doc.fault("time.end", wrong));
    }
    if steps >= TOO_MANY_STEPS {
        let wrong = format!("{step:?} makes {steps:.1e} steps to {end:?} s; expected less than 2^53");
        return Err(doc.fault("time.step", wrong));
    }
    if (steps - steps.round()).abs() <= WHOLE * steps {
        return Ok(time);
    }
    // Twelve digits pass the check and stay short for round numbers.
    let tidy = |value: f64| spell(format!("{value:.11e}").parse().unwrap_or(value));
    let counts = [steps.floor(), steps.floor() + 1.0];
    let [long, short] = counts.map(|count| tidy(end / count));
    let [before, after] = counts.map(|count| tidy(count * step));
    let is_of_step = doc.is_overridden("time.step") && !doc.is_overridden("time.end");
    let key = if is_of_step { "time.step" } else { "time.end" };
    let wrong = format!("{end:?} s is no whole number of steps of {step:?} s, but {steps:.6} of them");
    let expected = format!("expected time.step = {long} or {short}, or time.end = {before} or {after}");
    Err(doc.fault(key, format!("{wrong}; {expected}")))
}

/// Returns the scheme with its options, the mass, and the modes that carry inertia.
fn chosen(method: Method, doc: &Document, table: &str) -> Result<(SchemeSpec, Mass, Option<ModeRange>)> {
    let Method { scheme: name, mass, .. } = method;
    let Capabilities { options, needs_singular_mass, .. } = name.capabilities();
    for other in SchemeName::ALL.into_iter().filter(|other| *other != name) {
        for key in other.capabilities().options {
            let wrong = format!("contradicts time.scheme = \"{name}\"; expected only with \"{other}\"");
            doc.forbid_with("time.scheme", &join(table, key), wrong)?;
        }
    }
    let is_midpoint = options.contains(&"massless");
    let scheme = name.with(SchemeOptions {
        beta: method.beta.unwrap_or(0.5),
        restitution: method.restitution.unwrap_or(0.0),
        massless: if is_midpoint { massless(doc, &method)? } else { Massless::Reflected },
    });
    if let Some(why) = needs_singular_mass
        && mass == Mass::Consistent
    {
        let wrong = format!("\"consistent\" contradicts time.scheme = \"{name}\": {why}");
        let expected = "expected \"singular\" or \"modal\", or time.scheme = \"newmark\"";
        return Err(doc.fault("time.mass", format!("{wrong}; {expected}")));
    }
    Ok((scheme, mass, modes(doc, &method)?))
}

fn method((scheme, mass, modes): &(SchemeSpec, Mass, Option<ModeRange>)) -> Method {
    let (beta, restitution, massless) = match *scheme {
        SchemeSpec::Newmark { beta, restitution } => (Some(beta), Some(restitution), None),
        SchemeSpec::Midpoint { massless } => (None, None, Some(massless)),
        SchemeSpec::Conserving | SchemeSpec::Exact => (None, None, None),
    };
    let (modes, up_to) = match *modes {
        Some(ModeRange::Count(count)) => (Some(count), None),
        Some(ModeRange::UpTo(highest)) => (None, Some(highest)),
        None => (None, None),
    };
    Method { scheme: scheme.name(), mass: *mass, modes, up_to, beta, restitution, massless }
}

/// Returns which modes carry the inertia, by number or by frequency; keys of the modal mass only.
fn modes(doc: &Document, method: &Method) -> Result<Option<ModeRange>> {
    let is_modal = method.mass == Mass::Modal;
    for key in ["time.modes", "time.up_to"].into_iter().filter(|_| !is_modal) {
        doc.forbid_with("time.mass", key, "contradicts time.mass; expected only with \"modal\"")?;
    }
    if doc.get("time.modes").is_some() {
        doc.forbid_with("time.modes", "time.up_to", "contradicts time.modes; expected one of them")?;
    }
    Ok(method.up_to.map(ModeRange::UpTo).or(method.modes.map(ModeRange::Count)))
}

/// Returns the treatment of the massless part, whose default depends on mass and damping.
fn massless(doc: &Document, method: &Method) -> Result<Massless> {
    if method.mass == Mass::Modal {
        if method.massless == Some(Massless::Reflected) {
            let wrong =
                "\"reflected\" contradicts time.mass = \"modal\", whose massless rest is in equilibrium";
            return Err(doc.fault("time.massless", format!("{wrong}; expected \"equilibrium\"")));
        }
        return Ok(Massless::Equilibrium);
    }
    let is_positive = |key: &str| doc.figure(key).is_some_and(|damping| damping > 0.0);
    let has_dashpot = |table: &str| {
        let number = doc.entries(table, "").unwrap_or(0);
        (0..number).any(|index| is_positive(&format!("{table}.{index}.damping")))
    };
    let has_dashpots = ["obstacle", "ball", "dashpot"].into_iter().any(has_dashpot);
    let is_damped = has_dashpots || is_positive("damping.stiffness");
    let stretches = matches!(doc.value("in_plane.stretching"), Some(Value::Truth(true)));
    let usual = if is_damped || stretches { Massless::Reflected } else { method.mass.massless() };
    let massless = method.massless.unwrap_or(usual);
    if (usual, massless) == (Massless::Reflected, Massless::Equilibrium) {
        let why = match method.mass {
            Mass::Consistent => "time.mass = \"consistent\", which leaves nothing massless",
            _ if has_dashpots => "a dashpot, under which the massless part is in no equilibrium",
            _ if stretches => "in_plane.stretching, which the scheme knows at the middle of a step only",
            _ => "damping.stiffness, under which the massless part is in no equilibrium",
        };
        let wrong = format!("\"equilibrium\" contradicts {why}; expected \"reflected\"");
        return Err(doc.fault("time.massless", wrong));
    }
    Ok(massless)
}
