//! Tables `[[obstacle]]`: heights, the regions that can touch them, and their compliance.

use super::column::column;
use super::document::{Document, join};
use super::entry::{Entry, Kind, SceneText, Table, flat, table, via};
use super::given::{FieldInput, Region};
use super::kinds::{not_negative, number, positive, word};
use super::place::{SiteKeys, region, site_keys};
use super::words::{Choice, Side};
use crate::contact_law::{ContactLaw, StopLaw, StopLawSpec};
use crate::error::Result;
use crate::field::Names;
use std::sync::Arc;

table! {
    /// Obstacle: rigid, so that the plate cannot cross it, or a compliant stop that yields.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Obstacle {
        /// Name under which the forces of this obstacle are reported: columns of `history.csv`,
        /// `forces` in `summary.json`.
        name: Option<String> = column().optional();
        /// Side of the plate on which the obstacle lies: `"below"` or `"above"`.
        side: Side = word();
        /// Height, a field of x, y, t.
        height: FieldInput = number("a height", "m").field(Names::XYT);
        /// Region of the plate that can touch the obstacle.
        region: Region,
        /// Stiffness and damping of a compliant stop: per point (N/m, N s/m; N/m^1.5 for the law of
        /// Hertz), per length of a line (N/m2, N s/m2) or per area (N/m3, N s/m3); `None` for a
        /// rigid obstacle.
        compliance: Option<Compliance>,
        /// Position of its law, or of the table without one, for messages.
        position: SourcePosition = faced();
        /// Coefficient of friction (Coulomb) between the obstacle and the face of the plate; at
        /// least 0. The face slides as the plate turns, with an arm of half the thickness.
        friction: Option<f64> = not_negative("a coefficient of friction", "").optional();
        /// Velocity of the obstacle in its plane along x and y, each a field of x, y, t: a belt, a
        /// disc, a bow. Needs `friction`.
        velocity: Option<[FieldInput; 2]> = number("a velocity", "m/s").field(Names::XYT)
            .pair("expected [along x, along y] in m/s").optional();
    }
}

impl Obstacle {
    /// Returns the coefficient of friction where it is not 0.
    pub fn positive_friction(&self) -> Option<f64> {
        self.friction.filter(|coefficient| *coefficient > 0.0)
    }
}

/// Position in the text of a scene, in words. All positions compare as equal, so that scenes with
/// the same content do.
#[derive(Debug, Clone, Default)]
pub struct SourcePosition(pub String);

impl PartialEq for SourcePosition {
    fn eq(&self, _: &SourcePosition) -> bool {
        true
    }
}

/// Law, stiffness and damping of a compliant stop, with the units of [`Obstacle::compliance`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compliance {
    /// Law of the force.
    pub law: StopLaw,
    /// Stiffness, greater than 0.
    pub stiffness: f64,
    /// Damping beside the spring; 0 for the law of Hertz.
    pub damping: f64,
}

impl Compliance {
    /// Returns the law by which the bound yields; `None` for a linear stop, whose tip is bounded.
    pub fn contact_law(&self) -> Option<Arc<dyn ContactLaw>> {
        self.law.spec().law.map(|law| law(self.stiffness))
    }

    /// Returns whether a massless tip touches in place of the node or the ball.
    pub fn has_tip(&self) -> bool {
        self.law.spec().law.is_none()
    }
}

table! {
    /// Keys of what an obstacle faces, and of its compliance there.
    struct FacedKeys {
        /// Nodes that the obstacle faces.
        sites: SiteKeys = flat();
        /// Compliance.
        stop: StopKeys = flat();
    }
}

table! {
    /// Keys of a compliant stop.
    #[derive(Clone)]
    struct StopKeys {
        /// How the force of a compliant stop depends on its depth: `"linear"` (the default) or, at
        /// `at` and `point` and of balls, `"hertz"`.
        law: Option<StopLaw> = word().optional();
        /// N/m at a point and of a ball (N/m^1.5 with `"hertz"`), N/m2 along a `line`, N/m3
        /// otherwise; greater than 0: a compliant stop, as below. Without this key the stop is
        /// rigid.
        stiffness: Option<f64> = per_site(positive, "a stiffness", STIFFNESS).optional();
        /// N s/m, N s/m2, N s/m3; at least 0, by default 0, beside a `stiffness`, with `newmark`
        /// and `midpoint`, and with `conserving` on the modal mass; not with `"hertz"`.
        damping: Option<f64> = per_site(not_negative, "a damping", DAMPING).optional();
    }
}

/// Unit of a number of a stop, which depends on its law and on its site: a point (0), a line (1) or
/// an area (2).
type Unit = fn(StopLaw, usize) -> &'static str;

const STIFFNESS: Unit = |law, site| match law.spec() {
    StopLawSpec { unit, law: None, .. } => [unit, "N/m2", "N/m3"][site],
    StopLawSpec { unit, .. } => unit,
};
const DAMPING: Unit = |_, site| ["N s/m", "N s/m2", "N s/m3"][site];

/// Returns the kind of a number whose unit depends on the other keys of its table.
fn per_site(kind: fn(&str, &'static str) -> Kind<f64>, what: &'static str, unit: Unit) -> Kind<f64> {
    let read = move |doc: &Document, key: &str| {
        let table = key.rsplit_once('.').map_or("", |(table, _)| table);
        let is_given = |name: &str| doc.get(&join(table, name)).is_some();
        let (law, site) = law_and_site(doc.text(&join(table, "law"), "").unwrap_or_default(), is_given);
        (kind(what, unit(law, site)).read)(doc, key)
    };
    Kind { read: Box::new(read), unit: "", ..kind(what, unit(StopLaw::Linear, 2)) }
}

/// Returns the law of a name, linear by default, and the site of a stop whose table has some keys.
fn law_and_site(name: &str, is_given: impl Fn(&str) -> bool) -> (StopLaw, usize) {
    let law = StopLaw::ALL.into_iter().find(|law| law.word() == name).unwrap_or(StopLaw::Linear);
    let site = match (is_given("line"), is_given("at") || is_given("point")) {
        (true, _) => 1,
        (_, true) => 0,
        _ => 2,
    };
    (law, site)
}

/// Returns the units of a stop's stiffness and damping, given the name of its law and the keys of
/// its table.
pub fn compliance_units(law: &str, is_given: impl Fn(&str) -> bool) -> [&'static str; 2] {
    let (law, site) = law_and_site(law, is_given);
    [STIFFNESS, DAMPING].map(|unit| unit(law, site))
}

/// Region that an obstacle faces, its compliance there, and the position of its law.
fn faced() -> Entry<(Region, Option<Compliance>, SourcePosition)> {
    let read = |keys: FacedKeys, doc: &Document, table: &str| {
        let region = region(keys.sites, doc, table, SiteKeys::keys().names())?;
        let law = join(table, "law");
        let is_point = matches!(region, Region::At(_) | Region::Point(_));
        if let Some(given) = keys.stop.law.filter(|law| !is_point && law.spec().law.is_some()) {
            let wrong = format!(
                "\"{given}\" is the law of a contact at a point; expected at or point beside it, or \"linear\""
            );
            return Err(doc.fault(&law, wrong));
        }
        let compliance = compliance(keys.stop, doc, table)?;
        Ok((region, compliance, SourcePosition(doc.position(&law))))
    };
    let keys = |(region, compliance, _): &(Region, Option<Compliance>, SourcePosition)| FacedKeys {
        sites: site_keys(region),
        stop: stop_keys(compliance),
    };
    let write =
        move |_: &str, value: &(Region, Option<Compliance>, SourcePosition), lines: &mut SceneText| {
            keys(value).write(lines);
            let site = match value.0 {
                Region::At(_) | Region::Point(_) => 0,
                Region::Line(_) => 1,
                Region::All | Region::Where(_) | Region::Group(_) => 2,
            };
            units(&value.1, site, lines);
        };
    Entry { write: Box::new(write), ..via(read, keys) }
}

/// Compliance of a ball's contact point.
pub(super) fn contact_point() -> Entry<Option<Compliance>> {
    let write = |_: &str, compliance: &Option<Compliance>, lines: &mut SceneText| {
        stop_keys(compliance).write(lines);
        units(compliance, 0, lines);
    };
    Entry { write: Box::new(write), ..via(compliance, stop_keys) }
}

/// Adds the units to the rows of a stop, as comments.
fn units(compliance: &Option<Compliance>, site: usize, lines: &mut SceneText) {
    let law = compliance.map_or(StopLaw::Linear, |compliance| compliance.law);
    lines.says("stiffness", STIFFNESS(law, site));
    lines.says("damping", DAMPING(law, site));
}

/// Returns the compliance of a stop; `None` for a rigid one.
fn compliance(keys: StopKeys, doc: &Document, table: &str) -> Result<Option<Compliance>> {
    let [law_key, stiffness_key, damping_key] = ["law", "stiffness", "damping"].map(|name| join(table, name));
    let StopKeys { law, stiffness, damping } = keys;
    let law = law.unwrap_or(StopLaw::Linear);
    if law.spec().law.is_some() {
        let kind = per_site(positive, "a stiffness", STIFFNESS);
        let stiffness = stiffness.map_or_else(|| (kind.read)(doc, &stiffness_key), Ok)?;
        let wrong = format!("has no meaning beside law = \"{law}\", an elastic contact");
        doc.forbid(&damping_key, format!("{wrong}; expected it with law = \"linear\" only"))?;
        return Ok(Some(Compliance { law, stiffness, damping: 0.0 }));
    }
    let Some(stiffness) = stiffness else {
        for key in [&law_key, &damping_key] {
            doc.forbid(key, format!("has no use without {stiffness_key}; expected a stiffness beside it"))?;
        }
        return Ok(None);
    };
    Ok(Some(Compliance { law, stiffness, damping: damping.unwrap_or(0.0) }))
}

fn stop_keys(compliance: &Option<Compliance>) -> StopKeys {
    StopKeys {
        law: compliance.filter(|stop| !stop.has_tip()).map(|stop| stop.law),
        stiffness: compliance.map(|stop| stop.stiffness),
        damping: compliance.filter(Compliance::has_tip).map(|stop| stop.damping),
    }
}
