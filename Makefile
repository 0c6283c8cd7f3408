# Handrail: `make demo` turns the valve, `make test` runs all tests. Both set up whatever is missing.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ready
WARM := $(VENV)/.warm
KERNELS := handrail/compiled.py $(shell grep -rlE --include='*.py' '^@(compiled|njit)' hal daemon engines)
ARGS ?=

# Containers often set it: each of the hundreds of processes that the tests start would read every library's sources anew, uv leaves none compiled.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test soak screenshots setup lint format lock clean help

help:            ## this text
	@sed -n 's/^\([a-z]*\): .*## /  make \1: /p' $(MAKEFILE_LIST)

demo: $(WARM)   ## the whole stack turns a valve: make demo ARGS="--view --seeds 3"
	$(BIN)/handrail demo $(ARGS)

test: $(WARM)   ## lint, types, floors and every test (under 15 minutes on 2 cores)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
ifeq ($(strip $(ARGS)),)
	$(BIN)/mypy & types=$$!; $(BIN)/python tools/run_tests.py -m "not soak and not stack" -n 3 --dist loadfile --no-loadscope-reorder; \
	  tests=$$?; wait $$types && exit $$tests
	$(BIN)/python tools/run_tests.py -m "stack and not soak" -n 2 --dist worksteal tests/hil/test_campaign.py tests/stack
else
	$(BIN)/mypy
	$(BIN)/python -m pytest -m "not soak" $(ARGS)
endif

soak: $(WARM)   ## what takes longer: an hour of robot time, twenty seeds, two hundred faults, a start without compiled kernels; goes on where it was
	$(BIN)/python tools/soak.py $(ARGS)

screenshots: $(WARM)  ## every page of the operator's window, from a live simulated robot, into docs/images/tablet
	$(BIN)/python tools/screenshots.py

setup: $(WARM)  ## only set up: system packages, the venv from the lock file, warm compiled kernels

$(STAMP): requirements.lock pyproject.toml tools/setup.sh
	PYTHON=$(PYTHON) VENV=$(VENV) bash tools/setup.sh
	touch $@

# For a quick first start only: kernels that changed are compiled anew by whoever needs them first (handrail/compiled.py).
$(WARM): $(STAMP) $(KERNELS) tools/warm_up.py
	$(BIN)/python tools/warm_up.py
	touch $@

lint: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

lock: $(STAMP)   ## write requirements.lock anew from pyproject.toml
	$(BIN)/uv pip compile pyproject.toml --all-extras --python-version 3.11 --generate-hashes --no-header \
	  --no-emit-index-url --annotation-style line --upgrade -q -o requirements.lock

clean:           ## remove the environment and everything that was made
	rm -rf $(VENV) demo_output .pytest_cache .ruff_cache .hypothesis
