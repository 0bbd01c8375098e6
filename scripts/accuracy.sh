#!/bin/sh
# Makes again what docs/accuracy.md shows: the studies of the paper's plate, of the same refined, of a smooth problem and of the plate's free
# flight, and the paper's figures. Reports and pictures go to docs/accuracy. Some ten minutes on an idle machine; timings are its own.
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

# Pictures tell the command that made them; where its output went is this script's affair.
keep() { sed 's/ --out [^<]*//' "$work/$1" >"docs/accuracy/$2"; }
for name in paper refined; do
    cp "$work/$name/study.csv" "docs/accuracy/$name.csv"
done
keep paper/plots/work-precision-fvs-10x4.svg work-precision.svg
keep paper/plots/orders-fvs-10x4.svg orders.svg
keep refined/plots/work-precision.svg refined.svg
