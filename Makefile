# `make help` lists the targets. Everything is installed inside this folder: the installer uv in .tools, the rest in .venv.

PYTHON ?= python3
DEMO_OUT ?= runs/demo
WORKERS ?= 2

UV := .tools/uv/bin/uv
BIN := .venv/bin
# Stamp files inside .venv say what has been installed into it, so that a second run installs nothing.
HAS_VENV := .venv/.has-venv
HAS_CORE := .venv/.has-core
HAS_PROJECT := .venv/.has-project
HAS_TEST := .venv/.has-test

export UV_PYTHON_DOWNLOADS := never
export UV_NO_PROGRESS := 1
# A user's own pip settings must not redirect or refuse the one installation that pip does.
export PIP_USER := 0
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# The matrices are small: threads inside the linear algebra only get in each other's way.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1

UV_LOCK := $(UV) pip compile --quiet --universal --python-version 3.11 --fork-strategy fewest --generate-hashes \
	--no-emit-index-url --no-emit-find-links --custom-compile-command "make lock"

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo install test lint lock clean check-python

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(firstword $(MAKEFILE_LIST)) | sed -E 's/^([a-z-]+):[^#]*## */  make \1\t/' | expand -t 18

demo: $(HAS_PROJECT)  ## install what is needed, climb a 45 degree slope, write plots and a 3D replay
	$(BIN)/m4 wair --slope 45 --out $(DEMO_OUT)
	@echo
	@echo "Open $(DEMO_OUT)/report.html in a browser: verdict, figures, plots and the 3D replay (alone: viewer.html)."
	@echo "As numbers: summary.json, trajectory.nc. More: $(BIN)/m4 --help"

install: $(HAS_PROJECT)  ## install the locked dependencies and the project into .venv

test: $(HAS_TEST) lint  ## install the peers and the test tools, then lint and test
	$(BIN)/python -m pytest -n $(WORKERS)

lint: $(HAS_TEST)  ## ruff (lint and format) and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

lock: $(UV)  ## resolve the dependencies anew into requirements/*.txt
	$(UV_LOCK) --upgrade requirements/uv.in --output-file requirements/uv.txt
	$(UV_LOCK) --upgrade pyproject.toml --extra build --output-file requirements/core.txt
	$(UV_LOCK) --upgrade pyproject.toml --extra build --extra test --extra peers \
		--constraints requirements/core.txt --output-file requirements/test.txt

clean:  ## remove .venv, .tools, runs, artifacts and every cache
	rm -rf .venv .tools runs artifacts build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

check-python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
		echo "make: Python 3.11 or newer is needed, but '$(PYTHON)' is: $$($(PYTHON) --version 2>&1 | head -n 1)"; \
		echo "      name another one like this: make PYTHON=/path/to/python3.12 ..."; exit 1; } >&2

$(UV): requirements/uv.txt | check-python
	@$(PYTHON) -m pip --version >/dev/null 2>&1 || { \
		echo "make: '$(PYTHON)' has no pip (on Debian and Ubuntu: apt install python3-pip)"; exit 1; } >&2
	rm -rf .tools/uv
	$(PYTHON) -m pip install --quiet --require-hashes --target .tools/uv -r requirements/uv.txt
	@touch $@

$(HAS_VENV): | $(UV) check-python
	@$(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
		$(UV) venv --quiet --clear --python "$$($(PYTHON) -c 'import sys; print(sys.executable)')" .venv
	@touch $@

$(HAS_CORE): requirements/core.txt $(HAS_VENV) | $(UV)
	$(UV) pip install --quiet --python $(BIN)/python --require-hashes -r requirements/core.txt
	@touch $@

# pip and uv refuse a local project together with hashes, hence alone, with nothing left to download.
$(HAS_PROJECT): pyproject.toml $(HAS_CORE) | $(UV)
	$(UV) pip install --quiet --python $(BIN)/python --offline --no-deps --no-build-isolation --editable .
	@touch $@

$(HAS_TEST): requirements/test.txt $(HAS_PROJECT) | $(UV)
	$(UV) pip install --quiet --python $(BIN)/python --require-hashes -r requirements/test.txt
	@touch $@
