# `make run` and `make test` set everything up on a fresh clone; a second call reuses it.
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
STUDIES := aouf2019 zhao2017 zhao2018 nemeiksis2019 lei2014 papers

.PHONY: run test lint format clean tuned results

run: $(STAMP) ## one episode: S.F.L.C. in the U-shaped trap
	$(BIN)/navbench controller=sflc world=deadlock

test: $(STAMP) ## all tests, on all cores
	$(BIN)/python -m pytest -n auto --dist worksteal

lint: $(STAMP) ## style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# pybullet has wheels for CPython 3.10 and 3.11 only, and the locked packages need 3.11. The system's own comes first:
# distributions build theirs with profile-guided optimization, in which episodes take a tenth less time.
$(STAMP): pyproject.toml constraints.txt
	@python=; for candidate in /usr/bin/python3.11 python3.11 python3 python; do \
	  if $$candidate -c 'import ensurepip, sys, venv; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null; then python=$$candidate; break; fi; \
	done; \
	if [ -n "$$python" ]; then $$python -m venv --clear $(VENV); \
	elif command -v uv >/dev/null; then uv venv --clear --seed --python 3.11 $(VENV); \
	else echo "navbench needs CPython 3.11 (pybullet has no wheel for a newer one): install it, or install uv, and call make again" >&2; exit 1; fi
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $(STAMP)

clean:
	rm -rf $(VENV) outputs multirun .pytest_cache .mypy_cache .ruff_cache

tuned: $(STAMP) ## tune the PIDs of aouf2019 and evolve zhao2018's controller again, seed 0, into conf/controller
	for tuner in pso abc fa; do \
	  $(BIN)/navbench tune controller=pid tuner=$$tuner objective=ise world=no_deadlock budget=210 seed=0 \
	    workers=1 hydra.run.dir=outputs/tuned/$$tuner && \
	  cp outputs/tuned/$$tuner/conf/controller/$${tuner}_pid.yaml conf/controller/ || exit 1; \
	done
	$(BIN)/navbench tune controller=oa_to tuner=ga objective=zhao2018 world=zhao2018_static \
	  "worlds=[zhao2018_single,zhao2018_fleet]" budget=900 seed=0 name=oa_to_ga hydra.run.dir=outputs/tuned/ga
	cp outputs/tuned/ga/conf/controller/oa_to_ga.yaml conf/controller/

results: $(STAMP) ## run every study again, write its report into results, and join the reports in results/README.md
	for study in $(STUDIES); do $(BIN)/navbench study $$study || exit 1; done
	$(BIN)/navbench report join=results
