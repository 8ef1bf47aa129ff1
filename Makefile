# `make` alone shows the targets. Each of them creates or refreshes .venv first; only Python >= 3.11 with venv is needed.
PYTHON ?= python3
OUT ?= reports
.DEFAULT_GOAL := help
.PHONY: help labs test slow check kernels docs matrix dist pictures bench clean FORCE
.NOTPARALLEL:

# Bytecode is kept even where the environment says otherwise: the tests start many processes, which would compile it anew.
export PYTHONDONTWRITEBYTECODE :=

BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

# A stamp holds the folder and the interpreter it was made for: an environment that was copied or moved is installed anew.
HERE := $(CURDIR) $(shell $(PYTHON) -c 'import sys; print(sys.version.split()[0])' 2>/dev/null)
stale = $(if $(findstring x$(HERE)x,x$(shell cat $(1) 2>/dev/null)x),,FORCE)

help: ## show this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-8s %s\n", $$1, $$2 }' Makefile
	@echo "  PYTHON=python3.12 chooses the interpreter, OUT=folder where the reports go."

labs: .venv/.labs ## run every lab; the reports are in reports/ (index.html shows them all)
	$(BIN)/python -m ctlabs run all --out $(OUT)

test: .venv/.test ## run the tests that take seconds; COVER=1 measures the branch coverage too, as continuous integration does
	$(BIN)/python -m pytest -n 2 --dist loadgroup -m "not slow" $(if $(COVER),--cov --cov-report=term) -q

slow: .venv/.test ## run the tests that take minutes: every lab against its committed numbers, the wheel, all random examples
	$(BIN)/python -m pytest -n 2 --dist loadgroup -m "slow or property" --examples=1000 -q

check: .venv/.test ## lint, check spelling and types, run the examples in README.md and docs/, and the numerical tests under other kernels
	$(BIN)/python -m ruff check .
	$(BIN)/codespell *.md docs tasks ctlabs
	$(BIN)/python -m mypy
	$(BIN)/python -m pytest -q tests/test_docs.py
	$(BIN)/python tests/kernels.py --brief

kernels: .venv/.test ## run the numerical tests under every kernel of OpenBLAS that the processor can run
	$(BIN)/python tests/kernels.py

docs: .venv/.docs ## build the site into build/docs, with every example of the gallery
	rm -rf build/docs
	$(BIN)/python -m sphinx -W -n -q --keep-going docs build/docs
	@echo "build/docs/index.html"

matrix: ## run the tests on every Python that is found, with the lowest dependencies, and without numba; TESTS=tests/linalg tries a part
	$(PYTHON) .ci/matrix.py $(TESTS)

dist: .venv/.test ## build the wheel and the source distribution into dist, the same bytes from the same commit
	$(BIN)/python .ci/dist.py

pictures: .venv/.test ## take the documentation's pictures of the workbench again
	$(BIN)/python docs/images/take.py

bench: .venv/.test ## run the benchmarks; a ratio that is missed makes it fail
	@failed=0; for file in $(filter-out %/timing.py %/drawn.py,$(wildcard benchmarks/*.py)); do echo "== $$file"; $(BIN)/python $$file || failed=1; done; exit $$failed

clean: ## remove .venv, caches and everything built
	rm -rf .venv build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage .coverage.*
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/.labs: pyproject.toml $(call stale,.venv/.labs)
	$(call install,.)
.venv/.test: pyproject.toml $(call stale,.venv/.test)
	$(call install,.[test])
.venv/.docs: pyproject.toml $(call stale,.venv/.docs)
	$(call install,.[docs])
FORCE:

# An interrupted creation leaves a folder without a working pip, a change of PYTHON one of another version: both start anew.
define install
	@$(PYTHON) -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  echo "$(PYTHON): expected Python >= 3.11 with venv, received $$($(PYTHON) --version 2>&1)" \
	    "(choose another one with make PYTHON=python3.12; Debian and Ubuntu: apt install python3-venv)" >&2; exit 1; }
	@test "$$($(BIN)/python -c 'import pip, sys; print(sys.version.split()[0])' 2>/dev/null)" = "$(lastword $(HERE))" || { \
	  echo "creating .venv"; rm -rf .venv; $(PYTHON) -m venv .venv; }
	@echo "installing $(1) into .venv (about a minute)"
	@$(PIP) install --editable '$(1)'
	@echo '$(HERE)' > $@
endef
