# Two commands for a fresh machine: `make demo` and `make test`. Each makes the virtual environment it needs.
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV ?= .venv
BIN = $(VENV)/bin

.PHONY: demo sample test lint style docs validation clean

demo: $(VENV)/.installed
	$(BIN)/varos-warp demo -o demo

# a small data set as it is published: docs/howto/publishing.md
sample: $(VENV)/.installed
	$(BIN)/python examples/publish/publish.py sample -o build/sample

# types, too: tests/test_types.py runs mypy beside the others
test: $(VENV)/.installed-test style
	$(BIN)/python -m pytest -n auto --maxprocesses 8 --dist worksteal --readers --validation=build/validation

lint: style
	$(BIN)/mypy

style: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .

# the site, in build/site: every link is checked
docs: export NO_MKDOCS_2_WARNING = 1
docs: $(VENV)/.installed-docs
	$(BIN)/mkdocs build --strict

# take over the summary of the last `make test`
validation:
	cp build/validation/summary.md docs/known_values.md

$(VENV)/.installed: pyproject.toml
	@test -n "$(PYTHON)" || { echo "varos_warp needs Python 3.11 or newer: install it, or call make PYTHON=/path/to/python3"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable .[test,readers,docs]
	$(BIN)/python -m pip install --quiet --no-deps nerfbaselines==1.2.12  # its loaders run with numpy 2, it asks for 1
	touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable .[docs]
	touch $@

clean:
	rm -rf $(VENV) demo build *.egg-info
