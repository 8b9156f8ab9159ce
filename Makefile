# make demo | test | test-page | test-faces | test-all | lint | bench | docs | wheel | kernel | test-kernel; each but kernel makes .venv first.
# PYTHON=python3.12 make test picks another Python.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/installed
COMPILED := .venv/compiled

.PHONY: demo test test-page test-faces test-all lint bench docs wheel kernel test-kernel clean

demo: $(STAMP)
	$(BIN)/umo run ztheta

# Three times as many workers as processors: most of the time tests wait for processes.
PYTEST := PYTEST_XDIST_AUTO_NUM_WORKERS=$$((3 * $$(getconf _NPROCESSORS_ONLN))) $(BIN)/python -m pytest -n auto --dist worksteal

# ARGS goes to pytest here and below: make test ARGS="tests/control/test_pid.py -v". CHANGED=1: the tests that the change
# since HEAD can reach by imports; CHANGED=REV: since that commit (tools/changed.py).
test: $(COMPILED)
ifdef CHANGED
	modules=$$($(BIN)/python -m tools.changed $(CHANGED)) && { test -z "$$modules" || $(PYTEST) -m "not full" $(ARGS) $$modules; }
else
	$(PYTEST) -m "not full" $(ARGS)
endif

# The page in a browser; make test runs some of these tests. A browser has processes of its own: a worker for each processor.
test-page: $(STAMP)
	$(BIN)/python -m pytest -n auto --dist worksteal tests/clients/page $(ARGS)

# The faces, each with clients of other projects; make test runs one test of each.
test-faces: $(STAMP)
	$(PYTEST) tests/clients/faces $(ARGS)

# Every test, also the grids, seeds, matrices and campaigns: before a release. make test-all ARGS="--shard 2/4" runs the
# second of four parts.
test-all: $(STAMP)
	$(PYTEST) $(ARGS)

# A user-mode Linux kernel with simulated GPIO, I2C, SPI, IIO, counters, CAN: built once, in 5 to 10 minutes, into ~/.cache/umo.
kernel:
	tests/kernel/build

# The drivers for interfaces of the kernel, in that kernel: make test-kernel ARGS="-k gpio". KERNEL_PYTHON picks another environment.
KERNEL_PYTHON ?= $(BIN)/python
test-kernel: kernel $(if $(filter $(BIN)/python,$(KERNEL_PYTHON)),$(STAMP))
	tests/kernel/boot $(KERNEL_PYTHON) -m pytest -p no:cacheprovider tests/kernel $(ARGS)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(BIN)/python tools/lint.py
	tools/javascript/check

# About two minutes; python -m bench --help for the longer ones (--live, --kills).
bench: $(STAMP)
	$(BIN)/python -m bench

# The code blocks of README and docs/ are run, the tables of docs/machines.md and docs/verbs.md made; pages and docstrings become a site with
# search, site/index.html.
docs: $(STAMP)
	$(BIN)/python -m pytest tests/project/test_docs.py
	$(BIN)/python tools/count.py
	$(BIN)/python tools/verb_page.py
	$(BIN)/python -m sphinx -q -W -j auto docs site

# One wheel for every Python from 3.11 on, in dist/. The audit fails if its binary uses more than the stable interface.
wheel: $(STAMP)
	$(BIN)/python -m build --wheel --outdir dist
	$(BIN)/python -m abi3audit --strict dist/*.whl

$(STAMP): pyproject.toml setup.py constraints.txt $(wildcard src/umo/*/*.c)
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip uninstall --quiet --yes umo 2>/dev/null  # the name of umo-machines before 0.3
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[all,dev]'
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[spi]' 2>/dev/null || \
	    echo "spidev could not be built, for which a C compiler is needed: the driver spi is left out"
	touch $(STAMP)

# In a fresh clone: pytest's bytecode of the tests, by two processes. Else each of its workers makes all of it.
$(COMPILED): $(STAMP)
	find tests -name 'test_*.py' | env -u PYTHONDONTWRITEBYTECODE xargs -n 200 -P 2 $(BIN)/python -m pytest -q --collect-only >/dev/null; touch $(COMPILED)

clean:
	rm -rf .venv runs build dist
