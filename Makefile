# Works on a fresh machine with Python 3.11 or newer and make.
#
#   make compare   the paper's problem, polynomial against optimal, on the emulated machine
#   make comparison  the same with every method of README's table, to results/compare (a minute)
#   make suite     every method on every problem, to results/suite
#   make bench     speed beside an earlier version, scripts by hand and frameworks, to results/benchmarks
#   make paper     the paper's figures and numbers, to results/paper
#   make stress    the suite's longer cases; random problems and random pairs by family, to
#                  results/stress (an hour or two; continues where it ended)
#   make judging   what judging a plan costs; damaged plans, to results/judging (some minutes)
#   make coverage  which goals each method reaches, random pairs, to results/coverage (an hour)
#   make optimality  plans beside lengths that are known, and related plans (hours; continues), to results/optimality
#   make mutants  whether the tests see wrong code in the judge, proofs, systems, machine (an hour)
#   make robustness  the tracker on good and bad machines, to results/feedback (some minutes)
#   make controller  the tracker in C beside the one in Python, to results/controller (some minutes)
#   make sensitivity  plans that mind errors less, to results/sensitivity (some minutes)
#   make compensation  plans that know the hardware, to results/compensation (ten minutes)
#   make identification  machines from logs, home to end, to results/identification (half an hour)
#   make truths    arms outside the model, home to end, to results/truths (ten minutes; continues)
#   make map       a map of the goals that each method reaches from one start, to results/map (10 minutes)
#   make peers     examples of other projects beside ours (installs them from PyPI), to results/peers (a minute)
#   make singular  what the limit on z2 does near the singularity, to results/singular (a minute)
#   make report    pictures of the report's page (needs Chromium), to results/report
#   make explorer  pictures of the explorer in a browser (needs Chromium), to results/explorer
#   make gallery   the pictures of docs/gallery.md, to results/gallery (a minute)
#   make results-check  the pages of results/ whose code has changed since they were made
#   make notebook  Jupyter with the notebooks, the explorer in the first of them
#   make docs      the documentation, to out/docs/index.html; warnings are errors
#   make test      what CI runs: lint, types, tests
#   make processors  the methods with the arithmetic of other processors (some minutes)
#   make installed  built, installed and run on every Python here that pyproject.toml declares
#   make check     lint and types only
#   make format    put the code into the house format
#   make generated  write the files that come from tables (editors' options, the layout for C);
#                  a new layout compiles the kernel anew
#   make clean     remove what make has made

PYTHON ?= python3
# A file stays in one worker, which makes its fixtures once; the longest come first by their names.
PYTEST_FLAGS ?= -n 2 --dist loadfile --no-loadscope-reorder
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check

SIGN := $(BIN)/python tests/benchmarks/results_pages.py --sign

KERNEL := $(wildcard planner/machine/*.c planner/machine/*.h)

.DEFAULT_GOAL := compare
.PHONY: compare comparison suite bench stress judging coverage optimality mutants paper robustness controller sensitivity compensation \
  identification truths map peers singular report explorer gallery results-check notebook docs test \
  processors installed check lint format generated clean

compare: $(VENV)/.run
	@$(BIN)/planner compare problems/paper.toml --out out/compare

comparison: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/comparison.py
	@$(SIGN) compare

suite: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/suite.py
	@$(SIGN) suite

# BEFORE is the version to compare with: the one whose times were the reason for the aims.
BEFORE ?= a2c643bc
bench: $(VENV)/.run
	@$(PIP) install -e '.[rivals]'
	@$(PIP) install 'drake>=1.40' || echo "Drake cannot be installed on this system; it is left out"
	@$(BIN)/python tests/benchmarks/beside.py --before $(BEFORE)
	@$(BIN)/python tests/benchmarks/collocation.py
	@$(BIN)/python tests/benchmarks/replay.py --out results/benchmarks
	@$(BIN)/python tests/benchmarks/sweep.py --out results/benchmarks
	@$(SIGN) benchmarks

stress: $(VENV)/.dev
	@$(BIN)/python -m pytest $(PYTEST_FLAGS) -m campaign
	@$(BIN)/python tests/benchmarks/families.py
	@$(BIN)/python tests/benchmarks/stress.py
	@$(SIGN) stress

judging: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/judging.py
	@$(BIN)/python tests/benchmarks/judged.py
	@$(SIGN) judging

coverage: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/coverage.py
	@$(SIGN) coverage

optimality: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/optimality.py
	@$(SIGN) optimality

paper: $(VENV)/.run
	@$(BIN)/planner reproduce --out results/paper
	@$(SIGN) paper

mutants: $(VENV)/.dev
	@$(PIP) install -e '.[mutants]'
	@$(BIN)/python tests/benchmarks/mutants.py
	@$(SIGN) mutants

robustness: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/robustness.py
	@$(SIGN) feedback

controller: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/controller.py
	@$(SIGN) controller

sensitivity: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/sensitivity.py
	@$(SIGN) sensitivity

compensation: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/compensation.py
	@$(SIGN) compensation

identification: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/identification.py
	@$(SIGN) identification

truths: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/truths.py
	@$(SIGN) truths

map: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/goal_map.py
	@$(SIGN) map

peers: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/peers.py
	@$(SIGN) peers

singular: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/singular.py
	@$(SIGN) singular

report: $(VENV)/.dev
	@$(BIN)/python tests/benchmarks/pictures.py
	@$(SIGN) report

explorer: $(VENV)/.dev
	@PLANNER_SCREENSHOTS=results/explorer $(BIN)/python -m pytest -s -m campaign tests/browser/test_explorer_page.py
	@$(SIGN) explorer

gallery: $(VENV)/.run
	@MPLBACKEND=Agg $(BIN)/python tests/benchmarks/gallery.py
	@$(SIGN) gallery

results-check: $(VENV)/.run
	@$(BIN)/python tests/benchmarks/results_pages.py

notebook: $(VENV)/.notebook
	@$(BIN)/python -m jupyterlab --notebook-dir=notebooks notebooks/quick-tour.ipynb

docs: $(VENV)/.docs
	@echo "building the documentation"
	@test "$$PLANNER_DOCS_NOTEBOOKS" = off || test -d out/docs-cache || echo "running the notebooks (once)"
	@$(BIN)/python -m sphinx -q -W --keep-going -b html docs out/docs
	@echo "the documentation is in out/docs/index.html"

# The tests start many processes, each of which would compile the package anew without its caches.
test: export PYTHONDONTWRITEBYTECODE :=
# Two workers compute at a time: threads of their linear algebra would wait for each other.
test: export OPENBLAS_NUM_THREADS := 1

test: check
	@$(BIN)/python -m pytest $(PYTEST_FLAGS)

# Rounding must not decide between a plan and a refusal. OpenBLAS takes the name of a processor.
processors: $(VENV)/.dev
	@mkdir -p out
	@OPENBLAS_CORETYPE=Nehalem $(BIN)/python -m pytest $(PYTEST_FLAGS) tests/methods tests/problems tests/test_retime.py
	@OPENBLAS_CORETYPE=Haswell $(BIN)/python tests/benchmarks/same_plans.py out/haswell.json
	@OPENBLAS_CORETYPE=Nehalem $(BIN)/python tests/benchmarks/same_plans.py --against out/haswell.json --within 1e-6

installed: $(VENV)/.dev
	@$(BIN)/python tests/installed/legs.py

# A kernel that does not compile is left out in silence: there need be no compiler.
check lint: $(VENV)/.dev
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --check --quiet . || { echo "not in the house format; run: make format"; exit 1; }
	@$(BIN)/mypy
	@! command -v $(CC) >/dev/null || $(CC) -std=c99 -Wall -Wextra -Werror -fsyntax-only -DSOURCE=0 $(filter %.c,$(KERNEL))

format: $(VENV)/.dev
	@$(BIN)/ruff check --quiet --fix . ; $(BIN)/ruff format .

generated: $(VENV)/.dev
	@$(BIN)/python tests/generated.py
	@$(MAKE) --no-print-directory $(VENV)/.dev

clean:
	@rm -rf $(VENV) out build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamps make a second run start at once; a changed pyproject.toml installs anew.
$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "Python 3.11 or newer is needed; try: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@echo "preparing $(VENV) (once)"
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
	  echo "python3 -m venv failed; on Debian and Ubuntu: apt install python3-venv"; exit 1; }

$(VENV)/.run: pyproject.toml setup.py $(KERNEL) | $(VENV)/bin/python
	@$(PIP) install --editable .
	@touch $@

$(VENV)/.dev: pyproject.toml setup.py $(KERNEL) | $(VENV)/bin/python
	@$(PIP) install --editable '.[dev]'
	@touch $@ $(VENV)/.run

$(VENV)/.docs: pyproject.toml | $(VENV)/bin/python
	@$(PIP) install --editable '.[docs]'
	@touch $@ $(VENV)/.run

$(VENV)/.notebook: pyproject.toml | $(VENV)/bin/python
	@$(PIP) install --editable '.[notebook,tables]'
	@touch $@ $(VENV)/.run
