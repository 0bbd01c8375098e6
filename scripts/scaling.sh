#!/usr/bin/env bash
# Measures assembly, step times and peak memory of the PETSc engine on fine meshes of triangles, on
# 1 and 2 ranks. The run makes 20 steps of a bent plate that is pushed onto an obstacle just under
# its tip.
# Usage: scripts/scaling.sh [CELLS...]      default: 320,128 640,256
#   RANKS="1 2 4" scripts/scaling.sh 160,64
set -eu

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export PATH="$PATH:$HOME/.cargo/bin"
cargo build --release --locked --quiet --manifest-path "$root/Cargo.toml"
if [ "$(id -u)" -eq 0 ]; then
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
fi
[ $# -gt 0 ] || set -- 320,128 640,256

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/scene.toml" <<'SCENE'
title = "a bent plate pushed down on an obstacle just under its tip"
plate = { length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }
mesh = { element = "hct", cells = [20, 8] }
support = [{ edge = "left", kind = "clamped" }]
obstacle = [{ side = "below", height = -0.2085 }]
initial = { static_pressure = -14600 }
load = { pressure = -1e5 }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 2e-3 }
SCENE

# GNU time, if it is installed, measures the peak memory of each process, in KiB.
peak=()
[ -x /usr/bin/time ] && peak=(/usr/bin/time --append --output "$folder/memory" --format %M)

printf '%-10s %5s %9s %8s %8s %9s %9s %8s %9s\n' cells ranks dofs 'set-up s' 'start s' 'factor s' 's a step' contact 'peak MiB'
for cells in "$@"; do
    for ranks in ${RANKS:-1 2}; do
        : >"$folder/memory"
        mpirun --oversubscribe --mca mpi_yield_when_idle 1 --mca pml ob1 --mca btl ^tcp,ofi -n "$ranks" "${peak[@]}" "$root/target/release/rebond" \
            run "$folder/scene.toml" --engine petsc --set "mesh.cells=[$cells]" --json --overwrite --out "$folder/run" \
            >"$folder/summary.json"
        memory=$(awk '{ sum += $1 } END { if (NR) printf "%.0f", sum / 1024; else print "-" }' "$folder/memory")
        number() { awk -F '[:,]' -v key="\"$1\"" '$1 ~ key { printf "%s", $2; exit }' "$folder/summary.json"; }
        LC_ALL=C printf '%-10s %5d %9d %8.2f %8.2f %9.2f %9.3f %8s %9s\n' "${cells/,/x}" "$ranks" "$(number dofs)" \
            "$(number assembly)" "$(number equilibrium)" "$(number factor)" \
            "$(LC_ALL=C awk "BEGIN { print $(number stepping) / $(number steps) }")" \
            "$(number contact_steps)/$(number steps)" "$memory"
    done
done
