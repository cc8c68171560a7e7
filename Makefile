# Every target does all of its own set-up; only python3 and make are needed.
PYTHON ?= python3
BIN := .venv/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check

.DEFAULT_GOAL := help
.PHONY: help run test check bench clean

help:  ## list the targets
	@sed -n 's/^\([a-z]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST)

run: .venv/.ready  ## reproduce the paper's figures: results/report.html
	$(BIN)/dynkit reproduce --out results

test: .venv/.dev  ## run the tests
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses auto

check: .venv/.dev  ## lint, format, types, layers
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: .venv/.dev  ## run the benchmarks
	$(BIN)/python tests/benchmarks/run.py

clean:  ## remove environment, results and caches
	rm -rf .venv results build dist htmlcov *.egg-info .coverage .hypothesis .import_linter_cache \
		.mypy_cache .pytest_cache .ruff_cache
	find dynkit systems analysis tests -name __pycache__ -type d -prune -exec rm -rf {} +

# An environment that works is kept; one that is broken or too old is made anew.
.venv/.ready: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "dynkit needs Python 3.11 or newer; $(PYTHON) is %d.%d: try make PYTHON=python3.12" % sys.version_info[:2])'
	@echo "Setting up .venv (once, about a minute)"
	@$(BIN)/python -c 'import pip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || $(PYTHON) -m venv --clear .venv
	@$(INSTALL) --editable .
	@touch $@

.venv/.dev: .venv/.ready
	@$(INSTALL) --editable '.[dev]'
	@touch $@
