# One environment, .venv, with everything: ROS 2 from wheels, the suite, the tools of the tests.

PYTHON ?= python3
BIN := .venv/bin
SOURCES := $(sort package.xml setup.py setup.cfg pyproject.toml $(wildcard resource/* scripts/* \
  launch/* config/*.yaml config/*/*.* parallel_robot*/*.py parallel_robot*/*/*.py \
  parallel_robot*/*/*/*.py parallel_robot/*/*/templates/* parallel_robot/bags/*/*.json parallel_robot/live/static/*.* \
  parallel_robot/live/static/uplot/* trajectory_gen/*.py))
WARM := import logging, sys; \
  sys.stderr.isatty() and logging.basicConfig(format='  %(message)s', level='INFO'); \
  from parallel_robot_control.configuration import resolve; \
  from parallel_robot_control.controller import Controller; \
  from parallel_robot_sim.configuration import configure; \
  from parallel_robot_sim.plant_run import Simulator; \
  from trajectory_gen.configuration import motions_of; \
  values = resolve('paper_circle'); \
  whole = configure(values);
WARM_CONTROLLER := Controller(whole)
WARM_OTHERS := Simulator(whole).warm(); motions_of(values).load_kernels()
OF_TOOLS := from importlib.metadata import requires; from packaging.requirements import Requirement; \
  markers = {line: Requirement(line).marker for line in requires("parallel_robot")}; \
  print(*(line.partition(";")[0] for line, marker in markers.items() \
  if marker and marker.evaluate({"extra": "test"}) and not marker.evaluate({"extra": ""})), sep="\n")
TESTS := $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder --max-worker-restart 0
PAPER := smc s_smc nftsmc s_fotsmc
hash = $(firstword $(shell sha256sum $(1) | sha256sum))
# What compiles the kernels, as setup.py has it: they are compiled while the rest is downloaded.
COMPILE := $(shell grep -oE "'(numba|numpy|pyyaml|scipy)[<>=][^']*'" setup.py)
COMPILER := .venv/compiler-$(call hash,setup.py)
KERNELS := .venv/kernels-$(call hash,$(SOURCES))
DEPENDENCIES := .venv/dependencies-$(call hash,setup.py)
TOOLS := .venv/tools-$(call hash,setup.py)
INSTALLED := .venv/installed-$(call hash,$(SOURCES))

# Of a ROS that is installed, or of a Python that was started before: they would mix with .venv.
unexport AMENT_PREFIX_PATH LD_LIBRARY_PATH PYTHONHOME PYTHONPATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport PYTHONDONTWRITEBYTECODE  # each process of the tests would translate all modules
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: help setup demo docs site bench faults soak style check test warm endurance clean
.DELETE_ON_ERROR:

help: ## what can be made (this)
	@sed -n 's/^\([a-z]*\):.*## /  make \1\t/p' Makefile

setup: $(INSTALLED) $(TOOLS) ## create or update .venv with all tools; PYTHON=python3.12 chooses its Python
	@echo 'Ready: $(BIN)/parallel_robot --help'

demo: $(INSTALLED) ## run the paper's circle in real time over ROS 2, show it in a browser, record and measure it
	@$(BIN)/parallel_robot run paper_circle --live --law s_fotsmc --time-mode wall --duration 12 \
	--out runs/demo_$$(date +%Y%m%d_%H%M%S)

docs: setup ## write docs/parameters.md anew, draw the packages, run docs/notebook.ipynb, draw the moving robot
	$(BIN)/python docs/parameters.py docs/parameters.md
	$(BIN)/python docs/compiled_machines.py
	$(BIN)/python docs/architecture.py docs/images/packages.svg
	$(BIN)/python docs/notebook.py
	@bags=$$(mktemp -d) && trap 'rm -rf "$$bags"' EXIT && \
	for law in $(PAPER); do \
	$(BIN)/parallel_robot simulate paper_circle --law $$law --duration 6 --out $$bags/$$law || exit; \
	done && rm -f docs/images/moving_robot.gif && \
	$(BIN)/parallel_robot video $(PAPER:%=$$bags/%) --rate 9 --out docs/images/moving_robot.gif

site: setup ## write the documentation as a site, site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo 'site/index.html'

bench: setup ## measure all, beside the peers, a quarter of an hour; writes docs/benchmarks.md
	$(BIN)/python benchmarks/all.py

faults: setup ## inject faults into a running loop, a quarter of an hour; writes docs/safety.md
	$(BIN)/python benchmarks/faults.py

soak: setup ## run the loop for ten minutes, look at memory and losses; writes docs/safety.md
	$(BIN)/python benchmarks/soak.py

style: setup
	$(BIN)/ruff check --quiet
	$(BIN)/ruff format --quiet --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

check: style ## check style, types and layers, then run the quick tests, which start no process
	$(BIN)/python -m pytest -n 2 --quick

test: setup ## check style, types and layers, then run the tests, but for those of endurance
	@$(MAKE) --no-print-directory -j2 style warm
	$(TESTS) -m 'not endurance'

warm: setup
	PYTHONPATH=. $(BIN)/python test/warm.py

endurance: setup ## run the tests that must wait, or repeat a proof at length: cut links, whole programs of the pages
	$(TESTS) -m endurance

clean: ## remove .venv and everything built; runs/ stays
	@rm -rf .venv build install log site *.egg-info .*_cache .hypothesis
	@find . -name __pycache__ -prune -exec rm -rf {} +

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' || \
	{ echo 'error: "$(PYTHON)" is not a Python 3.10 to 3.13; name one: make setup PYTHON=python3.12' >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2> /dev/null || \
	{ echo 'error: "$(PYTHON)" cannot make environments; on Debian: apt install python3-venv' >&2; exit 1; }
	@echo "Setup, 1 of 3: creating .venv with $$($(PYTHON) --version) ..."
	@$(PYTHON) -m venv --clear .venv

$(COMPILER): | $(BIN)/python
	@echo 'Setup, 2 of 3: ROS 2 and libraries, some 100 packages, a minute the first time ...'
	@rm -f .venv/compiler-*
	@$(BIN)/python -m pip install -qq --no-compile $(COMPILE)
	@touch $@

$(DEPENDENCIES): | $(COMPILER)
	@rm -f .venv/dependencies-*
	@$(BIN)/python -m pip install -qq --no-compile '.[ros,all,source]'
	@touch $@

$(KERNELS): | $(COMPILER)
	@echo 'Setup, 3 of 3: parallel_robot; its some 250 kernels are compiled, one to two minutes ...'
	@rm -f .venv/kernels-*
	@PYTHONPATH=. $(BIN)/python -c "$(WARM) $(WARM_CONTROLLER)" & other=$$!; \
	trap 'kill $$other 2> /dev/null' EXIT; \
	PYTHONPATH=. $(BIN)/python -c "$(WARM) $(WARM_OTHERS)" && wait $$other && other=
	@touch $@

$(TOOLS): | $(INSTALLED)
	@echo 'Setup of the tools for tests and pages: some 100 packages more ...'
	@rm -f .venv/tools-*
	@$(BIN)/python -c '$(OF_TOOLS)' > .venv/tools.txt
	@$(BIN)/python -m pip install -qq --no-compile -r .venv/tools.txt
	@touch $@

$(INSTALLED): | $(COMPILER)
	@$(MAKE) --no-print-directory --silent -j2 $(DEPENDENCIES) $(KERNELS)
	@rm -rf .venv/installed-* build/lib build/bdist.*
	@$(BIN)/python -m pip install -qq --no-deps --no-build-isolation --force-reinstall .
	@rm -rf build/lib build/bdist.* parallel_robot.egg-info && rmdir --ignore-fail-on-non-empty build
	@warm=$$(mktemp -d) && trap 'rm -rf "$$warm"' EXIT && \
	bin='$(abspath $(BIN))' && cd "$$warm" && \
	"$$bin/parallel_robot" simulate paper_circle --duration 0.1 --out run > /dev/null && \
	"$$bin/parallel_robot" analyze run > /dev/null
	@touch $@
