#!/bin/sh
# Recomputes the results of docs/accuracy.md: the studies of the paper's plate, of the same plate
# refined, of a smooth problem, of the plate's free flight and of the plate with the modal mass, and
# the paper's figures. Reports and pictures go to docs/accuracy. The script takes some fifteen minutes
# on an idle machine; timings are those of the machine.
#
#   scripts/accuracy.sh
set -eu
cd "$(dirname "$0")/.."
cargo build --release --locked --quiet
rebond=target/release/rebond
work=$(mktemp -d)
trap 'rm -r "$work"' EXIT
mkdir -p docs/accuracy

for name in paper refined smooth cantilever front; do
    "$rebond" study "scenes/study/$name.toml" --out "$work/$name" >"docs/accuracy/$name.txt"
done
"$rebond" figures --out "$work/figures" >docs/accuracy/claims.txt
sed -i '/^written to/d' docs/accuracy/*.txt

# Pictures name the command that made them; its temporary output folder is removed from it.
keep() { sed 's/ --out [^<]*//' "$work/$1" >"docs/accuracy/$2"; }
for name in paper refined front; do
    cp "$work/$name/study.csv" "docs/accuracy/$name.csv"
done
keep paper/plots/work-precision-fvs-10x4.svg work-precision.svg
keep paper/plots/orders-fvs-10x4.svg orders.svg
keep refined/plots/work-precision.svg refined.svg
keep front/plots/work-precision.svg front.svg
keep front/plots/after-impact.svg after-impact.svg
