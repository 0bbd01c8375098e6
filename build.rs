//! Lists the hard scenes, which the program includes. Finds PETSc and MPI and writes the Rust
//! declarations of the PETSc functions that the crate calls. MPI is linked; the program loads PETSc where it is needed.
//!
//! PETSc is that of `PETSC_DIR` (and `PETSC_ARCH`) where these are set, otherwise the one that
//! pkg-config finds. Without the feature `petsc` this program lists the scenes only. A missing component
//! ends the build with one sentence that names the package to install.

use std::path::Path;

fn main() {
    hard_scenes().expect("the folder scenes/hard is there");
    #[cfg(feature = "petsc")]
    match petsc::bind() {
        Ok(lines) => lines.iter().for_each(|line| println!("cargo:{line}")),
        Err(sentence) => {
            println!("cargo:warning={sentence}");
            std::process::exit(1);
        }
    }
    println!("cargo:rerun-if-changed=build.rs");
}

/// Writes the names and contents of the files of `scenes/hard` as a slice of pairs.
fn hard_scenes() -> std::io::Result<()> {
    const FOLDER: &str = "scenes/hard";
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(FOLDER)? {
        paths.push(std::path::absolute(entry?.path())?);
    }
    paths.retain(|path| path.extension().is_some_and(|ending| ending == "toml" || ending == "msh"));
    paths.sort();
    let row =
        |path: &std::path::PathBuf| format!("({:?}, include_bytes!({path:?})),\n", path.file_name().unwrap());
    let rows: String = paths.iter().map(row).collect();
    let out = std::env::var_os("OUT_DIR").expect("cargo sets OUT_DIR");
    println!("cargo:rerun-if-changed={FOLDER}");
    std::fs::write(Path::new(&out).join("hard_scenes.rs"), format!("&[{rows}]"))
}

#[cfg(feature = "petsc")]
mod petsc {
    use std::collections::BTreeSet;
    use std::path::{Path, PathBuf};
    use std::process::Command;

    const WAY_OUT: &str = "or build without the distributed engine: --no-default-features";
    const HEADERS: &str = "\
        #include <petscsys.h>\n#include <petscsnes.h>\n#include <petsctao.h>\n\
        #include <petscdmplex.h>\n#include <petscdmplextransform.h>\n#include <petscsf.h>\n#include <petscpartitioner.h>\n";

    const TYPES: &[&str] = &[
        "PetscErrorCode|PetscErrorType|PetscInt|PetscScalar|PetscReal|PetscBool|PetscMPIInt",
        "Vec|Mat|IS|KSP|PC|SNES|Tao|DM|DMLabel|Petsc(Section|SF|Partitioner|Options|Viewer|Object)",
        "(Vec|Mat|KSP|PC|SNES|Tao|DM|Insert|Norm).*(Type|Mode|Option|Reason|Info|Structure|Reuse)",
    ];
    const CONSTANTS: &str = "PETSC_(ERR_.*|VERSION_.*|DETERMINE|DEFAULT)";

    const ENVIRONMENT: &[&str] = &[
        "PETSC_DIR",
        "PETSC_ARCH",
        "MPICC",
        "LIBCLANG_PATH",
        "PKG_CONFIG",
        "PKG_CONFIG_PATH",
        "PKG_CONFIG_LIBDIR",
    ];

    /// Folder of the sources that call PETSc.
    const SOURCES: &str = "src/petsc";

    /// Location of PETSc.
    struct Petsc {
        includes: Vec<PathBuf>,
        /// Folders that may hold the library.
        folders: Vec<PathBuf>,
        /// Names that the library may have.
        names: Vec<String>,
        /// Whether programs must be told the folder of the library.
        rpath: bool,
    }

    /// Writes the bindings and returns the directives for cargo, which are printed at the end only,
    /// so that a failure prints nothing else.
    pub fn bind() -> Result<Vec<String>, String> {
        let petsc = find()?;
        let release = suitable_release(&petsc)?;
        let library = shared_library(&petsc, release)?;
        let mpi = mpi_includes()?;

        let arguments: Vec<_> =
            petsc.includes.iter().chain(&mpi).map(|folder| format!("-I{}", folder.display())).collect();
        let mut builder = bindgen::Builder::default()
            .header_contents("rebond_petsc.h", HEADERS)
            .clang_args(arguments)
            .default_enum_style(bindgen::EnumVariation::NewType { is_bitfield: false, is_global: false })
            // Releases differ in whether these are enumerations; with plain types the same code
            // works for all.
            .constified_enum("PetscErrorCode|PETSC_ERR_.*|PetscBool")
            .prepend_enum_name(false)
            // MPI's types are those of the `mpi` crate, so that a communicator needs no cast.
            .blocklist_type("(MPI_|ompi_|MPIR_).*")
            .raw_line("pub use mpi::ffi::*;")
            // The program finds the functions when it first calls one.
            .dynamic_library_name("Functions")
            .dynamic_link_require_all(true)
            .layout_tests(false)
            .generate_comments(false);
        builder = builder.allowlist_function(names_in_sources()?).allowlist_var(CONSTANTS);
        for pattern in TYPES {
            builder = builder.allowlist_type(pattern);
        }

        let bindings = quietly(move || builder.generate())
            .map_err(|_| {
                format!("libclang cannot be loaded: install the Debian package libclang-dev (or set LIBCLANG_PATH), {WAY_OUT}")
            })?
            .map_err(|error| {
                let error = error.to_string().replace('\n', " ");
                format!("PETSc's headers cannot be read: install the Debian packages petsc-dev and libclang-dev, {WAY_OUT} ({error})")
            })?;
        let out = PathBuf::from(std::env::var_os("OUT_DIR").ok_or("cargo sets no OUT_DIR")?).join("petsc.rs");
        bindings.write_to_file(&out).map_err(|error| format!("{}: {error}", out.display()))?;

        let mut lines: Vec<_> =
            ENVIRONMENT.iter().map(|name| format!("rerun-if-env-changed={name}")).collect();
        for folder in petsc.includes.iter().filter(|folder| folder.join("petscconf.h").is_file()) {
            lines.push(format!("rerun-if-changed={}", folder.join("petscconf.h").display()));
        }
        for folder in petsc.folders.iter().filter(|_| petsc.rpath) {
            lines.push(format!("rustc-link-arg=-Wl,-rpath,{}", folder.display()));
        }
        lines.push(format!("rustc-env=REBOND_PETSC_LIBRARY={library}"));
        lines.push(format!("rerun-if-changed={SOURCES}"));
        Ok(lines)
    }

    /// Returns a pattern of all names in the sources that call PETSc, of which the headers know some.
    fn names_in_sources() -> Result<String, String> {
        let unread = |error| format!("{SOURCES}: {error}");
        let mut names = BTreeSet::new();
        for file in std::fs::read_dir(SOURCES).map_err(unread)? {
            let text = std::fs::read_to_string(file.map_err(unread)?.path()).map_err(unread)?;
            let words = text.split(|c: char| !c.is_ascii_alphanumeric());
            names.extend(words.filter(|word| word.starts_with(char::is_uppercase)).map(String::from));
        }
        Ok(names.into_iter().collect::<Vec<_>>().join("|"))
    }

    /// Returns the name by which programs load the shared library, with the release where it has one.
    fn shared_library(petsc: &Petsc, [major, minor]: [u32; 2]) -> Result<String, String> {
        let endings =
            [format!("so.{major}.{minor}"), format!("{major}.{minor}.dylib"), "so".into(), "dylib".into()];
        let mut names = petsc
            .names
            .iter()
            .flat_map(|name| endings.iter().map(move |ending| format!("lib{name}.{ending}")));
        names.find(|name| petsc.folders.iter().any(|folder| folder.join(name).is_file())).ok_or_else(|| {
            let folders: Vec<_> = petsc.folders.iter().map(|folder| folder.display().to_string()).collect();
            format!(
                "PETSc's shared library is missing in {}: install the Debian package petsc-dev, or configure PETSc with shared libraries, {WAY_OUT}",
                folders.join(" and ")
            )
        })
    }

    /// Runs a closure that may panic without printing the panic.
    fn quietly<T>(body: impl FnOnce() -> T) -> std::thread::Result<T> {
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(|_| {}));
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(body));
        std::panic::set_hook(hook);
        result
    }

    /// Finds PETSc.
    fn find() -> Result<Petsc, String> {
        if let Some(folder) = std::env::var_os("PETSC_DIR").filter(|folder| !folder.is_empty()) {
            return in_folder(Path::new(&folder));
        }
        if Command::new(std::env::var_os("PKG_CONFIG").unwrap_or("pkg-config".into()))
            .arg("--version")
            .output()
            .is_err()
        {
            return Err(format!("pkg-config is missing: install the Debian package pkg-config, {WAY_OUT}"));
        }
        for name in ["PETSc", "petsc"] {
            let found = pkg_config::Config::new().cargo_metadata(false).env_metadata(false).probe(name);
            if let Ok(pkg_config::Library { include_paths, link_paths, libs, .. }) = found {
                return Ok(Petsc { includes: include_paths, folders: link_paths, names: libs, rpath: false });
            }
        }
        Err(format!("PETSc is missing: install the Debian package petsc-dev (or set PETSC_DIR), {WAY_OUT}"))
    }

    /// Returns the PETSc of `PETSC_DIR` and `PETSC_ARCH`.
    fn in_folder(folder: &Path) -> Result<Petsc, String> {
        let arch = std::env::var_os("PETSC_ARCH").filter(|arch| !arch.is_empty());
        let root = arch.map_or(folder.to_path_buf(), |arch| folder.join(arch));
        let absent = || {
            format!(
                "PETSC_DIR={} holds no PETSc{}: correct or unset it (the Debian package is petsc-dev), {WAY_OUT}",
                folder.display(),
                if root == folder { "; PETSC_ARCH may be missing" } else { " of this PETSC_ARCH" }
            )
        };
        let includes: Vec<_> =
            [folder.join("include"), root.join("include")].into_iter().filter(|path| path.is_dir()).collect();
        if !includes.iter().any(|path| path.join("petscconf.h").is_file()) {
            return Err(absent());
        }
        // Debian's builds have their kind in the name: libpetsc_real.so.
        let names = ["petsc", "petsc_real"].map(String::from).to_vec();
        Ok(Petsc { includes, folders: vec![root.join("lib")], names, rpath: true })
    }

    /// Returns the values of `#define NAME VALUE` lines in PETSc's own headers.
    fn definitions(petsc: &Petsc, header: &str) -> Result<Vec<(String, String)>, String> {
        let path = petsc
            .includes
            .iter()
            .map(|folder| folder.join(header))
            .find(|path| path.is_file())
            .ok_or_else(|| {
                format!("PETSc's header {header} is missing: install the Debian package petsc-dev, {WAY_OUT}")
            })?;
        let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let pairs = text.lines().filter_map(|line| {
            let (name, value) = line.trim().strip_prefix("#define ")?.split_once(char::is_whitespace)?;
            Some((name.to_string(), value.trim().to_string()))
        });
        Ok(pairs.collect())
    }

    /// Returns the release of PETSc, and refuses one that is too old, complex, in single precision, or
    /// built with 64-bit indices.
    fn suitable_release(petsc: &Petsc) -> Result<[u32; 2], String> {
        let version = definitions(petsc, "petscversion.h")?;
        let number = |name: &str| -> u32 {
            version.iter().find(|(key, _)| key == name).and_then(|(_, value)| value.parse().ok()).unwrap_or(0)
        };
        let (major, minor) = (number("PETSC_VERSION_MAJOR"), number("PETSC_VERSION_MINOR"));
        if (major, minor) < (3, 18) {
            return Err(format!(
                "PETSc {major}.{minor} is too old, 3.18 or later is needed: install the Debian package petsc-dev of bookworm or later, {WAY_OUT}"
            ));
        }
        let configuration = definitions(petsc, "petscconf.h")?;
        let has = |name: &str| configuration.iter().any(|(key, value)| key == name && value != "0");
        let fault = if has("PETSC_USE_COMPLEX") {
            "computes with complex numbers"
        } else if !has("PETSC_USE_REAL_DOUBLE") {
            "is not in double precision"
        } else if has("PETSC_USE_64BIT_INDICES") {
            "has 64-bit indices"
        } else {
            return Ok([major, minor]);
        };
        Err(format!(
            "this PETSc {fault}, a real one in double precision with 32-bit indices is needed: install the Debian package petsc-dev (libpetsc-real-dev) or set PETSC_DIR, {WAY_OUT}"
        ))
    }

    /// Returns the include folders of the MPI to which the compiler wrapper (`MPICC`, otherwise
    /// `mpicc`) belongs.
    fn mpi_includes() -> Result<Vec<PathBuf>, String> {
        let wrapper = std::env::var_os("MPICC").unwrap_or("mpicc".into());
        let output =
            Command::new(&wrapper).arg("-show").output().ok().filter(|output| output.status.success());
        let line = output.ok_or_else(|| {
            format!(
                "MPI's compiler wrapper {} does not run: install the Debian package libopenmpi-dev (or set MPICC), {WAY_OUT}",
                Path::new(&wrapper).display()
            )
        })?;
        let line = String::from_utf8_lossy(&line.stdout).into_owned();
        Ok(line.split_whitespace().filter_map(|word| word.strip_prefix("-I")).map(PathBuf::from).collect())
    }
}
