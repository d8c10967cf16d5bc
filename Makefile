# Everything happens in .venv; "make setup" makes it once and costs nothing when nothing changed.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready

PYTHON312 ?= python3.12
# Some tests wait for other processes, so three workers pay on two cores; a file stays with one. Small
# matrices in several threads each would only wait for one another.
export OPENBLAS_NUM_THREADS = 1
export OMP_NUM_THREADS = 1
# Hundreds of processes start: where nothing compiled is kept, each compiles the package again.
unexport PYTHONDONTWRITEBYTECODE
# A worker that crashes ends the run and names its test: xdist hangs where it replaces one (its issue 1327).
PYTEST := python -m pytest -n 3 --dist loadfile --no-loadscope-reorder --max-worker-restart 0

.PHONY: setup demo test test-noble colcon mutants lint docs bench reliability lock clean

setup: $(READY)

$(READY): setup.py pyproject.toml requirements/lock.txt requirements/noble.txt requirements/setup.sh
	sh requirements/setup.sh '$(PYTHON)'
	touch $@

demo: $(READY)
	$(BIN)/wrist_ft_comp demo

test: $(READY)
	$(BIN)/$(PYTEST)

# The suite with the versions that Ubuntu 24.04 has, or what NOBLE leaves of it. The stamp is no part of
# build/noble itself.
test-noble: build/.noble
	build/noble/bin/$(PYTEST) $(NOBLE)

build/.noble: setup.py requirements/lock.txt requirements/noble.txt requirements/noble.sh
	sh requirements/noble.sh '$(PYTHON312)'
	touch $@

# A workspace's build of this package, and what it installs.
colcon: build/.colcon
	PATH="$(CURDIR)/build/colcon/bin:$$PATH" $(BIN)/python -m pytest test/node/test_colcon.py

# Do the tests of model and stream notice small changes? Takes over an hour.
mutants: build/.mutants
	$(BIN)/python bench/mutants.py

build/.colcon build/.mutants: build/.%: $(READY) requirements/%.txt requirements/overlay.sh
	sh requirements/overlay.sh $*
	touch $@

# Packages of messages for tests over DDS; without it these tests skip. Takes two minutes.
build/.messages: $(READY) requirements/messages.txt requirements/messages.sh requirements/overlay.sh \
    test/support/messages/CMakeLists.txt $(wildcard test/support/messages/*/*.msg)
	sh requirements/messages.sh
	touch $@

# docs/interface.md from the code.
docs: $(READY)
	$(BIN)/python docs/generator/interface.py > docs/interface.new
	mv docs/interface.new docs/interface.md

lint: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/flake8
	$(BIN)/mypy

bench: $(READY)
	$(BIN)/python bench/accuracy/contacts.py
	$(BIN)/python bench/accuracy/worlds.py
	$(BIN)/python bench/cost/stream.py
	$(BIN)/python bench/accuracy/identify.py
	$(BIN)/python bench/cost/memory.py
	$(BIN)/python bench/cost/footprint.py

# What docs/reliability.md is made from; most of an hour.
reliability: $(READY)
	$(BIN)/python bench/faults pauses
	$(BIN)/python bench/faults fuzz
	$(BIN)/python bench/faults kills
	$(BIN)/python bench/faults learning_kills 200
	$(BIN)/python bench/faults restart
	$(BIN)/python bench/faults endurance --fault 'node killed'
	$(BIN)/python bench/faults endurance
	$(BIN)/python bench/faults/thermometers.py
	$(BIN)/python bench/faults/truth.py --hours 120

# Solves for the newest versions that Python 3.10 can run; 3.11 to 3.13 run them, too.
lock:
	sh requirements/lock.sh '$(PYTHON)'

clean:
	rm -rf .venv build install log out *.egg-info
