# Needs Python 3.11+ and make; everything else goes into .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: demo paper test check lint types layers slow bench clean

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "rvaft needs Python 3.11 or newer; this is %d.%d (set PYTHON=...)" % sys.version_info[:2])'
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --upgrade pip
	@$(BIN)/python -m pip install --quiet --editable '.[dev]'
	@touch $@

TREE := trees/remote_inspection/pruned.rvaft

demo: $(STAMP)
	@echo "# The tree: rvaft show $(TREE)"
	@$(BIN)/rvaft show $(TREE)
	@echo; echo "# Its branches: rvaft branches $(TREE)"
	@$(BIN)/rvaft branches $(TREE)
	@for language in rml ltlf automaton; do echo; echo "# rvaft emit $(TREE) --to $$language"; $(BIN)/rvaft emit $(TREE) --to $$language || exit 1; done
	@echo; echo "# The traces of the paper's Tables 2 and 3: python -m papers.fmas2022.verdict_table"
	@$(BIN)/python -m papers.fmas2022.verdict_table

paper: $(STAMP)
	$(BIN)/python -m papers.fmas2022

test: $(STAMP)
	$(BIN)/python -m pytest -n auto -m "not slow" --ignore tests/benchmarks

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy rvaft backends cross_check tests

layers: $(STAMP)
	$(BIN)/lint-imports

check: lint types layers test

slow: $(STAMP)
	$(BIN)/python -m pytest -m slow

bench: $(STAMP)
	$(BIN)/python -m pytest tests/benchmarks -s

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
