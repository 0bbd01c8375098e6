//! Hard scenes that `rebond stability` runs by default, included in the program.

use crate::error::{Error, Result};
use std::path::{Path, PathBuf};

/// Defines the file names of `scenes/hard` and includes their bytes.
macro_rules! files {
    ($($name:literal,)*) => {
        /// Name and content of each file: scenes and their meshes.
        const FILES: &[(&str, &[u8])] =
            &[$(($name, include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/hard/", $name)))),*];
    };
}

files![
    "all-in-contact.toml",
    "beds-of-stops.toml",
    "caps.msh",
    "caps.toml",
    "chatter.toml",
    "closed-at-a-point.toml",
    "closed-gap.toml",
    "dented.msh",
    "dented.toml",
    "dropped-flat.toml",
    "fine.toml",
    "flat-cells.toml",
    "flatter-cells.toml",
    "gap-zero.toml",
    "graded-cut.msh",
    "graded-cut.toml",
    "graded.msh",
    "graded.toml",
    "grazing.toml",
    "hertz-stops.toml",
    "incompatible-start.toml",
    "kilometre.toml",
    "micrometre.toml",
    "needles.msh",
    "needles.toml",
    "never-reached.toml",
    "no-inf-sup.toml",
    "one-node.toml",
    "point-obstacle.toml",
    "poisson-0.499.toml",
    "poisson-0.toml",
    "preload.toml",
    "resting.toml",
    "slender.toml",
    "soft.toml",
    "step-1.toml",
    "step-1e-8.toml",
    "step-obstacle.toml",
    "stiff.toml",
    "thick.toml",
    "thin.toml",
    "thrown-into.toml",
    "tight-gap.toml",
    "turned.msh",
    "turned.toml",
    "unequal-stops.toml",
    "wedge.toml",
];

/// Temporary folder with the hard scenes, removed when dropped.
pub(super) struct HardScenes(PathBuf);

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

    /// Returns the path of the folder.
    pub fn folder(&self) -> &Path {
        &self.0
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
    use std::collections::BTreeSet;

    #[test]
    fn the_program_has_every_file_of_the_folder() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/hard");
        let there: BTreeSet<String> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .filter(|name| name.ends_with(".toml") || name.ends_with(".msh"))
            .collect();
        assert_eq!(there, FILES.iter().map(|(name, _)| name.to_string()).collect());
    }

    #[test]
    fn the_folder_goes_with_its_owner() {
        let scenes = HardScenes::unpack().unwrap();
        let folder = scenes.folder().to_owned();
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), FILES.len());
        drop(scenes);
        assert!(!folder.exists());
    }
}
