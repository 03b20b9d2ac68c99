# make demo: from nothing to G-code, report and preview.   make test: the tests.
# Both create .venv when it is missing; the stamps make a second call quick.

PYTHON ?= python3
PYTEST_ARGS ?= -n auto
BIN := .venv/bin

.PHONY: demo test lint format clean
.DEFAULT_GOAL := demo

.venv/.run: pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	$(BIN)/python -m compileall -q src
	@touch $@

.venv/.dev: pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	$(BIN)/python -m compileall -q src
	@touch $@ .venv/.run

demo: .venv/.run
	$(BIN)/grassfire run jobs/bracket.toml --out out

test: lint
	$(BIN)/python -m pytest $(PYTEST_ARGS)

lint: .venv/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: .venv/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf .venv out build dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
