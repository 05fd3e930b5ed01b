# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# Everything creates .venv from the lock file when needed (scripts/setup). `make demo ARGS=--once` passes options on.

SHELL := /bin/bash
PY := .venv/bin/python
ARGS ?=
export PYTHON

.PHONY: help setup demo test ci lint format generate evaluate bench lock clean
.DEFAULT_GOAL := help

help:  ## this list
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## /\1\t/' | expand -t 12

setup:  ## create .venv and install
	@scripts/setup

demo: setup  ## the whole system with its demonstration mission, at http://127.0.0.1:8080 until Ctrl-C
	@exec .venv/bin/cdff demo $(ARGS)

test: setup  ## the tests, at most 10 minutes
	@$(PY) scripts/run_tests.py $(ARGS)

ci: setup lint  ## lint, then all tests with the slow ones, at most 25 minutes
	@$(PY) scripts/run_tests.py --slow $(ARGS)
	@.venv/bin/cdff check --verified

lint: setup  ## ruff, mypy, import contracts, descriptions, generated files
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/mypy
	@.venv/bin/lint-imports
	@.venv/bin/cdff generate --check
	@.venv/bin/cdff check

format: setup  ## let ruff mend what it can
	@.venv/bin/ruff check --fix-only --quiet .
	@.venv/bin/ruff format --quiet .

generate: setup  ## write what is made from descriptions
	@.venv/bin/cdff generate

evaluate: setup  ## every accuracy figure again, into docs/evaluation/*.json (long)
	@$(PY) -m cdff_dev.evaluate $(ARGS)

bench: setup  ## every benchmark, into build/benchmarks/*.json
	@$(PY) benchmarks/run.py $(ARGS)

lock:  ## resolve the lock files again (needs uv)
	uv pip compile --quiet --python-version 3.11 --all-extras pyproject.toml -o requirements/py311.txt
	uv pip compile --quiet --python-version 3.12 --all-extras pyproject.toml -o requirements/py312.txt

clean:  ## remove everything that is made, .venv too
	rm -rf .venv build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
