#!/usr/bin/env bash
# Compares the speed of two revisions. The benchmarks of both are built and then run in turns, so
# that other work on the machine slows both alike; the shortest time of all turns counts.
#
# The noise band of a benchmark is the ratio of the shortest times of the first revision's odd and
# even turns: it tells by how much two equal programs differ here. A ratio outside of
# 1 +- (2 % + noise) is marked "slower" or "faster".
#
# Usage: scripts/bench_compare.sh OLD [NEW] [FILTER...]     default: NEW is the last commit
#   BENCH=effects TURNS=10 scripts/bench_compare.sh main~5 main
#   scripts/bench_compare.sh main~5 main f_step g_contact
# The exit code is 1 if a benchmark is slower.
set -eu
[ $# -gt 0 ] || { sed -n '2,/^set/{s/^# \{0,1\}//;/^set/d;p}' "$0" >&2; exit 2; }
old=$1
new=${2:-HEAD}
shift $(($# < 2 ? $# : 2))
bench=${BENCH:-step} turns=${TURNS:-6}

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
        cargo bench --locked --quiet --no-run --no-default-features --bench "$bench" --message-format json |
        sed -n "s/.*\"name\":\"$bench\".*\"executable\":\"\([^\"]*\)\".*/\1/p")
    cp "$program" "$folder/$revision"
done

# The filter keeps divan from running the bench's own comparison at the end.
[ $# -gt 0 ] || set -- ''
for ((turn = 1; turn <= turns; turn++)); do
    for revision in old new; do
        printf '\rturn %d of %d, %s ' "$turn" "$turns" "$revision" >&2
        "$folder/$revision" --bench --max-time 0.3 "$@" | sed "s/^/$revision $turn /" >>"$folder/times"
    done
done
printf '\r%30s\r' '' >&2

# A line of divan's table with arguments: tree, name, fastest time and unit, then other columns; a
# line without times names the benchmark of the lines below.
awk '
    BEGIN { in_us["ns"] = 1e-3; in_us["µs"] = 1; in_us["us"] = 1; in_us["ms"] = 1e3; in_us["s"] = 1e6 }
    {
        revision = $1; turn = $2
        line = $0; sub(/^[a-z]+ [0-9]+ /, "", line); gsub(/[│├╰─]/, " ", line)
        if (match(line, /[0-9.]+ (ns|µs|us|ms|s) /)) {
            split(substr(line, RSTART, RLENGTH), time, " ")
            name = substr(line, 1, RSTART - 1); gsub(/^ +| +$/, "", name)
            key = group " " name; value = time[1] * in_us[time[2]]
            if (!(key in seen)) { seen[key] = 1; order[++count] = key }
            least(key, revision, value); least(key, revision turn % 2, value)
        } else { group = line; gsub(/ .*$/, "", group); if (group == "") { split(line, words, " "); group = words[1] } }
    }
    function least(key, which, value) { if (!((key, which) in best) || value < best[key, which]) best[key, which] = value }
    END {
        printf "%-28s %12s %12s %8s %8s\n", "benchmark", "old us", "new us", "new/old", "noise"
        for (i = 1; i <= count; i++) {
            key = order[i]
            if (!((key, "old") in best) || !((key, "new") in best)) continue
            ratio = best[key, "new"] / best[key, "old"]
            noise = best[key, "old1"] / best[key, "old0"] - 1; if (noise < 0) noise = -noise
            mark = ratio > 1.02 + noise ? "slower" : ratio < 0.98 - noise ? "faster" : ""
            if (mark == "slower") slower++
            printf "%-28s %12.3f %12.3f %8.3f %7.1f%% %s\n", key, best[key, "old"], best[key, "new"], ratio, 100 * noise, mark
        }
        if (!count) { print "no benchmark fits" ; exit 2 }
        exit slower > 0
    }' "$folder/times"
