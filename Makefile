# 'make demo' and 'make test' work on a machine that has nothing but make and Python 3.11 or newer (with venv).
# The first of them makes .venv from the package registry; after that nothing is fetched until pyproject.toml or what
# is compiled changes.
#
#   make PYTHON=/path/to/python3 test      use that Python for a new .venv
#   make PYTEST_ARGS='-k rotation' test    hand options to pytest
#   make KERNELS='Zen SkylakeX' test-kernels   other values of OPENBLAS_CORETYPE
#   make BENCH_PHOTOS='50 2000' BENCH_CASES= BENCH_ARGS='--repetitions 3' bench    other benchmarks

.SUFFIXES:
.DEFAULT_GOAL := help

# Python keeps its bytecode, whatever is set outside: the tests start commands by the hundred, and pytest, which rewrites
# the assertions of every module, needs 25 seconds to find the tests where it has to do so again.
unexport PYTHONDONTWRITEBYTECODE

VENV := .venv
BIN := $(VENV)/bin
# Written last: say for which folder, and for which text of pyproject.toml, setup.py, Makefile and C sources, .venv has
# what orip needs to run, and all that its development needs.
RUNS := $(VENV)/orip-runs
READY := $(VENV)/orip-ready
# There while .venv is being made or changed; still there, the run was interrupted and .venv is not to be trusted.
UNFINISHED := $(VENV)/orip-unfinished

SAMPLE := drone_rtk
SECOND_SAMPLE := zurich_city_hall
DOCS := build/docs
build_docs = $(BIN)/sphinx-build --fail-on-warning --keep-going --nitpicky --fresh-env --quiet -b

state := { pwd -P; cat pyproject.toml setup.py Makefile orip/*.h orip/*/*/*.[ch] | cksum; }
state_wanted := $(shell $(state))
state_found = $(shell [ ! -e $(UNFINISHED) ] && $(BIN)/python -c pass 2>/dev/null && cat $(1) 2>/dev/null)

.PHONY: help
help:
	@echo 'make demo      run the sample project $(SAMPLE) from its measurements to the results; SAMPLE=... another one'
	@echo 'make test      run the tests (a few minutes)'
	@echo 'make test-all  run the tests and the long studies'
	@echo 'make test-kernels  run the numerical tests and the samples as other processors calculate (some minutes)'
	@echo 'make sanitize  run the tests of the C extensions with sanitizers (needs gcc with libasan; some minutes)'
	@echo 'make wheel     build a wheel in dist, and test it in a fresh environment without a compiler (some minutes)'
	@echo 'make browser-test  test the pages in Chromium (which has to be installed)'
	@echo 'make check     style, types, layers and documentation: ruff, mypy, import-linter, sphinx'
	@echo 'make docs      build the documentation; make docs-links looks at its links to elsewhere, too; make man: orip(1)'
	@echo 'make docker    build a container with orip, and run a sample project in it (needs docker)'
	@echo 'make bench     compare the speed with that of pycolmap and SciPy, which it installs in .venv-bench (some minutes)'
	@echo 'make clean     remove all that make and the tools have made, .venv too'

define shift_of_strip

[[antenna]]
name = "RTK"
shift = "strip"
strips = ["S3"]
endef
export shift_of_strip

.PHONY: demo
demo: $(RUNS)
	@rm -rf 'demo/$(SAMPLE)'
	@echo 'orip init --sample $(SAMPLE) demo/$(SAMPLE)'
	@$(BIN)/orip init --sample '$(SAMPLE)' 'demo/$(SAMPLE)'
	@[ '$(SAMPLE)' != drone_rtk ] || { \
	  echo 'The GNSS positions of strip S3 are shifted as a whole, which orip run says by itself; the setting that it advises:'; \
	  printf '%s\n' "$$shift_of_strip" | tee -a 'demo/$(SAMPLE)/orip.toml'; }
	@echo 'orip -C demo/$(SAMPLE) run'
	@$(BIN)/orip -C 'demo/$(SAMPLE)' run
	@echo
	@echo 'The project and its results are in demo/$(SAMPLE):'
	@echo '  report.html         to look at in a browser: can it be trusted, what is wrong, how good is it'
	@echo '  BUNDLE_RESULT.OUT   orientations and ground points with their standard deviations'
	@echo '  BUNDLE_ERROR.OUT    observations that do not fit'
	@echo '  result.json         the same figures for programs; residuals.csv: every residual'
	@echo '  README.md           where the data come from, and what is to be seen in them'
	@echo
	@echo "The report: file://$$(pwd -P | sed 's/ /%20/g')/demo/$(SAMPLE)/report.html"
	@[ '$(SAMPLE)' = '$(SECOND_SAMPLE)' ] || { echo; \
	  echo 'Next: make SAMPLE=$(SECOND_SAMPLE) demo     real photos with control points that are wrong, which orip names'; }

# two workers have two processors: threads of OpenBLAS would wait for each other
.PHONY: test
test: export OPENBLAS_NUM_THREADS := 1
test: $(READY)
	$(BIN)/python -m pytest -q -n 2 --dist worksteal $(PYTEST_ARGS)

.PHONY: test-all
test-all: $(READY)
	$(BIN)/python -m pytest -q -n 2 --dist worksteal -m '' --hypothesis-profile='many examples' $(PYTEST_ARGS)

# under other kernels of OpenBLAS than the tests, and without the compiled loop over photo points
KERNELS :=

.PHONY: test-kernels
test-kernels: $(READY)
	PYTHONPATH=tests $(BIN)/python tests/kernels/run.py $(KERNELS)

# the C extensions built with gcc's address and undefined-behaviour sanitizers; says what is missing where that cannot be
.PHONY: sanitize
sanitize: $(READY)
	PYTHONPATH=tests $(BIN)/python -m hostile.sanitize

# setuptools would put what it finds of earlier builds into the wheel
.PHONY: wheel
wheel: $(READY)
	rm -rf build/lib* build/bdist* build/temp* dist/*.whl
	$(BIN)/python -m pip wheel -q --no-deps --no-build-isolation --wheel-dir dist .
	$(BIN)/python tests/wheel/run.py dist/*.whl

.PHONY: browser-test
browser-test: $(READY)
	$(BIN)/python -m pip install -q -e '.[browser]'
	$(BIN)/python -m pytest -q tests/browser $(PYTEST_ARGS)

.PHONY: check
check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy tests/api/typed_script.py
	$(BIN)/lint-imports
	$(build_docs) html docs $(DOCS)

.PHONY: docs
docs: $(READY)
	$(build_docs) html docs $(DOCS)
	@echo 'The documentation is in $(DOCS)/index.html'

.PHONY: man
man: $(READY)
	$(build_docs) man docs $(DOCS)-man
	@echo 'The manual page is $(DOCS)-man/orip.1: man -l $(DOCS)-man/orip.1'

.PHONY: docs-links
docs-links: $(READY)
	$(build_docs) linkcheck docs $(DOCS)-links

# what a container prints of a sample that it runs ends with where the report is
.PHONY: docker
docker:
	docker build --tag orip .
	docker run --rm --entrypoint sh orip -c 'orip init --sample small_frame_block cliff && orip -C cliff run'

BENCH_PHOTOS := 50 500
# also: solve:20000 (half an hour), large; BAL is left out where its data are not
BENCH_CASES := penta rings BAL aerial-bal penta-bal rings-bal Zurich threads:500 threads:2000 threads:penta-bal \
	threads:rings-bal adjust:aerial-bal adjust:aerial-bal-2000 variants:500 variants:2000 chain:400 solve:500 solve:2000
BENCH_ARGS :=
BENCH_PYTHON := .venv-bench/bin/python
BENCH_PACKAGES := pycolmap==4.2.1 scipy

.PHONY: bench
bench: $(READY)
	@[ "$$(cat .venv-bench/packages 2>/dev/null)" = '$(BENCH_PACKAGES)' ] && $(BENCH_PYTHON) -c 'import pycolmap' || { \
	  echo 'Making .venv-bench with $(BENCH_PACKAGES): once, about a minute ...'; \
	  rm -rf .venv-bench && $(BIN)/python -m venv .venv-bench \
	    && $(BENCH_PYTHON) -m pip install -qq --disable-pip-version-check --no-input $(BENCH_PACKAGES) \
	    && echo '$(BENCH_PACKAGES)' >.venv-bench/packages; }
	$(BIN)/python benchmarks/against_peers.py --peer $(BENCH_PYTHON) $(BENCH_PHOTOS) $(BENCH_CASES) $(BENCH_ARGS)

.PHONY: clean
clean:
	rm -rf $(VENV) .venv-bench demo build dist orip.egg-info
	rm -rf .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find orip tests -name __pycache__ -type d -prune -exec rm -rf {} +

# The first Python that really runs (a name on PATH may be an empty shim, and hide a sound Python behind it), is new
# enough and can make environments.
define find_python
fit='import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))'; \
python=; \
if [ -n '$(PYTHON)' ]; then \
  if '$(PYTHON)' -c "$$fit" >/dev/null 2>&1; then python='$(PYTHON)'; fi; \
else \
  IFS=:; \
  for name in python3.14 python3.13 python3.12 python3.11 python3; do \
    for folder in $$PATH; do \
      if "$$folder/$$name" -c "$$fit" >/dev/null 2>&1; then python=$$folder/$$name; break 2; fi; \
    done; \
  done; \
  unset IFS; \
fi
endef

# .venv is made again from nothing when it is missing, broken, left half-made, or made for another folder (its programs
# name the folder they are in); otherwise, and when it is somebody's own, it is only completed. Packages are fetched while
# the extensions are compiled.
$(RUNS):
	@set -e; \
	if [ -e $(UNFINISHED) ] || ! $(BIN)/python -m pip --version >/dev/null 2>&1 \
	    || { [ -e $(RUNS) ] && [ "$$(head -n 1 $(RUNS))" != "$$(pwd -P)" ]; }; then \
	  $(find_python); \
	  if [ -z "$$python" ]; then \
	    echo 'orip needs Python 3.11 or newer with venv and ensurepip, and $(if $(PYTHON),$(PYTHON) is not that,none is on PATH);' \
	      'install it (Debian, Ubuntu: apt install python3 python3-venv) or name it: make PYTHON=/path/to/python3 ...' >&2; \
	    exit 1; \
	  fi; \
	  echo "Making $(VENV) with $$("$$python" --version) ($$python): once, about half a minute ..."; \
	  rm -rf $(BIN); rm -rf $(VENV); \
	  mkdir $(VENV); \
	  : >$(UNFINISHED); \
	  "$$python" -m venv $(VENV); \
	else \
	  echo 'Bringing $(VENV) up to date with pyproject.toml ...'; \
	  : >$(UNFINISHED); \
	fi; \
	rm -f $(RUNS) $(READY); \
	$(BIN)/python -c "$$print_packages"; \
	echo '  1 of 3: the tools to build with'; \
	$(pip_install) -r $(VENV)/build-packages || { $(not_installed); }; \
	echo '  2 of 3: compiling three extensions in C, while packages are fetched'; \
	$(pip_install) -r $(VENV)/run-packages & packages=$$!; \
	trap 'kill $$packages 2>/dev/null || :' EXIT; trap 'exit 130' HUP INT TERM; \
	$(pip_install) --no-build-isolation --no-deps -e . || { $(not_installed); }; \
	echo "  3 of 3: waiting for the packages: $$(sed 's/[<>=].*//' $(VENV)/run-packages | tr '\n' ' ')"; \
	wait $$packages || { $(not_installed); }; \
	$(state) >$(RUNS); \
	rm -f $(UNFINISHED); \
	echo '$(VENV) has what orip needs.'

# not `-e .[dev]`, which would compile the extensions a second time; the bytecode of all packages is made on all cores
$(READY): $(RUNS)
	@set -e; \
	echo 'Completing $(VENV) with what the tests and checks need ...'; \
	: >$(UNFINISHED); \
	rm -f $(READY); \
	$(BIN)/python -c "$$print_packages"; \
	$(pip_install) -r $(VENV)/dev-packages || { $(not_installed); }; \
	$(BIN)/python -m compileall -qq -j 0 $(VENV)/lib || :; \
	$(state) >$(READY); \
	rm -f $(UNFINISHED); \
	echo '$(VENV) is complete.'

# Bytecode is left to Python, which makes that of the modules that are imported.
pip_install := $(BIN)/python -m pip install -qq --disable-pip-version-check --no-input --no-compile
define not_installed
echo 'The packages that orip needs could not be installed: see above; without a network, is a package registry set for pip?' >&2; exit 1
endef
define print_packages
import tomllib
from pathlib import Path
text = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))
build, project = text["build-system"]["requires"], text["project"]
lists = {"build": build, "run": project["dependencies"], "dev": project["optional-dependencies"]["dev"]}
for name, packages in lists.items():
    Path("$(VENV)", f"{name}-packages").write_text("\n".join(packages) + "\n", encoding="utf-8")
endef
export print_packages

ifneq ($(call state_found,$(RUNS)),$(state_wanted))
$(RUNS): always
endif
ifneq ($(call state_found,$(READY)),$(state_wanted))
$(READY): always
endif
.PHONY: always
always:
