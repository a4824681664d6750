# make demo   sets up and runs the main job: record, identify, compensate, report
# make test   sets up, checks the style and runs the tests;  make studies  runs the long ones
# make setup  only sets up;  make dev  with what tests need;  make clean  removes what was made

.PHONY: demo test studies lint setup build dev clean
.DEFAULT_GOAL := help
DATA ?=
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
# Else each of hundreds of processes compiles every module that it imports.
unexport PYTHONDONTWRITEBYTECODE
run := source setup.bash &&
SHELL := /bin/bash

help:
	@sed -n '1,3s/^# //p' Makefile

setup build:
	@bash tools/setup.sh

dev:
	@bash tools/setup.sh dev

demo: setup
	@$(run) python -m piezo_hysteresis demo $(if $(DATA),--data '$(DATA)') --out out/demo

lint: dev
	@$(run) ruff check . && ruff format --check . && mypy

test: lint
	@$(run) python -m pytest -n 2 --dist worksteal --durations=20 -m 'not slow' test/docs test/property test/unit
	@$(run) python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --reruns 1 --durations=20 -m 'not slow' test/ros

studies: dev
	@$(run) python -m pytest -n 2 --dist worksteal --durations=20 -m slow test

clean:
	rm -rf build install log .venv out
