# make demo | test | lint | bench | docs; each makes .venv first. PYTHON=python3.12 make test picks another Python.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/installed

.PHONY: demo test lint bench docs clean

demo: $(STAMP)
	$(BIN)/umo run ztheta

test: $(STAMP)
	$(BIN)/python -m pytest -n auto --dist worksteal

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

# About two minutes; python -m bench --help for the longer ones (--live, --kills).
bench: $(STAMP)
	$(BIN)/python -m bench

# The code blocks of README and docs/ are run; the docstrings become site/index.html.
docs: $(STAMP)
	$(BIN)/python -m pytest tests/test_docs.py
	$(BIN)/pdoc umo umo.control umo.drivers umo.testing -o site

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[all,dev]'
	touch $(STAMP)

clean:
	rm -rf .venv runs build dist
