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

# Where tests leave what came of them, in files that others read too.
JUNIT := $(CURDIR)/$(BUILD)/junit

# Two makes at once in one tree would take each other's files away: a line that begins so has the lock of the folder until its end.
ALONE = exec 9< . && { flock -n 9 || { echo "Another make is at work here: waiting for it." >&2; flock 9; }; }

.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
.PHONY: help packages setup build programs wheel demo demo-lockstep pictures test test-cpp test-python test-nightly types wall wall-20 \
	bench bench-programs interop interop-lockstep safety safety-gate safety-lacking fuzz fuzz-gate sanitize asan asan-all tsan tsan-all gate nightly clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-15s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: ## install what is missing: system packages, .venv, frankapy in it
	@$(ALONE); if test -e $(VENV) && ! { test -e $(VENV)/.frankapy && ! $(CONTENTS) | LC_ALL=C comm -13 - $(VENV)/.frankapy | grep -m 1 .; }; then \
	  echo "$(VENV) is not whole: it is made anew."; rm -f $(VENV)/.installed; fi
	@$(MAKE) --no-print-directory $(VENV)/.frankapy

build: $(BUILD)/build.ninja ## configure and compile programs and tests
	@$(ALONE); cmake --build $(BUILD) -j $(JOBS) -- -k 0

programs: $(BUILD)/build.ninja
	@$(ALONE); cmake --build $(BUILD) -j $(JOBS) --target franka-interface fci-sim fci-render client wire_proto

# Of a copy: setuptools writes into the folder that it packs.
wheel: programs $(VENV)/.frankapy ## frankapy for other computers, in build/
	@$(ALONE); rm -rf $(BUILD)/wheel $(BUILD)/frankapy-*.whl && mkdir -p $(BUILD)/wheel && \
	find python -name __pycache__ -prune -o -type f -exec cp --parents -t $(BUILD)/wheel {} + && cp LICENSE $(BUILD)/wheel/python && \
	$(VENV)/bin/python -m pip wheel --no-deps --no-build-isolation --disable-pip-version-check --quiet -w $(BUILD) $(BUILD)/wheel/python && \
	ls $(BUILD)/frankapy-*.whl

demo: programs $(VENV)/.frankapy ## watch a Python script move a simulated arm
	$(VENV)/bin/python examples/demo.py

pictures: programs $(VENV)/.frankapy ## draw the pictures of docs/tutorial.md anew
	TUTORIAL_PICTURES=docs/tutorial $(VENV)/bin/python -m pytest tests/python/test_tutorial.py

demo-lockstep: programs $(VENV)/.frankapy ## the same as `make demo`, as fast as this computer can
	$(VENV)/bin/python examples/demo.py --lockstep

test: test-cpp test-python ## run the C++ and the Python tests

# Tests about wall time (label and marker `wall`) run apart, alone on the computer; those of `make nightly` take long. Of what runs on both
# models these have FR3's, and of the room of the loop the gate's sanitizer has FER's. Laws over long motions are nightly ones, too.
LONG_test-cpp := ^Arms/.*/fer|an_integral_|StretchedArm|FoldedArm.(keeps_its_links|rests_at)
CTEST  = ctest --test-dir $(BUILD) --no-tests=error --output-on-failure --output-junit "$(JUNIT)/ctest.xml" $(if $(AGAIN),--rerun-failed)
PYTEST = $(VENV)/bin/python -m pytest tests/python --junit-xml "$(JUNIT)/pytest.xml" $(if $(AGAIN),--lf --lfnf none)

test-cpp: build
	$(CTEST) -j $(JOBS) -LE 'wall|nightly' -E '$(LONG_$@)'

# A file's tests share their arms, and two files side by side have each its own.
test-python: programs $(VENV)/.frankapy
	$(PYTEST) -n $(JOBS) --dist loadfile -m 'not wall and not nightly'

test-nightly: build $(VENV)/.frankapy
	$(CTEST) -j $(JOBS) -R '$(LONG_test-cpp)'; cpp=$$?; $(PYTEST) -m nightly && exit $$cpp

types: programs $(VENV)/.frankapy ## check the types of the Python package
	@mkdir -p "$(JUNIT)"
	cd python && "$(CURDIR)/$(VENV)/bin/python" -m mypy --junit-xml "$(JUNIT)/types.xml"

# With none to run again, ctest would run all, and pytest has status 5.
ABOUT_WALL_TIME = -m wall --timeout 60
LAST_FAILED = $(BUILD)/Testing/Temporary/LastTestsFailed.log
wall: build $(VENV)/.frankapy ## run the tests about wall time, which want the computer for themselves
	$(if $(AGAIN),,rm -f $(LAST_FAILED))
	$(if $(AGAIN),test ! -s $(LAST_FAILED) || { none=5; false; } ||) $(CTEST) -j 1 -L wall; cpp=$$?; \
	  test $$cpp != 0 || rm -f $(LAST_FAILED); { $(PYTEST) $(ABOUT_WALL_TIME) || test $$? = "$$none"; } && exit $$cpp

wall-20: build $(VENV)/.frankapy
	failed=0; for i in $$(seq 20); do $(subst ctest.xml,ctest-$$i.xml,$(CTEST)) -j 1 -L wall || failed=1; \
	  $(PYTEST:pytest.xml=pytest-$$i.xml) $(ABOUT_WALL_TIME) || failed=1; done; exit $$failed

bench-programs: build
	@$(ALONE); cmake --build $(BUILD) -j $(JOBS) --target bench/all

bench: bench-programs $(VENV)/.frankapy ## measure, and write build/bench.json
	$(VENV)/bin/python bench/run.py

interop: build $(VENV)/.frankapy ## run independent programs against ours
	$(VENV)/bin/python tests/interop/run.py --junit "$(JUNIT)/interop.xml" $(if $(AGAIN),--again)

interop-lockstep: build $(VENV)/.frankapy
	$(VENV)/bin/python tests/interop/run.py --junit "$(JUNIT)/interop.xml" --lockstep $(if $(AGAIN),--again)

# SEED=n: that run again.
HOURS = 20
safety: programs $(VENV)/.frankapy ## look for violations of what keeps the arm safe, simulated hours of random skills and mishaps
	$(VENV)/bin/python tests/safety/campaign.py $(if $(SEED),--seed $(SEED),--hours $(HOURS))

safety-gate: programs $(VENV)/.frankapy ## the same for some minutes, always the same seeds
	$(VENV)/bin/python tests/safety/campaign.py --gate "$(JUNIT)/safety.xml"

# A kind of violation, and the server that lacks what is against it.
LACKING := limit:unlimited wall:unwalled hung:unrecovering
safety-lacking: bench-programs ## see that the campaign finds what servers lack (make nightly)
	@failed=0; for each in $(LACKING); do echo "$$each"; \
	  timeout 600 $(VENV)/bin/python tests/safety/campaign.py --no-shrink --until-found $${each%:*} --server $(BUILD)/bench/franka-interface-$${each#*:} || \
	  { failed=1; echo "not found: $$each"; }; done; \
	timeout 600 $(VENV)/bin/python tests/safety/campaign.py --no-shrink --until-found recording --record off && exit $$failed

FUZZERS := client_to_arm arm_to_client control_channel client_to_server
fuzz: fuzz-600 ## send mutated bytes to every parser, under sanitizers, for ten minutes each

# The same inputs each time: what is new is found by `make fuzz`.
fuzz-gate: SEED = 1
fuzz-gate: fuzz-30

fuzz-%: build $(BUILD)/asan/build.ninja
	@$(ALONE); cmake --build $(BUILD)/asan -j $(JOBS) --target $(FUZZERS)
	printf '%s\n' $(FUZZERS) | ASAN_OPTIONS=abort_on_error=1 UBSAN_OPTIONS=abort_on_error=1 xargs -P $(words $(FUZZERS)) -I @ \
	  sh -c '$(BUILD)/asan/bin/@ tests/fuzz/corpus/@ $* $(SEED) || { echo "@ has failed"; false; }'

sanitize: asan-all tsan-all ## run the C++ tests under address, undefined and thread sanitizer

gate: ## what every change has to pass
	scripts/run_stages.py gate

nightly: ## everything, and more of the same; takes hours
	scripts/run_stages.py nightly

clean: ## remove what was built (not .venv)
	rm -rf $(BUILD)

# --- what the targets stand on; a stamp is written last, so an interrupted step is done again ----------------------

packages:
	@scripts/install_packages.sh

# What is in .venv, and which Python it is for; all but what comes of use.
CONTENTS = { $(VENV)/bin/python -c 'import sys; print(sys.version_info[:2])'; \
  find $(VENV)/bin $(VENV)/lib -type f ! -name '*.pyc' -printf '%s %p\n'; } 2> /dev/null | LC_ALL=C sort

$(VENV)/.installed: requirements.lock requirements-meshes.lock | packages
	@$(ALONE); test $@ -nt requirements.lock && test $@ -nt requirements-meshes.lock && exit; \
	test -d $(VENV) -a ! -L $(VENV) || rm -f $(VENV); \
	echo "Installing requirements.lock in $(VENV)"; \
	$(PYTHON) -m venv --clear $(VENV) && $(VENV)/bin/python -m pip install --disable-pip-version-check --no-compile --no-deps --require-hashes \
	  -r requirements.lock -r requirements-meshes.lock || { echo "Not installed in $(VENV): what pip names above, and all after \
	it. Where it found \"versions: none\" it reached no package index: let there be a network, then do the same again." >&2; false; } \
	&& touch $@

$(VENV)/.frankapy: $(VENV)/.installed python/pyproject.toml
	@$(ALONE); test $@ -nt $< && test $@ -nt python/pyproject.toml && exit; \
	$(VENV)/bin/python -m pip install --disable-pip-version-check --no-deps --no-build-isolation --quiet -e python && $(CONTENTS) > $@

$(BUILD)/build.ninja: $(VENV)/.installed
	@$(ALONE); cmake -S . -B $(BUILD) -G Ninja

$(BUILD)/%/build.ninja: $(VENV)/.installed
	@$(ALONE); cmake -S . -B $(@D) -G Ninja -DSANITIZE=$(SANITIZE_$(*:-all=)) $(if $(filter %-all,$*),,-DPLAIN_BUILD="$(CURDIR)/$(BUILD)")

SANITIZE_asan := address,undefined
SANITIZE_tsan := thread

# gcc's thread sanitizer before 14 stops at random addresses as wide as newer kernels make them; a container may
# forbid to ask for fixed ones (setarch -R), and then mostly does not need it.
FIXED_ADDRESSES = $(shell setarch -R true 2> /dev/null && echo setarch -R)

# The gate has the first what reads bytes from outside and the loop, and the second what several threads share.
ROOMS_asan := wire realtime robot
ROOMS_tsan := robot server
ROOMS_asan-all := wire models realtime parts robot server sim
ROOMS_tsan-all := $(ROOMS_asan-all)
# Laws over long motions, whose code shorter tests run too, and the second of both models: by the nightly ones only.
LONG_asan := ^Arms/.*/fr3|whatever_(pose_)?is_asked_for|next_to_|many_walls_|OutOfReach|PushedArm|PulledArm|SprungArm|StretchedArm|FoldedArm|FastPose|PoseAlongWall|an_arm_that_(swings|dodges|is_torn|is_led|is_pressed)|braking_when_another|says_of_a_way|thin_wall|tool_faster
# What has one thread.
LONG_tsan := ^SkillBuilderTest

# The gate's sanitized builds take from the plain one what they need not compile; those of all compile all.
asan tsan: build
asan asan-all tsan tsan-all: FOLDER = $(BUILD)/$@
asan asan-all tsan tsan-all: %: $(BUILD)/%/build.ninja
	@$(ALONE); cmake --build $(FOLDER) -j $(JOBS) --target $(addsuffix _test,$(ROOMS_$@))
	TSAN_OPTIONS="suppressions='$(CURDIR)/tests/tsan.supp'" $(FIXED_ADDRESSES) ctest --test-dir $(FOLDER) --no-tests=error -j $(JOBS) \
	  -L '^($(subst $() ,|,$(ROOMS_$@)))$$' -LE '$(if $(findstring all,$@),^$$,wall|nightly)' -E '$(or $(LONG_$@),^$$)' \
	  --output-on-failure --output-junit "$(JUNIT)/ctest.xml" $(if $(AGAIN),--rerun-failed)
