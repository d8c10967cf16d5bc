# Everything happens in .venv; "make setup" makes it once and costs nothing when nothing changed.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready

.PHONY: setup demo test lint bench reliability lock clean

setup: $(READY)

$(READY): setup.py pyproject.toml requirements/lock.txt requirements/noble.txt requirements/setup.sh
	sh requirements/setup.sh '$(PYTHON)'
	touch $@

demo: $(READY)
	$(BIN)/wrist_ft_comp demo

test: $(READY)
	$(BIN)/python -m pytest

lint: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

bench: $(READY)
	$(BIN)/python bench/reading.py
	$(BIN)/python bench/accuracy.py
	$(BIN)/python bench/identification.py
	$(BIN)/python bench/stream.py

# What docs/reliability.md is made from; half an hour.
reliability: $(READY)
	$(BIN)/python bench/pauses.py
	$(BIN)/python bench/fuzz.py
	$(BIN)/python bench/kills.py
	$(BIN)/python bench/endurance.py

# Solves for the newest versions that Python 3.10 can run; 3.11 to 3.13 run them, too.
lock:
	sh requirements/lock.sh '$(PYTHON)'

clean:
	rm -rf .venv build install log out *.egg-info
