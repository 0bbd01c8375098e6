//! Table `[time]`: scheme, mass matrix, step and end.

use super::quantities::{BETA, END, FREQUENCY, POINT_DAMPING, RESTITUTION, STEP, STIFFNESS_DAMPING};
use crate::error::Result;
use crate::modes::ModeRange;
use crate::scene::document::{Document, spell};
use crate::scene::keys::{TableKeys, ValueKind, key, words};
use crate::scene::typed::Choice;
use crate::scene::{Mass, Massless, SchemeName, SchemeSpec, Time};
use crate::scheme::registry::{Capabilities, SchemeOptions};

/// Limit on the number of steps: all smaller integers are exact floating-point numbers.
const TOO_MANY_STEPS: f64 = (1_u64 << 53) as f64;

/// Relative distance of the end from a whole number of steps that rounding of decimals explains.
const WHOLE: f64 = 1e-9;

pub(super) static TIME: TableKeys = TableKeys {
    groups: &[&[
        key(
            "scheme",
            ValueKind::Word(words::<SchemeName>),
            "time scheme; conserving keeps the energy at any step",
        ),
        key(
            "mass",
            ValueKind::Word(words::<Mass>),
            "mass matrix; modal: only the lowest modes carry inertia",
        ),
        key("modes", ValueKind::Count(1), "modal: number of modes; default 200, or a third of the dofs"),
        key(
            "up_to",
            ValueKind::Number(&FREQUENCY),
            "modal: all modes up to this frequency in Hz, in place of modes",
        ),
        key("beta", ValueKind::Number(&BETA), "newmark: default 0.5"),
        key("restitution", ValueKind::Number(&RESTITUTION), "newmark: the paper's e, 0 to 1; default 0"),
        key("massless", ValueKind::Word(words::<Massless>), "midpoint: treatment of the massless part"),
        key("step", ValueKind::Number(&STEP), "s"),
        key("end", ValueKind::Number(&END), "s, a whole number of steps"),
    ]],
    needed: &["scheme", "mass", "step", "end"],
    one_of: &[],
};

pub(super) fn read(doc: &Document) -> Result<Time> {
    doc.allow("time", &TIME)?;
    let time = Time {
        scheme: scheme(doc)?,
        mass: doc.choice("time.mass")?,
        modes: modes(doc)?,
        step: doc.number("time.step", &STEP)?,
        end: doc.number("time.end", &END)?,
    };
    let Time { step, end, .. } = time;
    if end < step {
        let wrong = format!("{end:?} is before the first step; expected at least time.step = {step:?} s");
        return Err(doc.fault("time.end", wrong));
    }
    if end / step >= TOO_MANY_STEPS {
        let wrong = format!("{step:?} makes {:.1e} steps to {end:?} s; expected less than 2^53", end / step);
        return Err(doc.fault("time.step", wrong));
    }
    whole_steps(doc, &time)?;
    Ok(time)
}

/// Refuses an end between two steps, and suggests values that fit.
fn whole_steps(doc: &Document, time: &Time) -> Result<()> {
    let Time { step, end, .. } = *time;
    let steps = end / step;
    if (steps - steps.round()).abs() <= WHOLE * steps {
        return Ok(());
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

/// Reads which modes carry the inertia, by number or by frequency; keys of the modal mass only.
fn modes(doc: &Document) -> Result<Option<ModeRange>> {
    let is_modal = doc.choice::<Mass>("time.mass")? == Mass::Modal;
    for key in ["time.modes", "time.up_to"] {
        if !is_modal {
            let wrong = "contradicts time.mass; expected only with \"modal\"".to_owned();
            doc.forbid_with("time.mass", key, wrong)?;
        }
    }
    if doc.get("time.modes").is_some() {
        doc.forbid_with(
            "time.modes",
            "time.up_to",
            "contradicts time.modes; expected one of them".to_owned(),
        )?;
    }
    if let Some(highest) = doc.optional_number("time.up_to", &FREQUENCY)? {
        return Ok(Some(ModeRange::UpTo(highest)));
    }
    let count = doc.optional_count("time.modes", "a number of modes", 1)?;
    Ok(count.map(|count| ModeRange::Count(usize::try_from(count).unwrap_or(usize::MAX))))
}

/// Reads the scheme with its options, which no other scheme takes.
fn scheme(doc: &Document) -> Result<SchemeSpec> {
    let name: SchemeName = doc.choice("time.scheme")?;
    let Capabilities { options, needs_singular_mass, .. } = name.capabilities();
    for of in SchemeName::ALL.into_iter().filter(|of| *of != name) {
        for key in of.capabilities().options {
            let (name, of) = (name.word(), of.word());
            let wrong = format!("contradicts time.scheme = \"{name}\"; expected only with \"{of}\"");
            doc.forbid_with("time.scheme", &format!("time.{key}"), wrong)?;
        }
    }
    let number = |key: &str, limits, default| match options.contains(&key) {
        true => Ok(doc.optional_number(&format!("time.{key}"), limits)?.unwrap_or(default)),
        false => Ok(default),
    };
    let scheme = name.with(SchemeOptions {
        beta: number("beta", &BETA, 0.5)?,
        restitution: number("restitution", &RESTITUTION, 0.0)?,
        massless: if options.contains(&"massless") { massless(doc)? } else { Massless::Reflected },
    });
    match needs_singular_mass {
        Some(why) if doc.choice::<Mass>("time.mass")? == Mass::Consistent => {
            let name = name.word();
            let wrong = format!("\"consistent\" contradicts time.scheme = \"{name}\": {why}");
            let expected = "expected \"singular\" or \"modal\", or time.scheme = \"newmark\"";
            Err(doc.fault("time.mass", format!("{wrong}; {expected}")))
        }
        _ => Ok(scheme),
    }
}

/// Reads the treatment of the massless part, whose default depends on mass and damping.
fn massless(doc: &Document) -> Result<Massless> {
    let mass: Mass = doc.choice("time.mass")?;
    if mass == Mass::Modal {
        return match doc.optional_choice("time.massless")? {
            Some(Massless::Reflected) => {
                let wrong =
                    "\"reflected\" contradicts time.mass = \"modal\", whose massless rest is in equilibrium";
                Err(doc.fault("time.massless", format!("{wrong}; expected \"equilibrium\"")))
            }
            _ => Ok(Massless::Equilibrium),
        };
    }
    let damped = doc.optional_number("damping.stiffness", &STIFFNESS_DAMPING)?.is_some_and(|beta| beta > 0.0);
    let has_dashpots = has_dashpots(doc, "obstacle")? || has_dashpots(doc, "ball")?;
    let own = if damped || has_dashpots { Massless::Reflected } else { mass.massless() };
    let massless = doc.optional_choice("time.massless")?.unwrap_or(own);
    if (own, massless) == (Massless::Reflected, Massless::Equilibrium) {
        let why = match mass {
            Mass::Consistent => "time.mass = \"consistent\", which leaves nothing massless",
            _ if has_dashpots => "the damping of a stop, under which the massless part is in no equilibrium",
            _ => "damping.stiffness, under which the massless part is in no equilibrium",
        };
        let wrong = format!("\"equilibrium\" contradicts {why}; expected \"reflected\"");
        return Err(doc.fault("time.massless", wrong));
    }
    Ok(massless)
}

/// Returns whether a table `[[name]]` has a stop with damping.
fn has_dashpots(doc: &Document, name: &str) -> Result<bool> {
    let mut is_any = false;
    for number in 0..doc.entries(name, &format!("expected tables [[{name}]]"))? {
        let damping = doc.optional_number(&format!("{name}.{number}.damping"), &POINT_DAMPING)?;
        is_any |= damping.is_some_and(|damping| damping > 0.0);
    }
    Ok(is_any)
}
