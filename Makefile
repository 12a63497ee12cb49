# One command each; `make help` lists them. PYTHON=python3.12 picks another interpreter.
PYTHON ?= python3
# processes that share the tests
WORKERS ?= 2
# Programs are compiled for each test and called a few times. So XLA compiles them in half of the time, as it does those
# of searches for users (`runtime.QUICK`); numbers stay the same but for a last bit. Slow tests are compiled as users' programs are.
QUICK_XLA := --xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=1
VENV := .venv
BIN := $(VENV)/bin
KINDS := $(if $(ALL),not slow,not slow and not thorough)
FAST := $(BIN)/python -m pytest -m "$(KINDS)" -n $(WORKERS) --dist worksteal
PIP := PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip install --quiet --constraint constraints.txt
CORE := $(VENV)/.core
DEV := $(VENV)/.dev

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo docs notebooks test test-slow test-versions fuzz release check lint types bench bbob browser postgres clean

help:  ## This list
	@sed -n 's/^\([a-z-]*\):.*## /\1	/p' $(MAKEFILE_LIST) | expand -t 12

demo: $(CORE)  ## Fit a motor from a recording and write the report
	$(BIN)/plantfit demo gearmotor

test: $(DEV) browser postgres  ## Everyday tests, in about ten minutes; ALL=1 adds the thorough ones, as .ci/run does
	XLA_FLAGS="$$XLA_FLAGS $(QUICK_XLA)" $(FAST)
	@$(if $(ALL),,echo "NOT RUN: thorough tests (make test ALL=1, before a change is handed in) and slow ones (make test-slow).")

test-slow: $(DEV) browser postgres  ## Longer studies
	$(BIN)/python -m pytest -m slow

docs: $(DEV)  ## Build the site of the docs into site/, every link checked; SERVE=1 shows it
	$(BIN)/mkdocs $(if $(SERVE),serve,build --strict)

notebooks: $(DEV)  ## Run the notebooks of docs/notebooks anew and keep their outputs
	$(BIN)/python tools/notebooks.py

fuzz: $(DEV)  ## Broken inputs to every reader for MINUTES=5; SEED=1 repeats
	$(BIN)/python tests/fuzz/fuzz.py --minutes $(or $(MINUTES),5) $(if $(SEED),--seed $(SEED))

test-versions: $(DEV)  ## The suite on the lowest and the newest versions of all dependencies (newest of all with PYTHON=python3.13); TESTS="tests/native ..." runs a part
	$(BIN)/python tools/lowest.py > $(VENV)/lowest.txt
	for kind in lowest newest; do \
	  $(PYTHON) -m venv --clear $(VENV)-$$kind && \
	  PIP_DISABLE_PIP_VERSION_CHECK=1 $(VENV)-$$kind/bin/python -m pip install --quiet --editable '.[dev]' \
	    $$(test $$kind = newest && echo --upgrade || echo --constraint $(VENV)/lowest.txt) && \
	  $(VENV)-$$kind/bin/python -m pytest -m "not slow" -n $(WORKERS) --dist worksteal $(TESTS) || exit 1; \
	done

release: $(DEV)  ## Build sdist and wheel twice, compare them, install the wheel elsewhere; nothing is uploaded
	$(BIN)/python tools/release.py

check: lint types  ## Lint, format, types, imports between rooms
	$(BIN)/python -m pytest tests/test_import_graph.py

lint: $(DEV)
	$(BIN)/ruff check src tests benchmarks
	$(BIN)/ruff format --check src tests benchmarks

types: $(DEV)
	$(BIN)/pyrefly check --min-severity warn --progress-bar no

bbob: $(DEV)  ## Hold the optimizers to other implementations on BBOB (hours); QUICK=1 for a look at one of them
	@$(PIP) --editable '.[rivals]'
	$(BIN)/python -m benchmarks.bbob $(if $(QUICK),--methods pso --dimensions 5 --quick,--methods all)

bench: $(DEV)  ## Time the engine against other solvers; QUICK=1 for under a minute
	QUICK=$(QUICK) $(BIN)/python -m benchmarks

clean:  ## Remove the environment and what builds leave
	rm -rf $(VENV) build dist site .pytest_cache .ruff_cache src/*.egg-info
	find src tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamps are younger than what they were installed from.
$(CORE): pyproject.toml constraints.txt
	@$(PYTHON) tools/python_version.py || { echo "run make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || \
	{ rm -rf $(VENV); echo "$(PYTHON) cannot make a virtual environment; install its venv module (Debian, Ubuntu: apt-get install python3-venv)" >&2; exit 1; }
	@echo "Installing plantfit into $(VENV) ..."
	@$(PIP) --editable '.[trust]'
	@touch $@

$(DEV): $(CORE)
	@echo "Installing tools for tests and benchmarks into $(VENV) ..."
	@$(PIP) --editable '.[dev,bench]'
	@touch $@

# The report is also tested in a browser where there is one, or where one can be installed.
browser:
	@if { command -v chromium || command -v chromium-browser || command -v google-chrome; } >/dev/null; then :; \
	elif [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null \
	&& { apt-get install -y --no-install-recommends chromium || { apt-get update && apt-get install -y --no-install-recommends chromium; }; } >/dev/null 2>&1; then :; \
	else echo "NOTE: no Chromium here and none could be installed: the tests that open the report in a browser are SKIPPED."; fi

# Stores are also tested on a PostgreSQL of the tests' own, where there is one or one can be installed.
postgres:
	@if ls /usr/lib/postgresql/*/bin/initdb >/dev/null 2>&1 || command -v initdb >/dev/null; then :; \
	elif [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null \
	&& { apt-get install -y --no-install-recommends postgresql || { apt-get update && apt-get install -y --no-install-recommends postgresql; }; } >/dev/null 2>&1; then :; \
	else echo "NOTE: no PostgreSQL here and none could be installed: the tests of stores in PostgreSQL are SKIPPED."; fi
