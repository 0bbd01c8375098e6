#!/usr/bin/env bash
# Compares the speed of two revisions by benches/step.rs. The benchmarks of both are built and then
# run in turns, so that other work on the machine slows both alike.
#
# For each part the least median of a revision's runs counts. The noise is the ratio of the least
# medians of the first revision's odd and even runs: it tells by how much two equal programs differ
# here. A ratio outside of 1 +- (2 % + noise) is marked "slower" or "faster".
#
# Usage: scripts/bench_compare.sh OLD [NEW] [MESH...]     default: NEW is the last commit
#   TURNS=10 scripts/bench_compare.sh main~5 main "fvs 80x32"
# The exit code is 1 if a part is slower.
set -eu
[ $# -gt 0 ] || { sed -n '2,/^set/{s/^# \{0,1\}//;/^set/d;p}' "$0" >&2; exit 2; }
old=$1
new=${2:-HEAD}
shift $(($# < 2 ? $# : 2))
turns=${TURNS:-4}

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export PATH="$PATH:$HOME/.cargo/bin"
folder=$(mktemp -d)
trap 'git -C "$root" worktree remove --force "$folder/source" 2>"$folder/said" || true; rm -rf "$folder"' EXIT

# Both revisions are built in the same folder, so that only rebond itself is compiled twice.
git -C "$root" worktree add --quiet --detach "$folder/source" "$old"
for revision in old new; do
    git -C "$folder/source" checkout --quiet --detach "$(git -C "$root" rev-parse --verify "${!revision}^{commit}")"
    printf 'build %s %s\n' "${!revision}" "$(git -C "$folder/source" log -1 --format='%h %s')" >&2
    program=$(cd "$folder/source" && CARGO_TARGET_DIR=$root/target/bench_compare \
        cargo bench --locked --quiet --no-run --no-default-features --bench step --message-format json |
        sed -n 's/.*"name":"step".*"executable":"\([^"]*\)".*/\1/p')
    cp "$program" "$folder/$revision"
done

for ((turn = 1; turn <= turns; turn++)); do
    for revision in old new; do
        printf '\rturn %d of %d, %s ' "$turn" "$turns" "$revision" >&2
        "$folder/$revision" "$@" | sed "1d; s/^/$revision $turn /" >>"$folder/times"
    done
done
printf '\r%30s\r' '' >&2

# Columns: revision, turn, element, cells, words of the part, then the median and other numbers.
awk '
    {
        key = $3
        for (field = 4; $field !~ /^[0-9.]+$/ || field == 4; field++) key = key " " $field
        if (!(key in seen)) { seen[key] = 1; order[++count] = key }
        least(key, $1, $field); least(key, $1 $2 % 2, $field)
    }
    function least(key, which, value) { if (!((key, which) in best) || value < best[key, which]) best[key, which] = value }
    END {
        printf "%-30s %12s %12s %8s %8s\n", "part", "old us", "new us", "new/old", "noise"
        for (i = 1; i <= count; i++) {
            key = order[i]
            if (!((key, "old") in best) || !((key, "new") in best)) continue
            ratio = best[key, "new"] / best[key, "old"]
            noise = best[key, "old1"] / best[key, "old0"] - 1; if (noise < 0) noise = -noise
            mark = ratio > 1.02 + noise ? "slower" : ratio < 0.98 - noise ? "faster" : ""
            if (mark == "slower") slower++
            printf "%-30s %12.2f %12.2f %8.3f %7.1f%% %s\n", key, best[key, "old"], best[key, "new"], ratio, 100 * noise, mark
        }
        if (!count) { print "no mesh has such a name" ; exit 2 }
        exit slower > 0
    }' "$folder/times"
