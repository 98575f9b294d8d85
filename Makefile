# The first command after cloning may be any of these: each sets up what it needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: run test check browser pages same chaos docs lint shape types examples clean

run: $(VENV)/.installed
	$(BIN)/coastarc run examples/quick.toml

# Files of tests side by side, one more than there are processors, since many wait for processes of their own; in
# their own order, which has the longest in front and those with Ray at the end.
PYTEST := $(BIN)/python -m pytest -n $$(($$(getconf _NPROCESSORS_ONLN) + 1)) --maxprocesses 5 --dist loadfile --no-loadscope-reorder
test: $(VENV)/.installed-test
	$(PYTEST)

# What `make test` leaves out because it takes long; then the tests whose results depend on how a processor rounds,
# once more as on one that has neither FMA nor AVX2: the functions of the C library and of NumPy, and OpenBLAS.
NUMERIC := tests/core tests/workers tests/service/problem_set tests/service/missed_thrust tests/service/solutions \
    tests/acceptance tests/test_python_example.py
ELSEWHERE := GLIBC_TUNABLES=glibc.cpu.hwcaps=-FMA,-AVX2 NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4" OPENBLAS_CORETYPE=Nehalem
check: $(VENV)/.installed-test
	$(PYTEST) -m 'slow and (not browser or short)'
	$(ELSEWHERE) $(PYTEST) -m 'not ray and (not browser or short)' $(NUMERIC)

# The same solutions inline, on the process pool and on Ray, with the real solver: some twenty minutes.
same: $(VENV)/.installed-test
	$(BIN)/python -m tests.acceptance.same_everywhere

# Kill whatever can be killed, 200 times and more, and compare with runs that nobody disturbs: some twenty minutes.
# What one run drew is drawn again by `make chaos CHAOS="--rng-seed N"`, one round of it with `--round NAME` too.
chaos: $(VENV)/.installed-test
	$(BIN)/python -m tests.chaos $(CHAOS)

browser: $(VENV)/.installed-test
	COASTARC_REQUIRE_BROWSER=1 $(BIN)/python -m pytest -m '' tests/browser

# What the pages cost on an archive of 10,000 solves, as JSON; or PAGES="--solves 1000000 --minutes 60".
pages: $(VENV)/.installed-test
	$(BIN)/python -m tests.browser.measure $(PAGES)

# The pages of docs/ as a site; a broken link, like every other warning, is an error.
docs: $(VENV)/.installed-docs
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --builder html docs build/docs
	@echo "Open build/docs/index.html"

lint: $(VENV)/.installed-test node_modules/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/node node_modules/typescript/bin/tsc

# What the page's modules know of the API, after a change of its schemas.
types: $(VENV)/.installed-test node_modules/.installed
	$(BIN)/python -m tests.page_types

# The examples in the OpenAPI document, from a small campaign that is solved for them: about a minute.
examples: $(VENV)/.installed-test
	$(BIN)/python -m tests.api_examples

# How easily things are found: sizes of files, importers, forms of one noun, circles; JSON, and a table on a terminal.
shape: $(VENV)/.installed-test
	@$(BIN)/python -m benchmarks.shape

clean:
	rm -rf $(VENV) node_modules build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find core workers service benchmarks tests -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(VENV)/bin/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	touch $@

$(VENV)/.installed-test: $(VENV)/bin/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[test,dev]"
	touch $@ $(VENV)/.installed

$(VENV)/.installed-docs: $(VENV)/bin/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[docs]"
	touch $@ $(VENV)/.installed

# Node comes with the development packages; neither it nor these tools are there at run time.
node_modules/.installed: $(VENV)/.installed-test package.json package-lock.json
	PATH="$(BIN):$$PATH" $(BIN)/npm ci --silent
	touch $@
