# Two commands matter: `make plan` (install and run the main job) and `make test` (install and run the tests).
SHELL := /bin/bash
.DEFAULT_GOAL := help

PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	if command -v $$p >/dev/null 2>&1 && $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then echo $$p; break; fi; done)
VENV := .venv
BIN := $(VENV)/bin
TOP ?= 5
WORKERS ?= 2
OUT ?= out/plan
SEED ?= 1
MUTANTS ?= 300
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: help plan test test-long browser lint mutants fuzz hostile kills flat load bench bench-baseline external data reports readme docs pages programs installs lock wheel clean check-python
help:  ## show this list
	@awk -F':.*## ' '/^[a-z-]+:.*## /{printf "  make %-14s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

check-python:
	@if [ -z "$(PYTHON)" ]; then \
		echo "cpic-planner needs Python 3.11 or newer and found none on PATH." >&2; \
		echo "Remedy: install it (Debian/Ubuntu: apt install python3 python3-venv; macOS: brew install python), or name it: make plan PYTHON=/path/to/python3.12" >&2; exit 1; fi
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "$(PYTHON) is older than Python 3.11. Remedy: make plan PYTHON=/path/to/python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { \
		echo "$(PYTHON) has no venv module. Remedy: apt install python3-venv (Debian/Ubuntu), or use another Python: make plan PYTHON=..." >&2; exit 1; }

$(VENV)/installed: pyproject.toml constraints.txt | check-python
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing cpic-planner and what it needs into $(VENV) (once; about a minute)"
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[test,dev]'
	@touch $@

plan: $(VENV)/installed  ## rank the catalogue, confirm the best targets with images, write the report
	$(BIN)/cpic plan --top $(TOP) --workers $(WORKERS) --out $(OUT)

test: $(VENV)/installed  ## run the test suite (PYTEST="-p tools.spent": what each file takes)
	$(BIN)/python -m pytest -q --numprocesses 2 --dist worksteal $(PYTEST)

test-long: $(VENV)/installed  ## run the long tests (PYTEST="-p tools.part --part 3/24": one part of them)
	$(BIN)/python -m pytest -q -m long --numprocesses $(WORKERS) --dist worksteal $(PYTEST)

# Chromium is Debian's (apt-get install chromium) or the one that CHROMIUM names.
browser: $(VENV)/installed  ## do what a visitor of the pages does, in Chromium (PYTEST="-k slice": some of it)
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[browser]' || \
		echo "Playwright could not be installed: what needs it is skipped" >&2
	$(BIN)/python -m pytest -q -m browser tests/browser $(PYTEST)

lint: $(VENV)/installed  ## check style, types, who imports whom, words, figures of the README; name reports that are older than the code
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(BIN)/python -m tools.words
	$(BIN)/python -m tools.readme --check
	$(BIN)/python -m tools.reports --check

mutants: $(VENV)/installed  ## change the code in one place at a time; fails where no test sees it (SEED, MUTANTS, WORKERS)
	$(BIN)/python tests/mutants/run.py --seed $(SEED) --count $(MUTANTS) --workers $(WORKERS)

# Each surface in a process of its own: what one does to its process does not end another. With PYTHONMALLOC=debug damage to
# memory is named where it stands.
fuzz: $(VENV)/installed  ## draw 5000 cases of each surface that is open to others; fails where one is not answered or refused in one line (SEED, WORKERS)
	set -o pipefail; $(BIN)/python -m pytest -q --collect-only -m fuzz tests/fuzz | grep :: | tr '\n' '\0' \
		| xargs -0 -r -n 1 -P $(WORKERS) $(BIN)/python -m pytest -q -m fuzz --hypothesis-profile explore --hypothesis-seed $(SEED)

hostile: $(VENV)/installed  ## send 600 hostile requests to cpic serve; fails where one is not refused in one line (SEED)
	$(BIN)/python tests/cpic_planner/web/hostile.py --seed $(SEED)

kills: $(VENV)/installed  ## kill plan, simulate, whatif and confirm 50 times each; fails where bytes or foreign files change
	$(BIN)/python tests/faults/kills.py
	$(BIN)/python tests/faults/kills.py --workers 2 --count 10 --commands simulate plan

flat: $(VENV)/installed  ## run 1000 frames (7 GB) and 5000 universes; fails where open files or memory grow with them
	$(BIN)/python tests/faults/flat.py

load: $(VENV)/installed  ## ask cpic serve 20 000 times, 20 users at once; fails below 80 answers or 50 pages a second
	$(BIN)/python tests/benchmarks/load.py

bench: $(VENV)/installed  ## run the timed comparisons; fails where one is slower than its baseline
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[bench]'
	$(BIN)/python tests/benchmarks/run.py --check

bench-baseline: $(VENV)/installed  ## the same, and keep its figures as the baseline
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[bench]'
	$(BIN)/python tests/benchmarks/run.py

external: $(VENV)/installed  ## ask other people's packages anew, each in an environment of its own, and compare (needs a network)
	$(BIN)/python -m tools.reports external -- --install

data: $(VENV)/installed  ## rebuild catalogs/data from the pinned packages and compare
	$(BIN)/python -m tools.build_catalogue.build --check

reports: $(VENV)/installed  ## make every committed report anew, two at a time (ONLY="reach spectra" or --older: some)
	$(BIN)/python -m tools.reports $(ONLY)

readme: $(VENV)/installed  ## fill README.md with the figures of the reports
	$(BIN)/python -m tools.readme

docs: $(VENV)/installed  ## build the documentation into docs/_build/html; a warning is an error
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[docs]'
	$(BIN)/python -m sphinx -W --keep-going -q -j 2 -d docs/_build/doctrees docs docs/_build/html
	@echo "open docs/_build/html/index.html"

pages: $(VENV)/installed  ## run every command and block of Python of the README and of the pages, with fewer draws
	$(BIN)/python -m pytest -q -m pages --numprocesses 2 --dist worksteal tests/docs

programs: $(VENV)/installed  ## have other programs read what this one writes, each in an environment of its own (CPIC_PROGRAMS_CACHE keeps them)
	$(BIN)/python -m pytest -q -m programs --numprocesses $(WORKERS) --dist loadfile tests/programs

installs: $(VENV)/installed  ## install the built package with every Python that is found, and ask it questions there
	$(BIN)/python -m tools.installs

lock: $(VENV)/installed  ## write the lock with hashes, requirements-lock.txt, from constraints.txt
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[release]'
	@{ echo '# Checked by hashes: pip install --require-hashes --requirement requirements-lock.txt, then pip install --no-deps'; \
		echo '# cpic-planner. The versions of constraints.txt, extra "web" included; written by make lock.'; \
		$(BIN)/uv pip compile pyproject.toml --extra web --universal --python-version 3.11.5 --generate-hashes \
		--constraint constraints.txt --no-emit-index-url --no-header --no-annotate --quiet; } > requirements-lock.new
	@mv requirements-lock.new requirements-lock.txt

wheel: $(VENV)/installed  ## build the wheel
	$(BIN)/python -m build --wheel --outdir dist

clean:  ## remove what the other targets made
	rm -rf $(VENV) out dist build docs/_build docs/_made docs/notebooks docs/reports *.egg-info .pytest_cache .mypy_cache .ruff_cache
