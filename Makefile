PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed

.PHONY: setup demo test test-all lint speed sample leaderboard clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=python3.11 ...")'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet -c constraints.txt torch==2.13.0
	$(BIN)/pip install --quiet -c constraints.txt -e ".[build,cluster,dev]"
	touch $@

demo: setup
	$(BIN)/python demo.py

test: setup
	$(BIN)/pytest -n 2 -m "not slow"

test-all: setup
	$(BIN)/pytest -n 2

lint: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	PYTHONPATH=benchmarks:baselines:builder $(BIN)/lint-imports
	$(BIN)/xden-bench leaderboard --check
	rm -rf build/wheel
	$(BIN)/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir build/wheel .
	$(BIN)/check-wheel-contents build/wheel/*.whl

speed: setup
	$(BIN)/xden-build speed
	$(BIN)/xden-bench speed

# Each category of the test split is in the training split too, and new categories change nothing.
CATEGORIES := remote_control,scissors,pliers,smartphone,ballpoint_pen,electric_toothbrush,water_bottle,thermos,hammer,mug,power_drill,dumbbell
SAMPLE := --count 24 --seed 0 --size 192 --categories $(CATEGORIES)

sample: setup  # remake the packaged sample, then: make leaderboard
	$(BIN)/xden-build phantoms xden1k/sample --as-dataset $(SAMPLE)
	$(BIN)/pytest --quiet tests/xden1k/test_manual.py --update-golden

ROWS := build/rows

leaderboard: setup  # enter the rows of the packaged sample; entries that are there are refused
	rm -rf $(ROWS)
	$(BIN)/xden-build phantoms $(ROWS)/captures $(SAMPLE)
	$(BIN)/xden-build run $(ROWS)/captures --out $(ROWS)/dataset
	for name in zero water train-median category-median; do \
	  $(BIN)/xden-bench baseline $$name --out $(ROWS)/$$name.npz && \
	  $(BIN)/xden-bench submit $(ROWS)/$$name.npz || exit 1; \
	done
	$(BIN)/xden-bench baseline root --from $(ROWS)/dataset --out $(ROWS)/root.npz
	$(BIN)/xden-bench submit $(ROWS)/root.npz
	$(BIN)/xden-bench leaderboard

clean:
	rm -rf .venv .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis demo-output build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
