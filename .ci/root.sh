# root.sh: what the scripts beside it share, which make a Debian root and work in it; they source it.
cd "$(dirname "$0")/.."
root=$(realpath --canonicalize-missing "$1")
shift

# begin_root SUITE WHO: made once and kept, with the packages that pip needs there as it does here
begin_root() {
  if [ "$(id -u)" != 0 ] || ! command -v debootstrap >/dev/null; then
    echo "$2 needs root, and debootstrap: apt-get install debootstrap" >&2
    exit 1
  fi
  if [ ! -e "$root/bin/sh" ]; then
    mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Origin: Debian' | head -n 1)
    debootstrap --variant=minbase --include=ca-certificates,python3-venv "$1" "$root" ${mirror:+"$mirror"}
  fi
  cp --dereference --remove-destination /etc/resolv.conf "$root/etc/"
  for file in /etc/pip.conf /etc/ssl/certs/ca-certificates.crt; do
    if [ -e $file ]; then cp --dereference $file "$root$file"; fi
  done
}
