#!/usr/bin/env bash
# Builds the wheel of the Python package in the folder of the program's build, installs it in a
# virtual environment there, and tests it beside the program. Usage: scripts/check_python.sh [pytest's arguments]
set -eu
cd "$(dirname "$0")/.."
root=$PWD
CARGO_TARGET_DIR=$(realpath --canonicalize-missing "${CARGO_TARGET_DIR:-target}")
export PATH="$PATH:$HOME/.cargo/bin" CARGO_TARGET_DIR
folder=$CARGO_TARGET_DIR/python
environment=$folder/environment
needs=(maturin numpy scipy matplotlib pytest)

# The environment is made while the crates are built.
[ -x "$environment/bin/pip" ] || python3 -m venv --clear "$environment"
"$environment/bin/pip" install --quiet --disable-pip-version-check "${needs[0]}"
"$environment/bin/pip" install --quiet --disable-pip-version-check "${needs[@]}" & packages=$!

# The library is compiled once more, without PETSc. It is not optimised, which saves more time than the
# slower tests cost.
rm -rf "$folder/wheels"
PATH="$environment/bin:$PATH" MATURIN_PEP517_ARGS="--config profile.release.package.rebond.opt-level=0" \
    "$environment/bin/pip" wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation --wheel-dir "$folder/wheels" ./python
wait $packages
"$environment/bin/pip" install --quiet --disable-pip-version-check --no-deps --force-reinstall "$folder"/wheels/*.whl

# From elsewhere than the sources, so that the wheel is what is tested.
cd "$folder"
REBOND=${REBOND:-$CARGO_TARGET_DIR/release/rebond} REBOND_CACHE='' MPLBACKEND=Agg PYTHONDONTWRITEBYTECODE=1 \
    "$environment/bin/python" -m pytest -c "$root/python/pyproject.toml" -p no:cacheprovider "$root/python/tests" "$@"
