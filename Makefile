# Two commands do all the set-up: `make demo` and `make test`. They need git, make and a Python with venv.

MAKEFLAGS += --no-print-directory
.SILENT:
.DELETE_ON_ERROR:
.PHONY: help demo test slow long docs setup kernels clean

VENV := .venv
# Files of tests side by side, one for each core, each with one thread; in the order in which they
# are collected (`tests/conftest.py`), for files of few tests are the longest and would come last.
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(VENV)/bin/pytest --numprocesses logical --dist loadfile --no-loadscope-reorder
# Tests that `make test` runs, as pytest's option -m names them.
TESTS := not slow and not long
CASE := examples/alpha/case.toml
PAGE := examples/alpha/results/report.html

# medcoupling has no wheel for a Python newer than 3.13.
SUITABLE := import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))
PYTHON ?= $(shell for name in python3 python3.13 python3.12 python3.11; do \
	if $$name -c '$(SUITABLE)' 2>/dev/null; then echo $$name; break; fi; done)

help:
	echo "make demo    set everything up in $(VENV) and run $(CASE)"
	echo "make test    set everything up in $(VENV), then lint, type check and test"
	echo "make slow    run the slower set of tests"
	echo "make long    run the longest tests, the demo among them"
	echo "make docs    set everything up in $(VENV) and build the documentation into site/"
	echo "make setup   set everything up in $(VENV)"
	echo "make clean   remove $(VENV), the caches and the demo's results"

demo: $(VENV)/installed
	$(VENV)/bin/prismid run $(CASE)
	echo "The report is $(CURDIR)/$(PAGE)"

# Types are checked beside the tests, on what they leave free, and told after them.
test: kernels
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy > $(VENV)/types.log 2>&1 & types=$$!; \
	trap 'kill $$types; exit 130' INT TERM; \
	$(PYTEST) -m '$(TESTS)'; tests=$$?; \
	wait $$types; types=$$?; \
	cat $(VENV)/types.log; \
	test $$tests = 0 && test $$types = 0

slow: kernels
	$(PYTEST) -m slow

long: kernels
	$(PYTEST) -m long

# Files of tests side by side would compile the same kernels at the same time.
kernels: $(VENV)/installed-dev $(VENV)/checkout
	$(VENV)/bin/python -m tools.compiled_kernels

docs: $(VENV)/installed-dev
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --quiet --strict
	echo "The documentation is $(CURDIR)/site/index.html"

setup: $(VENV)/installed

# Each stamp is as new as the requirements that it was made from.
$(VENV)/installed: pyproject.toml | $(VENV)/bin/python
	echo "Installing prismid and its libraries into $(VENV); the first time this takes some minutes."
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable .
	$(VENV)/bin/python -I meshes/system_libraries.py
	touch $@

$(VENV)/installed-dev: $(VENV)/installed
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

# The benchmarks are scripts that share modules with each other and with the tests.
$(VENV)/checkout: $(VENV)/installed-dev
	$(VENV)/bin/python -c 'import pathlib, sysconfig; pathlib.Path(sysconfig.get_path("purelib"), "prismid_checkout.pth").write_text(f"{pathlib.Path.cwd()}\n", "utf-8")'
	touch $@

$(VENV)/bin/python:
	test -n "$(PYTHON)" || { \
		echo "prismid needs Python 3.11, 3.12 or 3.13 and found none of them as python3, python3.13, python3.12 or python3.11; name one with: make $(MAKECMDGOALS) PYTHON=/path/to/python" >&2; exit 1; }
	$(PYTHON) -c '$(SUITABLE)' || { \
		echo "prismid needs Python 3.11, 3.12 or 3.13 and found $$($(PYTHON) --version 2>&1) as $(PYTHON)." >&2; exit 1; }
	$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "prismid needs the venv module of $(PYTHON) and found none: ask an administrator to run \`apt-get install -y python3-venv\`." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

clean:
	rm -rf $(VENV) build site *.egg-info .mypy_cache .ruff_cache .pytest_cache examples/*/results
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
