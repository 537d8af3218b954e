# Each target first installs what it needs into $(VENV). `make help` lists the targets.
PYTHON ?= python3
VENV ?= .venv
PY ?= $(VENV)/bin/python
RESULTS ?= results
EXPERIMENT ?=
ALGO ?=
SETTINGS ?=
STOCHASTIC ?=
SEEDS ?=
SMOKE ?=
TESTS ?=
CHECKED ?= .
SPEED ?=

# Files that mark what is installed. To use a Python that already has it, leave them empty: make reproduce PY=python BASE=
BASE ?= $(VENV)/.base
DEEP ?= $(VENV)/.deep
DEV ?= $(VENV)/.dev

# SMOKE=1 runs a miniature, EXPERIMENT_smoke, to check that everything works; its numbers mean nothing.
# SEEDS=5 runs seeds 0 to 4 of every variant, fewer of those with fewer runs, and draws them in a folder of their own,
# EXPERIMENT_seeds_0-4. By default each variant has the seeds that its experiment declares.
RUN = $(PY) -m benchmark run --results $(RESULTS) --report $(if $(SMOKE),--smoke) $(if $(SEEDS),$(if $(shell echo '$(SEEDS)' | \
	grep -xE '[1-9][0-9]*'),--seeds 0-$(shell expr $(SEEDS) - 1),$(error SEEDS=$(SEEDS): accepted: a whole number, 2 or more)))

PYTEST = $(PY) -m pytest -n 2 --dist loadfile --no-loadscope-reorder

.PHONY: help reproduce tune compare-deep when suite bench report test test-slow check speed clean

help: ## list these commands
	@grep -hE '^[a-z0-9-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "make %-12s %s\n", $$1, $$2}'

reproduce: $(BASE) ## the paper's figure, claims and tables, in results/reproduce/
	$(RUN) $(or $(EXPERIMENT),reproduce)

tune: $(DEEP) ## search for the settings of every learner, in results/tuning/ (an hour and a half)
	$(RUN) $(or $(EXPERIMENT),tuning)

compare-deep: $(DEEP) ## tables, tile coding, DQN and PPO, in results/compare_deep/ (an hour and a quarter; SEEDS=5: 5 minutes, 5 seeds each, in compare_deep_seeds_0-4)
	$(RUN) $(or $(EXPERIMENT),compare_deep)

when: $(DEEP) ## what one must know for tile coding to do: the ladder, in results/when/ (an hour and a half)
	$(RUN) $(or $(EXPERIMENT),when)

suite: $(DEEP) ## the learners beside which your own is shown, in eight scenes, in results/suite/
	$(RUN) $(or $(EXPERIMENT),suite)

bench: $(DEEP) ## an algorithm of your own beside them: make bench ALGO=sb3_contrib:TRPO SETTINGS='learning_rate=1e-3 gamma=0.95' (a quarter of an hour)
	$(PY) -m benchmark bench $(ALGO) --results $(RESULTS) $(if $(SMOKE),--smoke) $(if $(STOCHASTIC),--stochastic) $(if $(SETTINGS),--settings $(SETTINGS))

report: $(BASE) ## the page and the texts of results, from the tables that are there
	$(PY) -m benchmark report --results $(RESULTS)

test: $(DEV) ## the quick tests, in four minutes (TESTS=PATH: some of them)
	$(PYTEST) -m 'not slow' $(TESTS)

test-slow: $(DEV) ## the other tests: older processors, whole experiments, every target of make (six minutes)
	$(PYTEST) -m slow $(TESTS)

check: $(DEV) ## format, lint, types, spelling
	$(PY) -m ruff format --check $(CHECKED)
	$(PY) -m ruff check $(CHECKED)
	$(PY) -m mypy $(CHECKED)
	git ls-files -z --cached --others --exclude-standard -- $(CHECKED) | xargs -0 $(PY) -m codespell_lib

speed: $(DEEP) ## speed against plain Python and Stable-Baselines3, in results/speed/
	OPENBLAS_NUM_THREADS=1 $(PY) -m benchmark speed --results $(RESULTS) $(SPEED)

clean: ## remove installed packages, caches and runs; published results stay
	rm -rf $(VENV) build *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	rm -rf $(RESULTS)/runs.db* $(RESULTS)/index.html $(RESULTS)/*_smoke $(RESULTS)/*_seeds_* $(RESULTS)/bench_* $(RESULTS)/.*.making
	rm -f benchmark/experiments/*_smoke.chosen.json
	find agents benchmark envs tests -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/.base: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=...")'
	$(PYTHON) -m venv $(VENV)
	$(PY) -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[reproduce]'
	@touch $@

# .deep, .dev, or any other extra of pyproject.toml
$(VENV)/.%: $(VENV)/.base
	$(PY) -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[$*]'
	@touch $@
