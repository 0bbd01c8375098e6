#!/usr/bin/env bash
# Installs a package from PyPI, without its dependencies, in a folder of the build, and prints that
# folder; a package that is there already is not installed again. Fails where pip cannot install it.
# Usage: scripts/from_pypi.sh PACKAGE VERSION
set -eu
cd "$(dirname "$0")/.."

package=$1 version=$2
folder=${CARGO_TARGET_DIR:-target}/$package-$version
if [ ! -e "$folder/complete" ]; then
    rm -rf "$folder"
    if ! said=$(python3 -m pip install --quiet --no-deps --target "$folder" "$package==$version" 2>&1); then
        printf 'pip cannot install %s %s for this python: %s\n' "$package" "$version" "$(tail -n 1 <<<"$said")" >&2
        exit 1
    fi
    touch "$folder/complete"
fi
printf '%s\n' "$folder"
