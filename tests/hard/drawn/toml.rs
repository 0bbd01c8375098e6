//! Scene file of a drawn scene, as a view shows it.

use super::scene::{Drawn, EDGES, Place};
use super::view::{Factors, View};
use std::fmt::Write;

impl Drawn {
    /// Writes the scene as a view shows it, with more keys of the table `initial`.
    pub fn toml(&self, view: &View, initial: &str) -> String {
        let Factors { length: a, time: tau, mass: m, force, pressure, sign } = view.factors();
        let [length, width] = self.sides;
        let drift = self.drift.map(|velocity| sign * a / tau * velocity);
        // Formulas are written in the coordinates that the plain scene has.
        let coordinates = [format!("(x/{a:e})"), format!("(y/{a:e})")];
        let [first, y] = if view.turned { [1, 0].map(|i| coordinates[i].clone()) } else { coordinates };
        let x = if view.mirrored { format!("({length:e} - {first})") } else { first };
        let t = format!("(t/{tau:e})");
        let place = |[px, py]: [f64; 2]| {
            let px = if view.mirrored { length - px } else { px };
            let [px, py] = if view.turned { [py, px] } else { [px, py] };
            format!("[{:e}, {:e}]", a * px, a * py)
        };
        let edge = |edge: usize| {
            let edge = if view.mirrored && edge < 2 { 1 - edge } else { edge };
            EDGES[if view.turned { (edge + 2) % 4 } else { edge }]
        };
        let swap = |values: [usize; 2]| if view.turned { [values[1], values[0]] } else { values };
        let (halves, share) = if view.rewritten { (2, 0.5) } else { (1, 1.0) };
        let always = if view.rewritten { "where = \"x > -1e9\"\n" } else { "" };
        let sides = if view.turned { [width, length] } else { self.sides };
        let diagonal = match self.diagonal {
            2 => "alternating",
            d if (d == 0) != view.mirrored => "right",
            _ => "left",
        };
        let taper = if self.is_tapered {
            format!("*(1 + 0.3*{x}/{length:e} - 0.2*({y}/{width:e})^2)")
        } else {
            String::new()
        };
        let mut out = String::new();
        let _ = write!(
            out,
            "[plate]\nlength = {:e}\nwidth = {:e}\nthickness = \"{:e}{taper}\"\nyoungs_modulus = {:e}\n\
             poissons_ratio = {:e}\ndensity = {:e}\n[mesh]\nelement = \"{}\"\ncells = {:?}\n",
            a * sides[0],
            a * sides[1],
            a * self.thickness,
            pressure * self.youngs_modulus * view.nudge,
            self.poissons_ratio,
            m / a.powi(3) * self.density,
            self.element,
            swap(self.cells),
        );
        if self.element == "hct" {
            let _ = writeln!(out, "diagonal = \"{diagonal}\"");
        }
        for (number, (side, kind, [stiffness, rotation])) in self.supports.iter().enumerate() {
            let _ = write!(
                out,
                "[[support]]\nname = \"s{number}\"\nedge = \"{}\"\nkind = \"{kind}\"\n{always}",
                edge(*side)
            );
            if *kind == "elastic" {
                let _ = writeln!(
                    out,
                    "stiffness = {:e}\nrotation = {:e}",
                    pressure * stiffness,
                    force * rotation
                );
            }
            let [amplitude, omega] = self.motion.unwrap_or_default();
            if amplitude != 0.0 || drift[0] != 0.0 {
                let swing = format!("{:e}*sin({omega:e}*{t})", sign * a * amplitude);
                let _ = writeln!(out, "motion = \"{swing} + {:e}*t\"", drift[0]);
            }
        }
        for (number, obstacle) in self.obstacles.iter().enumerate() {
            let is_below = obstacle.is_below != view.upside_down;
            let height = sign * a * obstacle.gap * if obstacle.is_below { -1.0 } else { 1.0 };
            let mut swing = obstacle.swing.map_or(String::new(), |[amplitude, omega]| {
                format!(" + {:e}*sin({omega:e}*{t})", sign * a * amplitude)
            });
            if drift[1] != 0.0 {
                let _ = write!(swing, " + {:e}*t", drift[1]);
            }
            let side = if is_below { "below" } else { "above" };
            let _ = writeln!(
                out,
                "[[obstacle]]\nname = \"o{number}\"\nside = \"{side}\"\nheight = \"{height:e}{swing}\""
            );
            let dimension = match obstacle.place {
                Place::Everywhere => 2,
                Place::Beyond(from) => {
                    let _ = writeln!(out, "where = \"{x} > {from:e}\"");
                    2
                }
                Place::At(point) => {
                    let _ = writeln!(out, "at = {}", place(point));
                    0
                }
                Place::Line(column) => {
                    let _ = writeln!(out, "line = [{}, {}]", place([column, 0.0]), place([column, width]));
                    1
                }
            };
            if let Some(stiffness) = obstacle.stiffness {
                let spread = [1.0, width, length * width][dimension];
                let stiffness = if obstacle.is_hertz {
                    let _ = writeln!(out, "law = \"hertz\"");
                    force / a.powf(1.5) * stiffness / self.thickness.sqrt()
                } else {
                    force / a.powi(1 + dimension as i32) * stiffness / spread
                };
                let _ = writeln!(out, "stiffness = {stiffness:e}");
            }
        }
        let (size, grows, omega) = self.pressure;
        let growth = if grows { format!("*({x}/{length:e})^2*(1 + {y}/{width:e})") } else { String::new() };
        let wave = if omega > 0.0 { format!("*cos({omega:e}*{t})") } else { String::new() };
        let (pressure_there, gravity) = (-sign * pressure * size, sign * a / tau / tau * self.gravity);
        let _ =
            writeln!(out, "[load]\npressure = \"{pressure_there:e}{growth}{wave}\"\ngravity = {gravity:e}");
        for _ in 0..halves {
            if let Some((point, value)) = self.force {
                let _ = writeln!(
                    out,
                    "[[load.force]]\nat = {}\nvalue = {:e}",
                    place(point),
                    sign * force * share * value
                );
            }
            for &(point, mass) in &self.masses {
                let _ = writeln!(out, "[[mass]]\nat = {}\nmass = {:e}", place(point), m * share * mass);
            }
            for &(point, stiffness) in &self.springs {
                let _ = writeln!(
                    out,
                    "[[spring]]\nat = {}\nstiffness = {:e}",
                    place(point),
                    force / a * share * stiffness
                );
            }
            if let Some(stiffness) = self.foundation {
                let _ = writeln!(out, "[[foundation]]\nstiffness = {:e}", pressure / a * share * stiffness);
            }
            if let Some(([from, to], [bending, torsion, mass])) = self.rib {
                let _ = writeln!(
                    out,
                    "[[rib]]\nline = [{}, {}]\nbending = {:e}\ntorsion = {:e}\nmass = {:e}",
                    place([0.0, from]),
                    place([length, to]),
                    force * a * a * share * bending,
                    force * a * a * share * torsion,
                    m / a * share * mass
                );
            }
        }
        if let Some((node, slip, stiffness)) = self.slider {
            let _ =
                writeln!(out, "[[slider]]\nname = \"pad\"\nat = {}\nforce = {:e}", place(node), force * slip);
            if let Some(stiffness) = stiffness {
                let _ = writeln!(out, "stiffness = {:e}", force / a * stiffness);
            }
        }
        if let Some(ball) = &self.ball {
            let side = if ball.is_above != view.upside_down { "above" } else { "below" };
            let up = sign * if ball.is_above { 1.0 } else { -1.0 };
            let _ = writeln!(
                out,
                "[[ball]]\nat = {}\nside = \"{side}\"\nmass = {:e}\nheight = {:e}\nvelocity = {:e}",
                place(ball.point),
                m * ball.mass,
                up * a * ball.height,
                drift[2] - up * a / tau * ball.speed
            );
            if let Some(stiffness) = ball.stiffness {
                let _ = writeln!(out, "stiffness = {:e}", force / a * stiffness);
            }
        }
        if self.damping[0] > 0.0 {
            let _ = writeln!(
                out,
                "[damping]\nmass = {:e}\nstiffness = {:e}",
                self.damping[0] / tau,
                self.damping[1] * tau
            );
        }
        if initial.is_empty() {
            let _ = writeln!(
                out,
                "[initial]\nvelocity = \"{:e}*({x}/{length:e})*(1 - 0.3*{y}/{width:e}) + {:e}\"",
                sign * a / tau * self.speed,
                drift[2]
            );
        } else {
            let _ = writeln!(out, "[initial]\n{initial}");
        }
        let _ = writeln!(
            out,
            "[time]\nscheme = \"{}\"\nmass = \"{}\"\nstep = {:e}\nend = {:e}",
            self.scheme,
            self.mass,
            tau * self.step,
            tau * self.step * self.steps as f64
        );
        if self.scheme == "newmark" {
            let _ = writeln!(out, "beta = {}", self.beta);
        }
        if self.mass == "modal" {
            let _ = writeln!(out, "modes = 8");
        }
        let probes: String = self
            .points
            .iter()
            .enumerate()
            .map(|(number, point)| format!("{{ name = \"point{number}\", at = {} }}, ", place(*point)))
            .chain(
                self.springs
                    .iter()
                    .map(|(point, _)| format!("{{ name = \"spring\", at = {} }}, ", place(*point))),
            )
            .collect();
        let ball = if self.ball.is_some() { "{ name = \"ball\", ball = 0 }" } else { "" };
        let _ = writeln!(out, "[output]\nevery = 1\nprobes = [{probes}{ball}]");
        let _ = writeln!(out, "[solver]\nengine = \"native\"\nenergy_guard = 1e6");
        if view.rewritten { rewritten(&out) } else { out }
    }
}

/// Returns a scene with its tables in the opposite order, but for the supports, the first of which
/// has what they share, and with its numbers and formulas as formulas of a parameter.
fn rewritten(toml: &str) -> String {
    let mut tables: Vec<String> = vec!["[parameters]\none = 1\n".into()];
    for line in toml.lines() {
        if line.starts_with('[') {
            tables.push(String::new());
        }
        let table = tables.last_mut().unwrap();
        let (key, value) = line.split_once(" = ").unwrap_or_default();
        let takes_formula = match key {
            "pressure" | "height" | "value" | "velocity" => !table.starts_with("[[ball"),
            "stiffness" => table.starts_with("[[foundation"),
            "thickness" | "motion" => true,
            _ => false,
        };
        let line = if takes_formula {
            format!("{key} = \"one*({})\"", value.trim_matches('"'))
        } else {
            line.into()
        };
        *table += &(line + "\n");
    }
    let (supports, mut others): (Vec<_>, Vec<_>) =
        tables.into_iter().partition(|table| table.starts_with("[[support"));
    others.reverse();
    [supports, others].concat().concat()
}
