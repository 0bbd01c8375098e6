#!/usr/bin/env bash
# Writes the reports of two runs, a sweep and a study, and checks them in headless Chromium without a network
# (scripts/check_report.py). Installs Debian's chromium and chromium-driver if they are missing, as
# root or by sudo; the check is skipped only where that is impossible.
# Usage: scripts/check_report.sh [--pictures DIR]
set -eu
cd "$(dirname "$0")/.."

if ! command -v chromedriver >/dev/null; then
    as_root=()
    [ "$(id -u)" -eq 0 ] || as_root=(sudo)
    if ! command -v apt-get >/dev/null || ! "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get -qq install --yes --no-install-recommends chromium chromium-driver >/dev/null; then
        printf 'skipped: chromium and chromium-driver cannot be installed\n'
        exit 0
    fi
fi

rebond=${CARGO_TARGET_DIR:-target}/release/rebond
[ -x "$rebond" ] || cargo build --release --locked
runs=$(mktemp -d)
trap 'rm -rf "$runs"' EXIT
"$rebond" run scenes/csma2013/fig4.toml --quiet --set output.fields_every=333 --set output.stresses=true \
    --set time.end=0.25 --out "$runs/paper"
"$rebond" run scenes/csma2013/fig4.toml --quiet --set time.end=0.06 --out "$runs/still"
"$rebond" new shaker --out "$runs/shaker.toml" >/dev/null
"$rebond" sweep "$runs/shaker.toml" --quiet --set sweep.periods=20 --out "$runs/sweep"
"$rebond" new plate --out "$runs/plate.toml" >/dev/null
"$rebond" study "$runs/plate.toml" --quiet --schemes newmark,conserving --steps 2e-4,1e-4 --cells 6x2 \
    --set time.end=0.02 --set time.mass=singular --out "$runs/study" >/dev/null
for run in paper still sweep study; do
    "$rebond" report "$runs/$run" >/dev/null
done
python3 scripts/check_report.py "$runs"/*/report.html "$@"
