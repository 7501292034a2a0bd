# `make demo` and `make test` are all that a newcomer needs. Both create .venv on first use, and change nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python requirements/install.py

INTERFACES := interfaces/control_msgs interfaces/epson_msgs interfaces/industrial_msgs interfaces/tf2_msgs
INTERFACE_FILES := $(shell find $(INTERFACES) interfaces/cmake -type f)
PACKAGE_FILES := setup.py setup.cfg pyproject.toml package.xml README.md \
	$(shell find $(wildcard epson_driver config controller_program launch resource scripts urdf) -not -name '*.pyc' -not -name __pycache__)

# Six processes, each with one thread for matrices: tests of real processes mostly wait. Each file stays in one of
# them, so that what its tests share is started once.
ALL_TESTS := --numprocesses 6 --dist loadfile --no-loadscope-reorder
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest

# An environment belongs to the Python that made it: PYTHON=... with another one is an error.
ifneq ($(origin PYTHON),file)
ifneq ($(and $(wildcard $(VENV)/pyvenv.cfg),$(filter-out clean help,$(or $(MAKECMDGOALS),help))),)
SERIES := $(shell $(PYTHON) -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
ifeq ($(wildcard $(VENV)/lib/$(SERIES)),)
$(error $(VENV) was made with another Python than $(PYTHON) ($(notdir $(wildcard $(VENV)/lib/python3*))): make clean, then again)
endif
endif
endif

# Containers often set it. Each process would compile 500 modules at its start, and the tests start hundreds.
unexport PYTHONDONTWRITEBYTECODE

# Otherwise Fast DDS would multicast on every network.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: demo fleet browser docs test test-all test-rest soak-tests coverage lint bench bench-motion bench-fleet
.PHONY: soak soak-motion faults fuzz generate pictures hashes licences clean help

help:
	@echo "make demo          execute a planned trajectory through ROS 2 on a simulated EPSON controller, and report"
	@echo "                   (ARGS='--trajectory FILE': another one; ARGS=--plan: plan a pick and place first;"
	@echo "                   ARGS=--panel: watch it in a browser, and go on until Ctrl-C)"
	@echo "make fleet N=16    run so many simulated robots with their drivers behind a discovery server, until Ctrl-C"
	@echo "make test          run the tests (some of them: make test ARGS=test/driver)"
	@echo "make browser       install what drives Debian's chromium in tests of the panel, which are skipped without"
	@echo "make test-all      run the slow tests as well (half an hour)"
	@echo "make test-rest     run what test-all adds to test: the slow tests, and more examples (twenty minutes)"
	@echo "make coverage      report which statements the tests run (with the slow tests: ARGS=all)"
	@echo "make lint          run ruff and mypy"
	@echo "make docs          build the documentation as a site that needs no network (build/site/index.html)"
	@echo "make bench         measure the driver beside programs that do the least (docs/performance.md), and the CPU time of"
	@echo "                   smoother, drivers, collision checks, SPEL+ program and panel (ARGS=--quick: only the former)"
	@echo "make bench-motion  compare the smoother with stop-and-go, splines and optima (ARGS=--quick: a part; ARGS=--help);"
	@echo "                   tables and pictures go to benchmark/results"
	@echo "make bench-fleet   measure how 1 to 32 robots find each other, and what that costs the network (ten minutes;"
	@echo "                   ARGS=--quick: up to 4)"
	@echo "make soak          send 2,000 goals and 20,000 service calls, and watch the driver's memory (ten minutes)"
	@echo "make soak-motion   an hour in which everything happens to goals (ARGS='--minutes 5': less)"
	@echo "make faults        every fault in every phase of a motion, on every controller (minutes)"
	@echo "make fuzz          a million mutated messages to both roles and all ports (ARGS='--inputs 50000 --seed 1')"
	@echo "make soak-tests    run 2,000 random plans, and new examples for every property (hours)"
	@echo "make generate      regenerate meshes, URDFs and MoveIt files from config/robots"
	@echo "make pictures      redraw the pictures of the robots in docs and the animation of the README (ten minutes)"
	@echo "make hashes        write the hashes of all pinned packages anew, after a change to requirements/constraints.txt"
	@echo "make licences      write docs/licences.md anew, after the same"
	@echo "make clean         remove the environment and everything else that make has created"
	@echo "PYTHON=...         the interpreter to use, 3.11 or newer (now: $(PYTHON))"

DEMO_EXTRAS := $(if $(filter --plan,$(ARGS)),planning) $(if $(filter --panel,$(ARGS)),panel)

# ALSO: the steps after the driver, so that all sizes are announced before the first download
demo: ALSO := $(DEMO_EXTRAS)
test soak-tests coverage lint generate pictures soak-motion faults fuzz: ALSO := dev
test-all test-rest: ALSO := dev docs
bench bench-motion: ALSO := bench
docs: ALSO := docs

demo: $(VENV)/.driver $(DEMO_EXTRAS:%=$(VENV)/.%)
	$(BIN)/epson_driver demo $(ARGS)

fleet: $(VENV)/.driver
	$(BIN)/epson_driver fleet --robots $(or $(N),4) $(ARGS)

# for the panel's tests in a browser (apt install chromium), which are skipped without it
browser: $(VENV)/.browser

test: $(VENV)/.dev
	$(PYTEST) $(or $(ARGS),$(ALL_TESTS))

test-all: $(VENV)/.dev $(VENV)/.docs
	$(PYTEST) -m 'not soak' $(or $(ARGS),$(ALL_TESTS))

test-rest: $(VENV)/.dev $(VENV)/.docs
	$(PYTEST) -m '(slow or hypothesis) and not soak' $(or $(ARGS),$(ALL_TESTS))

soak-tests: $(VENV)/.dev
	$(PYTEST) -m 'soak or hypothesis' $(or $(ARGS),$(ALL_TESTS))

# includes child processes; no report if a test fails
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

docs: $(VENV)/.docs
	$(BIN)/python docs/make_site.py

# one thread per process: the matrices are small, and two processes share the machine
bench: $(VENV)/.bench
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.performance $(ARGS)
ifeq ($(filter --quick,$(ARGS)),)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.cost
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.collision
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.robots
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.spel_program
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.panel
endif

bench-motion: $(VENV)/.bench
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.motion $(ARGS)

# a network of its own on this machine; needs the right to make one (benchmark/hosts.py), and iproute2
bench-fleet: $(VENV)/.driver
	$(BIN)/python -m benchmark.fleet $(ARGS)

# ten minutes; the tests have a short form of it
soak: $(VENV)/.driver
	$(BIN)/python -m benchmark.soak $(ARGS)

# tables and pictures go to benchmark/results and docs/reliability.md
soak-motion: $(VENV)/.dev
	$(BIN)/python -m benchmark.soak_motion $(ARGS)

faults: $(VENV)/.dev
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.faults $(ARGS)

fuzz: $(VENV)/.dev
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.fuzz $(ARGS)

# in this order: each uses the output of the one before
generate: $(VENV)/.dev
	$(BIN)/python -m generate.meshes
	$(BIN)/python -m generate.urdf
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m generate.moveit

# ten minutes, most of it the animation; not part of generate, as no test compares them
pictures: $(VENV)/.dev
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m generate.picture $(ARGS)
	$(if $(ARGS),,OPENBLAS_NUM_THREADS=1 $(BIN)/python -m generate.animation)

hashes: $(VENV)/.driver
	$(BIN)/python requirements/make_hashes.py

licences: $(VENV)/.driver
	$(BIN)/python requirements/make_licences.py

clean:
	rm -rf $(VENV) build install log dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage .coverage.* demo-report.png demo-report.html demo-report.json
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The steps of the installation, each with a stamp. install.py prints the progress.
$(VENV)/.runtime: requirements/runtime.txt requirements/constraints.txt requirements/hashes.txt
	@command -v $(PYTHON) >/dev/null || { echo "no $(PYTHON): Python 3.11 or newer is needed (make PYTHON=...)" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$(PYTHON) is too old: Python 3.11 or newer is needed (make PYTHON=...)" >&2; exit 1; }
	@$(PYTHON) requirements/install.py runtime --all runtime interfaces $(ALSO)

$(VENV)/.interfaces: $(VENV)/.runtime interfaces/requirements-build.txt $(INTERFACE_FILES)
	@$(INSTALL) interfaces

$(VENV)/.driver: $(VENV)/.interfaces $(PACKAGE_FILES)
	@$(INSTALL) driver

$(VENV)/.dev: $(VENV)/.driver requirements/dev.txt requirements/generate.txt requirements/panel.txt requirements/planning.txt \
		requirements/report.txt
	@$(INSTALL) dev

$(VENV)/.docs: $(VENV)/.driver requirements/docs.txt
	@$(INSTALL) docs

$(VENV)/.planning: $(VENV)/.driver requirements/planning.txt
	@$(INSTALL) planning

$(VENV)/.panel: $(VENV)/.driver requirements/panel.txt
	@$(INSTALL) panel

$(VENV)/.browser: $(VENV)/.dev requirements/browser.txt
	@$(INSTALL) browser

$(VENV)/.bench: $(VENV)/.driver requirements/bench.txt requirements/panel.txt
	@$(INSTALL) bench
