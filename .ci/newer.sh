#!/usr/bin/env bash
# newer.sh ROOT [WORDS FOR PYTEST]: the tests under CPython 3.13, in a Debian trixie root that is made once and kept.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$(realpath --canonicalize-missing "$1")
shift
if [ "$(id -u)" != 0 ] || ! command -v debootstrap >/dev/null; then
  echo "make test-newer needs root, and debootstrap: apt-get install debootstrap" >&2
  exit 1
fi
if [ ! -e "$root/venv" ]; then
  mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Origin: Debian' | head -n 1)
  debootstrap --variant=minbase --include=ca-certificates,python3-venv trixie "$root" ${mirror:+"$mirror"}
  chroot "$root" python3 -m venv /venv
fi
# pip gets its packages there as it does here
cp --dereference --remove-destination /etc/resolv.conf "$root/etc/"
for file in /etc/pip.conf /etc/ssl/certs/ca-certificates.crt; do
  if [ -e $file ]; then cp --dereference $file "$root$file"; fi
done
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
