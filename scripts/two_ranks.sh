#!/usr/bin/env bash
# Runs the paper's scene on 2 ranks with the PETSc engine. The numbers agree with those of one
# process; rank 0 writes the files and the report.
# Usage: scripts/two_ranks.sh [SCENE.toml [arguments of rebond run]]
#   RANKS=4 scripts/two_ranks.sh scenes/csma2013/fig1.toml --set mesh.refine=2 -- -log_view
set -eu

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export PATH="$PATH:$HOME/.cargo/bin"
cargo build --release --locked --quiet --manifest-path "$root/Cargo.toml"

# Open MPI starts programs as root, the usual user of a container, only with both of these
# variables.
if [ "$(id -u)" -eq 0 ]; then
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
fi

# --oversubscribe allows more ranks than cores; yield_when_idle makes waiting ranks leave the core
# to the others; pml ob1 and btl ^tcp,ofi keep to memory: without a network Open MPI 5 complains
# otherwise, and the search for one takes Open MPI 4 a second per job.
launch=(mpirun --oversubscribe --mca mpi_yield_when_idle 1 --mca pml ob1 --mca btl ^tcp,ofi -n "${RANKS:-2}")

if [ $# -eq 0 ]; then
    set -- "$root/scenes/csma2013/fig4.toml" --set time.step=1e-5 --set time.end=0.1 --out "runs/ranks"
fi
# With several processes the program chooses the PETSc engine.
exec "${launch[@]}" "$root/target/release/rebond" run "$@"
