//! Generator of random scenes with all that a scene may attach.

use crate::common::Random;
use crate::common::plates::{Alternating, Fvs, Hct, Left, Right};
use rebond::mesh::Mesh;

#[derive(Clone)]
pub(super) struct Obstacle {
    pub is_below: bool,
    pub gap: f64,
    pub place: Place,
    /// Amplitude (m) and angular frequency (1/s) of its motion.
    pub swing: Option<[f64; 2]>,
    pub stiffness: Option<f64>,
    pub is_hertz: bool,
}

#[derive(Clone)]
pub(super) enum Place {
    Everywhere,
    Beyond(f64),
    At([f64; 2]),
    Line(f64),
}

#[derive(Clone)]
pub(super) struct Ball {
    pub point: [f64; 2],
    pub is_above: bool,
    pub mass: f64,
    pub height: f64,
    pub speed: f64,
    pub stiffness: Option<f64>,
}

/// Drawn scene in SI units.
#[derive(Clone)]
pub(super) struct Drawn {
    pub sides: [f64; 2],
    pub thickness: f64,
    pub youngs_modulus: f64,
    pub poissons_ratio: f64,
    pub density: f64,
    pub is_tapered: bool,
    pub cells: [usize; 2],
    pub element: &'static str,
    pub diagonal: usize,
    /// Edges (left, right, bottom, top) with kinds, stiffness in N/m2 and rotation in N.
    pub supports: Vec<(usize, &'static str, [f64; 2])>,
    pub motion: Option<[f64; 2]>,
    pub obstacles: Vec<Obstacle>,
    /// Velocities of supports, of obstacles, and of all else at the start, in m/s.
    pub drift: [f64; 3],
    /// Pressure in Pa, whether it grows along x, and its angular frequency.
    pub pressure: (f64, bool, f64),
    pub gravity: f64,
    pub force: Option<([f64; 2], f64)>,
    pub masses: Vec<([f64; 2], f64)>,
    pub springs: Vec<([f64; 2], f64)>,
    pub foundation: Option<f64>,
    /// Node, force in N, and stiffness in N/m of a slider.
    pub slider: Option<([f64; 2], f64, Option<f64>)>,
    /// Ends across the plate, bending and torsion in N m2, mass in kg/m.
    pub rib: Option<([f64; 2], [f64; 3])>,
    pub ball: Option<Ball>,
    pub damping: [f64; 2],
    pub speed: f64,
    pub scheme: &'static str,
    pub mass: &'static str,
    pub beta: f64,
    pub step: f64,
    pub steps: usize,
    pub points: [[f64; 2]; 3],
}

pub(super) const EDGES: [&str; 4] = ["left", "right", "bottom", "top"];

pub(super) fn between(random: &mut Random, low: f64, high: f64) -> f64 {
    low + (high - low) * random.unit()
}

pub(super) fn draw(seed: u64) -> Drawn {
    let random = &mut Random::new(seed);
    let sides = [between(random, 0.3, 2.0), between(random, 0.2, 1.0)];
    let [length, width] = sides;
    let thickness = length.min(width) * between(random, 0.008, 0.03);
    let youngs_modulus = 10f64.powf(between(random, 9.0, 11.3));
    let poissons_ratio = between(random, -0.2, 0.45);
    let density = between(random, 500.0, 9000.0);
    let bending = youngs_modulus * thickness.powi(3) / 12.0 / (1.0 - poissons_ratio * poissons_ratio);
    let omega = 3.5 / length.powi(2) * (bending / (density * thickness)).sqrt();
    let amplitude = thickness * between(random, 0.3, 1.0);
    let spring = bending / length.powi(2);
    let weight = density * thickness * length * width;
    let [is_tapered, is_moving, is_fvs, has_second] =
        [0.25, 0.2, 0.5, 0.5].map(|share| random.unit() < share);
    let cells = [4 + 2 * random.below(2), 2 + 2 * random.below(2)];
    let kinds = ["clamped", "simply_supported", "guided", "elastic"];
    let kinds = if is_moving { &kinds[..2] } else { &kinds };
    let first = random.below(4);
    let mut supports = vec![(first, "clamped", [0.0; 2])];
    if has_second {
        let kind = kinds[random.below(kinds.len())];
        let stiff = [bending / length.powi(3) * 50.0, bending / length * 5.0];
        supports.push(((first + 1 + random.below(3)) % 4, kind, stiff));
    }
    let motion = is_moving.then(|| [0.3 * amplitude, omega * (1.0 + 3.0 * random.unit())]);
    let count = [0, 1, 1, 2][random.below(4)];
    let mut obstacles = Vec::new();
    for number in 0..count {
        let column = (1 + random.below(cells[0] - 1)) as f64 * length / cells[0] as f64;
        let row = random.below(cells[1] + 1) as f64 * width / cells[1] as f64;
        let place = match random.below(4) {
            0 => Place::Everywhere,
            1 => Place::Beyond(length * (0.2 + 0.6 * random.unit())),
            2 => Place::At([column, row]),
            _ => Place::Line(column),
        };
        let swing = (random.unit() < 0.25).then(|| [0.1 * amplitude, omega * (1.0 + 5.0 * random.unit())]);
        let is_soft = random.unit() < 0.45;
        let is_hertz = is_soft && matches!(place, Place::At(_)) && random.unit() < 0.5;
        obstacles.push(Obstacle {
            is_below: number == 0,
            gap: amplitude * (0.15 + 0.35 * random.unit()),
            stiffness: is_soft.then(|| spring * (100.0 + 900.0 * random.unit())),
            place,
            swing,
            is_hertz,
        });
    }
    let mut point = || sides.map(|side| side * between(random, 0.05, 0.95));
    let points = [point(), point(), point()];
    let attached = [point(), point(), point(), point()];
    let mut some = |share: f64| random.unit() < share;
    let pressure =
        (bending * amplitude / length.powi(4) * 8.0, some(0.5), if some(0.5) { 4.0 * omega } else { 0.0 });
    let gravity = if some(0.4) { 0.5 * pressure.0 / (density * thickness) } else { 0.0 };
    let force = some(0.4).then_some((attached[0], 0.3 * pressure.0 * length * width));
    let masses = if some(0.25) { vec![(attached[1], 0.2 * weight)] } else { Vec::new() };
    let springs = if some(0.25) { vec![(attached[2], 30.0 * spring)] } else { Vec::new() };
    let foundation = some(0.25).then_some(20.0 * bending / length.powi(4));
    let rib_mass = if some(0.7) { 0.3 * density * thickness * width } else { 0.0 };
    let rib = some(0.25)
        .then_some(([0.3 * width, 0.62 * width], [bending * width, 0.3 * bending * width, rib_mass]));
    let is_above = some(0.5);
    let ball_stiffness = some(0.5).then_some(500.0 * spring);
    let ball = some(0.2).then_some(Ball {
        point: attached[3],
        is_above,
        mass: 0.1 * weight,
        height: 0.2 * amplitude,
        speed: 2.0 * amplitude * omega,
        stiffness: ball_stiffness,
    });
    let is_constant = motion.is_none() && pressure.2 == 0.0 && obstacles.iter().all(|o| o.swing.is_none());
    let has_hertz = obstacles.iter().any(|obstacle| obstacle.is_hertz);
    let scheme = match seed % 4 {
        0 => "newmark",
        1 => "midpoint",
        2 if is_constant && !has_hertz => "exact",
        _ => "conserving",
    };
    let mass = match seed % 5 {
        0 if scheme == "newmark" => "consistent",
        1 | 2 => "modal",
        _ => "singular",
    };
    let node = [1 + random.below(cells[0] - 1), 1 + random.below(cells[1] - 1)];
    let node = [0, 1].map(|axis| node[axis] as f64 * sides[axis] / cells[axis] as f64);
    let faces = |obstacle: &Obstacle| match obstacle.place {
        Place::At(point) => (point[0] - node[0]).hypot(point[1] - node[1]) < 1e-6 * length,
        Place::Line(column) => (column - node[0]).abs() < 1e-6 * length,
        Place::Everywhere | Place::Beyond(_) => true,
    };
    let takes_friction = scheme == "newmark" && mass != "modal" && motion.is_none();
    let slides = takes_friction && !obstacles.iter().any(faces);
    let slip = 0.05 * spring * amplitude * (1.0 + 9.0 * random.unit());
    let softness = (random.unit() < 0.5).then_some(100.0 * spring);
    let slider = slides.then_some((node, slip, softness));
    let mut some = |share: f64| random.unit() < share;
    let allows_damping = matches!(scheme, "newmark" | "midpoint") || mass == "modal";
    Drawn {
        damping: if some(0.3) {
            [0.1 * omega, if allows_damping { 0.01 / omega } else { 0.0 }]
        } else {
            [0.0; 2]
        },
        speed: (if some(0.5) { 1.0 } else { -1.0 }) * amplitude * omega * 2.0,
        beta: if some(0.5) { 0.3 } else { 0.5 },
        step: std::f64::consts::TAU / omega / 1000.0,
        steps: 120,
        diagonal: (seed / 4 % 3) as usize,
        element: if is_fvs { "fvs" } else { "hct" },
        sides,
        thickness,
        youngs_modulus,
        poissons_ratio,
        density,
        is_tapered,
        cells,
        supports,
        motion,
        obstacles,
        drift: [0.0; 3],
        pressure,
        gravity,
        force,
        masses,
        springs,
        foundation,
        slider,
        rib,
        ball,
        scheme,
        mass,
        points,
    }
}

impl Drawn {
    /// Returns the mesh of the scene.
    pub fn mesh(&self) -> Mesh {
        let [length, width] = self.sides;
        let element = if self.element == "fvs" { Fvs } else { Hct };
        let diagonal = [Right, Left, Alternating][self.diagonal];
        Mesh::rectangle(length, width, self.cells, element, diagonal).unwrap()
    }

    /// Returns the sum of the constant loads of the scene, upward, in N.
    pub fn load(&self) -> f64 {
        let [length, width] = self.sides;
        let (size, grows, _) = self.pressure;
        let taper = if self.is_tapered { 1.0 + 0.3 / 2.0 - 0.2 / 3.0 } else { 1.0 };
        let rib = self.rib.map_or(0.0, |([from, to], [.., mass])| mass * length.hypot(to - from));
        let points: f64 = self.masses.iter().map(|(_, mass)| mass).sum();
        let mass = self.density * self.thickness * taper * length * width + points + rib;
        let force = self.force.map_or(0.0, |(_, value)| value);
        force - size * length * width * if grows { 0.5 } else { 1.0 } - mass * self.gravity
    }
}
