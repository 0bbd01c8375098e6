#!/usr/bin/env bash
# Checks that the pages of the documentation contain the equations unchanged, so that KaTeX can
# typeset them.
# Usage: scripts/check_equations.sh, after cargo doc
set -eu
cd "$(dirname "$0")/.."
pages=target/doc/rebond

fail() { printf 'check_equations: %s\n' "$*" >&2; exit 1; }

# Markdown removes a backslash before punctuation.
holds() {
    local page=$pages/$1 part
    shift
    for part; do grep -qF -- "$part" "$page" || fail "$page has no $part"; done
}
holds scheme/newmark/index.html 'language-math' '\frac{' '\tfrac{' '\Bigl(' '\,(' 'katex.min.js'
holds scheme/massless/potential/index.html 'language-math' '\tfrac12' '\{' '\;' 'katex.min.js'
if grep -rnE '^ *//[/!].*\\[][()]' src; then
    fail 'write displays as fences of the language "math" and inline formulas as code between dollar signs'
fi
for file in katex.min.js katex.min.css fonts/KaTeX_Main-Regular.woff2; do
    [ -s "docs/katex/$file" ] || fail "docs/katex/$file is missing"
done
