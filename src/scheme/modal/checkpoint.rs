//! Saving and restoring the schemes for the modal mass, on any number of ranks.
//!
//! Where the modes have changed (see [`super::coordinates`]), the certificates for the nodes that
//! are no candidates are renewed. The numbers of the candidates stay.

use super::contact_model::ContactModel;
use super::coordinates::Coordinates;
use super::{Balance, ModalScheme};
use crate::archive::Archive;
use crate::error::Result;
use crate::linalg::Engine;
use crate::scheme::Approach;
use faer::Mat;

impl<E: Engine> ModalScheme<'_, E> {
    /// Saves or restores the scheme. Collective.
    pub(super) fn save_or_restore(&mut self, archive: &mut Archive) -> Result<()> {
        self.record.archive(archive)?;
        let Balance { start, work, offset } = &mut self.balance;
        for value in [start, work, offset, &mut self.span, &mut self.ahead] {
            archive.value(value)?;
        }
        archive.value(&mut self.length)?;
        archive.value(&mut self.relaxation)?;
        archive.value(&mut self.tips.taken)?;
        self.archive_candidates(archive)?;
        let ModalScheme { system, modes, global, now, before, implicit, mean_balance, .. } = self;
        let coordinates = Coordinates::new(system, modes, global);
        now.archive(archive, &coordinates)?;
        before.archive(archive, &coordinates)?;
        implicit.archive(archive, &coordinates)?;
        mean_balance.as_mut().map_or(Ok(()), |balance| balance.archive(archive, &coordinates))?;
        let are_same = coordinates.are_same.get();
        self.reach.archive(archive)?;
        self.flight.archive(archive)?;
        archive.value(&mut self.presses)?;
        archive.value(&mut self.mean)?;
        let mut is_listed = self.is_listed;
        archive.value(&mut is_listed)?;
        self.stretching.archive(archive)?;
        self.contact.archive(archive)?;
        Approach::archive(&mut self.free, archive)?;
        if !archive.saves() {
            self.complete(is_listed, are_same)?;
        }
        Ok(())
    }

    /// Saves the candidates, or restores them with their displacements.
    fn archive_candidates(&mut self, archive: &mut Archive) -> Result<()> {
        let mut grown = self.grown.clone();
        archive.value(&mut grown)?;
        if archive.saves() {
            return Ok(());
        }
        if self.global.is_partitioned() {
            // Rounding may have chosen other ones at the start.
            self.model = ContactModel::new(self.model.magnitude);
            self.rows = Mat::new();
            self.reach.forget();
            self.grown.clear();
        }
        let count = self.grown.len();
        for near in grown.split_off(count.min(grown.len())) {
            self.add_candidates(near)?;
        }
        Ok(())
    }

    /// Completes a restored scheme by what follows from its state.
    fn complete(&mut self, is_listed: bool, are_same: bool) -> Result<()> {
        if !self.system.drive.varies() {
            self.before.data = self.now.data.clone();
            self.implicit.next.data = self.now.data.clone();
        }
        if !are_same {
            self.reach.renew_all();
            while self.admit_near()? {}
        }
        self.tips.begin(&self.before);
        // The start has listed candidates, and deflections are those of listed candidates.
        self.record.candidates = Some(Vec::new());
        self.is_listed = false;
        if is_listed {
            self.list_candidates();
        }
        let record = self.record.clone();
        self.show();
        self.record = record;
        if let Some(parameters) = self.newmark_parameters() {
            self.show_newmark(parameters);
        }
        self.is_listed = is_listed;
        Ok(())
    }
}
