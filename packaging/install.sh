#!/bin/sh
# Installs the service on a Debian-like computer with systemd, or takes it away again.
set -eu
umask 022  # what is installed is for others to read

usage() {
    cat <<'END'
usage: install.sh [--uninstall [--purge]] [--dry-run] [--root DIR] [--python PROGRAM] [--no-program]

Puts the program into /opt/companion, the unit, the user and the folders in place, and an environment
file and a mission file to be edited into /etc/companion. It can be run again at any time: what the
operator has edited is left alone, and what is as it should be is not touched.

  --uninstall   take away what was installed; configuration, flights and the user stay
  --purge       with --uninstall: these too
  --dry-run     say what would be done, and do nothing
  --root DIR    install below DIR, for an image; nothing is started, no user is made, and the program
                itself is left out: it does not move, so run this in the image for it
  --python P    the Python, 3.11 or newer, that the program will run on
  --no-program  everything but the program itself
END
}

action=install purge=no dry=no root="" python=python3 program=yes renewed=no
while [ $# -gt 0 ]; do
    case $1 in
        --uninstall) action=uninstall ;;
        --purge) purge=yes ;;
        --dry-run) dry=yes ;;
        --root) root=${2:?--root needs a folder}; program=no; shift ;;
        --python) python=${2:?--python needs a program}; shift ;;
        --no-program) program=no ;;
        -h | --help) usage; exit 0 ;;
        *) echo "install.sh: unknown option $1" >&2; usage >&2; exit 2 ;;
    esac
    shift
done
if [ "$purge" = yes ] && [ "$action" = install ]; then
    echo "install.sh: --purge goes with --uninstall" >&2
    exit 2
fi

here=$(cd "$(dirname "$0")" && pwd)
source=$(dirname "$here")
root=${root%/}
if [ -z "$root" ] && [ "$dry" = no ] && [ "$(id -u)" != 0 ]; then
    echo "install.sh: must be run as root, or with --root DIR or --dry-run" >&2
    exit 1
fi
if [ "$(cat "$root/opt/companion/installed" 2> /dev/null)" = package ]; then
    echo "install.sh: the Debian package has installed the program: apt keeps and removes it" >&2
    exit 1
fi

say() { echo "$*"; }
run() {
    say "+ $*"
    [ "$dry" = yes ] || "$@"
}

# file SOURCE TARGET MODE: a file of ours, replaced when it differs.
file() {
    if cmp -s "$1" "$root$2"; then
        return
    fi
    run install -D -m "$3" "$1" "$root$2"
}

# template SOURCE TARGET MODE: a file of the operator's, written once.
template() {
    if [ -e "$root$2" ]; then
        return
    fi
    run install -D -m "$3" "$1" "$root$2"
}

# gone PATH: a file or folder of ours, removed where it is.
gone() {
    if [ -e "$root$1" ] || [ -L "$root$1" ]; then
        run rm -rf "$root$1"
    fi
}

has_systemd() { [ -z "$root" ] && [ -d /run/systemd/system ]; }

unit=/etc/systemd/system/companion.service
users=/usr/lib/sysusers.d/companion.conf
folders=/usr/lib/tmpfiles.d/companion.conf

install_program() {
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
        echo "install.sh: Python 3.11 or newer is needed; name it: --python /path/to/python3" >&2
        exit 1
    }
    # The digest of what is installed says whether there is anything to do.
    stamp=/opt/companion/installed
    digest=$(cd "$source" && find companion requirements/service.txt pyproject.toml setup.py -type f ! -path '*/__pycache__/*' \
        -exec sha256sum {} + | LC_ALL=C sort | sha256sum | cut -d ' ' -f 1)
    if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$digest" ]; then
        return
    fi
    [ -x /opt/companion/bin/python ] || run "$python" -m venv /opt/companion
    # pip builds in the folder that it is given. In the checkout it would leave root's files, and install
    # from them what has been deleted since.
    copy=/tmp/companion
    if [ "$dry" = no ]; then
        copy=$(mktemp -d)
        trap 'rm -rf "$copy"' EXIT
    fi
    run cp -R "$source/companion" "$source/pyproject.toml" "$source/setup.py" "$source/README.md" "$copy"
    # Nothing is installed but what has the hash that the lock file has of it.
    run /opt/companion/bin/python -m pip install --quiet --disable-pip-version-check \
        --only-binary :all: --require-hashes -r "$source/requirements/service.txt"
    run /opt/companion/bin/python -m pip install --quiet --disable-pip-version-check \
        --force-reinstall --no-deps --no-build-isolation "$copy"
    say "+ remember $digest"
    [ "$dry" = yes ] || echo "$digest" > "$stamp"
    renewed=yes
}

# Kernels are compiled by the service's user, into the service's cache; else its first start does it.
warm_up() {
    say "The planner's kernels are compiled; a small computer takes a minute or two."
    run install -d -o companion -g companion -m 0750 /var/cache/companion
    run runuser -u companion -- env NUMBA_CACHE_DIR=/var/cache/companion \
        /opt/companion/bin/companion warm-up ||
        say "kernels are not compiled yet: the service's first start will take longer"
}

install_all() {
    [ "$program" = no ] || install_program
    file "$source/README.md" /opt/companion/share/doc/README.md 0644
    file "$here/99-companion.rules.example" /opt/companion/share/doc/99-companion.rules.example 0644
    file "$here/companion.service" "$unit" 0644
    file "$here/companion.sysusers" "$users" 0644
    file "$here/companion.tmpfiles" "$folders" 0644
    template "$here/environment.example" /etc/companion/environment 0640
    template "$source/mission_configs/first-flight.yaml" /etc/companion/mission.yaml 0640
    if [ -z "$root" ]; then
        run systemd-sysusers "$users"
        run chgrp -R companion /etc/companion
        run systemd-tmpfiles --create "$folders"
        [ "$renewed" = no ] || warm_up
    fi
    if has_systemd; then
        run systemctl daemon-reload
        say "Edit /etc/companion/environment and /etc/companion/mission.yaml, then:"
        say "  systemctl enable --now companion && journalctl -fu companion"
    fi
}

uninstall_all() {
    if has_systemd; then
        run systemctl disable --now companion.service || say "companion.service was not there"
    fi
    gone "$unit"
    gone "$folders"
    gone "$users"
    gone /opt/companion
    if has_systemd; then
        run systemctl daemon-reload
    fi
    if [ "$purge" = yes ]; then
        for folder in /etc/companion /var/lib/companion /var/cache/companion /var/log/companion; do
            gone "$folder"
        done
        if [ -z "$root" ] && id companion > /dev/null 2>&1; then
            run userdel companion
        fi
    fi
}

"${action}_all"
