# Needs Python 3.11+ and make; everything else goes into .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
CONVERTERS := .venv-sigma/.installed
RUNTIME := $(VENV)/.installed-rvaft
# Modules are compiled once they are imported, not in each of the many processes of the tests, nor all when they are installed.
unexport PYTHONDONTWRITEBYTECODE

PROGRAMS := tests/export tests/cli/test_processes.py tests/cli/test_show.py tests/cross_check/test_mona.py

.PHONY: converters demo paper docs pictures playground proofs verified test trust bare check lint sizes types layers slow attack lock bench clean

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "rvaft needs Python 3.11 or newer; this is %d.%d (set PYTHON=...)" % sys.version_info[:2])'
	@echo "Making $(VENV)"
	@$(PYTHON) -m venv $(VENV)

$(RUNTIME): pyproject.toml | $(BIN)/python
	@echo "Installing rvaft and what it needs into $(VENV); once, about a minute"
	@$(BIN)/python -m pip install --quiet --no-compile --editable .
	@touch $@

$(STAMP): pyproject.toml | $(BIN)/python
	@echo "Installing rvaft and the tools of its developers into $(VENV); once, one or two minutes"
ifdef LOCKED
	@for part in build dev; do \
		$(BIN)/python .ci/locked.py $$part >$(VENV)/requirements.txt && \
		$(BIN)/python -m pip install --quiet --no-compile --no-deps --no-build-isolation --require-hashes \
			--requirement $(VENV)/requirements.txt || exit 1; \
	done
	@$(BIN)/python -m pip install --quiet --no-compile --no-deps --no-build-isolation --editable .
else
	@$(BIN)/python -m pip install --quiet --no-compile --editable '.[dev]'
endif
	@touch $@ $(RUNTIME)

# pySigma's backends, which need an older pySigma than rvaft's; tests/backends/sigma/test_conversions.py runs them.
$(CONVERTERS): tests/backends/sigma/requirements.txt
	@$(PYTHON) -m venv .venv-sigma
ifdef LOCKED
	@.venv-sigma/bin/python -m pip install --quiet --no-compile --no-deps --require-hashes --requirement .ci/converters.txt
else
	@.venv-sigma/bin/python -m pip install --quiet --no-compile --requirement $<
endif
	@touch $@

converters: $(CONVERTERS)

TREE := docs/first/ssh_guessed.rvaft
LOG := docs/first/sshd.log

demo: $(RUNTIME)
	@echo "# 1. How a password is guessed, as a tree. rvaft show $(TREE)"
	@$(BIN)/rvaft show $(TREE)
	@echo; echo "# 2. The log of an SSH server. head $(LOG)"
	@head -12 $(LOG)
	@echo; echo "# 3. What happened in it, drawn in the tree. rvaft monitor $(TREE) $(LOG) --profile sshd --explain"
	@$(BIN)/rvaft monitor $(TREE) $(LOG) --profile sshd --explain 2>/dev/null; test $$? -eq 1
	@echo; echo "# 4. The tree as a query of Elasticsearch. rvaft emit $(TREE) --to eql"
	@$(BIN)/rvaft emit $(TREE) --to eql
	@echo; echo "# The attack is detected. Next: source $(BIN)/activate puts rvaft on your path; go on in README.md."

paper: $(STAMP)
	@echo "Computing tables, figures and measurements into out/; one or two minutes"
	$(BIN)/python -m papers.fmas2022

# The site, in out/site; a broken link or anchor is an error. The notice is about a release of MkDocs that is not used.
docs: $(STAMP)
	@$(BIN)/python docs/playground.py --try
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# What the page docs/playground.md loads; `make docs` leaves it out where it cannot be fetched.
playground: $(STAMP)
	$(BIN)/python docs/playground.py

pictures: $(STAMP)
	$(BIN)/python docs/pictures.py

# The proofs in Coq, checked by its kernel alone; about a minute. Needs coq and ocaml-nox (Debian, Ubuntu).
proofs:
	@$(MAKE) --no-print-directory -C proofs check

# The monitor that is extracted from the proofs: proofs/build/rvaft-verified.
verified:
	@$(MAKE) --no-print-directory -C proofs build/rvaft-verified

# Continuous integration says which tests run: TESTS="not slow and not sample". Each process runs neighbouring tests,
# which share caches and fixtures.
TESTS ?= not slow and not ci

test: $(STAMP)
	$(BIN)/python -m pytest -n auto --dist worksteal -m "$(TESTS)" --ignore tests/benchmarks

# The tests that start programs, on a PATH with no program but Python, a shell, `sleep` and make.
bare: $(STAMP)
	@folder=$$(mktemp -d); trap 'rm -rf "$$folder"' EXIT; \
	for program in sh make sleep; do ln -s "$$(command -v $$program)" "$$folder/$$program"; done; \
	ln -s "$(CURDIR)/$(BIN)/python" "$$folder/python3"; \
	PATH=$$folder $(BIN)/python -m pytest -q -m "not slow and not ci" $(PROGRAMS)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# How many lines and words each part has; a report, on which nothing depends.
sizes: $(STAMP)
	@$(BIN)/python -m tests.house

types: $(STAMP)
	$(BIN)/mypy rvaft backends cross_check papers/languages papers/multipath tests

layers: $(STAMP)
	$(BIN)/lint-imports

check: lint types layers docs test bare

# What is checked, on one page: sections of the definition by participants, and the planted faults that are found.
trust: $(STAMP)
	@$(BIN)/python -m tests.faults.trust

slow: $(STAMP)
	$(BIN)/python -m pytest -m slow

# The versions and hashes that continuous integration and the GitHub Action install; needs uv.
lock:
	uv pip compile pyproject.toml --extra dev --extra native --group build --universal --python-version 3.11 --upgrade --generate-hashes \
		--no-header --quiet --output-file .ci/requirements.txt
	uv pip compile tests/backends/sigma/requirements.txt --universal --python-version 3.11 --upgrade --generate-hashes \
		--no-header --quiet --output-file .ci/converters.txt

# Attacks: hostile trees, logs, texts, files and clients; five minutes.
attack: $(STAMP)
	$(BIN)/python -m pytest -n auto tests/attacks

bench: $(STAMP)
	$(BIN)/python -m pytest tests/benchmarks -s

clean:
	$(MAKE) -C proofs clean
	rm -rf $(VENV) .venv-sigma build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
