//! Hard scenes that `rebond stability` runs by default, included in the program.

use crate::error::{Error, Result};
use std::path::PathBuf;

/// Name and content of each file of `scenes/hard`: scenes and their meshes.
const FILES: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/hard_scenes.rs"));

/// Temporary folder with the hard scenes, removed when dropped.
pub(super) struct HardScenes(pub PathBuf);

impl HardScenes {
    /// Writes the scenes into a new temporary folder.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where a file cannot be written.
    pub fn unpack() -> Result<HardScenes> {
        let name = |number: u32| format!("rebond-hard-scenes-{}-{number}", std::process::id());
        let folders = (0..100).map(|number| std::env::temp_dir().join(name(number)));
        // An existing folder may belong to another process.
        let folder = folders.clone().find(|folder| !folder.exists()).unwrap_or_else(std::env::temp_dir);
        std::fs::create_dir(&folder).map_err(Error::io(&folder))?;
        let scenes = HardScenes(folder);
        for (name, content) in FILES {
            let path = scenes.0.join(name);
            std::fs::write(&path, content).map_err(Error::io(&path))?;
        }
        Ok(scenes)
    }
}

impl Drop for HardScenes {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_goes_with_its_owner() {
        let scenes = HardScenes::unpack().unwrap();
        let folder = scenes.0.clone();
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), FILES.len());
        drop(scenes);
        assert!(!folder.exists());
    }
}
