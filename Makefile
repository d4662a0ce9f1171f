# `make demo` and `make test` do all of their own set-up in a virtual environment.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# Python compiles modules when they are first imported: few of those that come with torch ever are.
# What all of a first job's processes import is compiled before them.
PIP_OPTIONS := --quiet --no-compile --disable-pip-version-check -c constraints.txt
SITE_STAMP := $(VENV)/.site-installed
# Tests and jobs start hundreds of processes. Without its bytecode each would compile a thousand
# modules again: a second and more.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-all test-vectors lint site clean

demo: $(STAMP)
	$(BIN)/lfportrait demo --out demo-out

test: $(STAMP)
	$(BIN)/python -m pytest

# Slow tests, too: pages in a browser, shaders, whole jobs, processes that are killed, examples.
test-all: $(STAMP)
	LFPORTRAIT_SLOW=1 $(BIN)/python -m pytest

# Tests that run kernels, and the small demo, as on processors with fewer instructions than this.
KERNEL_TESTS := tests/simd tests/lightfield $(addprefix tests/field/test_, background.py \
	cutout.py field.py poses.py raycast.py steps.py sweep.py texture.py) tests/example/test_kernels.py \
	tests/example/test_patches.py tests/example/test_patch_levels.py \
	tests/example/test_surface_guide.py tests/example/skin/test_atlas.py \
	tests/capture/test_mattes.py tests/capture/test_likelihood.py tests/share/page/test_texels.py
test-vectors: $(STAMP)
	for level in avx2 sse2; do \
	  echo "compiled for $$level"; export LFPORTRAIT_VECTORS=$$level; \
	  $(BIN)/python -m pytest $(KERNEL_TESTS) $(addprefix --ignore=tests/lightfield/,gpu screens) \
	    && $(BIN)/lfportrait demo --quick --out demo-out/$$level || exit 1; \
	done

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python scripts/lint_page.py

# The documentation as pages in site/, to be read without a network: open site/index.html.
site: $(SITE_STAMP)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	$(BIN)/python scripts/check_site.py site

$(SITE_STAMP): $(STAMP)
	$(BIN)/python -m pip install $(PIP_OPTIONS) -e '.[site]'
	touch $(SITE_STAMP)

$(STAMP): pyproject.toml src/lfportrait_eval/pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install $(PIP_OPTIONS) torch==2.13.0
	$(BIN)/python -m pip install $(PIP_OPTIONS) -e '.[dev]' -e src/lfportrait_eval
	$(BIN)/python -m compileall -q -j 0 -x '/tests?/' $(addprefix $(VENV)/lib/python3*/site-packages/, \
	  llvmlite numba numpy scipy)
	touch $(STAMP)

clean:
	rm -rf $(VENV) demo-out site
