# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# Everything creates .venv from the lock file when needed (scripts/setup). `make demo ARGS=--once` passes options on.

SHELL := /bin/bash
PY := .venv/bin/python
ARGS ?=
export PYTHON
# Imports are kept as bytecode in .venv and __pycache__: every process of the system starts in half the time.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup shell demo test ci lint format generate docs pictures site peers evaluate soak bench warm lock sbom wheel clean
.DEFAULT_GOAL := help

help:  ## this list
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## /\1\t/' | expand -t 12

setup:  ## create .venv, install, compile what the demonstration uses
	@scripts/setup

warm: setup  ## compile all kernels now instead of at their first use
	@$(PY) -m services.warm --algorithms

shell: setup  ## a shell in which the commands of the documentation work
	@bash --rcfile <(cat ~/.bashrc 2>/dev/null; echo '. .venv/bin/activate') -i

demo: setup  ## the whole system with its demonstration mission, at http://127.0.0.1:8080 until Ctrl-C
	@exec .venv/bin/cdff demo $(ARGS)

test: setup  ## the tests, at most 8 minutes
	@$(PY) scripts/run_tests.py $(ARGS)

ci: setup  ## lint, then all tests with the slow ones, at most 25 minutes
	@$(MAKE) --no-print-directory -j2 -O peers warm
	@$(MAKE) --no-print-directory -j2 -O lint site
	@$(PY) scripts/run_tests.py --slow $(ARGS)
	@.venv/bin/cdff check --verified

lint: setup  ## ruff, mypy, import contracts, language, descriptions, generated files
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/mypy
	@.venv/bin/lint-imports
	@$(PY) scripts/prose.py
	@.venv/bin/cdff generate --check
	@.venv/bin/cdff check

format: setup  ## let ruff mend what it can
	@.venv/bin/ruff check --fix-only --quiet .
	@.venv/bin/ruff format --quiet .

generate: setup  ## write what is made from descriptions
	@.venv/bin/cdff generate

docs: setup  ## the documentation at http://127.0.0.1:8000
	@NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs serve --quiet

pictures: setup  ## draw the pictures of the viewer in the documentation again; fails if one differs from docs/images
	@$(PY) scripts/documentation_pictures.py $(ARGS)

site: setup  ## build the documentation into build/site; fails on a broken link, reports a picture that differs
	-@$(PY) scripts/documentation_pictures.py
	@NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build --strict --quiet

peers:  ## install the foreign programs that some slow tests use
	@scripts/peers

evaluate:  ## every accuracy figure again, into docs/evaluation/*.json (long)
	@scripts/setup evaluate
	@$(PY) -m evaluation $(ARGS)

soak: setup  ## the tests that take many minutes each (long)
	@$(PY) scripts/run_tests.py --soak $(ARGS)

bench:  ## every benchmark, into build/benchmarks/*.json
	@scripts/setup evaluate
	@$(PY) benchmarks/run.py $(ARGS)

lock:  ## resolve the lock files again (needs uv)
	@scripts/lock

sbom: setup  ## list the packages with their licences in build/sbom.cdx.json; fails if one that ships is under the GPL
	@scripts/sbom

wheel: setup  ## build wheel and sdist into dist/
	@.venv/bin/python -m hatchling build

clean:  ## remove everything that is made, .venv too
	rm -rf .venv build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
