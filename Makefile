# Everything a person or CI needs: `make demo`, `make test`. Both set up what they need by themselves.
PYTHON ?= python3
# Everything happens in .venv; an interpreter that is named on the command line has an environment of its own.
NAMED = $(or $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])'),$(error $(PYTHON) cannot be run))
VENV := .venv$(if $(filter command,$(origin PYTHON)),-$(NAMED))
SEED := 1
# [s] for stories of the World from new seeds; seeds.log keeps where the next night goes on.
SEEDS_FOR := 1800
WORKERS := 4
INTERPRETERS := 3.11 3.12 3.13 3.14
BIN := $(VENV)/bin
LOCK := requirements.lock
STAMP := $(VENV)/.ready
INTEROP := .venv-interop
INTEROP_LOCK := requirements-interop.lock
COMPARISON := .venv-comparison
COMPARISON_LOCK := requirements-comparison.lock
JAVASCRIPT := examples/controller_js
# What the example in JavaScript needs, where there is npm; else its tests are skipped.
NODE_READY := $(if $(shell command -v npm),$(JAVASCRIPT)/node_modules/.ready)
# Containers often set it: then each process that the tests start compiles robotree again.
unexport PYTHONDONTWRITEBYTECODE
SUBPACKAGES := assistants client files kinds protocol sim vr proxy testing tui

.DEFAULT_GOAL := help
.PHONY: help setup demo test browser interpreters check check-style check-types check-mypy check-imports soak interop comparison lock format clean

help:  ## list the targets
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## */\t/' | expand -t 10

setup: $(STAMP)  ## build .venv from the hash-pinned lock

# uv is taken from the machine when it is there, else installed into .venv by pip, as the lock has it. `sync` also takes
# away what the lock no longer has, robotree too, which the next line puts back.
# Its last line names what this system lacks and no package index has.
# Other people's packages are compiled at once, as pip does: a program that is started outside of make may not keep
# what it has compiled (PYTHONDONTWRITEBYTECODE).
$(STAMP): $(LOCK) pyproject.toml
	@test -x $(BIN)/python || echo "installing everything into $(VENV), once: this takes a minute or two …"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@command -v uv >/dev/null || test -x $(BIN)/uv || $(MAKE) --no-print-directory --silent $(BIN)/uv
	@UV=$$(command -v uv || echo $(BIN)/uv); \
	  $$UV pip sync --quiet --compile-bytecode --python $(BIN)/python --require-hashes $(LOCK) && \
	  $$UV pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation -e .
	@$(BIN)/python -m robotree.tui.line.installed
	@touch $@

demo: $(STAMP)  ## the whole system in one terminal: cell, proxy, lookup, directory, host, supervisor
	@$(BIN)/robotree demo

# Twice as many workers as two cores: half of the time the tests wait for something. Tests that measure speed come
# after the others, one at a time: a worker beside them on the same core makes their processor time longer, too.
test: $(STAMP) $(NODE_READY) browser  ## the test suite (about 11 minutes on 2 cores); PYTHON=python3.13 chooses another interpreter
	$(BIN)/python -m pytest -n $(WORKERS)
	$(BIN)/python -m pytest -m "speed and not soak" $$(grep -rl --include='test_*.py' 'mark\.speed' tests)

# For the tests of `robotree web`, which are skipped without it: Debian's Chromium, where that may be installed.
browser:
	@if command -v chromium >/dev/null && command -v chromedriver >/dev/null; then :; \
	elif test $$(id -u) = 0 && command -v apt-get >/dev/null; then \
	  echo "installing Chromium for the tests of the browser …"; \
	  { apt-get update && apt-get install --yes --no-install-recommends chromium chromium-driver; } >/dev/null 2>&1 || \
	  echo "Chromium cannot be installed; the tests that need it are skipped"; fi

# Looked for on PATH, then where pyenv and uv keep theirs. A shim of pyenv is there and runs nothing, so each is tried.
interpreters:  ## the test suite on every interpreter that the project supports and this machine has
	@said=; code=0; \
	for version in $(INTERPRETERS); do \
	  found=; \
	  for one in python$$version $$HOME/.pyenv/versions/$$version.*/bin/python \
	      $$HOME/.local/share/uv/python/cpython-$$version.*/bin/python; do \
	    $$one -c "import sys; sys.exit(sys.version_info[:2] != ($$(echo $$version | tr . ,)))" 2>/dev/null && found=$$one && break; \
	  done; \
	  if [ -z "$$found" ]; then said="$$said\n$$version not found"; continue; fi; \
	  if $(MAKE) --no-print-directory test PYTHON=$$found; then said="$$said\n$$version passed"; \
	  else said="$$said\n$$version FAILED"; code=1; fi; \
	done; \
	printf "$$said\n"; exit $$code

# Elsewhere the tests of a space in PostgreSQL are skipped where there is none.
soak: export ROBOTREE_REQUIRE_POSTGRES = 1
soak: $(STAMP) $(NODE_READY)  ## the slow tests, one on a fresh Debian testing, and the campaign of kills, freezes, splits and stops; SEED=2 QUICK=--quick
	@$(BIN)/python -m tests.vr.space.postgres || $$(test $$(id -u) = 0 || echo sudo) apt-get install --yes postgresql
	$(BIN)/python -m pytest -m soak -rs
	$(BIN)/python -m pytest tests/vr/space
	for round in 1 2 3; do $(BIN)/python -m pytest --hypothesis-profile search tests/machines || exit 1; done
	$(BIN)/python -m tests.durability.campaign --seed $(SEED)
	$(BIN)/python -m tests.laboratory.campaign --seed $(SEED)
	$(BIN)/python -m tests.soak --seed $(SEED) $(QUICK)
	$(BIN)/python -m tests.world.families $(SEEDS_FOR) seeds.log

interop: $(STAMP) $(INTEROP)/.ready  ## drive the simulated arm with the real MAVProxy and MAVSDK; Foxglove's SDK, data sets
	$(BIN)/python -m pytest -m interop tests/interop

comparison: $(STAMP) $(COMPARISON)/.ready  ## play docs/comparison.md: the same page here, with py_trees and with bluesky
	$(BIN)/python -m pytest -m comparison tests/comparison
	$(BIN)/python -m tests.comparison.table

$(JAVASCRIPT)/node_modules/.ready: $(JAVASCRIPT)/package-lock.json
	@$(MAKE) --no-print-directory -C $(JAVASCRIPT) node_modules/.ready

# Tools of other people, apart from ours: what they need must not decide what we get.
$(INTEROP)/.ready: $(INTEROP_LOCK)
$(COMPARISON)/.ready: $(COMPARISON_LOCK)
$(INTEROP)/.ready $(COMPARISON)/.ready: $(STAMP)
	@test -x $(@D)/bin/python || $(PYTHON) -m venv --without-pip $(@D)
	@UV=$$(command -v uv || echo $(BIN)/uv); \
	  $$UV pip sync --quiet --python $(@D)/bin/python --require-hashes $(filter %.lock,$^)
	@touch $@

check: $(STAMP)  ## ruff, pyright, mypy --strict, import-linter; two at a time
	@$(MAKE) --no-print-directory --jobs=2 --output-sync check-types check-style check-mypy check-imports

check-style check-types check-mypy check-imports: $(STAMP)
check-style:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
check-types:
	$(BIN)/pyright
check-mypy:
	$(BIN)/mypy $(addprefix -p robotree.,$(SUBPACKAGES))
check-imports:  # there the rooms are links in one folder
	PYTHONPATH=typings $(BIN)/lint-imports

format: $(STAMP)  ## let ruff format and mend
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

lock: $(VENV)/bin/uv  ## resolve the dependencies again
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --extra all --group dev \
	  --no-emit-index-url --no-emit-find-links --upgrade --custom-compile-command "make lock" \
	  pyproject.toml -o $(LOCK)
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --group interop \
	  --no-emit-index-url --no-emit-find-links --upgrade --custom-compile-command "make lock" \
	  -o $(INTEROP_LOCK)
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --group comparison \
	  --no-emit-index-url --no-emit-find-links --upgrade --custom-compile-command "make lock" \
	  -o $(COMPARISON_LOCK)

$(BIN)/uv:
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@awk '/^[a-z]/ { keep = /^uv==/ } keep' $(LOCK) >$(VENV)/uv.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r $(VENV)/uv.lock

clean:  ## remove what setup and the tests made
	rm -rf .venv .venv-3.* $(INTEROP) $(COMPARISON) $(JAVASCRIPT)/node_modules build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
