//! Eight numbers side by side, which vector registers of any width compute with at once.

use pulp::Simd;
use std::ops::{Add, AddAssign, Div, Mul, Sub};

/// Number of lanes, and of the cells of a batch.
pub(crate) const LANES: usize = 8;

/// One number for each cell of a batch, or for each of several systems.
///
/// The operators take values instead of references: the compiler would have to assume that
/// references alias and could not vectorise.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(align(64))]
pub(crate) struct Lanes(pub [f64; LANES]);

impl Lanes {
    /// Number of lanes.
    pub const COUNT: usize = LANES;

    /// Loads eight consecutive numbers of a vector in layout order.
    #[inline(always)]
    pub(crate) fn at(x: &[f64], place: u32) -> Lanes {
        let mut lanes = [0.0; LANES];
        lanes.copy_from_slice(&x[place as usize..][..LANES]);
        Lanes(lanes)
    }

    /// Returns a number in the first lane, and 0 in the others.
    pub fn first(value: f64) -> Lanes {
        let mut lanes = Lanes::default();
        lanes.0[0] = value;
        lanes
    }

    /// Returns the numbers of one vector register.
    #[inline(always)]
    pub(crate) fn register<S: Simd>(&self, part: usize) -> S::f64s {
        S::as_simd_f64s(&self.0).0[part]
    }

    /// Returns the numbers of one vector register.
    #[inline(always)]
    pub(crate) fn register_mut<S: Simd>(&mut self, part: usize) -> &mut S::f64s {
        &mut S::as_mut_simd_f64s(&mut self.0).0[part]
    }

    /// Returns the magnitudes.
    #[inline(always)]
    pub fn abs(mut self) -> Lanes {
        for lane in 0..LANES {
            self.0[lane] = self.0[lane].abs();
        }
        self
    }

    /// Sets the numbers to multiples of the magnitudes of others.
    ///
    /// From a loop over many [`Lanes`], the compiler may otherwise make vectors across them, which
    /// it gathers and scatters; so with [`Lanes::add_scaled`].
    #[inline(always)]
    pub fn set_to_scaled_abs<S: Simd>(&mut self, simd: S, scale: f64, other: &Lanes) {
        let scale = simd.splat_f64s(scale);
        for (value, other) in S::as_mut_simd_f64s(&mut self.0).0.iter_mut().zip(S::as_simd_f64s(&other.0).0) {
            *value = simd.mul_f64s(scale, simd.abs_f64s(*other));
        }
    }

    /// Adds multiples of other numbers.
    #[inline(always)]
    pub fn add_scaled<S: Simd>(&mut self, simd: S, scale: f64, other: &Lanes) {
        let scale = simd.splat_f64s(scale);
        for (value, other) in S::as_mut_simd_f64s(&mut self.0).0.iter_mut().zip(S::as_simd_f64s(&other.0).0) {
            *value = simd.add_f64s(*value, simd.mul_f64s(scale, *other));
        }
    }

    /// Returns the numbers moved up by one lane, with 0 in the first, given the mask of the first
    /// lane of a register.
    #[inline(always)]
    pub(crate) fn moved_up<S: Simd>(&self, simd: S, first: S::m64s) -> Lanes {
        let mut moved = Lanes::default();
        if S::F64_LANES == LANES {
            let turned = simd.rotate_right_f64s(self.register::<S>(0), 1);
            *moved.register_mut::<S>(0) = simd.select_f64s(first, simd.splat_f64s(0.0), turned);
        } else {
            // Narrower registers take ten instructions to turn, and one to load from a lane below.
            moved.0[1..].copy_from_slice(&self.0[..LANES - 1]);
        }
        moved
    }

    /// Returns the larger number of each pair.
    #[inline(always)]
    pub fn max(mut self, other: Lanes) -> Lanes {
        for lane in 0..LANES {
            self.0[lane] = if self.0[lane] > other.0[lane] { self.0[lane] } else { other.0[lane] };
        }
        self
    }

    /// Returns the smaller number of each pair.
    #[inline(always)]
    pub fn min(mut self, other: Lanes) -> Lanes {
        for lane in 0..LANES {
            self.0[lane] = if self.0[lane] < other.0[lane] { self.0[lane] } else { other.0[lane] };
        }
        self
    }

    /// Returns the sum over the cells.
    pub fn sum(self) -> f64 {
        self.0.iter().sum()
    }
}

/// Interleaves the values of eight cells, one cell per lane.
pub(crate) fn interleave(values: &[&[f64]; LANES]) -> Vec<Lanes> {
    let mut panel = vec![Lanes::default(); values[0].len()];
    for (lane, values) in values.iter().enumerate() {
        for (slot, value) in panel.iter_mut().zip(*values) {
            slot.0[lane] = *value;
        }
    }
    panel
}

/// Returns the dofs of a node, for those cells that a register holds.
#[inline(always)]
pub(crate) fn dofs<S: Simd>(local: &[Lanes], node: usize, k: usize) -> [S::f64s; 3] {
    let [w, w_x, w_y] = [&local[3 * node], &local[3 * node + 1], &local[3 * node + 2]];
    [w.register::<S>(k), w_x.register::<S>(k), w_y.register::<S>(k)]
}

/// Stores the forces on a node, for those cells that a register holds.
#[inline(always)]
pub(crate) fn store<S: Simd>(force: [S::f64s; 3], result: &mut [Lanes], node: usize, k: usize) {
    for (dof, force) in force.into_iter().enumerate() {
        *result[3 * node + dof].register_mut::<S>(k) = force;
    }
}

/// Implements operators lane by lane.
macro_rules! operators {
    ($type:ident: $($operator:ident, $method:ident, $assign:tt;)+) => {
        $(impl $operator for $type {
            type Output = $type;

            #[inline(always)]
            fn $method(mut self, other: $type) -> $type {
                for lane in 0..LANES {
                    self.0[lane] $assign other.0[lane];
                }
                self
            }
        })+
    };
}
pub(super) use operators;

operators! { Lanes: Add, add, +=; Sub, sub, -=; Mul, mul, *=; Div, div, /=; }

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Lanes) {
        *self = *self + other;
    }
}

impl Mul<Lanes> for f64 {
    type Output = Lanes;

    #[inline(always)]
    fn mul(self, lanes: Lanes) -> Lanes {
        Lanes([self; LANES]) * lanes
    }
}
