#!/usr/bin/env bash
# Prepares a machine to build and test rebond: installs the Debian packages that are missing and
# checks the Rust tools. It prints nothing when nothing is missing.
# Usage: scripts/setup.sh [PACKAGE...]    further packages that are needed
set -eu

# Packages that the build needs besides Rust and gcc.
packages=(
    make                 # runs the targets of the Makefile
    pkg-config           # finds PETSc
    ca-certificates      # lets cargo download the crates over https
    petsc-dev            # the distributed engine; brings Open MPI and MUMPS
    libclang-dev         # reads the headers of PETSc and MPI
    libopenblas0-pthread # a factorisation takes 4 times as long with the reference BLAS
)

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export PATH="$PATH:$HOME/.cargo/bin"

say() { printf 'setup: %s\n' "$*" >&2; }
fail() { say "$@"; exit 1; }

packages+=("$@")

install_packages() {
    # pip installs what make test checks spelling and the fields of a run with.
    python3 -m pip --version >/dev/null 2>&1 || packages+=(python3-pip)
    # The Python package is tested in an environment of its own.
    python3 -c 'import ensurepip, venv' >/dev/null 2>&1 || packages+=(python3-venv)
    command -v cc >/dev/null || packages+=(gcc libc6-dev)
    if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
        say "this system has no apt; please make sure that it has the equivalents of: ${packages[*]}"
        return
    fi

    local installed missing=() package
    installed=$(dpkg-query --show --showformat='${binary:Package} ${db:Status-Status}\n' "${packages[@]}" 2>/dev/null || true)
    for package in "${packages[@]}"; do
        grep -qE "^$package(:[a-z0-9]+)? installed$" <<<"$installed" || missing+=("$package")
    done
    [ ${#missing[@]} -gt 0 ] || return 0

    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null ||
            fail "packages are missing and there is no sudo; as root, run: apt-get install ${missing[*]}"
        as_root=(sudo)
    fi
    say "installing what the build needs: ${missing[*]}"
    local apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq)
    "${apt[@]}" update >/dev/null || fail "apt-get update failed"
    "${apt[@]}" install --yes --no-install-recommends "${missing[@]}" >/dev/null || fail "apt-get install failed"
}

check_rust() {
    local minimum found component
    minimum=$(sed -n 's/^rust-version *= *"\(.*\)"/\1/p' "$root/Cargo.toml")
    command -v cargo >/dev/null ||
        fail "cargo is missing; install Rust $minimum or later by rustup: https://rustup.rs"
    found=$(cargo --version | cut -d' ' -f2)
    printf '%s\n' "$minimum" "${found%%-*}" | sort --check=quiet --version-sort ||
        fail "Rust $found is too old, rebond needs $minimum or later; try: rustup update stable"

    for component in rustfmt clippy; do
        cargo "${component/rustfmt/fmt}" --version >/dev/null 2>&1 && continue
        command -v rustup >/dev/null ||
            fail "$component is missing and there is no rustup to add it; install it as you installed Rust"
        say "adding $component, which make test runs"
        rustup --quiet component add "$component" || fail "rustup could not add $component"
    done
}

install_packages
check_rust
