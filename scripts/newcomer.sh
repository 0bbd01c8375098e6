#!/usr/bin/env bash
# Follows README.md and docs/tutorial.md as a newcomer does, on a bare Debian with Rust, and prints
# the seconds of each command. The commands, files and expected lines are those of the pages'
# fenced blocks; tests/cli/pages.rs says what the words after their fences mean. At the end the
# reports are opened in headless Chromium.
# Usage: scripts/newcomer.sh bookworm|trixie    on a fresh root folder, as root (scripts/debian.sh)
#        scripts/newcomer.sh here               on this machine, in this clone: packages are installed
set -eu

clone=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$clone"
case ${1:-} in
here) ;;
bookworm | trixie)
    export DEBIAN_ROOT=${DEBIAN_ROOT:-/var/tmp/rebond-newcomer} DEBIAN_USER=newcomer
    rm -rf --one-file-system "${DEBIAN_ROOT:?}/$1"
    exec scripts/debian.sh "$1" scripts/newcomer.sh here
    ;;
*)
    sed -n 's/^# Usage: /usage: /p' "${BASH_SOURCE[0]}" >&2
    exit 2
    ;;
esac

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
milestones=()

fail() { printf 'newcomer: %s\n' "$*" >&2; exit 1; }
now() { date +%s.%N; }
since() { awk -v from="$1" -v to="$(now)" 'BEGIN { printf "%.1f", to - from }'; }
squeezed() { tr -s '[:space:]' ' ' | sed 's/ $//'; }

# Notes when something was there for the first time.
reach() {
    [[ " ${milestones[*]-} " == *": $1 "* ]] || milestones+=("$(printf '%8s: %s ' "$(since "$start")" "$1")")
}

# Runs a command of a page in this shell, so that `cd` and `activate` stay, and prints its row.
follow_command() {
    local page=$1 command=$2 begin
    begin=$(now)
    # A run in the background may still write there: the shell appends what it says.
    : >"$scratch/output"
    if ! eval "$command" >>"$scratch/output" 2>&1 </dev/null; then
        tail -n 30 "$scratch/output" >&2
        fail "$page: this command failed: $command"
    fi
    cat "$scratch/output" >>"$scratch/said"
    printf '%8s %8s  %-16s  %s\n' "$(since "$begin")" "$(since "$start")" "$page" "$(squeezed <<<"${command%% #*}")"
    case $command in
    'rebond run scenes/'*) reach 'a build, and a run' ;;
    'make run'*) reach 'a build with PETSc, and a run' ;;
    'rebond run'*) reach 'a run of a scene of one'\''s own' ;;
    'rebond plot'*) reach 'a picture' ;;
    'rebond report'*) reach 'a report' ;;
    *' --until '*) ;;
    'rebond resume'*) reach 'an interrupted run, resumed' ;;
    'mpirun'*) reach 'a run on two ranks with PETSc' ;;
    'python3 '*.py*) reach 'a program in Python' ;;
    esac
}

# Follows a page: writes its files, runs its commands, and seeks the lines that these must say.
follow_page() {
    local page=$1 inside='' line words file
    while IFS= read -r line <&3; do
        if [[ $line == '```'* ]]; then
            [ -z "$inside" ] || { inside='' && continue; }
            read -r -a words <<<"${line#'```'}"
            case ${words[*]} in
            sh | 'sh mpi' | 'sh python') inside=commands && : >"$scratch/said" ;;
            text) inside=expected ;;
            *' >> '*) inside=file file=${words[2]} ;;
            'sh '* | rust | '') inside=other ;;
            *) inside=file file=${words[1]} && : >"$file" ;;
            esac
            continue
        fi
        case $inside in
        commands) [[ $line == '#'* ]] || follow_command "$page" "$line" ;;
        expected) grep -qF "$(squeezed <<<"$line")" <<<"$(squeezed <"$scratch/said")" ||
            fail "$page: after this command, no line says: $line" ;;
        file) printf '%s\n' "$line" >>"$file" ;;
        esac
    done 3<"$clone/$page"
}

printf ' seconds  elapsed  page              command\n'
# Rust by rustup asks for a linker.
command -v cc >/dev/null || sudo apt-get -qq install --yes gcc libc6-dev >/dev/null
start=$(now)
follow_page README.md
follow_page docs/tutorial.md

# What the newcomer's eyes do, with a browser that the system does not have yet.
sudo apt-get -qq install --yes --no-install-recommends chromium chromium-driver >/dev/null 2>&1
find . "$clone/runs" -name report.html -exec "$clone/scripts/check_report.py" {} +
reach 'the reports, opened in Chromium (with its installation)'

printf '\nseconds from the start until there was\n'
printf '%s\n' "${milestones[@]}"
