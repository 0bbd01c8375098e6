#!/usr/bin/env bash
# Checks the snapshots of a run with VTK's own reader, from PyPI, by tests/vtk.py. The check is
# skipped only where VTK cannot be installed.
# Usage: scripts/check_vtk.sh
set -eu
cd "$(dirname "$0")/.."

# VTK's dependencies serve only for drawing.
vtk=$(scripts/from_pypi.sh vtk 9.5.2) || { echo 'the check by VTK is skipped' && exit 0; }

export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
PYTHONPATH=$vtk exec python3 tests/vtk.py "${CARGO_TARGET_DIR:-target}/release/rebond" \
    mpirun --oversubscribe --mca mpi_yield_when_idle 1 --mca pml ob1 --mca btl ^tcp,ofi -n 2
