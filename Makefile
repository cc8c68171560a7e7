# Every target does all of its own set-up; only python3 and make are needed.
PYTHON ?= python3
BIN := $(if $(filter Windows_NT,$(OS)),.venv/Scripts,.venv/bin)
# --system-site-packages takes heyoka from conda-forge where the package index has none
VENV_OPTIONS ?=
# Modules are compiled when they are first imported, and most of them never are.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
# The oldest versions that are supported, in an environment of their own; TESTS= picks some tests.
OLDEST_PYTHON ?= $(shell command -v python3.11 || echo $(PYTHON))
OLDEST := .venv-oldest
OLDEST_BIN := $(subst .venv,$(OLDEST),$(BIN))

# Processors that differ from this one in last digits: vector instructions and fused products of Numba's code, of
# OpenBLAS, of NumPy and of the C library's sin, cos and exp; and the order of sums of two threads.
GENERIC := NUMBA_CPU_NAME=generic OPENBLAS_CORETYPE=Nehalem NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4" \
	GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA OMP_NUM_THREADS=1
UNFUSED := NUMBA_CPU_NAME=generic NUMBA_CPU_FEATURES=+avx,+avx2 OPENBLAS_CORETYPE=Sandybridge OMP_NUM_THREADS=1
HASWELL := NUMBA_CPU_NAME=haswell NUMBA_CPU_FEATURES= OPENBLAS_CORETYPE=Haswell NPY_DISABLE_CPU_FEATURES=X86_V4 OMP_NUM_THREADS=2
# What is tested here does not depend on the processor: files, figures, pages, commands, checks of the sources, other
# processes, references in numbers of many digits. Only the numbers that notebooks and pages print may:
# test-processors runs these too.
SAME_EVERYWHERE := $(addprefix --ignore=,tutorials $(addprefix tests/,cli data plotting project scaling tutorials viewer) \
	$(addprefix tests/,analysis/test_measures.py core/test_progress.py) $(addprefix tests/reference/test_,extremes.py first_root.py general_invariants.py general_oscillator.py \
	impact_chain.py peers.py) $(addprefix tests/sweeps/test_,bad_input.py kills.py progress.py refused_stores.py \
	resuming.py) $(addprefix tests/continuation/test_,drawing.py network_drawing.py) \
	$(addprefix tests/impact/test_,animation.py sketch.py) $(addprefix tests/benchmarks/test_,page.py programs.py))
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist worksteal

# Processes that a target starts, one after the other, need not compile all modules anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help run test test-generic test-processors test-plain test-view test-oldest check bench validate docs tutorials clean

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST)

run: .venv/.ready  ## reproduce the paper's figures: results/report.html
	$(BIN)/python -m tutorials.cusumano_bai_1993 --out results

test: .venv/.dev  ## run the tests
	OMP_NUM_THREADS=1 $(PYTEST)

test-generic: .venv/.dev  ## run the tests of numbers as on a processor without AVX and fused products
	$(GENERIC) $(PYTEST) $(or $(TESTS),$(SAME_EVERYWHERE))

test-processors: .venv/.dev  ## run all tests as on three other processors, one of them with two threads
	$(GENERIC) $(PYTEST) $(TESTS)
	$(UNFUSED) $(PYTEST) $(TESTS)
	$(HASWELL) $(PYTEST) $(TESTS)

test-plain: .venv/.dev  ## run tests of the kernels with the JIT switched off
	NUMBA_DISABLE_JIT=1 OMP_NUM_THREADS=1 $(PYTEST) -m plain tests

test-view: .venv/.dev  ## run the tests of pages in a browser, which needs Chromium
	@$(BIN)/python -c 'from tests.browser import chromium; import sys; sys.exit(None if chromium() else "test-view needs Chromium; none was found")'
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m browser tests/viewer

# What newer libraries warn of when older ones use them is not ours to mend: warnings are no errors.
test-oldest: $(OLDEST)/.ready  ## run the tests on the oldest supported versions
	OMP_NUM_THREADS=1 $(OLDEST_BIN)/python -m pytest --numprocesses auto --dist worksteal -W default $(TESTS)

check: .venv/.dev  ## lint, format, spelling, types, layers
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/codespell
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: .venv/.dev  ## run the benchmarks, which write docs/benchmarks.md and its figures
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.run

validate: .venv/.dev  ## compare estimated errors with actual ones in all random cases
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.validation

docs: .venv/.docs  ## build the documentation: docs/_build/index.html
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build

tutorials: .venv/.dev  ## execute the tutorials and write their outputs into them
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.notebooks

clean:  ## remove environment, results and caches
	rm -rf .venv $(OLDEST) results docs/_build docs/api/generated docs/concepts/*.png docs/gallery/*.png docs/gallery/*.gif docs/gallery/index.md docs/jupyter_execute docs/tutorials build dist htmlcov *.egg-info .coverage .hypothesis .import_linter_cache \
		.mypy_cache .pytest_cache .ruff_cache
	find dynkit systems analysis tests tutorials -name __pycache__ -type d -prune -exec rm -rf {} +

# An environment that works is kept; one that is broken or too old is made anew.
.venv/.ready: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "dynkit needs Python 3.11 or newer; $(PYTHON) is %d.%d: try make PYTHON=python3.12" % sys.version_info[:2])'
	@test -d dynkit/systems || { echo "dynkit/systems must be a symbolic link: clone with git clone -c core.symlinks=true" >&2; exit 1; }
	@echo "Setting up .venv (once, half a minute)"
	@$(BIN)/python -c 'import pip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || $(PYTHON) -m venv --clear $(VENV_OPTIONS) .venv
	@$(INSTALL) --editable '.[view]'
	@touch $@

.venv/.dev: .venv/.ready
	@$(INSTALL) --editable '.[dev]'
	@touch $@

.venv/.docs: .venv/.ready
	@$(INSTALL) --editable '.[docs]'
	@touch $@

$(OLDEST)/.ready: pyproject.toml tests/oldest.txt
	@echo "Setting up $(OLDEST)"
	@$(OLDEST_PYTHON) -m venv --clear $(VENV_OPTIONS) $(OLDEST)
	@$(OLDEST_BIN)/python -m pip install --quiet --disable-pip-version-check --constraint tests/oldest.txt --editable '.[dev]'
	@touch $@
