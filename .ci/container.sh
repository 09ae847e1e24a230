#!/usr/bin/env bash
# container.sh ROOT: what the image does, without an engine: installed by its own script in a Debian root, then run by a
# user without a name or a home while nothing but /work and /tmp can be written.
set -euo pipefail
source "$(dirname "$0")/root.sh"
begin_root bookworm "make test-container"
rm -rf "$root/opt/navbench"
mkdir -p "$root/opt/navbench/source" "$root/work"
git ls-files -z | tar --create --null --files-from - | tar --extract --directory "$root/opt/navbench/source"
# what is mounted in a namespace of its own ends with it
exec unshare --mount sh -euc '
  root=$1
  mount -t proc proc "$root/proc"
  mount --rbind /dev "$root/dev"
  chroot "$root" env HOME=/root LC_ALL=C.UTF-8 PATH=/usr/bin:/bin sh /opt/navbench/source/containers/install.sh /opt/navbench/source
  mount --bind "$root" "$root"
  mount -o remount,bind,ro "$root"
  mount -t tmpfs -o mode=1777 work "$root/work"
  mount -t tmpfs -o mode=1777 tmp "$root/tmp"
  cd "$root/work"
  exec chroot --userspec=12345:12345 "$root" env --ignore-environment LC_ALL=C.UTF-8 MPLCONFIGDIR=/tmp \
    NAVBENCH_CACHE_DIR=/opt/navbench/cache PATH=/opt/navbench/venv/bin:/usr/bin:/bin sh -euc "
      cd /work
      if touch /opt/navbench/written 2>/dev/null; then echo \"the root can be written\" >&2; exit 1; fi
      navbench controller=sflc world=deadlock
      navbench -m controller=sflc,pid world=deadlock,no_deadlock workers=2
      navbench verify outputs/*/*"
  ' unshare "$root"
