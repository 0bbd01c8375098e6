//! The exact scheme where modes with inertia of their own decay at different rates, compared with
//! small steps of an independent program and with the balances of a free plate.

use crate::common::difference;
use crate::common::models::PAPER_FALL;
use crate::modal::{FreeFall, all_modes, dense, free_fall, modal_scene};
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use rebond::linalg::Form;
use rebond::scheme::{Exact, Scheme, Solution};
use rebond::simulation::Model;

/// Returns the paper's plate that falls, with a damping table.
fn damped_fall(damping: &str, cells: [usize; 2], modes: usize, step: f64) -> Model {
    let tables = format!("{PAPER_FALL}damping = {{ {damping} }}\n");
    Model::new(&modal_scene(&tables, "fvs", cells, modes, step)).unwrap()
}

/// Modes and rest of a plate above one obstacle, advanced by Runge and Kutta's fourth-order steps.
struct SmallSteps {
    squares: Vec<f64>,
    rates: Vec<f64>,
    /// Shapes of the modes and compliance of the rest at the nodes.
    shapes: Mat<f64>,
    compliance: Mat<f64>,
    height: f64,
    touching: Vec<usize>,
}

impl SmallSteps {
    /// Returns the reactions that keep all nodes above the obstacle, found by trial from those
    /// nodes that touched before.
    fn reactions(&mut self, z: &Mat<f64>) -> Mat<f64> {
        let gap = &self.shapes * z - Mat::from_fn(self.shapes.nrows(), 1, |_, _| self.height);
        for _ in 0..100 {
            let of = &self.touching;
            let block = Mat::from_fn(of.len(), of.len(), |i, j| self.compliance[(of[i], of[j])]);
            let missing = Mat::from_fn(of.len(), 1, |i, _| -gap[(of[i], 0)]);
            let held = match of.is_empty() {
                true => missing,
                false => block.llt(Side::Lower).unwrap().solve(missing),
            };
            let mut forces = Mat::zeros(gap.nrows(), 1);
            of.iter().enumerate().for_each(|(k, &i)| forces[(i, 0)] = held[(k, 0)]);
            let open = &gap + &self.compliance * &forces;
            let touches = |i: &usize| match of.contains(i) {
                true => forces[(*i, 0)] > 0.0,
                false => open[(*i, 0)] < -1e-15,
            };
            let next: Vec<usize> = (0..gap.nrows()).filter(touches).collect();
            if next == self.touching {
                return forces;
            }
            self.touching = next;
        }
        panic!("no set of nodes in contact was found");
    }

    /// Returns the derivative of z and z' (columns).
    fn derivative(&mut self, state: &Mat<f64>) -> Mat<f64> {
        let forces = self.reactions(&state.get(.., ..1).to_owned());
        let push = self.shapes.transpose() * forces;
        Mat::from_fn(state.nrows(), 2, |k, j| match j {
            0 => state[(k, 1)],
            _ => push[(k, 0)] - self.squares[k] * state[(k, 0)] - self.rates[k] * state[(k, 1)],
        })
    }

    fn advance(&mut self, state: &mut Mat<f64>, step: f64) {
        let scaled = |of: &Mat<f64>, by: f64| of * faer::Scale(by);
        let first = self.derivative(state);
        let second = self.derivative(&(&*state + scaled(&first, 0.5 * step)));
        let third = self.derivative(&(&*state + scaled(&second, 0.5 * step)));
        let fourth = self.derivative(&(&*state + scaled(&third, step)));
        *state += scaled(&(first + fourth + scaled(&(second + third), 2.0)), step / 6.0);
    }
}

#[test]
fn modes_that_decay_at_rates_of_their_own_move_as_small_steps_say() {
    const MODES: usize = 10;
    // Light damping, some modes overdamped, and rates that do not follow the frequencies.
    for damping in ["stiffness = 2e-5", "mass = 3, stiffness = 4e-4", "modal = [0.02, 0.3, 0.01, 0.05]"] {
        let model = damped_fall(damping, [4, 2], MODES, 1e-3);
        let Form::Modal { consistent, .. } = &model.system.mass else { panic!("not the modal mass") };
        let (k, m) =
            (dense(&model, &model.system.stiffness), dense(&model, &Form::Cells(consistent.clone())));
        let all = all_modes(&k, &m);
        let at = &model.system.bounds.dofs;
        let ratios = [0.02, 0.3, 0.01, 0.05];
        let rate = |k: usize| {
            let square = all[k].0;
            match damping {
                "stiffness = 2e-5" => 2e-5 * square,
                "mass = 3, stiffness = 4e-4" => 3.0 + 4e-4 * square,
                _ => ratios.get(k).map_or(0.0, |ratio| 2.0 * ratio * square.sqrt()),
            }
        };
        let mut small = SmallSteps {
            squares: all[..MODES].iter().map(|mode| mode.0).collect(),
            rates: (0..MODES).map(rate).collect(),
            shapes: Mat::from_fn(at.len(), MODES, |i, k| all[k].1[at[i]]),
            compliance: Mat::from_fn(at.len(), at.len(), |i, j| {
                all[MODES..].iter().map(|(square, shape)| shape[at[i]] * shape[at[j]] / square).sum()
            }),
            height: -0.1,
            touching: Vec::new(),
        };
        let start = Mat::from_fn(m.nrows(), 1, |i, _| model.start.displacement[i]);
        let place = Mat::from_fn(m.nrows(), MODES, |i, k| all[k].1[i]).transpose() * &m * start;
        let mut state = Mat::from_fn(MODES, 2, |k, j| if j == 0 { place[(k, 0)] } else { 0.0 });
        let mut scheme = Exact::new(&model.system, 1e-3, model.start.clone()).unwrap();
        let (mut apart, mut largest, mut touched) = (0.0f64, 0.0f64, 0);
        for _ in 0..150 {
            scheme.advance().unwrap();
            for _ in 0..1000 {
                small.advance(&mut state, 1e-6);
            }
            let forces = small.reactions(&state.get(.., ..1).to_owned());
            let places = &small.shapes * state.get(.., ..1) + &small.compliance * &forces;
            let found: Vec<f64> = at.iter().map(|&dof| scheme.displacement()[dof]).collect();
            apart = apart.max(difference(&found, places.col_as_slice(0)));
            largest = found.iter().fold(largest, |a, b| a.max(b.abs()));
            touched += scheme.take_events().len();
            assert!(scheme.step_report().kkt <= 1e-11, "{damping}: {:e}", scheme.step_report().kkt);
        }
        println!("{damping}: {apart:.1e} of {largest:.3} m, {touched} events");
        // Without such damping the program is as far from the motion that other tests prove.
        assert!(touched > 10 && apart <= 2e-7 * largest, "{damping}: {apart:e} of {largest}, {touched}");
    }
}

/// Rigid motions have no stiffness, so that damping by it takes nothing from them.
#[test]
fn a_free_plate_damped_by_its_stiffness_keeps_its_momentum() {
    for stiffness in ["1e-6", "1e-4"] {
        let FreeFall { events, unbalanced, energies } =
            free_fall(&format!("damping = {{ stiffness = {stiffness} }}\n"));
        let gained = energies.windows(2).map(|pair| pair[1] / pair[0] - 1.0).fold(0.0, f64::max);
        let left = energies[100] / energies[0];
        println!("{stiffness} s: {events} events, momentum {unbalanced:.1e} N s, energy left {left}");
        assert!(events > 10 && unbalanced <= 1e-8 && gained <= 1e-12, "{events}, {unbalanced:e}, {gained:e}");
        assert!(left < 0.999, "{left}");
    }
}
