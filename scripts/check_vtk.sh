#!/usr/bin/env bash
# Checks the snapshots of a run with VTK's own reader, from PyPI, by tests/vtk.py. The check is
# skipped only where VTK cannot be installed.
# Usage: scripts/check_vtk.sh
set -eu
cd "$(dirname "$0")/.."

version=9.5.2
vtk=${CARGO_TARGET_DIR:-target}/vtk-$version
if [ ! -e "$vtk/complete" ]; then
    rm -rf "$vtk"
    # VTK's dependencies serve only for drawing.
    if ! said=$(python3 -m pip install --quiet --no-deps --target "$vtk" "vtk==$version" 2>&1); then
        printf 'skipped: pip cannot install vtk %s for this python: %s\n' "$version" "$(tail -n 1 <<<"$said")"
        exit 0
    fi
    touch "$vtk/complete"
fi

export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
PYTHONPATH=$vtk exec python3 tests/vtk.py "${CARGO_TARGET_DIR:-target}/release/rebond" \
    mpirun --oversubscribe --mca mpi_yield_when_idle 1 --mca pml ob1 --mca btl ^tcp,ofi -n 2
