#!/usr/bin/env bash
# Gathers the files of a release in target/dist, which `make static deb wheels` has made, with their
# checksums, and writes the part of CHANGELOG.md on this version to target/notes.md.
# Usage: scripts/release.sh [TAG]    TAG must name the version of Cargo.toml, as v0.2.0 does
set -eu
cd "$(dirname "$0")/.."
version=$(sed -n '/^version = /{s/.*"\(.*\)"/\1/p;q}' Cargo.toml)
if [ "${1:-v$version}" != "v$version" ]; then
    echo "release: the tag $1 is not the version $version of Cargo.toml" >&2
    exit 1
fi

# The part begins with a heading that names the version, and ends at the next heading of its rank.
awk -v version="$version" '/^## / { here = $2 == version || $2 == version "," } here' CHANGELOG.md > target/notes.md
if [ ! -s target/notes.md ]; then
    echo "release: CHANGELOG.md has no heading for $version" >&2
    exit 1
fi

static=$(uname -m)-unknown-linux-musl
rm -rf target/dist
mkdir -p target/dist
tar -czf "target/dist/rebond-$version-$static.tar.gz" --transform "s,^,rebond-$version/," \
    LICENSE-APACHE LICENSE-MIT README.md CHANGELOG.md -C "target/$static/release" rebond
cp target/debian/*"_$version"*.deb target/wheels/*"-$version"*.whl target/wheels/*"-$version".tar.gz target/dist
cd target/dist
sha256sum -- * > SHA256SUMS
ls -sh
