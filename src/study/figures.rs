//! Figures of the paper, drawn again, and tests of its claims.
//!
//! The paper is C. Pozzolini, Y. Renard, M. Salaün, *Schémas asymptotiquement conservatifs en
//! énergie dans un problème de vibro-impact de plaques*, CSMA 2013, section 5. Its figures show the
//! deflection of the tip (1 and 2), the energy with Newmark's scheme (3 and 4) and the energy with
//! the midpoint scheme (5 and 6), on triangles (odd numbers) and quadrilaterals (even numbers). The
//! scenes are those of `scenes/csma2013`.

use super::accuracy::run_native;
use super::accuracy::trajectory::Trajectory;
use crate::element::ElementKind;
use crate::error::{Error, Result};
use crate::output::plot::{Axis, Curve, Figure, Obstacle, Panel};
use crate::output::text::significant;
use crate::scene::{Scene, SchemeSpec};
use crate::scheme::{Newmark, NewmarkParameters, Scheme as _, Solution as _};
use crate::simulation::{Model, Outcome};
use serde::Serialize;
use std::collections::HashMap;
use std::fmt;
use std::path::Path;
use std::rc::Rc;

const SCENES: [&str; 6] = [
    include_str!("../../scenes/csma2013/fig1.toml"),
    include_str!("../../scenes/csma2013/fig2.toml"),
    include_str!("../../scenes/csma2013/fig3.toml"),
    include_str!("../../scenes/csma2013/fig4.toml"),
    include_str!("../../scenes/csma2013/fig5.toml"),
    include_str!("../../scenes/csma2013/fig6.toml"),
];

/// Time steps of the energies, in s.
const STEPS: [f64; 5] = [1e-4, 5e-5, 1e-5, 5e-6, 1e-6];
/// Time steps that a figure draws, in s; more curves would overlap.
const DRAWN: [f64; 4] = [1e-4, 1e-5, 5e-6, 1e-6];
/// Time step of the deflections in the paper, in s.
const PAPER_STEP: f64 = 5e-6;
/// Number of steps from which the claims are judged.
const FEWEST_JUDGED: usize = 3;
/// Relative change of the energy that rounding explains, in half a million steps.
const ROUNDING: f64 = 1e-9;
/// Time between rows, in s.
const ROWS: f64 = 1e-4;

/// Element with the numbers of its figures: deflection, Newmark's energy, midpoint energy.
const ELEMENTS: [(ElementKind, [usize; 3]); 2] =
    [(ElementKind::Hct, [1, 3, 5]), (ElementKind::Fvs, [2, 4, 6])];

/// Number of rectangles of the paper's meshes, 10 x 4.
const RECTANGLES: usize = 40;

/// Variant of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Kind {
    /// Newmark scheme with e = 0 and the singular mass.
    Absorbing,
    /// Newmark scheme with e = 1 and the singular mass.
    Bouncing,
    /// Newmark scheme with e = 0 and the consistent mass.
    Consistent,
    /// Midpoint scheme with the singular mass.
    Midpoint,
    /// Conserving scheme, which is not in the paper.
    Conserving,
    /// Exact scheme, which is not in the paper.
    Exact,
}

impl Kind {
    /// Returns the index of the curve style, if it is the same in all figures.
    fn style(self) -> Option<usize> {
        match self {
            Kind::Conserving => Some(5),
            Kind::Exact => Some(6),
            _ => None,
        }
    }

    /// Returns the scene of one of the paper's figures with this variant and step.
    fn scene(self, figure: usize, step: f64) -> Result<Scene> {
        let changes = match self {
            Kind::Absorbing => &["time.restitution=0"][..],
            Kind::Bouncing => &["time.restitution=1"],
            Kind::Consistent => &["time.restitution=0", "time.mass=consistent"],
            Kind::Midpoint => &[],
            Kind::Conserving => &["time.scheme=conserving"],
            Kind::Exact => &["time.scheme=exact"],
        };
        let every = (ROWS / step).round().max(1.0);
        let timing = [format!("time.step={step:e}"), format!("output.every={every}")];
        let overrides: Vec<String> = changes.iter().map(ToString::to_string).chain(timing).collect();
        let mut scene = Scene::from_str(SCENES[figure - 1], &format!("fig{figure}.toml"), &overrides)?;
        scene.title = String::new();
        Ok(scene)
    }
}

/// Recorded run with its outcome.
type Recorded = Rc<(Trajectory, Outcome)>;

/// Cache of runs that figures and claims share.
struct Runs<'w> {
    known: HashMap<String, Recorded>,
    starts: &'w mut dyn FnMut(&str),
}

impl Runs<'_> {
    fn get(&mut self, figure: usize, kind: Kind, step: f64) -> Result<Recorded> {
        let scene = kind.scene(figure, step)?;
        let name = scene.resolved();
        if let Some(run) = self.known.get(&name) {
            return Ok(run.clone());
        }
        (self.starts)(&format!("figure {figure}, {} s", significant(step)));
        let run = Rc::new(run_native(&scene, false)?);
        self.known.insert(name, run.clone());
        Ok(run)
    }
}

/// Verdict on a claim of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Claim that holds.
    Holds,
    /// Claim that does not hold.
    Fails,
    /// Claim that the steps are too few to judge.
    NotJudged,
}

/// Claim of the paper's section 5, with the measurements.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Claim {
    /// Text of the claim.
    pub claim: &'static str,
    /// Measurements in words.
    pub measured: Vec<String>,
    /// Verdict on the claim.
    pub verdict: Verdict,
}

/// Claims of the paper.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Claims(pub Vec<Claim>);

impl fmt::Display for Claims {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for (number, Claim { claim, measured, verdict }) in self.0.iter().enumerate() {
            let verdict = match verdict {
                Verdict::Holds => "holds",
                Verdict::Fails => "FAILS",
                Verdict::NotJudged => "not judged, the steps are too few",
            };
            writeln!(f, "{}  {claim}: {verdict}", number + 1)?;
            for line in measured {
                writeln!(f, "   {line}")?;
            }
        }
        Ok(())
    }
}

/// Returns whether a file name is that of a figure.
pub fn is_one(name: &str) -> bool {
    name.starts_with("fig") && (name.ends_with(".svg") || name.ends_with(".png"))
}

/// Draws the figures into a folder and tests the claims, with steps of at least `smallest` (in s).
///
/// # Errors
/// Returns [`Error::Usage`] where no step is left, the error that ends a run, and [`Error::Io`]
/// where a file cannot be written.
pub fn figures(folder: &Path, smallest: f64, command: &str, starts: &mut dyn FnMut(&str)) -> Result<Claims> {
    if STEPS.iter().filter(|step| **step >= smallest).count() < 2 {
        return Err(Error::Usage(format!(
            "--smallest-step {smallest:e} leaves fewer than two steps, which show no trend; expected at most {:e} s",
            STEPS[1]
        )));
    }
    let mut runs = Runs { known: HashMap::new(), starts };
    for (element, [deflection, newmark, midpoint]) in ELEMENTS {
        let steps: Vec<f64> = DRAWN.into_iter().filter(|step| *step >= smallest).collect();
        for (others, name, beyond) in
            [(&[][..], "", ""), (&[Kind::Exact, Kind::Conserving], "-more", ", with conserving and exact")]
        {
            let draw = |number: usize, what: &str, panels: Vec<Panel>| {
                let cells = RECTANGLES * element.shape().per_rectangle();
                let cell_name = element.title();
                let title = format!("CSMA 2013, figure {number}: {what}, {cells} {cell_name}{beyond}");
                let file = folder.join(format!("fig{number}{name}"));
                panels.into_iter().fold(Figure::new(title).note(command), Figure::panel).write(&file)
            };
            let mut energies = |figure, heading: &str, kinds: &[Kind]| {
                energies(&mut runs, figure, heading, &[kinds, others].concat(), &steps)
            };
            let absorbing = energies(newmark, "(a) e = 0", &[Kind::Absorbing, Kind::Consistent])?;
            let bouncing = energies(newmark, "(b) e = 1", &[Kind::Bouncing])?;
            draw(newmark, "energy, Newmark", vec![absorbing, bouncing])?;
            draw(midpoint, "energy, midpoint", vec![energies(midpoint, "", &[Kind::Midpoint])?])?;
            let step = PAPER_STEP.max(smallest);
            let panel = deflections(&mut runs, deflection, step, others)?;
            draw(deflection, "deflection of a corner", vec![panel])?;
        }
    }
    claims(&mut runs, smallest)
}

fn deflections(runs: &mut Runs, figure: usize, step: f64, others: &[Kind]) -> Result<Panel> {
    let paper = [
        ("e = 0, singular mass", Kind::Absorbing),
        ("e = 1, singular mass", Kind::Bouncing),
        ("e = 0, consistent mass", Kind::Consistent),
    ];
    let others = others.iter().map(|&kind| (if kind == Kind::Exact { "exact" } else { "conserving" }, kind));
    let mut curves = Vec::new();
    for (number, (name, kind)) in paper.into_iter().chain(others).enumerate() {
        let run = runs.get(figure, kind, if kind == Kind::Exact { ROWS } else { step })?;
        let corner: Vec<f64> = run.0.samples.probes.iter().map(|probes| probes[0]).collect();
        curves.push(Curve::of(name, &run.0.times, &corner).style(kind.style().unwrap_or(number)));
    }
    Ok(Panel::new(Axis::linear("time", "s").tight(), Axis::linear("deflection", "m"))
        .height(130.0)
        .obstacles(&[Obstacle::Below(-0.1)])
        .curves(curves))
}

/// Draws energies relative to their start for several steps.
///
/// As in the paper, the consistent mass has the smallest step only; the conserving scheme has the
/// largest.
fn energies(runs: &mut Runs, figure: usize, heading: &str, kinds: &[Kind], steps: &[f64]) -> Result<Panel> {
    let mut curves = Vec::new();
    for &kind in kinds {
        let (steps, words) = match kind {
            Kind::Consistent => (&steps[steps.len().saturating_sub(1)..], ", consistent mass"),
            Kind::Conserving => (&steps[..1], ", conserving"),
            Kind::Exact => (&[ROWS][..], "exact"),
            _ => (steps, ""),
        };
        for &step in steps {
            let run = runs.get(figure, kind, step)?;
            let start = run.0.energies[0];
            let over_start: Vec<f64> = run.0.energies.iter().map(|energy| energy / start).collect();
            let time = if kind == Kind::Exact { String::new() } else { format!("{} s", significant(step)) };
            let style = kind.style().unwrap_or(curves.len());
            curves.push(Curve::of(time + words, &run.0.times, &over_start).style(style));
        }
    }
    let panel = Panel::new(Axis::linear("time", "s").tight(), Axis::linear("energy / initial", ""));
    Ok(panel.heading(heading).height(110.0).curves(curves))
}

/// Relative changes of the energy at the end, one per step.
struct Changes {
    element: ElementKind,
    absorbing: Vec<f64>,
    bouncing: Vec<f64>,
    midpoint: Vec<f64>,
    /// Change with the consistent mass, at the smallest step.
    consistent: f64,
    flights: Flights,
}

/// Relative changes of the invariant H of Newmark's scheme with e = 0; see [`Newmark::invariant`].
#[derive(Debug, Clone, Copy, Default)]
struct Flights {
    /// Number of sequences of steps without contact.
    count: u64,
    /// Largest change of H within such a sequence.
    drift: f64,
    /// Total loss in steps with contact.
    loss: f64,
    /// Largest rise in a step with contact.
    rise: f64,
}

fn claims(runs: &mut Runs, smallest: f64) -> Result<Claims> {
    let steps: Vec<f64> = STEPS.into_iter().filter(|step| *step >= smallest).collect();
    let least = steps[steps.len() - 1];
    let mut measured = Vec::new();
    for (element, [_, newmark, midpoint]) in ELEMENTS {
        let mut changes = |figure, kind| -> Result<Vec<f64>> {
            steps.iter().map(|&step| Ok(change(&runs.get(figure, kind, step)?.0))).collect()
        };
        let (absorbing, bouncing) = (changes(newmark, Kind::Absorbing)?, changes(newmark, Kind::Bouncing)?);
        let midpoint = changes(midpoint, Kind::Midpoint)?;
        let consistent = change(&runs.get(newmark, Kind::Consistent, least)?.0);
        let flights = flights(&Kind::Absorbing.scene(newmark, least)?)?;
        measured.push(Changes { element, absorbing, bouncing, midpoint, consistent, flights });
    }
    Ok(Claims(judge(&steps, &measured)))
}

fn change(run: &Trajectory) -> f64 {
    run.energy_drift().map_or(f64::NAN, |[end, _]| end)
}

/// Evaluates H after every step; its change in a step is the work of the reaction between two
/// instants.
fn flights(scene: &Scene) -> Result<Flights> {
    let SchemeSpec::Newmark { beta, restitution } = scene.time.scheme else { return Ok(Flights::default()) };
    let model = Model::new(scene)?;
    let parameters = NewmarkParameters { beta, restitution, step: scene.time.step };
    let mut scheme = Newmark::new(&model.system, parameters, model.start.clone())?;
    let start = scheme.invariant()?;
    let (mut flights, mut last, mut took_off) =
        (Flights { count: 1, ..Flights::default() }, start, Some(start));
    for _ in 0..scene.time.steps() {
        scheme.advance()?;
        let now = scheme.invariant()?;
        if scheme.reaction().iter().any(|r| *r != 0.0) {
            flights.loss += (last - now) / start;
            flights.rise = flights.rise.max((now - last) / start);
            took_off = None;
        } else {
            flights.count += u64::from(took_off.is_none());
            let from = *took_off.get_or_insert(last);
            flights.drift = flights.drift.max(((now - from) / start).abs());
        }
        last = now;
    }
    Ok(flights)
}

/// Judges the six claims by the measurements.
fn judge(steps: &[f64], elements: &[Changes]) -> Vec<Claim> {
    let verdict = |holds: bool| match holds {
        _ if steps.len() < FEWEST_JUDGED => Verdict::NotJudged,
        true => Verdict::Holds,
        false => Verdict::Fails,
    };
    let every = |holds: &dyn Fn(&Changes) -> bool| verdict(elements.iter().all(holds));
    let lines = |line: &dyn Fn(&Changes) -> String| {
        elements.iter().map(|case| format!("{}  {}", case.element, line(case))).collect::<Vec<String>>()
    };
    let list = |changes: &[f64]| {
        let entry = |(step, change): (&f64, &f64)| format!("{:+.5} at {} s", change, significant(*step));
        steps.iter().zip(changes).map(entry).collect::<Vec<String>>().join(", ")
    };
    let last = |changes: &[f64]| changes[changes.len() - 1];
    let least = significant(steps[steps.len() - 1]);
    let vanishes = |changes: &[f64]| last(changes).abs() < 0.5 * changes[0].abs();
    let grows_and_is_cured = |changes: &[f64]| {
        changes.iter().all(|change| *change > 0.0) && last(changes) < 0.1 * changes[0] && last(changes) < 0.05
    };
    let stricter = |part: fn(&Changes) -> &[f64]| {
        let [triangles, quadrilaterals] = [0, 1].map(|k| part(&elements[k]));
        triangles.iter().zip(quadrilaterals).all(|(t, q)| t.abs() > q.abs())
    };
    vec![
        Claim {
            claim: "with e = 0 energy is lost at impacts and only there",
            measured: lines(&|case| {
                let Flights { count, drift, loss, rise } = case.flights;
                format!(
                    "step {least} s: of the invariant H, {loss:.2e} is lost in steps with contact, none of which raises it by more than \
                     {rise:.0e}; in each of the {count} flights between them it is constant to {drift:.0e}"
                )
            }),
            verdict: every(&|case| {
                case.flights.drift < ROUNDING && case.flights.rise < ROUNDING && case.flights.loss > 0.0
            }),
        },
        Claim {
            claim: "with e = 0 the loss vanishes with the step",
            measured: lines(&|case| list(&case.absorbing)),
            verdict: every(&|case| vanishes(&case.absorbing) && case.absorbing.is_sorted()),
        },
        Claim {
            claim: "the consistent mass loses far more than the singular one",
            measured: lines(&|case| {
                let (consistent, singular) = (case.consistent, last(&case.absorbing));
                let ratio = consistent / singular;
                format!("step {least} s: {consistent:+.5} against {singular:+.5}, {ratio:.0} times as much")
            }),
            verdict: every(&|case| case.consistent < 2.0 * last(&case.absorbing)),
        },
        Claim {
            claim: "with e = 1 the energy grows, and a small step cures it",
            measured: lines(&|case| list(&case.bouncing)),
            verdict: every(&|case| grows_and_is_cured(&case.bouncing)),
        },
        Claim {
            claim: "triangles need smaller steps than quadrilaterals",
            measured: vec![
                "the energy of each run above changes more on triangles than on quadrilaterals".to_owned(),
            ],
            verdict: verdict(stricter(|case| &case.absorbing) && stricter(|case| &case.bouncing)),
        },
        Claim {
            claim: "the midpoint scheme does likewise",
            measured: lines(&|case| list(&case.midpoint)),
            verdict: verdict(
                elements.iter().all(|case| grows_and_is_cured(&case.midpoint))
                    && stricter(|case| &case.midpoint),
            ),
        },
    ]
}
