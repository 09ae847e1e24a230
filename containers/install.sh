#!/bin/sh
# install.sh SOURCE: navbench with its compiled code in /opt/navbench, for every user and a root that is only read.
set -eu
python3 -m venv /opt/navbench/venv
/opt/navbench/venv/bin/pip install --quiet --no-cache-dir --disable-pip-version-check --constraint "$1/constraints.txt" "$1"
export NAVBENCH_CACHE_DIR=/opt/navbench/cache
work=$(mktemp -d)
cd "$work"
for simulator in planar pybullet; do
  /opt/navbench/venv/bin/navbench -m controller=go_to_goal,pid,sflc,oa_to,multi_agent,dual_layer world=empty \
    simulator=$simulator workers=1 hydra.sweep.dir=compiled-for-$simulator >/dev/null
done
cd /
rm -rf "$work"
chmod -R a+rX,go-w /opt/navbench
