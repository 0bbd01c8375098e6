#!/bin/sh
# Makes again what docs/accuracy.md shows: the studies of the paper's plate, of the same refined, of a smooth problem and of the plate's free
# flight, and the paper's figures. Reports and pictures go to docs/accuracy. Some MINUTES minutes on two idle cores; timings are the machine's.
#
#   scripts/accuracy.sh
set -eu
cd "$(dirname "$0")/.."
cargo build --release --locked --quiet
rebond=target/release/rebond
work=$(mktemp -d)
trap 'rm -r "$work"' EXIT
mkdir -p docs/accuracy

for name in paper refined smooth cantilever; do
    "$rebond" study "scenes/study/$name.toml" --out "$work/$name" >"docs/accuracy/$name.txt"
done
"$rebond" figures --out "$work/figures" >docs/accuracy/claims.txt
sed -i '/^written to/d' docs/accuracy/*.txt

for name in paper refined; do
    cp "$work/$name/study.csv" "docs/accuracy/$name.csv"
done
cp "$work/paper/plots/work-precision-fvs-10x4.svg" docs/accuracy/work-precision.svg
cp "$work/paper/plots/orders-fvs-10x4.svg" docs/accuracy/orders.svg
