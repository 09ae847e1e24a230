# `make run` and `make test` set everything up on a fresh clone; a second call reuses it.
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
NEWER := build/trixie
IMAGE := build/image
STUDIES := aouf2019 zhao2017 zhao2018 nemeiksis2019 lei2014 papers

.PHONY: run test warm test-newer test-container slow docs docs-media lint format clean tuned results

run: $(STAMP) ## one episode: S.F.L.C. in the U-shaped trap
	$(BIN)/navbench controller=sflc world=deadlock
	@echo 'navbench is installed in $(VENV): `source $(BIN)/activate` puts it on the path of your shell'

test: $(STAMP) ## all tests, on all cores
	$(BIN)/python -m pytest -n auto --dist worksteal

warm: $(STAMP) ## compile what most episodes need, once, before several processes do so side by side
	rm -rf build/warm
	$(BIN)/navbench -m controller=sflc world=deadlock simulator=planar,pybullet workers=0 hydra.sweep.dir=build/warm

slow: $(BIN)/mkdocs ## the commands of the pages that take minutes to hours, the site, and the notebook; what needs torch by hand
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[notebook]'
	$(BIN)/python -m pytest -m slow

docs: $(BIN)/mkdocs ## the pages as a site in build/site, which opens from the disk
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo 'open build/site/index.html'

docs-media: $(STAMP) ## make the pictures of the pages again, from real runs
	$(BIN)/python docs/media.py

$(BIN)/mkdocs: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[docs]'

test-newer: ## all tests under CPython 3.13, in a Debian root made by debootstrap (as root; kept in NEWER)
	.ci/newer.sh $(NEWER)

test-container: ## the image's own installation, run by any user from a root that is only read (as root; kept in IMAGE)
	.ci/container.sh $(IMAGE)

lint: $(STAMP) ## style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# 3.11 and the system's own come first: distributions build theirs with profile-guided optimization, in which episodes take
# a tenth less time. mypy knows no package that lies in two places, so conf and controllers are linked for it.
$(STAMP): pyproject.toml constraints.txt
	@python=; for candidate in /usr/bin/python3.11 python3.11 /usr/bin/python3 python3.12 python3.13 python3 python; do \
	  if $$candidate -c 'import ensurepip, sys, venv; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null; then python=$$candidate; break; fi; \
	done; \
	if [ -n "$$python" ]; then $$python -m venv --clear $(VENV); \
	elif command -v uv >/dev/null; then uv venv --clear --seed --python 3.11 $(VENV); \
	else echo "navbench needs CPython 3.11, 3.12 or 3.13, with its venv: install one, or install uv, and call make again" >&2; exit 1; fi
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@mkdir -p $(VENV)/types/navbench
	@ln -sfn ../../../conf $(VENV)/types/navbench/conf
	@ln -sfn ../../../controllers $(VENV)/types/navbench/controllers
	@touch $(STAMP)

clean:
	rm -rf $(VENV) build outputs multirun .pytest_cache .mypy_cache .ruff_cache

tuned: $(STAMP) ## tune the PIDs of aouf2019 and evolve zhao2018's controller again, seed 0, into conf/controller
	for tuner in pso abc fa; do \
	  $(BIN)/navbench tune controller=pid tuner=$$tuner objective=ise simulator=planar world=no_deadlock budget=210 seed=0 \
	    workers=0 hydra.run.dir=outputs/tuned/$$tuner && \
	  cp outputs/tuned/$$tuner/conf/controller/$${tuner}_pid.yaml conf/controller/ || exit 1; \
	done
	$(BIN)/navbench tune controller=oa_to tuner=ga objective=zhao2018 simulator=planar world=zhao2018_static \
	  "worlds=[zhao2018_single,zhao2018_fleet]" budget=900 seed=0 name=oa_to_ga hydra.run.dir=outputs/tuned/ga
	cp outputs/tuned/ga/conf/controller/oa_to_ga.yaml conf/controller/

results: $(STAMP) ## run every study again, the papers' in planar too, and join the reports in results/README.md
	for study in $(STUDIES); do $(BIN)/navbench study $$study || exit 1; done
	for study in $(filter-out papers,$(STUDIES)); do $(BIN)/navbench study $$study simulator=planar || exit 1; done
	$(BIN)/navbench report join=results
