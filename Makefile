# Everything a newcomer needs: python3 (>= 3.11) with its venv module, and make.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
PIP    := PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
DEMO   ?=
# Tests run side by side, one a core and four at most; what measures time runs alone afterwards.
WORKERS ?= $(shell n=$$(nproc); echo $$((n < 4 ? n : 4)))
PYTEST := $(BIN)/python -m pytest
APART  := -n $(WORKERS) --dist worksteal
# Tests start hundreds of interpreters, which would compile every module again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo test coverage lint types layers test-train test-build test-slow test-recipes pair-study nightly test-kill fuzz test-machines test-systemd test-socketcan lock dialect clean golden

help:            ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 16

demo: $(VENV)/.sim   ## the whole device against the rotor rig in software; options: make demo DEMO="--seconds 60 --seed 7"
	@$(BIN)/orbitd demo $(DEMO)

test: $(VENV)/.dev   ## the default tests (about 8 minutes on two cores)
	@$(PYTEST) --ignore=tests/models -m "not slow and not timing" $(APART)
	@$(PYTEST) $$(grep -rl "mark.timing" tests --include="test_*.py" --exclude-dir=models) -m "timing and not slow"

# Without the tests that fly a rig, but for wire schema 2: they reach no branch that the others do not.
COVERED := tests/config tests/machine tests/monitor tests/acquire tests/guard tests/faults/test_guard_faults.py \
           tests/faults/test_two_senders.py tests/wire/test_can_codec.py tests/wire/test_can_link.py \
           tests/wire/test_schema_2.py tests/test_signals.py tests/sim_hil/hil/test_schema_2_loop.py tests/cli/test_rig_new.py \
           --ignore-glob=*on_rig.py

coverage: $(VENV)/.dev   ## every branch that may trip, take authority or believe an input is tested (about 10 minutes)
	@$(BIN)/coverage erase
	@$(BIN)/coverage run -m pytest $(COVERED) -m "not slow and not timing" $(APART)
	@$(BIN)/coverage combine --quiet
	@$(BIN)/coverage report

lint: $(VENV)/.dev   ## ruff: rules and format
	@$(BIN)/ruff check firmware_py sim_hil models tests deploy
	@$(BIN)/ruff format --check --quiet firmware_py sim_hil models tests deploy

types: $(VENV)/.dev $(VENV)/.train   ## mypy --strict
	@$(BIN)/mypy

layers: $(VENV)/.dev ## import order
	@$(BIN)/lint-imports

test-train: $(VENV)/.dev $(VENV)/.train   ## trainers, exports and a smoke training of every model (about 4 minutes)
	@$(PYTEST) tests/models --ignore=tests/models/builder/test_whole_build.py -m "slow or not slow" $(APART)

test-build: $(VENV)/.dev $(VENV)/.train   ## whole small builds: killed and gone on with, spread over workers, sealed (about 4 minutes)
	@$(PYTEST) tests/models/builder/test_whole_build.py -m "slow or not slow" $(APART)

test-slow: $(VENV)/.dev   ## the heavier suites (about 12 minutes)
	@$(PYTEST) --ignore=tests/models --ignore=tests/recipes -m slow

test-recipes: $(VENV)/.dev   ## recipes of docs/how_to_add.md, executed in a copy of the project (about 5 minutes)
	@$(PYTEST) tests/recipes -m slow

test-kill: $(VENV)/.dev   ## kills and stops every process 30 times each (about 90 minutes on an idle machine, resumable: kills.jsonl)
	@$(BIN)/python tests/faults/kill_matrix.py --repeats 30 --out kills.jsonl

fuzz: $(VENV)/.dev   ## random bytes on every input, the long form; goes on where it stood (about 90 minutes in all)
	@$(BIN)/python -m tests.fuzz

test-machines: $(VENV)/.dev   ## random machines, 5 s each in the closed loop; goes on where it stood (about 20 minutes)
	@$(BIN)/python -m tests.fuzz machines

golden: $(VENV)/.dev ## fly and record the golden recordings again: after a meant change of the guard (about 5 minutes)
	@$(BIN)/python -m tests.golden.make

pair-study: $(VENV)/.dev   ## false alarms of the probe pair's plausibility in 20 simulated hours (about 1 h on 2 cores)
	@$(BIN)/python -m models.control.pair_study --hours 20

nightly: $(VENV)/.train   ## final figures of what ships by the whole device, 50 scenarios; goes on where it stood (hours)
	@$(BIN)/python -m models.nightly --out nightly.jsonl

test-systemd: $(VENV)/.dev   ## boots a real systemd, installs, starts and kills the service (root, about 4 minutes)
	@deploy/systemd_test/run.sh

test-socketcan: $(VENV)/.dev   ## the link on real SocketCAN in user-mode Linux (root, half a minute)
	@deploy/socketcan_test/run.sh

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit("orbitd needs Python 3.11 or newer, this is " + sys.version.split()[0] + "; set PYTHON=python3.11") if sys.version_info < (3, 11) else None'
	@echo "creating the environment in $(VENV) (once, about a minute)"
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.sim: pyproject.toml constraints.txt | $(BIN)/python
	@$(PIP) -e '.[sim]' && touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(BIN)/python
	@$(PIP) -e '.[dev]' && touch $@ $(VENV)/.sim

$(VENV)/.train: pyproject.toml constraints.txt | $(BIN)/python
	@$(PIP) -e '.[train,crosscheck,spread]' && touch $@ $(VENV)/.sim

dialect: $(VENV)/.dev   ## generate the MAVLink dialect module from its XML again
	@$(BIN)/python deploy/make_dialect.py

lock:            ## renew constraints.txt from the present environment
	@$(BIN)/python -m pip freeze --exclude-editable | sed 's/+cpu$$//' > constraints.txt

clean:           ## remove the environment and all caches
	@rm -rf $(VENV) build *.egg-info .mypy_cache .ruff_cache .pytest_cache
