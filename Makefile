# Every target sets up what it needs: a virtual environment with the pinned versions of the lock files.
# uv is used where it is on the PATH, pip otherwise; python3-venv is not needed.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
UV := $(shell command -v uv 2>/dev/null)

.PHONY: help run test test-all test-long golden typed fuzz mutants check release-check docs bundle bench figures studies lock clean

# Bytecode is kept whatever the environment says: it is not made when packages are installed, but when they are first
# imported, which takes half the time, as most modules never are.
run test test-all test-long typed fuzz: export PYTHONDONTWRITEBYTECODE =
run: $(VENV)/.runtime  ## fly mission T5 (the target of a plain `make`)
	$(BIN)/laisn fly T5

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "  make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

# Idle workers take tests from busy ones; more than eight only wait for each other.
PYTEST := $(BIN)/python -m pytest -n auto --maxprocesses 8 --dist worksteal
test: $(VENV)/.dev  ## run the quick tests on all cores; PYTEST_ARGS="-n 0 -k word" for some of them in one process
	$(PYTEST) --hypothesis-profile quick $(PYTEST_ARGS)

test-all: $(VENV)/.dev  ## run these and those of whole commands, processes, films and documents
	$(PYTEST) -m 'not typed and not long' $(PYTEST_ARGS)

test-long: $(VENV)/.dev  ## run those that take half a minute to some minutes each
	$(PYTEST) -m long $(PYTEST_ARGS)

golden: $(VENV)/.dev  ## write the golden pages of tests/data/pages anew; read what changes in them
	GOLDEN=write $(BIN)/python -m pytest -n 0 -q -k golden $(PYTEST_ARGS)

fuzz: $(VENV)/.dev  ## search for counterexamples to the property tests, and for inputs that fail, with fresh seeds
	$(BIN)/python -m pytest -n auto --dist worksteal -m hypothesis --hypothesis-profile fuzz $(PYTEST_ARGS)
	$(BIN)/python -m tools.fuzz $(FUZZ_ARGS)

typed: $(VENV)/.dev  ## run every block of the documents whole as typed, for hours
	$(PYTEST) -m typed $(PYTEST_ARGS)

# A mutant takes some ten seconds, all of them days.
mutants: $(VENV)/.mutants  ## mutation tests; MUTANTS=60 draws 60 of each package, MUTANTS_ARGS="FILE --seed 2"
	$(BIN)/python -m tools.mutants $(if $(MUTANTS),--count $(MUTANTS)) $(MUTANTS_ARGS)

check: $(VENV)/.dev  ## lint, formatting, types; numbers in README and docs
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m tools.documents.markers --check

release-check: check test-long  ## check, run the long tests, and fail if a study has to be run again
	$(BIN)/python -m tools.documents.markers --check --strict

docs: $(VENV)/.dev  ## build the site of the documents into out/site: pages, examples, API reference; check its links
	$(BIN)/python -m tools.documents.site

bundle:  ## build the script of the 3D scene of the reports from reports/scene/src (needs npm)
	cd tools/scene && npm ci --silent && npm run build --silent

bench: $(VENV)/.dev  ## measure speeds three times into out/benchmarks.json; BENCH_ARGS=--record keeps them in docs/results
	$(BIN)/python -m tools.benchmarks.run $(BENCH_ARGS)

figures: $(VENV)/.runtime  ## bring the numbers of README and docs up to docs/results, draw their pictures anew
	$(BIN)/python -m tools.documents.markers
	$(BIN)/python -m tools.documents.scenario_reference
	$(BIN)/python -m tools.documents.draw

studies: $(VENV)/.runtime  ## fly all studies anew (minutes) and keep their records in docs/results
	$(BIN)/python -m tools.documents.studies

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "laisn-sim needs Python 3.11 or newer, $(PYTHON) is $$($(PYTHON) --version 2>&1); try: make PYTHON=python3.11"; exit 2; }
ifdef UV
	$(UV) venv --quiet --allow-existing --python $(PYTHON) $(VENV)
else
	$(PYTHON) -m venv --without-pip $(VENV)
	@$(PYTHON) -m pip --version >/dev/null 2>&1 || \
	  { rm -rf $(VENV); echo "neither uv nor pip is installed; on Debian: apt-get install python3-pip"; exit 2; }
endif

# $(1): lock file. The editable install builds with the pinned backend, so nothing unpinned is fetched.
ifdef UV
install = $(UV) pip install --quiet --python $(BIN)/python --require-hashes -r $(1) && \
  $(UV) pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation -e .
else
install = $(PYTHON) -m pip --python $(BIN)/python install --quiet --no-compile --require-hashes -r $(1) && \
  $(PYTHON) -m pip --python $(BIN)/python install --quiet --no-deps --no-build-isolation -e .
endif

$(VENV)/.runtime: requirements.lock pyproject.toml | $(BIN)/python
	@echo "setting up $(VENV) (once; downloads about 250 MB)"
	$(call install,requirements.lock)
	@touch $@

$(VENV)/.dev: requirements-dev.lock pyproject.toml | $(BIN)/python
	@echo "setting up $(VENV) for development (once; downloads about 400 MB)"
	$(call install,requirements-dev.lock)
	@touch $@ $(VENV)/.runtime

$(VENV)/.mutants: requirements-mutants.lock pyproject.toml | $(BIN)/python
	@echo "setting up $(VENV) for mutants (once)"
	$(call install,requirements-mutants.lock)
	@touch $@ $(VENV)/.dev $(VENV)/.runtime

# Pins the newest versions that pyproject.toml allows; needs uv.
LOCK := uv pip compile --quiet --upgrade --universal --python-version 3.11 --generate-hashes --no-annotate --no-header
lock:  ## pin the newest versions that are allowed (needs uv)
	$(LOCK) --extra build pyproject.toml -o requirements.lock
	$(LOCK) --extra build --extra dev -c requirements.lock pyproject.toml -o requirements-dev.lock
	$(LOCK) --extra build --extra dev --extra mutants -c requirements-dev.lock pyproject.toml -o requirements-mutants.lock

clean:  ## remove the environment, results and caches
	rm -rf $(VENV) out dist build .pytest_cache .mypy_cache .ruff_cache
