//! Examples and hints at the end of the help of each command; a test runs the parser on each line.

/// Begins the work, and tells the exit codes.
pub(super) const PROGRAM: &str = "\
Begin with:
  rebond new plate            # writes plate.toml, a commented scene
  rebond check plate.toml     # every default, natural frequencies, an advised step, warnings
  rebond run plate.toml       # simulates, into runs/plate
  rebond plot runs/plate      # pictures
  rebond report runs/plate    # one page with the moving plate, for a browser

Exit codes: 0 done; 2 scene or command line; 3 a solver did not converge; 4 reading or writing;
5 the energy guard stopped the run; 130 interrupted, with a checkpoint written.";

pub(super) const RUN: &str = "\
Examples:
  rebond run plate.toml
  rebond run plate.toml --set time.step=1e-6 --set time.scheme=conserving --out runs/fine
  rebond run plate.toml --set 'load.pressure=100*sin(40*t)' --overwrite
  rebond run plate.toml --engine petsc --vi tao -- -tao_monitor
  mpirun -n 2 rebond run plate.toml

Ctrl-C writes a checkpoint; `rebond resume` goes on from it.";

pub(super) const RESUME: &str = "\
Examples:
  rebond resume runs/plate
  rebond resume runs/plate --until 0.5    # beyond the end of the scene";

pub(super) const CHECK: &str = "\
Examples:
  rebond check plate.toml
  rebond check plate.toml --set mesh.refine=2 --json";

pub(super) const INSPECT: &str = "\
Examples:
  rebond inspect plate.toml
  rebond inspect plate.toml --matrices matrices";

pub(super) const COMPARE: &str = "\
Examples:
  rebond compare plate.toml --set time.end=0.06
  rebond compare plate.toml --with native,petsc,petsc:tao:gpcg";

pub(super) const STUDY: &str = "\
Examples:
  rebond study plate.toml
  rebond study plate.toml --set 'study.schemes=[\"newmark\", \"conserving\"]' --jobs 2

The table [study] of the scene says what is compared; without it a usual choice is.";

pub(super) const SWEEP: &str = "\
Examples:
  rebond sweep shaker.toml                                  # the scene's table [sweep]
  rebond sweep shaker.toml --over frequency=15..30:61 --period 1/frequency --up-and-down
  rebond sweep shaker.toml --over frequency=15..30:16 --over amplitude=1e-4,2e-4 --jobs 2
  mpirun -n 2 rebond sweep shaker.toml --ranks-per-run 1    # on PETSc, two runs at a time

Ctrl-C stops it; the same command goes on with the runs that are missing.";

pub(super) const STABILITY: &str = "\
Examples:
  rebond stability
  rebond stability plate.toml --with native,petsc:tao";

pub(super) const FIGURES: &str = "\
Examples:
  rebond figures
  rebond figures --smallest-step 1e-5    # in less time";

pub(super) const PLOT: &str = "\
Examples:
  rebond plot runs/plate
  rebond plot sweeps/shaker";

pub(super) const REPORT: &str = "\
Examples:
  rebond report runs/plate
  rebond report sweeps/shaker";

pub(super) const ANIMATE: &str = "\
Examples:
  rebond animate runs/plate
  rebond animate runs/plate --duration 10 --width 1280 --out slides/plate.png";

pub(super) const NEW: &str = "\
Examples:
  rebond new                  # plate.toml
  rebond new gmsh             # gmsh.toml, with the drawing and the mesh of its plate
  rebond new shaker --out rig/strip.toml";

pub(super) const COMPLETIONS: &str = "\
Examples:
  rebond completions bash > ~/.local/share/bash-completion/completions/rebond
  rebond completions zsh > ~/.zfunc/_rebond
  rebond completions fish > ~/.config/fish/completions/rebond.fish";

pub(super) const MAN: &str = "\
Examples:
  rebond man | man -l -
  rebond man sweep | man -l -
  rebond man --out ~/.local/share/man/man1    # all pages";

pub(super) const SCHEMA: &str = "\
Example:
  rebond schema > scene.schema.json

Editors with a TOML language server complete and check a scene whose first line is
#:schema ./scene.schema.json";
