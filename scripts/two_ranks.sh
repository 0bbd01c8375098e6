#!/usr/bin/env bash
# The paper's scene on 2 ranks: PETSc's engine, the same numbers as in one process, files and report from rank 0.
# Usage: scripts/two_ranks.sh [SCENE.toml [arguments of rebond run]]
#   RANKS=4 scripts/two_ranks.sh scenes/csma2013/fig1.toml --set mesh.refine=2 -- -log_view
set -eu

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export PATH="$PATH:$HOME/.cargo/bin"
cargo build --release --locked --quiet --manifest-path "$root/Cargo.toml"

# Open MPI refuses to start programs as root, which is what one is in most containers, unless told twice.
if [ "$(id -u)" -eq 0 ]; then
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
fi

# --oversubscribe: more ranks than cores may start; yield_when_idle: those that wait leave the core to the others;
# btl ^tcp: ranks of one machine need no network, of whose absence Open MPI 5 complains.
launch=(mpirun --oversubscribe --mca mpi_yield_when_idle 1 --mca btl ^tcp -n "${RANKS:-2}")

if [ $# -eq 0 ]; then
    set -- "$root/scenes/csma2013/fig4.toml" --set time.step=1e-5 --set time.end=0.1 --out "runs/ranks"
fi
# Several processes choose the PETSc engine by themselves.
exec "${launch[@]}" "$root/target/release/rebond" run "$@"
