# make demo: two vehicles meet.  make test: the test suite.  Both set everything up first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: install demo test lint type bench-engine bench-age clean

install: $(VENV)/installed

$(VENV)/installed: setup.py constraints.txt
	sh .ci/debian-packages
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q --disable-pip-version-check "torch>=2.4" -c constraints.txt
	$(BIN)/pip install -q --disable-pip-version-check -e ".[ros,test,dev]" -c constraints.txt
	touch $@

demo: install
	$(BIN)/python -m gcl_ros.demo --out build/demo

test: install
	$(BIN)/python -m pytest

lint: install
	$(BIN)/ruff check . && $(BIN)/ruff format --check .

type: install
	$(BIN)/mypy gcl_core

# Run it when nothing else runs.  spconv goes to a folder of its own, for this comparison only.
bench-engine: install
	test -d build/spconv || $(BIN)/pip install -q --disable-pip-version-check --no-deps \
		--target build/spconv spconv cumm pccm ccimport pybind11 fire termcolor lark portalocker ninja
	PYTHONPATH=build/spconv $(BIN)/python -m gcl_core.bench.engine --out bench/engine.json

# Likewise; MINUTES=30 for the memory of a long run.
bench-age: install
	$(BIN)/python -m gcl_ros.bench_age --out build/age --minutes $(or $(MINUTES),1)

clean:
	rm -rf $(VENV) build install log *.egg-info
