//! Force `$K U^n$` of the Newmark scheme, summed from step to step.
//!
//! The check of a step computes K x, and with `$x = U^{n+1} - 2 U^n + U^{n-1}$`
//!
//! ```math
//! K (U^{n+1} - U^n) = K (U^n - U^{n-1}) + K x, \qquad K U^{n+1} = K U^n + K (U^{n+1} - U^n) :
//! ```
//!
//! the next step needs no product of its own. Rounding errors of the sums would grow with the
//! number of steps, as its square in `$K U^n$`. Both terms are therefore computed anew every
//! [`RENEWAL`] steps, in turns; in between, the rounding errors of K x count less than those of
//! `$K U^n$` itself by `$(\omega \Delta t)^2$`.

use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::{add, copy_scaled};
use crate::scheme::System;

/// Number of steps after which a sum of products is replaced by a product.
const RENEWAL: u32 = 16;

/// Products of the stiffness with the displacement and its increment.
pub(super) struct StiffnessForce {
    /// Product `$K U^n$`, in N, one entry per dof. Once a step has given its product, it is
    /// `$K U^{n+1}$` until the next step begins.
    pub of_u: Vec<f64>,
    /// Product with the increment that led to the last instant computed, in N.
    of_d: Vec<f64>,
    /// Whether `of_d` is known, since each step so far gave the product K x.
    is_summed: bool,
    /// Number of the step modulo [`RENEWAL`].
    turn: u32,
    /// Elastic energy of `$U^n$`, in J, where a product gave it.
    pub elastic: Option<f64>,
}

impl StiffnessForce {
    /// Creates the force of the state at the start.
    pub fn new(dofs: usize) -> StiffnessForce {
        let zeros = vec![0.0; dofs];
        StiffnessForce { of_u: zeros.clone(), of_d: zeros, is_summed: false, turn: 0, elastic: None }
    }

    /// Takes the product of the first step, whose unknown is `$2 (U^1 - U^0)$`.
    pub fn start(&mut self, product: Option<&mut Vec<f64>>) {
        self.is_summed = product.is_some();
        if let Some(product) = product {
            copy_scaled(0.5, product, &mut self.of_d);
            add(&self.of_d, &mut self.of_u);
        }
    }

    /// Adds the product K x of a step to both sums, and leaves other values in its place.
    pub fn add(&mut self, product: Option<&mut Vec<f64>>) {
        match product {
            Some(product) if self.is_summed => {
                // The product was written just now: a sum elsewhere would be written to memory too.
                let sums = self.of_d.iter().zip(&mut self.of_u);
                for (product, (of_d, of_u)) in product.iter_mut().zip(sums) {
                    *product += of_d;
                    *of_u += *product;
                }
                std::mem::swap(product, &mut self.of_d);
            }
            _ => self.is_summed = false,
        }
    }

    /// Moves on to the next instant, with the displacement `$U^n$` and the increment
    /// `$U^n - U^{n-1}$`.
    pub fn advance<E: Engine>(&mut self, system: &System<E>, u_n: &[f64], d_n: &[f64]) -> Result<()> {
        self.turn = (self.turn + 1) % RENEWAL;
        self.elastic = None;
        if !self.is_summed || self.turn == 0 {
            self.renew(system, u_n)?;
        } else if self.turn == RENEWAL / 2 {
            system.engine.multiply(&system.stiffness, d_n, &mut self.of_d)?;
        }
        Ok(())
    }

    /// Returns the product with the increment `$U^n - U^{n-1}$` to the present instant, in N, one
    /// entry per dof; `None` where it is not known.
    pub fn of_increment(&self) -> Option<&[f64]> {
        self.is_summed.then_some(&self.of_d)
    }

    /// Computes `$K U^n$` as a product.
    pub fn renew<E: Engine>(&mut self, system: &System<E>, u_n: &[f64]) -> Result<()> {
        self.elastic = Some(0.5 * system.engine.multiply(&system.stiffness, u_n, &mut self.of_u)?);
        Ok(())
    }

    /// Returns the elastic energy of `$U^n$`, in J; `product` is work space. Collective.
    pub fn elastic_energy<E: Engine>(
        &self,
        system: &System<E>,
        u_n: &[f64],
        product: &mut [f64],
    ) -> Result<f64> {
        let computed = || Ok(0.5 * system.engine.multiply(&system.stiffness, u_n, product)?);
        self.elastic.map_or_else(computed, Ok)
    }

    /// Saves or restores the sums.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.turn)?;
        archive.value(&mut self.is_summed)?;
        self.elastic = self.elastic.filter(|_| archive.saves());
        if self.is_summed {
            archive.vector(VectorKind::Dofs, &mut self.of_u)?;
            archive.vector(VectorKind::Dofs, &mut self.of_d)?;
        }
        Ok(())
    }
}
