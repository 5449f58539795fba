# make run | test | lint | bench | clean: everything happens in .venv, made on first use.
# CI runs `make test`.
.DEFAULT_GOAL := help
SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.ONESHELL:

# A sourced ROS or another venv must not leak into .venv.
unexport PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
# Tests start hundreds of processes: compiled once, a module is not compiled in each of them.
unexport PYTHONDONTWRITEBYTECODE
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PATH := $(CURDIR)/.venv/bin:$(PATH)

VENV := .venv
BUILD_FILES := setup.py setup.cfg pyproject.toml Makefile
WORKERS ?= 2
FOR_RUN := .[ros,rerun,analysis]
FOR_TESTS := .[ros,rerun,sweep,test,dev]
# uv installs in a seventh of pip's time, which does it where uv cannot; both take packages from
# where pip's settings say, and trust whom this machine trusts.
export UV_NATIVE_TLS := 1
ifdef PIP_INDEX_URL
export UV_DEFAULT_INDEX := $(PIP_INDEX_URL)
endif
ifdef PIP_FIND_LINKS
export UV_FIND_LINKS := $(PIP_FIND_LINKS)
endif
# What is imported is compiled then; of what is installed that is little.
define install
{ { command -v uv >/dev/null || $(VENV)/bin/python -m pip install --quiet --no-compile uv; } && \
  uv pip install --quiet --python $(1)/bin/python $(2); } || \
  $(1)/bin/python -m pip install --quiet --no-compile $(2)
endef
OUT ?= out

# What can tell versions apart: YAML and pydantic, typer and its texts, LLVM, what numpy and scipy
# compute, files of matplotlib, mcap and rosbags. The rest is the same with other versions.
FLOOR_TESTS := $(addprefix tests/,catalogue/test_spec.py scene/test_load.py scene/test_schema.py \
  scene/test_yaml_reader.py scene/test_builder.py compiler/graph/test_machine.py compiler/test_program.py \
  io/test_bag_reader.py io/test_bag_writer.py io/test_bag_sqlite.py \
  io/test_plots.py equilibrium/test_closed_forms.py cli/test_run.py cli/test_errors.py \
  cli/test_public.py) \
  $(addsuffix ],$(addprefix tests/oracles/test_oracles.py::test_case[,heavytop_bruls_cardona \
  pendulum_3rad trans_helix sphere_FK_const disk_steady cylinder_unbalanced stiff_point_spring \
  chaplygin_sleigh))
FLOOR_TOOLS := pytest hypothesis
# The first two want an empty stderr, where `rb_sim run` notes here that Rerun is absent; the others
# ask nothing more of a version than their neighbours: one shipped scene of the 25 has all checks.
FLOOR_OMIT := not off_the_constraint and not writes_bag_recording_plots \
  and not processes_compile and not processes_at_once and not every_set_of_point_masses \
  and not (passes_all_checks and not incline_block)

.PHONY: help run test test-core test-rest test-ros test-installed test-floor test-packaging lint docs bench clean

help:
	@echo "make run      start the node on a shipped scene and command it over DDS; results in $(OUT)/"
	echo "make test     everything that CI runs: lint, tests, oldest supported versions, packaging"
	echo "make lint     ruff, pyrefly and the import contract"
	echo "make docs     the documentation as a site, in build/site"
	echo "make bench    the benchmarks"
	echo "make clean    remove environments and outputs"

# The first of python3.12, python3.11, python3 that is 3.11 or 3.12 and can make a venv.
$(VENV)/.made:
	@for candidate in python3.12 python3.11 python3; do
	  if $$candidate -c 'import sys, venv, ensurepip; assert (3, 11) <= sys.version_info[:2] <= (3, 12)' 2>/dev/null; then
	    echo "making $(VENV) with $$($$candidate --version)"
	    rm -rf $(VENV); $$candidate -m venv $(VENV); touch $@; exit 0
	  fi
	done
	echo "needs Python 3.11 or 3.12 with the venv module (on Debian and Ubuntu: apt install python3-venv)" >&2
	exit 1

# Its loops are compiled while the node runs, which compiles those that it needs itself.
$(VENV)/.run: export RB_SIM_LOOPS := later
$(VENV)/.run: $(VENV)/.made $(BUILD_FILES)
	@echo "installing rb_sim with ROS and Rerun into $(VENV) (once)"
	$(call install,$(VENV),--editable '$(FOR_RUN)')
	touch $@

# It has all that .run has, so that nothing is installed twice.
$(VENV)/.test: $(VENV)/.made $(BUILD_FILES)
	@echo "installing rb_sim with the test tools into $(VENV) (once)"
	$(call install,$(VENV),--editable '$(FOR_TESTS)')
	touch $(VENV)/.run $@

# The pinned versions are fetched beside .venv; the tree itself is written to by one pip at a time.
.venv-floor/.pins: $(VENV)/.made requirements/floor.txt
	@echo "installing the oldest supported versions into .venv-floor (once)"
	rm -rf .venv-floor; $(VENV)/bin/python -m venv .venv-floor
	$(call install,.venv-floor,--requirement requirements/floor.txt $(FLOOR_TOOLS))
	touch $@

.venv-floor/.made: .venv-floor/.pins $(VENV)/.test
	@$(call install,.venv-floor,--constraint requirements/floor.txt --editable .)
	touch $@

run: $(VENV)/.run
	@nice -n 10 $(VENV)/bin/python -m rb_sim.compiler.ship $$(uname -m) &
	$(VENV)/bin/python -m rb_sim.ros.demo --out $(OUT)
	wait

# Most tests wait for processes, files and DDS now and then, so that three groups side by side keep
# two cores busy.
test: $(VENV)/.made
	@$(MAKE) --jobs=2 $(VENV)/.test .venv-floor/.pins
	@$(MAKE) --jobs=3 --output-sync=target test-core test-ros test-rest

# Side by side they share the cores; threads of BLAS would only wait for each other.
test-core test-ros test-rest test-floor: export OPENBLAS_NUM_THREADS := 1

test-rest:
	@$(MAKE) lint
	$(MAKE) test-installed

test-installed: test-floor test-packaging

# A worker takes 6 s of CPU to collect all tests: no more of them than cores.
# Laws are drafts there: LLVM would take a quarter of the time to make quick what runs once. Tests of
# nodes, of the oldest versions and of what is installed run the code that users do.
test-core: export RB_SIM_DRAFT := 1
test-core: $(VENV)/.test
	$(VENV)/bin/python -m pytest -q -n $(WORKERS) --dist worksteal tests --ignore=tests/ros --ignore=tests/packaging

# -n gives each worker its own ROS_DOMAIN_ID (tests/ros/conftest.py); each node is a process beside
test-ros: $(VENV)/.test
	$(VENV)/bin/python -m pytest -q -n $(WORKERS) --dist worksteal tests/ros

# One process: a second would take as long to collect the tests as it takes of them.
test-floor: .venv-floor/.made
	.venv-floor/bin/python -m pytest -q -r fE $(FLOOR_TESTS) -k '$(FLOOR_OMIT)'

test-packaging: $(VENV)/.test
	$(VENV)/bin/python -m pytest -q tests/packaging

lint: $(VENV)/.test
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/lint-imports
	$(VENV)/bin/pyrefly check

# generated pages and all pictures, then the site in build/site, links checked; the pages link to
# the repository that package.xml names
docs: export REPOSITORY_URL ?= $(shell sed -n 's|.*<url type="repository">\(.*\)</url>.*|\1|p' package.xml)
docs: $(VENV)/.test
	$(VENV)/bin/python -m tools.law_pages
	$(VENV)/bin/python -m tools.thresholds
	$(VENV)/bin/python -m tools.reference
	$(VENV)/bin/python -m tools.tutorials
	$(VENV)/bin/python -m tools.pictures
	$(VENV)/bin/zensical build --clean --strict
	@echo "build/site/index.html"

bench: $(VENV)/.test
	@for name in steps memory start_time pay_for_use; do $(VENV)/bin/python -m benchmarks.$$name; done

clean:
	rm -rf .venv .venv-floor build install log out dist *.egg-info .pytest_cache .ruff_cache .hypothesis
