#!/usr/bin/env bash
# newer.sh ROOT [WORDS FOR PYTEST]: the tests under CPython 3.13, in a Debian trixie root that is made once and kept.
set -euo pipefail
source "$(dirname "$0")/root.sh"
begin_root trixie "make test-newer"
if [ ! -e "$root/venv" ]; then chroot "$root" python3 -m venv /venv; fi
mkdir -p "$root/navbench"
# what is mounted in a namespace of its own ends with it
exec unshare --mount sh -euc '
  root=$1
  shift
  mount -t proc proc "$root/proc"
  mount --rbind /dev "$root/dev"
  mount --bind . "$root/navbench"
  exec chroot "$root" env HOME=/root TMPDIR=/tmp LC_ALL=C.UTF-8 PATH=/venv/bin:/usr/bin:/bin sh -euc "
    cd /navbench
    pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable .[dev]
    exec python -m pytest -n auto --dist worksteal \"\$@\"" pytest "$@"' unshare "$root" "$@"
