#!/usr/bin/env bash
# Looks for misspelt words in pages, sources and scripts, by codespell from PyPI. The check is
# skipped only where codespell cannot be installed.
# Usage: scripts/check_spelling.sh [FILE...]    default: all files of the repository but data
set -eu
cd "$(dirname "$0")/.."

codespell=$(scripts/from_pypi.sh codespell 2.4.3) || { echo 'the check of the spelling is skipped' && exit 0; }

if [ $# -eq 0 ]; then
    mapfile -t files < <(git -c safe.directory='*' ls-files 2>/dev/null ||
        find . -type f -not -path './target/*' -not -path './.git/*' -not -path './runs/*' -not -path '*/node_modules/*')
    for file in "${files[@]}"; do
        case $file in
        *tests/data/* | *docs/katex/* | */bundle.* | *.svg | *.png | *.lock | *package-lock.json | *.msh) ;;
        *) set -- "$@" "$file" ;;
        esac
    done
fi
# Statics is a field. The others are misspelt on purpose, where messages suggest the right word, or
# parts of names.
PYTHONPATH=$codespell exec python3 -m codespell_lib --ignore-words-list statics,thicknes,widht,ser,fro,numer,co-ordinate "$@"
