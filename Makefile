# Two commands for a newcomer: `make demo` and `make test`. Both do their own set-up in .venv.
# PYTHON=python3.11 chooses another interpreter.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --disable-pip-version-check --quiet -c constraints.txt
SOURCES := pyproject.toml constraints.txt

export HIPPOMAT_DATA ?= $(abspath ../shared/data)
LIDAR := $(HIPPOMAT_DATA)/lidar

.PHONY: demo test lint check bench results fuzz torture golden firmware-native idf-check format clean

demo: $(VENV)/.sim
	$(BIN)/hippomat-sim demo

test: $(VENV)/.dev
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile

lint: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/clang-format --dry-run --Werror $$(git ls-files '*.c' '*.h')

check: lint test

# A missed target ends with an error, after everything was run.
bench: $(VENV)/.dev
	@code=0; run() { echo "$$@"; "$$@" || code=$$?; }; \
	run $(BIN)/python -m benchmarks; \
	run $(BIN)/hippomat-bench plan "$(HIPPOMAT_DATA)"/movingai/*.scen --matrix; \
	for map in random:0.2 random:0.3 warehouse corridors; do run $(BIN)/hippomat-bench motion --map $$map; done; \
	run $(BIN)/hippomat-bench motion --map random:0.2 --loss 0.3 --seeds 1; \
	run $(BIN)/hippomat-bench slam $(LIDAR)/intel_raw_odometry.log.gz --relations $(LIDAR)/intel.relations \
	  --between $(LIDAR)/intel.gfs.log.gz --time-offset 976052857.337284; \
	run $(BIN)/hippomat-bench logs; \
	run $(BIN)/hippomat-bench replay; \
	exit $$code

# docs/results.md, its CSV and its pictures: trains what is missing in build/runs (the paper's networks for one fleet
# size each; STEPS=N agent steps instead of the usual), then measures everything: an hour or two on two cores.
# Interrupted, it goes on where it was. A missed goal is no error here.
results: $(VENV)/.dev
	$(BIN)/hippomat-bench tables --train $(STEPS) --resume --out build/tables --runs build/runs || [ $$? -eq 2 ]
	cp build/tables/results.md build/tables/results.csv build/tables/results_*.png docs/

# 1,000,000 inputs for the firmware's parsers under sanitizers, 1,000,000 for C beside Python (INPUTS=...).
fuzz: $(VENV)/.dev
	bash esp32_firmware/fuzz/run.sh

# 1,000 cut logs, 1,000 flipped bits, 50 kills, 100 pulled plugs, a full disk: what is left of the log (10 minutes).
torture: $(VENV)/.dev
	PYTHONPATH=tests $(BIN)/python tests/logs/torture.py

# tests/golden/runs recorded anew, where the log's format changed: make golden REASON='...' (docs/replay.md).
golden: $(VENV)/.dev
	$(BIN)/python tests/golden/record_runs.py --reason "$(REASON)"

# The tests of `pio test -e native`, where PlatformIO cannot fetch its test framework.
FIRMWARE := esp32_firmware
firmware-native:
	@mkdir -p build
	$${CC:-cc} -std=gnu11 -g -Wall -Wextra -Werror -I tests/firmware/unity_stub -I $(FIRMWARE)/lib/radio_core \
	  $(FIRMWARE)/test/*/*.c $(FIRMWARE)/lib/radio_core/*.c -o build/firmware-native
	build/firmware-native

# IDF_PATH=... : the firmware against the headers of a real ESP-IDF. esp32_firmware/README.md
idf-check: $(BIN)/python
	@$(PIP) 'esp-idf-kconfig<3'
	$(BIN)/python $(FIRMWARE)/tools/idf_check.py

format: $(VENV)/.dev
	$(BIN)/ruff check --fix --exit-zero .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $$(git ls-files '*.c' '*.h')

clean:
	rm -rf $(VENV) build dist runs

# The set-up. Every missing piece is one line that says what to install.
$(BIN)/python:
	@command -v $(PYTHON) >/dev/null || \
	  { echo "make: $(PYTHON) was not found: install it (Debian: apt install python3 python3-venv)" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	  { echo "make: $(PYTHON) has no venv module: apt install python3-venv" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 11))' || \
	  { echo "make: $(PYTHON) is $$($(PYTHON) -V): pybullet has wheels for Python 3.10 and 3.11 only;" \
	    "choose one with 'make PYTHON=python3.11 ...'" >&2; exit 1; }
	@echo "Setting up $(VENV) (once; about a minute)"
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.sim: $(BIN)/python $(SOURCES)
	@$(PIP) -e '.[sim]'
	@command -v "$${CC:-cc}" >/dev/null || command -v gcc >/dev/null || command -v clang >/dev/null || \
	  { echo "No C compiler found: installing the one that the package ziglang carries"; $(PIP) ziglang; }
	@touch $@

$(VENV)/.dev: $(VENV)/.sim
	@$(PIP) -e '.[dev]'
	@touch $@
