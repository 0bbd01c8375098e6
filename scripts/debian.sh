#!/usr/bin/env bash
# Builds and tests the working tree on a bare Debian of another release, in a root folder (chroot)
# that debootstrap fills. It runs scripts/setup.sh, then `make run` and `make test`; on sid, whose
# packages change daily, it runs only the build, its lints and the tests of PETSc's handles. The
# script must run as root. Rust is the caller's own (~/.cargo, ~/.rustup); debootstrap is installed
# if it is missing.
# Usage: scripts/debian.sh bookworm|trixie|sid [COMMAND [ARGUMENTS]]
#   DEBIAN_MIRROR=http://deb.debian.org/debian   source of packages; default: the first Debian mirror of
#                                                this machine's apt
#   DEBIAN_ROOT=/var/tmp/rebond-debian           parent of the root folders and of their build products
#   DEBIAN_USER=ada                              user, made with sudo, who runs the command with a ~/.cargo of
#                                                her own; default: root, who runs scripts/setup.sh before
#   scripts/debian.sh trixie cargo test --release --locked --test petsc
set -eu

release=${1:-}
case $release in
bookworm | trixie) whole='make run && make test' ;;
sid) whole='cargo build --release --locked && cargo clippy --release --locked --all-targets -- -D warnings && cargo test --release --locked --test petsc' ;;
*)
    sed -n 's/^# Usage: /usage: /p' "${BASH_SOURCE[0]}" >&2
    exit 2
    ;;
esac
shift
[ $# -gt 0 ] || set -- bash -c "$whole"

source=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
system=${DEBIAN_ROOT:-/var/tmp/rebond-debian}/$release

say() { printf 'debian: %s\n' "$*" >&2; }
fail() { say "$@"; exit 1; }

# Prints the first mirror of Debian's main archive that apt knows.
mirror() {
    apt-get indextargets --format '$(ORIGIN) $(LABEL) $(REPO_URI)' 'Created-By: Packages' |
        sed -n 's/^Debian Debian //p' | head -n 1
}

[ "$(id -u)" -eq 0 ] || fail "only root can change the root folder (chroot)"
command -v cargo >/dev/null || export PATH="$PATH:$HOME/.cargo/bin"
command -v cargo >/dev/null || fail "cargo is missing; install Rust by rustup: https://rustup.rs"
if ! command -v debootstrap >/dev/null; then
    say "installing debootstrap"
    apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq install --yes debootstrap >/dev/null
fi

if [ ! -e "$system/complete" ]; then
    packages=${DEBIAN_MIRROR:-$(mirror)}
    [ -n "$packages" ] || fail "apt knows no mirror of Debian; name one: DEBIAN_MIRROR=http://deb.debian.org/debian"
    say "$release from $packages to $system"
    rm -rf --one-file-system "$system"
    mkdir -p "$system"
    debootstrap --variant=minbase --include=ca-certificates "$release" "$system" "$packages" >"$system.log" 2>&1 ||
        fail "debootstrap failed: see $system.log"
    # Settings by which this machine's apt reaches mirrors: proxies, and whether packages may be
    # outdated.
    apt-config dump Acquire | grep -iE '::(proxy|check-)' >"$system/etc/apt/apt.conf.d/90machine" || true
    touch "$system/complete"
fi

# The mounts disappear with their name space, however the script ends.
export source system
exec unshare --mount --propagation private bash -eu -c '
    bind() { mkdir -p "$2"; mount --rbind "$1" "$2"; }
    file() { mkdir -p "$(dirname "$2")"; touch "$2"; mount --bind "$1" "$2"; }
    mount -t proc proc "$system/proc"
    bind /sys "$system/sys"
    bind /dev "$system/dev"
    bind "${CARGO_HOME:-$HOME/.cargo}" "$system/opt/cargo"
    bind "${RUSTUP_HOME:-$HOME/.rustup}" "$system/opt/rustup"
    for name in /etc/resolv.conf /etc/hosts /etc/ssl/certs/ca-certificates.crt; do
        [ ! -e "$name" ] || file "$name" "$system$name"
    done

    # Copies the working tree, with files that are not committed, and removes the files of an
    # earlier copy.
    mkdir -p "$system/rebond"
    find "$system/rebond" -mindepth 1 -maxdepth 1 ! -name target ! -name runs -exec rm -rf {} +
    cd "$source"
    git -c safe.directory="*" ls-files --cached --others --exclude-standard -z |
        while IFS= read -r -d "" name; do [ ! -e "$name" ] || printf "%s\0" "$name"; done |
        tar --create --null --files-from - | tar --extract --directory "$system/rebond"

    environment=(HOME=/root TERM="${TERM:-dumb}" CARGO_HOME=/opt/cargo RUSTUP_HOME=/opt/rustup
        PATH=/opt/cargo/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin)
    for name in http_proxy https_proxy no_proxy HTTP_PROXY HTTPS_PROXY NO_PROXY CARGO_HTTP_CAINFO PIP_INDEX_URL \
        CARGO_BUILD_JOBS CARGO_INCREMENTAL CARGO_PROFILE_RELEASE_DEBUG CARGO_PROFILE_RELEASE_LTO CARGO_PROFILE_RELEASE_OPT_LEVEL; do
        [ -z "${!name:-}" ] || environment+=("$name=${!name}")
    done
    if [ -z "${DEBIAN_USER:-}" ]; then
        before="cd /rebond; scripts/setup.sh"
    else
        before="
            if ! id $DEBIAN_USER >/dev/null 2>&1; then
                apt-get -qq update
                DEBIAN_FRONTEND=noninteractive apt-get -qq install --yes --no-install-recommends sudo >/dev/null 2>&1
                useradd --create-home --shell /bin/bash $DEBIAN_USER
                echo \"$DEBIAN_USER ALL=(ALL) NOPASSWD: ALL\" >/etc/sudoers.d/$DEBIAN_USER
            fi
            chown -R $DEBIAN_USER: /rebond
            cd /rebond
            export HOME=/home/$DEBIAN_USER CARGO_HOME=/home/$DEBIAN_USER/.cargo
            export PATH=\$CARGO_HOME/bin:\$PATH
            set -- runuser -u $DEBIAN_USER -- \"\$@\""
    fi
    exec chroot "$system" env -i "${environment[@]}" bash -eu -c "$before; exec \"\$@\"" rebond "$@"
' rebond "$@"
