# SPDX-License-Identifier: Apache-2.0
SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: help setup build demo test test-quick test-deep test-oldest test-pythons test-distributions test-repeated coverage mutation bench soak docs lint clean

DEMO := python3 -m bev_preheat.demo
BENCH := python3 -m bev_preheat_studies cost
# make soak MINUTES=60
MINUTES := 10
# make test-deep EXAMPLES=10000
EXAMPLES := 1000
# make test TESTS="test/vehicle/test_model.py -k joule"
TESTS := test
# The tests of a file stay together and share nodes; they spend much time waiting for the nodes, so there are more workers than
# cores. Files with few tests are slow and must not run last, as they would with newer versions of xdist. Not every ROS
# machine has xdist.
several_files_at_once := $$(python3 -c 'import xdist; print("-n 4 --dist loadfile", "--no-loadscope-reorder" * (tuple(map(int, xdist.__version__.split(".")[:2])) >= (3, 7)))' 2>/dev/null || true)

several_without_nodes := $(subst -n 4,-n auto,$(several_files_at_once))

# Groups of packages in addition to those that the program always needs; scripts/requirements-optional.txt lists them:
# make setup WITH="bus logs"
WITH :=
# The groups of a target are in effect for its prerequisites too.
groups :=
test test-quick test-deep test-oldest test-repeated coverage: groups := test
bench: groups := studies
soak: groups := studies
docs: groups := test docs
lint: groups := test lint
mutation: groups := test mutation

# If it is set, each test worker compiles all tests again.
unexport PYTHONDONTWRITEBYTECODE

# Isolate these nodes from other robots on the network.
local_only := export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
environment := . scripts/env.bash

help: ## print this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 16

setup: ## the working environment in .venv: packages missing from the ROS 2 distribution, or ROS 2 from wheels
	@scripts/setup.bash $(groups) $(WITH)

# For a car, without the studies: BEV_PREHEAT_WITHOUT_STUDIES=1 make build.
build: ## the three packages, if anything changed (colcon build --base-paths . core msg_defs)
	@scripts/setup.bash --build $(groups) $(WITH)
	@scripts/build.bash

demo: build ## a simulated drive to the fast charger
	@$(environment); $(local_only); $(DEMO)

test: build ## all tests
	@$(environment); $(local_only); scripts/compile_tests.bash; python3 -m pytest -q $(several_files_at_once) -m "not deep and not linter" $(TESTS)

# The tests use the checkout's Python files, so only changed messages, equations and C files need a build.
test-quick: setup ## the quick tests without DDS, for use while editing
	@[ -e install/.built ] && [ -z "$$(find msg_defs core bev_preheat/code_generation bev_preheat/vehicle/*.py -newer install/.built -print -quit)" ] || scripts/build.bash
	@$(environment); $(local_only); PYTHONPATH="$$PWD:$$PWD/studies:$$PYTHONPATH" python3 -m pytest -q $(several_without_nodes) -m "not dds and not deep and not costly and not linter" $(TESTS)

test-deep: build ## all tests, including the long ones: all scenarios over DDS, EXAMPLES (1000) for each property
	@$(environment); $(local_only); BEV_PREHEAT_EXAMPLES=$(EXAMPLES) python3 -m pytest -q $(several_files_at_once) -m "not linter" --hypothesis-profile deep -o timeout=7200 $(TESTS)

# Uses its own environment and build in .environments/oldest.
test-oldest: export BEV_PREHEAT_ENVIRONMENT := oldest
test-oldest: build ## all tests with the oldest supported versions (scripts/requirements-oldest.txt), no optional package
	@$(environment); $(local_only); scripts/compile_tests.bash; python3 -m pytest -q $(several_files_at_once) -m "not deep and not linter" $(TESTS)

test-pythons: ## all tests with each supported Python that is installed (scripts/pythons.txt), in PATH or by pyenv
	@scripts/test_environments.bash $$(cat scripts/pythons.txt) -- $(TESTS)

# The tests that talk to ROS or compiled code; make test-distributions TESTS=test runs all.
test-distributions: ## the tests of nodes, messages and the core with the wheels of ROS 2 Kilted and Lyrical, if the package index has them
	@scripts/test_environments.bash kilted lyrical -- $(if $(filter file,$(origin TESTS)),test/nodes test/messages test/native test/monitoring,$(TESTS))

test-repeated: build ## make test 20 times, half of the runs beside one busy loop per core
	@scripts/repeat_tests.bash

# Not part of make test: measuring nearly doubles the time of computations in Python. The threshold is in setup.cfg.
coverage: build ## all tests, with their coverage of lines and branches, including the nodes' processes
	@$(environment); $(local_only); export COVERAGE_FILE="$$PWD/out/coverage/data"; mkdir -p out/coverage; rm -f out/coverage/data*; \
	    python3 -m coverage run -m pytest -q $(several_files_at_once) -m "not deep and not linter" $(TESTS); \
	    python3 -m coverage combine -q; python3 -m coverage html -q -d out/coverage/html --fail-under=0; python3 -m coverage report

# make mutation MUTATION="--subject gate --sample 1000"
mutation: build ## changes of the gate, the admission of inputs and the run within limits that no test notices
	@$(environment); $(local_only); python3 scripts/mutation.py $(MUTATION)

bench: build ## time and memory of the planner, beside an empty node
	@$(environment); $(local_only); $(BENCH)

soak: build ## the planner under load for MINUTES (10), in real time
	@$(environment); $(local_only); python3 -m bev_preheat_studies soak --minutes $(MINUTES)

# A broken link, an unknown anchor and any other warning are errors. The reference is generated from the checkout's code.
docs: build ## the documentation as a site: out/docs/index.html
	@$(environment); PYTHONPATH="$$PWD:$$PWD/studies:$$PYTHONPATH" python3 -m sphinx -q -W -n --keep-going -d out/.doctrees docs out/docs
	@echo out/docs/index.html

# Not every machine has shellcheck.
lint: setup ## ruff (errors, imports, names, docstrings), mypy, ament_flake8 and ament_pep257 for Python, each installed compiler for C, shellcheck for the scripts
	@$(environment); ruff check --quiet
	@$(environment); mypy
	@$(environment); python3 -m pytest -q -p no:cacheprovider -m linter test/test_ament_style.py
	@$(environment); scripts/lint_core.bash
	@if command -v shellcheck >/dev/null; then shellcheck -x scripts/*.bash .ci/run; fi

clean: ## delete the results of build and tests, but not .venv
	rm -rf build install log out .pytest_cache .hypothesis
	find . \( -name .venv -o -path ./.environments \) -prune -o -name __pycache__ -type d -print0 | xargs -0 -r rm -rf
