#!/usr/bin/env bash
# Builds the Python package in target/wheels: a wheel for any Linux and every Python from 3.10 on, and the
# sources, from which pip builds elsewhere. Then installs the wheel in an environment and imports it.
# Usage: scripts/wheels.sh [maturin's arguments]
set -eu
cd "$(dirname "$0")/.."
export PATH="$PATH:$HOME/.cargo/bin"
folder=target/wheels
environment=target/python/wheels

[ -x "$environment/bin/pip" ] || python3 -m venv --clear "$environment"
# Zig links against an old C library, which a wheel for any Linux needs.
"$environment/bin/pip" install --quiet --disable-pip-version-check 'maturin[zig]>=1.7,<2'
export PATH="$PWD/$environment/bin:$PATH"

rm -rf "$folder"
maturin build --release --locked --zig --compatibility manylinux2014 --manifest-path python/Cargo.toml --out "$folder" "$@"
maturin sdist --manifest-path python/Cargo.toml --out "$folder"

pip install --quiet --disable-pip-version-check --force-reinstall "$folder"/*.whl
cd "$folder"
python -c 'import rebond; print(rebond.__version__)'
