# Everything a newcomer needs: `make demo` and `make test`. Both create .venv on first use; nothing else is changed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python requirements/install.py

INTERFACES := interfaces/control_msgs interfaces/epson_msgs interfaces/industrial_msgs
INTERFACE_FILES := $(shell find $(INTERFACES) interfaces/cmake -type f)
PACKAGE_FILES := setup.py setup.cfg pyproject.toml package.xml README.md \
	$(shell find $(wildcard epson_driver config launch resource scripts urdf) -not -name '*.pyc' -not -name __pycache__)

# Two at a time, each with one thread for its matrices. Whoever is done takes tests from the end of the other's.
ALL_TESTS := --numprocesses 4 --dist loadfile --no-loadscope-reorder
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest

# An environment stays with the Python that made it: PYTHON=... with another one is a mistake to be told of.
ifneq ($(origin PYTHON),file)
ifneq ($(and $(wildcard $(VENV)/pyvenv.cfg),$(filter-out clean help,$(or $(MAKECMDGOALS),help))),)
SERIES := $(shell $(PYTHON) -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
ifeq ($(wildcard $(VENV)/lib/$(SERIES)),)
$(error $(VENV) was made with another Python than $(PYTHON) ($(notdir $(wildcard $(VENV)/lib/python3*))): make clean, then again)
endif
endif
endif

# Fast DDS would multicast on every network otherwise.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: demo test test-all soak-tests coverage lint bench bench-motion soak generate pictures clean help

help:
	@echo "make demo    a planned trajectory through ROS 2 to a simulated EPSON controller, and a report"
	@echo "             (other arguments: make demo ARGS='--trajectory FILE'; ARGS=--plan: a pick and place, planned on the spot)"
	@echo "make test    the tests, in five minutes (a part of them: make test ARGS=test/client)"
	@echo "make test-all       the tests with all that is rare and long: half an hour"
	@echo "make coverage       which statements the tests run (those of test-all: make coverage ARGS=all)"
	@echo "make lint    ruff and mypy"
	@echo "make bench          what a step of the smoother costs in streams of 10 to 100,000 points, what a robot costs its"
	@echo "                    driver, and a check for collision with collision meshes and with visual ones"
	@echo "make bench-motion   the smoother against stop-and-go, splines and optima; tables and pictures in benchmark/results"
	@echo "             (a part of it: make bench-motion ARGS='--quick'; all of what can be chosen: ARGS=--help)"
	@echo "make soak           2,000 goals and 20,000 service calls: the driver's memory stays flat (ten minutes)"
	@echo "make soak-tests     2,000 random plans, and new examples for every property (hours)"
	@echo "make generate       meshes, URDFs and MoveIt files, made again from config/robots"
	@echo "make pictures       the pictures of the robots in docs, and the animation in the README (ten minutes)"
	@echo "make clean   remove what the others made"
	@echo "PYTHON=...   the interpreter to use, 3.11 or newer (now: $(PYTHON))"

# ALSO: what is to come after the driver, so that all sizes are named before the first download
demo: ALSO := $(if $(findstring --plan,$(ARGS)),planning)
test test-all soak-tests coverage lint generate pictures: ALSO := dev
bench bench-motion: ALSO := bench

demo: $(VENV)/.driver $(if $(findstring --plan,$(ARGS)),$(VENV)/.planning)
	$(BIN)/epson_driver demo $(ARGS)

test: $(VENV)/.dev
	$(PYTEST) $(or $(ARGS),$(ALL_TESTS))

test-all: $(VENV)/.dev
	$(PYTEST) -m 'not soak' $(or $(ARGS),$(ALL_TESTS))

soak-tests: $(VENV)/.dev
	$(PYTEST) -m 'soak or hypothesis' $(or $(ARGS),$(ALL_TESTS))

# also what child processes run; no report if a test fails
coverage: $(VENV)/.dev
	rm -f .coverage .coverage.*
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 \
		$(BIN)/python -m coverage run -m pytest $(ALL_TESTS) $(if $(filter all,$(ARGS)),-m 'not soak')
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report --skip-covered --show-missing

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# one thread per process: the matrices are small, and two processes share the machine
bench: $(VENV)/.bench
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.cost
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.collision
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.robots

bench-motion: $(VENV)/.bench
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.motion $(ARGS)

# not in the tests, which have a short form of it: ten minutes
soak: $(VENV)/.driver
	$(BIN)/python -m benchmark.soak $(ARGS)

# in this order: each uses what the one before has made
generate: $(VENV)/.dev
	$(BIN)/python -m generate.meshes
	$(BIN)/python -m generate.urdf
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m generate.moveit

# ten minutes, most of it the animation; not part of generate, as no test compares them
pictures: $(VENV)/.dev
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m generate.picture $(ARGS)
	$(if $(ARGS),,OPENBLAS_NUM_THREADS=1 $(BIN)/python -m generate.animation)

clean:
	rm -rf $(VENV) build install log dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage .coverage.* demo-report.png
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# What make installs in one go, each with a stamp. The lines, sizes and bars are install.py's.
$(VENV)/.runtime: requirements/runtime.txt requirements/constraints.txt
	@command -v $(PYTHON) >/dev/null || { echo "no $(PYTHON): Python 3.11 or newer is needed (make PYTHON=...)" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$(PYTHON) is too old: Python 3.11 or newer is needed (make PYTHON=...)" >&2; exit 1; }
	@$(PYTHON) requirements/install.py runtime --all runtime interfaces $(ALSO)

$(VENV)/.interfaces: $(VENV)/.runtime interfaces/requirements-build.txt $(INTERFACE_FILES)
	@$(INSTALL) interfaces

$(VENV)/.driver: $(VENV)/.interfaces $(PACKAGE_FILES)
	@$(INSTALL) driver

$(VENV)/.dev: $(VENV)/.driver requirements/dev.txt requirements/planning.txt requirements/generate.txt
	@$(INSTALL) dev

$(VENV)/.planning: $(VENV)/.driver requirements/planning.txt
	@$(INSTALL) planning

$(VENV)/.bench: $(VENV)/.driver requirements/bench.txt
	@$(INSTALL) bench
