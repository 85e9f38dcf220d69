# Each target sets up what it needs by itself: a machine with make and Python 3.11 or newer is enough.
# `make test PYTHON=python3.12` chooses the interpreter of an environment that is not there yet.

VENV := .venv
BIN := $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable

PYTEST := $(BIN)/python -m pytest -n 2 --dist worksteal
# Sets of instructions that `processors` tries: without fused multiply-adds, and with them.
INSTRUCTIONS ?= SSE4_2 AVX2
# Shapes and types of every annotation are enforced, which only tests do: users pay nothing for them.
# The numeric tower lets a Python integer stand for a `float`, as it does for every other reader.
CHECKED := --jaxtyping-packages="jaxspace,beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))"

# Neither tool may remark on newer releases of itself in the middle of a result.
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1
export NO_MKDOCS_2_WARNING := true
# The tests start Python a hundred times: each start would compile all sources of the package again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-all beyond processors quick lint format types docs unit sweep faults costs fuzz bench validation
.PHONY: lowest release-check manual keep-bench clean
.NOTPARALLEL:
.DELETE_ON_ERROR:

demo: $(VENV)/.demo  ## simulate the example scene: a kick stage and its dispersion
	@$(BIN)/jaxspace disperse examples/scenes/kick_stage.toml --overwrite

test: lint  ## what a change needs while it is made
	@# Side by side: each of both keeps one core busy.
	@$(MAKE) --no-print-directory types & types=$$!; $(MAKE) --no-print-directory docs; \
		docs=$$?; wait $$types && exit $$docs
	@$(MAKE) --no-print-directory unit

lint: $(VENV)/.test  ## rules and layout of the sources
	@$(BIN)/ruff check --quiet
	@$(BIN)/ruff format --quiet --check || { echo "Some files are not formatted: make format." >&2; exit 1; }

format: $(VENV)/.test  ## rewrite the sources in the layout that `lint` asks for
	@$(BIN)/ruff check --quiet --fix
	@$(BIN)/ruff format --quiet

types: $(VENV)/.test  ## static types
	@$(BIN)/pyright --pythonpath $(BIN)/python

docs: $(VENV)/.test  ## the manual, in site/; a broken link or name is an error
	@# Not `--quiet`: with it, mkdocs counts no warnings, and `--strict` lets broken links pass.
	@log=$$(mktemp); $(BIN)/mkdocs build --strict >"$$log" 2>&1 || { cat "$$log" >&2; rm "$$log"; exit 1; }; \
		rm "$$log"

unit: $(VENV)/.test  ## the tests that take little, with shapes and types checked
	@$(PYTEST) $(CHECKED) --part quick

quick: $(VENV)/.test  ## those of one package: make quick PACKAGE=orbits
	@$(PYTEST) --part quick tests/$(PACKAGE)

test-all: lint types docs  ## every test, with shapes and types checked; of a long sweep a fixed sample
	@$(PYTEST) $(CHECKED) --no-programs

# The same functions pass the checks of shapes and types in `unit`; here they would add a sixth.
beyond: $(VENV)/.test  ## the tests that `test` leaves out, compiled as users do
	@$(PYTEST) --part rest --optimised

processors: $(VENV)/.test  ## every test, compiled as users do, with the instructions of other processors
	@for set in $(INSTRUCTIONS); do XLA_FLAGS=--xla_cpu_max_isa=$$set $(PYTEST) $(CHECKED) --optimised || exit 1; done

faults: $(VENV)/.test  ## kills, signals, full disks and lost workers, three times over
	@for k in 1 2 3; do $(BIN)/python -m pytest --quiet --sweep all tests/dispersion/test_campaigns.py tests/dispersion/test_campaign_faults.py tests/dispersion/test_campaign_clusters.py || exit 1; done

sweep: $(VENV)/.test  ## the tests with every case of the long sweeps
	@$(PYTEST) $(CHECKED) --no-programs --sweep all

costs: $(VENV)/.test  ## measure what each test takes, and so which of them `test` runs
	@$(PYTEST) --write-costs
	@rm -rf .programs
	@$(PYTEST) --write-costs --part quick

fuzz: $(VENV)/.test  ## search for the worst errors of all closed forms, a silent NaN, wrong derivatives at rest
	@$(BIN)/python tests/fuzz_errors.py
	@$(BIN)/python tests/fuzz_nan.py
	@$(BIN)/python tests/fuzz_slopes.py
	@$(BIN)/python tests/fuzz_single.py

validation: $(VENV)/.test $(VENV)/.bench  ## the numbers of others beside ours, and their page of the manual
	@$(BIN)/python -m validation

bench: $(VENV)/.bench  ## speed and accuracy on this machine
	@$(BIN)/python -m benchmarks

keep-bench:  ## commit the results of `bench` to the branch of measurements, and push it
	@.ci/keep_benchmarks

lowest:  ## the lowest releases that pyproject.toml allows
	@.ci/lowest

release-check: $(VENV)/.test $(VENV)/.release  ## packages, a bare installation of each Python, manual, links, metadata
	@$(BIN)/python .ci/release_check.py

manual: $(VENV)/.test $(VENV)/.release  ## publish the manual of this commit under its version
	@.ci/publish_manual

clean:  ## remove what the other targets made
	rm -rf $(VENV) .venv-lowest .programs site build dist .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -not -path "./.git/*" -prune -exec rm -rf {} +

$(VENV)/.python:
	@python=$${PYTHON:-$$(.ci/python)} && "$$python" -m venv --clear $(VENV)
	@touch $@

$(VENV)/.demo: pyproject.toml | $(VENV)/.python
	@echo "Installing jaxspace into $(VENV); this happens once." >&2
	@$(INSTALL) ".[app]"
	@touch $@

$(VENV)/.test: pyproject.toml | $(VENV)/.python
	@echo "Installing jaxspace and its tools into $(VENV); this happens once." >&2
	@$(INSTALL) ".[app,docs,test]"
	@touch $@

$(VENV)/.bench: pyproject.toml | $(VENV)/.python
	@echo "Installing jaxspace and its benchmarks into $(VENV); this happens once." >&2
	@$(INSTALL) ".[app,bench]"
	@touch $@

$(VENV)/.release: pyproject.toml $(VENV)/.test
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check build check-jsonschema mike towncrier twine
	@touch $@
