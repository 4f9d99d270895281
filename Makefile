# make demo: two vehicles meet.  make test: the test suite.  Both set everything up first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: install browser demo test lint type bench bench-engine clean

install: $(VENV)/installed

$(VENV)/installed: setup.py constraints.txt
	sh .ci/debian-packages
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q --disable-pip-version-check "torch>=2.4" -c constraints.txt
	$(BIN)/pip install -q --disable-pip-version-check -e ".[ros,test,dev]" -c constraints.txt
	touch $@

demo: install
	$(BIN)/python -m gcl_ros.demo --out build/demo

test: install browser
	$(BIN)/python -m pytest

browser:  # the report is opened in it
	sh .ci/debian-packages test

lint: install
	$(BIN)/ruff check . && $(BIN)/ruff format --check .

type: install
	$(BIN)/mypy gcl_core

# Run it when nothing else runs: make bench DATA=folder of recorded drives in KITTI's layout.
bench: install
	test -d build/kiss || $(BIN)/pip install -q --disable-pip-version-check --no-deps \
		--target build/kiss kiss-matcher
	PYTHONPATH=build/kiss $(BIN)/python -m gcl_core.bench.results $(if $(DATA),--data $(DATA))

# Run it when nothing else runs.  spconv goes to a folder of its own, for this comparison only.
bench-engine: install
	test -d build/spconv || $(BIN)/pip install -q --disable-pip-version-check --no-deps \
		--target build/spconv spconv cumm pccm ccimport pybind11 fire termcolor lark portalocker ninja
	PYTHONPATH=build/spconv $(BIN)/python -m gcl_core.bench.engine --out bench/engine.json

clean:
	rm -rf $(VENV) build install log *.egg-info
