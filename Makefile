# make demo   sets up and runs the main job: record, identify, compensate, report
# make test   sets up, checks the style and runs the tests;  make studies, make scripts  the long ones
# make setup  only sets up;  make dev  with what tests need;  make clean  removes what was made
# make site   builds the documentation as a site: out/site/index.html

.PHONY: demo test studies scripts peers lint setup setup-demo build dev site clients clean
.DEFAULT_GOAL := help
DATA ?=
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
# Else each of hundreds of processes compiles every module that it imports.
unexport PYTHONDONTWRITEBYTECODE
run := source setup.bash &&
SHELL := /bin/bash

help:
	@sed -n '1,4s/^# //p' Makefile

setup build:
	@bash tools/setup.sh

dev:
	@bash tools/setup.sh dev

# the kernels of the demo only
setup-demo:
	@bash tools/setup.sh demo

# results of own data are in a folder named after them
demo: $(if $(DATA),setup,setup-demo)
	@$(run) python -m piezo_hysteresis demo $(if $(DATA),--data '$(DATA)') \
	    --out 'out/$(if $(DATA),$(basename $(notdir $(firstword $(DATA)))),demo)'

lint: dev
	@$(run) ruff check . && ruff format --check . && mypy

# Durations and results by test stay in out/tests. Files of live tests and of studies stay whole:
# processes are shared within them, and what takes a minute to compile.
pytest := python -m pytest -n 2 --durations=30
fast := --dist worksteal test/docs test/property test/unit
live := --dist loadfile --no-loadscope-reorder test/ros

# In an environment of its own: the clients of the makers need a newer Python.
clients:
	@bash tools/clients.sh

test: lint clients
	@$(run) PIEZO_UNIT_SECONDS=1 $(pytest) -m 'not slow' --junitxml=out/tests/fast.xml $(fast)
	@$(run) $(pytest) -m 'not slow' --junitxml=out/tests/live.xml $(live)

studies: dev
	@$(run) $(pytest) -m slow --junitxml=out/tests/studies.xml \
	  --dist loadfile --no-loadscope-reorder --ignore test/scripts test

# Every script of bench/ and studies/, made small: evidence, not the product.
scripts: dev
	@$(run) $(pytest) --junitxml=out/tests/scripts.xml --dist worksteal test/scripts

# The peers of the leaderboard made small, in environments of their own.
peers: dev
	@for set in requirements requirements_jax; do \
	  test -x out/peers/$$set/bin/pip || python3 -m venv out/peers/$$set; \
	  out/peers/$$set/bin/pip install -q --disable-pip-version-check -r studies/peers/$$set.txt; done
	@$(run) python studies/study.py leaderboard --quick --peers out/peers/*/bin/python \
	  | tee out/peers/quick.txt; ! grep 'left out' out/peers/quick.txt

# In an environment of its own: nothing else needs these packages. The verbs print their own page.
site: setup-demo
	@test -x .venv-docs/bin/pip || python3 -m venv .venv-docs
	@.venv-docs/bin/pip install -q --disable-pip-version-check -r requirements-docs.txt
	@$(run) python tools/write_reference.py out/cli.md
	@NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build -q --strict
	@echo out/site/index.html

clean:
	rm -rf build install log .venv .venv-docs .venv-clients out
