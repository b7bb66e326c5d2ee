# make demo | test | test-fast | docs | test-versions | mutants | attack | interruptions | endurance | clean. Another interpreter: make PYTHON=/path/to/python test
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install -q --disable-pip-version-check

.PHONY: demo test test-fast docs test-versions mutants attack interruptions endurance clean help
.DELETE_ON_ERROR:

help:
	@echo "make demo           one episode of the unprotected left turn, results in out/demo"
	@echo "make test           all checks: style, types, layers, tests"
	@echo "make test-fast      the tests that are quick, to run while working"
	@echo "make docs           the documentation as a site in out/site; fails at a broken link"
	@echo "make test-versions  a smoke set with every supported Python of this machine, newest and lowest dependencies"
	@echo "make mutants        small wrong changes to planners, cost, referee and commands: does a test notice each? a part: make mutants OF=model/cost.py COUNT=50 SEED=2"
	@echo "make attack         thousands of wrong inputs through the real command; a part: make attack KIND=yaml SHARE=0.1"
	@echo "make interruptions  a batch, interrupted at 60 moments"
	@echo "make endurance      two simulated hours and a thousand episodes: does memory stay flat?"
	@echo "make clean          remove caches, builds and out/demo; environments and other results stay"

demo: $(VENV)/.installed
	$(BIN)/sumo-mcts run unprotected-left-turn --out out/demo

test: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --strict sumo_mcts
	$(BIN)/lint-imports
	$(BIN)/pytest -n 2

test-fast: $(VENV)/.installed-dev
	$(BIN)/pytest -n 2 -m "not slow"

# Material warns of its own future on every build; links are checked (see mkdocs.yml).
docs: $(VENV)/.installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# VERSIONS=--newest-python: with one Python only.
test-versions: $(VENV)/.installed-dev
	$(BIN)/python tests/versions.py $(VERSIONS)

# What takes long; docs/reliability.md says what each shows.
mutants: $(VENV)/.installed-dev
	PYTHONPATH=tests $(BIN)/python -m mutants $(OF) --count $(or $(COUNT),200) --seed $(or $(SEED),1)

attack: $(VENV)/.installed-dev
	PYTHONPATH=tests $(BIN)/python -m attack $(KIND) --share $(or $(SHARE),1)

interruptions: $(VENV)/.installed-dev
	PYTHONPATH=tests $(BIN)/python -m attack.interrupted_batch

endurance: $(VENV)/.installed-dev
	$(BIN)/python tests/endurance.py

# The stamps say that a step was finished, so an interrupted one is done again.
$(VENV)/.created:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))' 2>/dev/null || \
		{ echo "$(PYTHON) is missing or not Python 3.11, 3.12 or 3.13; name another one: make PYTHON=/path/to/python $(MAKECMDGOALS)" >&2; exit 1; }
	@echo "creating $(VENV)"
	@$(PYTHON) -m venv $(VENV) || { echo "$(PYTHON) cannot create $(VENV); on Debian and Ubuntu: apt-get install python3-venv" >&2; exit 1; }
	@touch $@

$(VENV)/.installed: pyproject.toml | $(VENV)/.created
	@echo "installing sumo_mcts and SUMO into $(VENV); the first time this takes a minute or two"
	@$(PIP) -e .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml | $(VENV)/.created
	@echo "installing sumo_mcts, SUMO and the tools for development into $(VENV); the first time this takes a minute or two"
	@$(PIP) -e '.[dev]'
	@touch $@ $(VENV)/.installed

$(VENV)/.installed-docs: pyproject.toml | $(VENV)/.created
	@echo "installing the tools for the documentation into $(VENV)"
	@$(PIP) -e '.[docs]'
	@touch $@

clean:
	rm -rf build dist out/demo .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -not -path './$(VENV)/*' -prune -exec rm -rf {} +
