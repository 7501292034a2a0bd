# Everything a newcomer needs: `make demo` and `make test`. Both create .venv on first use; nothing else is changed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
# byte code is made when a module is first used: most of what is installed never is
INSTALL := $(PIP) install --no-compile

INTERFACES := interfaces/control_msgs interfaces/epson_msgs interfaces/industrial_msgs
INTERFACE_FILES := $(shell find $(INTERFACES) interfaces/cmake -type f)
PACKAGE_FILES := setup.py setup.cfg pyproject.toml package.xml README.md \
	$(shell find $(wildcard epson_driver config launch resource scripts urdf) -not -name '*.pyc' -not -name __pycache__)

# two at a time: most tests wait for real time to pass
ALL_TESTS := --numprocesses 2 --dist loadfile

# Fast DDS would multicast on every network otherwise.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: demo test lint bench bench-motion soak generate pictures clean help

help:
	@echo "make demo    a planned trajectory through ROS 2 to a simulated EPSON controller, and a report"
	@echo "             (other arguments: make demo ARGS='--trajectory FILE'; ARGS=--plan: a pick and place, planned on the spot)"
	@echo "make test    all tests (a part of them: make test ARGS=test/client)"
	@echo "make lint    ruff and mypy"
	@echo "make bench          what a step of the smoother costs in streams of 10 to 100,000 points, what a robot costs its"
	@echo "                    driver, and a check for collision with collision meshes and with visual ones"
	@echo "make bench-motion   the smoother against stop-and-go, splines and optima; tables and pictures in benchmark/results"
	@echo "             (a part of it: make bench-motion ARGS='--quick'; all of what can be chosen: ARGS=--help)"
	@echo "make soak           2,000 goals and 20,000 service calls: the driver's memory stays flat (ten minutes)"
	@echo "make generate       meshes, URDFs and MoveIt files, made again from config/robots"
	@echo "make pictures       the pictures of the robots in docs"
	@echo "make clean   remove what the others made"
	@echo "PYTHON=...   the interpreter to use, 3.11 or newer (now: $(PYTHON))"

demo: $(VENV)/.run $(if $(findstring --plan,$(ARGS)),$(VENV)/.planning)
	$(BIN)/epson_driver demo $(ARGS)

test: $(VENV)/.dev
	$(BIN)/python -m pytest $(or $(ARGS),$(ALL_TESTS))

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
soak: $(VENV)/.run
	$(BIN)/python -m benchmark.soak $(ARGS)

# in this order: each uses what the one before has made
generate: $(VENV)/.dev
	$(BIN)/python -m generate.meshes
	$(BIN)/python -m generate.urdf
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m generate.moveit

# three minutes; not part of generate, as no test compares them
pictures: $(VENV)/.dev
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m generate.picture $(ARGS)

clean:
	rm -rf $(VENV) build install log dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis demo-report.png
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/.packages: requirements/runtime.txt requirements/constraints.txt interfaces/requirements-build.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$(PYTHON) is too old: Python 3.11 or newer is needed (make PYTHON=...)" >&2; exit 1; }
	@for compiler in "$${CC:-cc}" "$${CXX:-c++}"; do command -v $$compiler >/dev/null || \
		{ echo "no $$compiler: the ROS message packages need a C and a C++ compiler (Debian: apt install build-essential)" >&2; exit 1; }; done
	@echo "installing into $(VENV), about a minute on first use"
	@$(PYTHON) -m venv $(VENV)
	@$(INSTALL) -c requirements/constraints.txt -r requirements/runtime.txt -r interfaces/requirements-build.txt
	@touch $@

$(VENV)/.interfaces: $(VENV)/.packages $(INTERFACE_FILES)
	@echo "building control_msgs, epson_msgs and industrial_msgs"
	@rm -rf $(VENV)/wheels
	@for package in $(INTERFACES); do \
		$(PIP) wheel --no-build-isolation --no-deps -w $(VENV)/wheels ./$$package & builds="$$builds $$!"; \
	done; for build in $$builds; do wait $$build || exit 1; done
	@$(INSTALL) --no-deps --force-reinstall $(VENV)/wheels/*.whl
	@touch $@

$(VENV)/.run: $(VENV)/.interfaces $(PACKAGE_FILES)
	@rm -rf build
	@$(INSTALL) --no-build-isolation --no-deps .
	@touch $@

$(VENV)/.dev: $(VENV)/.run requirements/dev.txt requirements/planning.txt requirements/generate.txt
	@echo "installing the test tools"
	@$(INSTALL) -c requirements/constraints.txt -r requirements/dev.txt
	@touch $@

$(VENV)/.planning: $(VENV)/.run requirements/planning.txt
	@echo "installing the planner"
	@$(INSTALL) -c requirements/constraints.txt -r requirements/planning.txt
	@touch $@

$(VENV)/.bench: $(VENV)/.run requirements/bench.txt
	@echo "installing what the benchmark compares with"
	@$(INSTALL) -c requirements/constraints.txt -r requirements/bench.txt
	@touch $@
