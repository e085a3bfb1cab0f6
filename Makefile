# Two words for users: demo, test. Four more for those who build it: serve, check, bench, lock.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.DEFAULT_GOAL := help
.PHONY: help demo serve test test-interpreted check bench lock clean

help:  ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-18s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(READY): requirements-dev.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "surepath needs Python 3.11 or newer, found $$($(PYTHON) --version). Try: make PYTHON=python3.12 …"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || \
	  { $(PYTHON) -m pip install --user virtualenv && $(PYTHON) -m virtualenv $(VENV); }
	@echo "Installing locked requirements into $(VENV) …"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements-dev.txt
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	@touch $(READY)

demo: $(READY)  ## field, plan over REST, pictures in out/
	@$(BIN)/surepath demo

serve: $(READY)  ## the service on http://127.0.0.1:8080
	@$(BIN)/surepath serve

test: $(READY)  ## all tests, doctests included
	@$(BIN)/python -m pytest

test-interpreted: $(READY)  ## kernels without the compiler: bounds checked, branches counted
	@NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -m "not slow" tests/maps/kernels tests/localization/kernels tests/planner/kernels

check: $(READY)  ## ruff, format, mypy, import contracts, dependency audit where it can
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports
	@$(BIN)/python tests/audit.py

bench: $(READY)  ## every figure we print, as ratios within one run
	@$(BIN)/python -m tests.benchmarks $(ARGS)

lock: $(READY)  ## renew the locked requirements
	@$(BIN)/python -m pip install --quiet uv
	@for extra in "" dev; do \
	  $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --no-emit-index-url --no-emit-find-links \
	    --no-header --no-annotate $${extra:+--extra $$extra} -o requirements$${extra:+-$$extra}.txt pyproject.toml; done

clean:  ## remove what make made
	rm -rf $(VENV) out .pytest_cache .mypy_cache .ruff_cache .hypothesis
