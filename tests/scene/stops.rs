//! Compliant stops: their keys, what is refused, and where their tips are.

use crate::common::models::{CLAMPED, UNIT};
use crate::common::scenes::{STILL, close, grid, model, read, refusal, run, run_to_end, scene};
use rebond::Result;
use rebond::contact_law::StopLaw;
use rebond::scene::{Compliance, Scene};
use rebond::simulation::{self, Model, Observer, Row, Snapshot};

fn with(obstacle: &str, rest: &str) -> String {
    [UNIT, &grid("fvs", 4, 4), CLAMPED, &format!("obstacle = [{{ {obstacle} }}]\n"), rest].concat()
}

const BELOW: &str = "side = \"below\", height = -0.1";

#[test]
fn keys_are_read_and_written() {
    let text = with(&format!("{BELOW}, at = [1, 1], stiffness = 2e3, damping = 4"), STILL);
    let scene = read(&text).unwrap();
    assert_eq!(
        scene.obstacles[0].compliance,
        Some(Compliance { law: StopLaw::Linear, stiffness: 2e3, damping: 4.0 })
    );
    let effects = scene.effects();
    assert!(["compliant stops", "damping of stops"].iter().all(|of| effects.iter().any(|on| on == of)));
    assert_eq!(Scene::from_str(&scene.resolved(), "resolved", &[]).unwrap(), scene);
    for (region, unit) in
        [("at = [1, 1]", "N/m"), ("line = [[1, 0], [1, 1]]", "N/m2"), ("where = \"x > 0.5\"", "N/m3")]
    {
        let text = with(&format!("{BELOW}, {region}, stiffness = 2.5"), STILL);
        let resolved = read(&text).unwrap().resolved();
        let row = resolved.lines().find(|row| row.trim_start().starts_with("stiffness")).unwrap();
        assert!(row.ends_with(&format!("# {unit}")), "{row}");
    }
}

#[test]
fn bad_values_are_refused_by_name() {
    let at = "at = [1, 1]";
    let cases = [
        (
            format!("{at}, stiffness = -1"),
            "obstacle.0.stiffness: -1 is not positive; expected a stiffness in N/m greater than 0",
        ),
        (
            format!("{at}, stiffness = 0"),
            "obstacle.0.stiffness: 0 is not positive; expected a stiffness in N/m greater than 0",
        ),
        (
            format!("{at}, stiffness = inf"),
            "obstacle.0.stiffness: inf is not a finite number; expected a stiffness in N/m greater than 0",
        ),
        (
            format!("{at}, stiffness = nan"),
            "obstacle.0.stiffness: nan is not a finite number; expected a stiffness in N/m greater than 0",
        ),
        (
            "line = [[1, 0], [1, 1]], stiffness = -2.5".into(),
            "obstacle.0.stiffness: -2.5 is not positive; expected a stiffness in N/m2 greater than 0",
        ),
        (
            "where = \"x > 0.5\", stiffness = -2.5".into(),
            "obstacle.0.stiffness: -2.5 is not positive; expected a stiffness in N/m3 greater than 0",
        ),
        (
            format!("{at}, stiffness = \"x\""),
            "obstacle.0.stiffness: found the string \"x\"; expected a stiffness in N/m greater than 0",
        ),
        (
            format!("{at}, stiffness = 1, damping = -1"),
            "obstacle.0.damping: -1 is negative; expected a damping in N s/m of at least 0",
        ),
        (
            format!("{at}, damping = 1"),
            "obstacle.0.damping: has no use without obstacle.0.stiffness; expected a stiffness beside it",
        ),
    ];
    for (keys, expected) in cases {
        let said = refusal(&with(&format!("{BELOW}, {keys}"), STILL)).to_string();
        assert!(said.contains(expected), "{said}\n{expected}");
    }
    let time = |keys: &str| format!("time = {{ step = 1e-3, end = 1e-3, {keys} }}\n");
    let damped = format!("{BELOW}, {at}, stiffness = 1, damping = 1");
    let plain = format!("{BELOW}, {at}, stiffness = 1");
    let cases = [
        (
            &damped,
            "scheme = \"exact\", mass = \"singular\"",
            "obstacle.0.damping: time.scheme = \"exact\" follows no damped",
        ),
        (
            &damped,
            "scheme = \"conserving\", mass = \"singular\"",
            "obstacle.0.damping: time.scheme = \"conserving\" follows no damped",
        ),
        (
            &damped,
            "scheme = \"newmark\", mass = \"modal\"",
            "obstacle.0.damping: time.scheme = \"newmark\" with time.mass = \"modal\" follows no damped",
        ),
        (
            &damped,
            "scheme = \"midpoint\", mass = \"singular\", massless = \"equilibrium\"",
            "time.massless: \"equilibrium\" contradicts a dashpot",
        ),
        (
            &plain,
            "scheme = \"newmark\", mass = \"singular\", beta = 0.25",
            "time.beta: 0.25 lets the massless tips",
        ),
    ];
    for (keys, scheme, expected) in cases {
        let said = refusal(&with(keys, &time(scheme))).to_string();
        assert!(said.contains(expected), "{said}\n{expected}");
    }
    let ball = "ball = [{ at = [0.5, 0.5], mass = 1, height = 1, damping = 2 }]\n";
    let said = refusal(&[UNIT, &grid("fvs", 4, 4), CLAMPED, ball, STILL].concat()).to_string();
    assert!(said.contains("ball.0.damping: has no use without ball.0.stiffness"), "{said}");
    let narrow = format!("{BELOW}, where = \"x > 0.99\", stiffness = 1");
    let said = refusal(&with(&narrow, STILL)).to_string();
    assert!(said.contains("obstacle.0.where: it holds at the centre of no cell"), "{said}");
}

/// Each stop has a tip of its own at a node, beside a rigid obstacle there; none has one where a
/// support holds the deflection.
#[test]
fn tips_are_dofs_of_their_own() {
    let obstacles = format!(
        "obstacle = [{{ {BELOW} }}, {{ {BELOW}, stiffness = 3 }}, {{ {BELOW}, at = [1, 1], stiffness = 5 }}]\n"
    );
    let text = [UNIT, &grid("fvs", 4, 4), CLAMPED, &obstacles, STILL].concat();
    let model = model(&text);
    // 20 nodes are free; all have a tip on the area, and one a further tip.
    assert_eq!(model.system.bounds.len(), 20 + 20 + 1);
    let tips: Vec<_> = model.sites.iter().filter(|site| site.is_tip).collect();
    assert_eq!(tips.len(), 21);
    assert_eq!(tips.iter().filter(|site| site.at == [1.0, 1.0]).count(), 2);
    assert!(tips.iter().all(|tip| model.sites.iter().any(|site| !site.is_tip && site.node == tip.node)));
}

/// A plate without supports rests on compliant stops alone; it sinks evenly by its weight over
/// their stiffness, and the static start finds this equilibrium of a mechanism.
#[test]
fn a_plate_rests_on_rubber() {
    for (element, region) in [("fvs", ""), ("hct", ""), ("fvs", ", where = \"x < 2\"")] {
        let text = [
            UNIT,
            &grid(element, 4, 4),
            &format!("obstacle = [{{ side = \"below\", height = 0.01, stiffness = 20{region} }}]\n"),
            "load.gravity = 10\ninitial.equilibrium = true\n",
            "output.probes = [{ name = \"centre\", at = [0.5, 0.5] }]\n",
            "time = { scheme = \"conserving\", mass = \"singular\", step = 1e-3, end = 0.02 }\n",
        ]
        .concat();
        let rows = run(&text);
        close("force", rows[0].contact_force, 10.0, 1e-8);
        // The mass is spread evenly, the springs are lumped at the nodes.
        close("deflection", rows[0].probes[0], 0.01 - 10.0 / 20.0, 0.01);
        for row in &rows {
            assert!((row.probes[0] - rows[0].probes[0]).abs() <= 1e-9, "{element}: {}", row.probes[0]);
        }
    }
}

/// A compliant ball bounces off a heavy plate after half a period of its mass on its stiffness.
#[test]
fn a_compliant_ball_bounces() {
    let text = |damping: &str, scheme: &str| {
        [
            "plate = { length = 1, width = 1, thickness = 1, youngs_modulus = 1e12, poissons_ratio = 0.3, density = 1e4 }\n",
            &grid("fvs", 4, 4),
            CLAMPED,
            &format!("ball = [{{ at = [0.5, 0.5], mass = 0.5, height = 0, velocity = -2, stiffness = 1e5{damping} }}]\n"),
            "output.probes = [{ name = \"ball\", ball = 0 }]\n",
            &format!("time = {{ {scheme}, mass = \"singular\", step = 1e-5, end = 0.01 }}\n"),
        ]
        .concat()
    };
    let contact = std::f64::consts::PI * (0.5_f64 / 1e5).sqrt();
    for scheme in ["exact", "conserving", "midpoint", "newmark"] {
        let (rows, outcome) = run_to_end(&text("", &format!("scheme = \"{scheme}\"")));
        let [begin, end] = outcome.contacts[0];
        assert!((end - begin - contact).abs() <= 3e-5, "{scheme}: {} for {contact}", end - begin);
        let deepest = rows.iter().fold(0.0, |least: f64, row| row.probes[0].min(least));
        close("depth", deepest, -2.0 * (0.5_f64 / 1e5).sqrt(), 2e-3);
        let last = rows.last().unwrap();
        close("height", last.probes[0], 2.0 * (last.time - contact), 1e-2);
    }
    // A dashpot takes energy, under the name of the ball.
    let damped = text(", damping = 50, name = \"mallet\"", "scheme = \"newmark\"");
    assert_eq!(scene(&damped).force_columns(), ["force_mallet", "impulse_mallet"]);
    let (rows, outcome) = run_to_end(&damped);
    close("taken", outcome.dissipated["mallet"], outcome.energy.lost, 5e-3);
    assert!(outcome.forces.contains_key("mallet") && !outcome.forces.contains_key("ball_1"));
    let last = rows.last().unwrap();
    assert!(last.probes[0] > 0.0 && last.probes[0] < 1.9 * (last.time - contact), "{}", last.probes[0]);
}

/// The damping of a stop is what its key says, with and without Rayleigh damping of the stiffness,
/// which multiplies the springs of all stops too.
#[test]
fn rayleigh_damping_leaves_the_damping_of_stops_alone() {
    for beta in [0.0, 1e-3] {
        let text = with(
            &format!("{BELOW}, at = [1, 1], stiffness = 2e3, damping = 7"),
            &format!("damping.stiffness = {beta:?}\n{STILL}"),
        );
        let model = model(&text);
        let tip = model.system.bounds.dofs[0];
        let mut entry = 0.0;
        for (factor, form) in
            [(beta, &model.system.stiffness), (1.0, model.system.drive.dashpots.as_ref().unwrap())]
        {
            form.for_each_lower(|row, column, value| {
                if (row, column) == (tip, tip) {
                    entry += factor * value;
                }
            });
        }
        assert!((entry - 7.0).abs() <= 1e-14, "{entry}");
    }
}

/// Forces of the rows, and sums of reactions and least gaps of the snapshots.
#[derive(Default)]
struct Watched {
    forces: Vec<f64>,
    snapshots: Vec<[f64; 2]>,
}

impl Observer for Watched {
    fn row(&mut self, row: &Row) -> Result<()> {
        self.forces.push(row.contact_force);
        Ok(())
    }

    fn fields(&mut self, snapshot: &Snapshot) -> Result<()> {
        let reaction = snapshot.reaction.as_ref().unwrap().iter().sum();
        let gap = snapshot.gap.as_ref().unwrap().iter().fold(f64::INFINITY, |least, gap| gap.min(least));
        self.snapshots.push([reaction, gap]);
        Ok(())
    }
}

/// Snapshots show the reaction of a stop at its node, and a negative gap where it yields.
#[test]
fn snapshots_show_forces_and_depth_of_stops() {
    let text = [
        UNIT,
        &grid("hct", 4, 4),
        &format!("obstacle = [{{ {BELOW}, at = [1, 1], stiffness = 40 }}, {{ {BELOW}, stiffness = 3 }}]\n"),
        "initial.velocity = -2\noutput = { every = 1, fields_every = 1 }\n",
        "time = { scheme = \"newmark\", mass = \"singular\", step = 1e-3, end = 0.2 }\n",
    ]
    .concat();
    let scene = read(&text).unwrap();
    let model = Model::new(&scene).unwrap();
    let mut watched = Watched::default();
    simulation::run(&scene, &model, &simulation::condensed, &mut watched).unwrap().1.unwrap();
    let most = watched.forces.iter().fold(0.0, |most: f64, force| force.max(most));
    assert!(most > 1.0 && watched.forces.len() == watched.snapshots.len());
    for (force, [reaction, _]) in watched.forces.iter().zip(&watched.snapshots) {
        assert!((force - reaction).abs() <= 1e-12 * most, "{force}, {reaction}");
    }
    let deepest = watched.snapshots.iter().fold(0.0, |least: f64, [_, gap]| gap.min(least));
    assert!(deepest < -0.05, "{deepest}");
}
