#!/usr/bin/env bash
# Runs one scene with several of PETSc's options, and prints the difference of each from the native
# engine and its cost. rebond refuses an option that the contenders of its line do not use, and
# names it.
# Usage: scripts/petsc_options_sweep.sh [SCENE.toml [arguments of rebond compare]]
set -eu

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export PATH="$PATH:$HOME/.cargo/bin"
cargo build --release --locked --quiet --manifest-path "$root/Cargo.toml"

if [ $# -eq 0 ]; then
    set -- "$root/scenes/csma2013/fig4.toml" --set time.step=1e-4 --set time.end=0.1
fi

# Each line has contenders, then the options for them.
sweep='
petsc
petsc           -pc_type cholesky -pc_factor_mat_solver_type petsc
petsc           -pc_type lu
petsc           -ksp_type cg -ksp_rtol 1e-14
petsc:snes
petsc:snes      -rebond_always_iterate
petsc:snes      -snes_linesearch_type bt
petsc:snes:vinewtonssls
petsc:tao:tron
petsc:tao:bnls
petsc:tao:gpcg
'

failed=0
while read -r contenders options; do
    [ -n "$contenders" ] || continue
    printf '==> %s %s\n' "$contenders" "$options"
    # shellcheck disable=SC2086  # options are words
    "$root/target/release/rebond" compare "$@" --with "$contenders" ${options:+-- $options} || failed=1
done <<<"$sweep"
exit $failed
