# SPDX-License-Identifier: Apache-2.0
SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: help setup build demo test test-deep bench soak lint clean

DEMO := python3 -m bev_preheat.demo
BENCH := python3 -m bev_preheat.benchmark
# make soak MINUTES=60
MINUTES := 10
# make test TESTS="test/test_model.py -k joule"
TESTS := test
# The tests of one file stay together; much of their time is waiting for nodes. Files with few tests are the slow ones and
# must not come last, as newer versions of xdist would have it. Not every ROS machine has xdist.
several_files_at_once := $$(python3 -c 'import xdist; print("-n 4 --dist loadfile", "--no-loadscope-reorder" * (tuple(map(int, xdist.__version__.split(".")[:2])) >= (3, 7)))' 2>/dev/null || true)

# What runs here must neither hear nor disturb the other robots of the network.
local_only := export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
environment := . scripts/env.bash

help: ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 16

setup: ## the working environment: a ROS 2 distribution is checked, else ROS 2 goes into .venv
	@scripts/setup.bash

build: setup ## both packages, if anything changed (colcon build --base-paths . msg_defs)
	@scripts/build.bash

demo: build ## a simulated drive to the fast charger
	@$(environment); $(local_only); $(DEMO)

test: build ## all tests
	@$(environment); $(local_only); python3 -m pytest -q $(several_files_at_once) $(TESTS)

test-deep: build ## all tests, those too that take long: all scenarios over DDS, a longer fuzz
	@$(environment); $(local_only); python3 -m pytest -q $(several_files_at_once) -m "deep or not deep" $(TESTS)

bench: build ## speed and cost against other ways to plan
	@scripts/setup.bash bench
	@$(environment); $(local_only); $(BENCH)

soak: build ## the planner under load for MINUTES (10), in real time
	@$(environment); $(local_only); python3 -m bev_preheat.endurance --minutes $(MINUTES)

lint: setup ## pyflakes on the Python; shellcheck on the scripts, where it is installed
	@$(environment) 2>/dev/null; python3 -m pyflakes bev_preheat test setup.py
	@if command -v shellcheck >/dev/null; then shellcheck -x scripts/*.bash .ci/run; fi

clean: ## what build and tests made; .venv stays
	rm -rf build install log out .pytest_cache .hypothesis
	find . -path ./.venv -prune -o -name __pycache__ -type d -print0 | xargs -0 -r rm -rf
