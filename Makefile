# Everything starts here: `make help`.
# Each target does what it needs first, and does no work twice.

# Debian's and Ubuntu's own, whatever else is first in PATH.
PYTHON ?= /usr/bin/python3
VENV   := .venv
BUILD  := build
JOBS   := $(shell nproc)

# Another project's environment (ROS sets this one) must not reach ours.
unexport PYTHONPATH

# Recordings of what runs from here stay here.
export XDG_DATA_HOME := $(CURDIR)/$(BUILD)/data

# A clone in another folder finds what this one compiled.
export CCACHE_BASEDIR := $(CURDIR)
export CCACHE_NOHASHDIR := 1
export CCACHE_SLOPPINESS := pch_defines,time_macros

.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
.PHONY: help packages setup build demo test bench interop fuzz sanitize asan tsan clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: $(VENV)/.frankapy ## install what is missing: system packages, .venv, frankapy in it

build: $(BUILD)/build.ninja ## configure and compile programs and tests
	cmake --build $(BUILD) -j $(JOBS)

demo: $(BUILD)/build.ninja $(VENV)/.frankapy ## watch a Python script move a simulated arm
	cmake --build $(BUILD) -j $(JOBS) --target franka-interface fci-sim fci-render wire_proto
	$(VENV)/bin/python examples/demo.py

test: build $(VENV)/.frankapy ## run the C++ and the Python tests
	ctest --test-dir $(BUILD) -j $(JOBS) --output-on-failure
	$(VENV)/bin/python -m pytest tests/python

bench: build $(VENV)/.frankapy ## measure, and write build/bench.json
	cmake --build $(BUILD) -j $(JOBS) --target bench/all
	$(VENV)/bin/python bench/run.py

interop: build $(VENV)/.frankapy ## run independent programs against ours
	$(VENV)/bin/python tests/interop/run.py

fuzz: $(BUILD)/asan/build.ninja ## send mutated bytes to every parser, under sanitizers: SECONDS=600
	cmake --build $(BUILD)/asan -j $(JOBS) --target client_to_arm arm_to_client
	for target in client_to_arm arm_to_client; do \
	  $(BUILD)/asan/bin/$$target tests/fuzz/corpus/$$target $(SECONDS) || exit 1; done

sanitize: asan tsan ## run the C++ tests under address, undefined and thread sanitizer

clean: ## remove what was built (not .venv)
	rm -rf $(BUILD)

# --- what the targets stand on; a stamp is written last, so an interrupted step is done again ----------------------

packages:
	@scripts/install_packages.sh

$(VENV)/.installed: requirements.lock requirements-meshes.lock | packages
	$(PYTHON) -m venv --clear $(VENV)
	$(VENV)/bin/python -m pip install --disable-pip-version-check --no-compile --no-deps --require-hashes \
	  -r requirements.lock -r requirements-meshes.lock
	@touch $@

$(VENV)/.frankapy: $(VENV)/.installed python/pyproject.toml
	$(VENV)/bin/python -m pip install --disable-pip-version-check --no-deps --no-build-isolation --quiet -e python
	@touch $@

$(BUILD)/build.ninja: $(VENV)/.installed
	cmake -S . -B $(BUILD) -G Ninja

$(BUILD)/%/build.ninja: $(VENV)/.installed
	cmake -S . -B $(@D) -G Ninja -DSANITIZE=$(SANITIZE_$*)

SECONDS := 600

SANITIZE_asan := address,undefined
SANITIZE_tsan := thread

# gcc's thread sanitizer before 14 stops at random addresses as wide as newer kernels make them; a container may
# forbid to ask for fixed ones (setarch -R), and then mostly does not need it.
FIXED_ADDRESSES = $(shell setarch -R true 2> /dev/null && echo setarch -R)

# Threads are in these rooms alone.
TARGETS_tsan := --target robot_test server_test sim_test
LABELS_tsan  := -L '^(robot|server|sim)$$'

asan tsan: %: $(BUILD)/%/build.ninja
	cmake --build $(BUILD)/$@ -j $(JOBS) $(TARGETS_$@)
	TSAN_OPTIONS="suppressions=$(CURDIR)/tests/tsan.supp" \
	  $(FIXED_ADDRESSES) ctest --test-dir $(BUILD)/$@ $(LABELS_$@) -j $(JOBS) --output-on-failure
