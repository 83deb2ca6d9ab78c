# Every target sets up what it needs in .venv by itself.  `make help` lists them.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

VENV := .venv
PY := $(VENV)/bin/python
LINT := .venv-lint
DOCS := .venv-docs
RELEASE := .venv-release
MUTANTS_VENV := .venv-mutants
# One BLAS thread a process: the solver's small stacked products only lose by more.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1
export PYTHONDONTWRITEBYTECODE ?= 1
# Blender starts from its factory settings: a user's own add-ons and start-up file have no say in any target.
export BLENDER_USER_RESOURCES := $(abspath $(VENV))/blender

MODEL ?=
PLATFORMS ?=
PYTEST ?=

# Where tests run beside others, whole lines are printed, each with the name of its group.
beside = $(if $(BESIDE),| sed --unbuffered 's/^/$(1): /')

.PHONY: help venv native demo test test-solver test-tools test-blender test-others test-long test-matrix test-window test-mutants lint-venv lint format build docs release bench pages \
	figures clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 24

venv: ## set up .venv (Python 3.11 or 3.13 as found, or PYTHON=...)
	@python="$$(scripts/find_python.sh 3.11 3.13)" && \
		"$$python" scripts/environment.py $(VENV) test development solver blender --editable
	@$(PY) scripts/build_native.py --if-needed
	@$(PY) -m compileall -q __init__.py __main__.py benchmarks command_line operators solver ui # hundreds of tests start the command

demo: venv ## approximate two models, or MODEL=file, in Blender; results in out/
	@$(PY) scripts/demo.py $(if $(MODEL),"$(MODEL)")

test: venv ## all tests that need no window: the solver's beside all others
	@$(MAKE) --no-print-directory --jobs=2 BESIDE=others test-solver test-others

test-others: venv
	@$(MAKE) --no-print-directory test-tools
	@$(MAKE) --no-print-directory test-blender

test-solver: venv ## tests of the solver, with bpy out of reach
	@$(PY) -m pytest -m "not long" tests/solver $(PYTEST) $(call beside,solver)

test-tools: venv ## tests of the command line, the packaging and the architecture
	@$(PY) -m pytest -m "not long" tests --ignore=tests/solver --ignore=tests/blender $(PYTEST) $(call beside,tools)

test-blender: venv ## tests under bpy on the installed zip
	@$(PY) -m pytest -m "not long" tests/blender $(PYTEST) $(call beside,Blender)

test-long: venv ## the tests that take minutes: thousands of generated meshes, long runs
	@$(PY) -m pytest -m long tests --ignore=tests/blender $(PYTEST)
	@$(PY) -m pytest -m long tests/blender $(PYTEST)

test-matrix: venv ## the Blender tests on every supported bpy, the solver tests on every supported NumPy
	@$(PY) scripts/test_matrix.py $(MATRIX)

test-window: venv ## the tests in a real Blender window (BLENDER=executable, or ../shared/tools/real-blender)
	@$(PY) scripts/test_window.py $(WINDOW)

test-mutants: venv ## change the core modules in small ways and list what no test notices (MUTANTS="solver/fitting/pursuit.py --count 100")
	@"$$(scripts/find_python.sh 3.11 3.13)" scripts/environment.py $(MUTANTS_VENV) mutants
	@$(MUTANTS_VENV)/bin/python scripts/test_mutants.py $(MUTANTS)

# The checks have an environment of their own: what mypy says depends on the version of NumPy, not on the one of Blender.
lint-venv:
	@"$$(scripts/find_python.sh 3.11 3.13)" scripts/environment.py $(LINT) lint

lint: lint-venv ## ruff (lint and format) and mypy
	@$(LINT)/bin/python -m ruff check .
	@$(LINT)/bin/python -m ruff format --check .
	@$(LINT)/bin/python scripts/type_check.py

native: venv ## the compiled kernel for every platform, into build/native/
	@$(PY) scripts/build_native.py --all

format: lint-venv ## format the code
	@$(LINT)/bin/python -m ruff check --fix .
	@$(LINT)/bin/python -m ruff format .

build: venv ## the extension zips in dist/, validated (PLATFORMS="linux-x64 ..." for some of them)
	@$(PY) scripts/build_extension.py $(PLATFORMS) $(if $(OUTPUT),--output "$(OUTPUT)")

docs: ## build the documents as a web site, notebooks run, into dist/docs (PYTHON=... chooses the Python)
	@"$$(scripts/find_python.sh 3.11 3.13)" scripts/environment.py $(DOCS) docs solver --editable
	@$(DOCS)/bin/python scripts/build_native.py --if-needed
	@$(DOCS)/bin/python scripts/build_docs.py

release: venv ## version, changelog, library, zips, documents, checksums, commit and tag (VERSION=0.2.0)
	@"$$(scripts/find_python.sh 3.11 3.13)" scripts/environment.py $(RELEASE) release
	@$(RELEASE)/bin/python scripts/release.py "$(VERSION)"

bench: venv ## measure speed and accuracy into docs/measured.json and the pages (BENCH="--only stages sizes")
	@$(PY) -m pip --disable-pip-version-check install --quiet --requirement=requirements/peers.txt || \
		echo "MeshLab and MeshLib do not install here: they are left out of the benchmark"
	@$(PY) -m sparse_surface benchmark --keep $(BENCH)
	@$(PY) scripts/fill_pages.py

pages: venv ## fill the marked places of README.md and docs/: measured figures, tables of settings
	@$(PY) scripts/fill_pages.py

figures: venv ## make the pictures of docs/ and docs/paper.md again (FIGURES="fig9 heat_map" for some of them)
	@$(PY) scripts/figures.py $(FIGURES)

clean: ## remove what the targets made, but for the environments and the wheels
	@rm -rf build dist out .cache .pytest_cache .mypy_cache .ruff_cache
	@find . -name __pycache__ -not -path './.venv*' -prune -exec rm -rf {} +
