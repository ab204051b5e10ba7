# Everything one does with the project. The first `make` of any target sets up .venv; later ones start at once.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.stamp
TORCH := torch==2.13.0
MODELS ?= ../shared/models
REFEREE ?= $(wildcard ../shared/referee/quadcheck.py)
LIBRARIES := libegl1 libgl1 libgl1-mesa-dri libglu1-mesa libgomp1 libopengl0 \
	libxcursor1 libxfixes3 libxft2 libxinerama1 libxrender1

export DO_NOT_TRACK := 1
export OMP_NUM_THREADS ?= 2
export OPENBLAS_NUM_THREADS ?= 2
export VTK_DEFAULT_OPENGL_WINDOW ?= vtkEGLRenderWindow

# The linter of compose.yaml, and the browser's driver for `make integration`: from npm, pinned, never committed.
DCLINT := dclint@3.1.0
PLAYWRIGHT := playwright-core@1.65.1

.PHONY: setup faults lint-compose integration bench-flow bench-batch train rl-ablation libraries demo test lint bench extra-bench robustness bench-quality rl-harvest rl-baselines rl-tables train-value judge-value clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	$(MAKE) libraries
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check $(TORCH)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[flow,s3,scale,rl,dev]'
	@echo "compiling kernels, once per installation"
	@folder=$$(mktemp -d) && $(BIN)/drl-meshgen mesh hemisphere --triangles 5000 --target-quads 100 --no-pictures \
		--out $$folder >/dev/null; rm -r $$folder
	touch $@

# System libraries that gmsh, pymeshlab and VTK load; asked for only where some are missing and apt can be used.
libraries:
	@missing=$$(for name in $(LIBRARIES); do dpkg-query -W -f='$${Status}' $$name 2>/dev/null \
		| grep -q 'ok installed' || echo $$name; done); \
	test -z "$$missing" || if command -v apt-get >/dev/null && test "$$(id -u)" = 0; then \
		apt-get update -qq && apt-get install -y -qq --no-install-recommends $$missing; \
	else echo "these system libraries are missing: $$missing"; fi

demo: setup
	$(BIN)/python -m flows.mesh hemisphere giraffe hand --target-quads 8000 --report reports/generated/demo

test: setup
	$(BIN)/python -m pytest

lint: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright
	$(BIN)/lint-imports

# Needs no container engine.
lint-compose:
	@if command -v npx >/dev/null; then npx --yes $(DCLINT) --max-warnings 0 compose.yaml; \
	else echo "compose.yaml is not linted: npx of Node.js is not installed"; fi

# The topology of compose.yaml with real processes: Postgres, server, workers, file server, browser, faults.
INTEGRATION := out/integration
integration: setup
	@missing=$$(command -v chromium >/dev/null || echo chromium; command -v node >/dev/null || echo nodejs npm; \
	ls /usr/lib/postgresql/*/bin/initdb >/dev/null 2>&1 || echo postgresql); \
	test -z "$$missing" || if command -v apt-get >/dev/null && test "$$(id -u)" = 0; then \
		apt-get update -qq && apt-get install -y -qq --no-install-recommends $$missing; \
	else echo "install these packages first:" $$missing; exit 1; fi
	@test -d $(INTEGRATION)/node_modules/playwright-core || npm install --silent --no-audit --no-fund --no-save \
		--no-package-lock --prefix $(INTEGRATION) $(PLAYWRIGHT)
	NODE_PATH=$(CURDIR)/$(INTEGRATION)/node_modules $(BIN)/python -m pytest tests/integration/check_deployment.py -x -v

# What flow and commands cost over the plain library; starts a Prefect server if none answers, computes what is missing.
bench-flow: setup
	$(BIN)/python -m tests.benchmark.flow_cost

# Each runner with a Prefect server, workers and a store of its own; cold, then with all rows kept.
BATCH_MODELS ?= 200
bench-batch: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m flows.bench_batch --models $(BATCH_MODELS) \
		--out out/bench-batch

bench: setup
	$(BIN)/python -m pytest tests/benchmark --benchmark-only --benchmark-columns=min,mean,max,rounds --benchmark-sort=name
	@folder=$$(mktemp -d) && $(BIN)/drl-meshgen mesh giraffe --target-quads 8000 --timings --no-pictures --out $$folder \
		; code=$$?; rm -r $$folder; exit $$code

# Rivals that only the benchmarks need.
extra-bench: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench]'

# All 500 malformed files; the tests take a share of them.
faults: setup
	MALFORMED=500 $(BIN)/python -m pytest tests/faults/test_malformed.py

# An hour and a half, and a quarter of one, on two cores; interrupted, the next `make` goes on. Exit status 1: not every
# surface went through.
robustness: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m drl_meshgen.benchmarks.robustness --resume \
		--models $(MODELS) $(if $(REFEREE),--referee $(REFEREE)) --out docs/benchmarks; code=$$?; \
	$(BIN)/python docs/gallery/hardest.py docs/benchmarks --models $(MODELS) && exit $$code

bench-quality: extra-bench
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m drl_meshgen.benchmarks.quality --resume \
		--models $(MODELS) --out docs/benchmarks

# The policy that comes with the project, from nothing, in 20 minutes on two cores; interrupted, the next call goes on.
# Then the data of the ablations and of the learning figures, ten minutes.
train: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m drl_meshgen.rl.train --out out/train

rl-ablation: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m drl_meshgen.rl.ablation --trained out/train \
		--out docs/benchmarks/rl

# A learner by value or policy gradient: dqn (the paper's), rainbow or ppo. Interrupted, the next call goes on.
LEARNER ?= dqn
MINUTES ?= 60
SEED ?= 0
train-value: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m drl_meshgen.rl.train_value --learner $(LEARNER) \
		--minutes $(MINUTES) --seed $(SEED) --past-convergence --data out/rl/domains --out out/rl/$(LEARNER)

judge-value: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m drl_meshgen.rl.judge_value \
		$(foreach name,dqn rainbow ppo,docs/benchmarks/rl/$(name).safetensors) --out docs/benchmarks/rl

# Domains that the pipeline hands to templates, from every surface; ten minutes.
rl-harvest: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m drl_meshgen.benchmarks.harvest --models $(MODELS) \
		--out docs/benchmarks/rl

# Long searches on the test sets, half an hour on two cores; interrupted, the next call goes on. Then the tables of every
# method, under a quarter of an hour.
rl-baselines: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m drl_meshgen.benchmarks.templates --resume

rl-tables: setup
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m drl_meshgen.benchmarks.rl_tables \
		--out docs/benchmarks/rl --report reports/generated/rl

clean:
	rm -rf build dist out reports/generated .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -path ./$(VENV) -prune -o -name __pycache__ -type d -exec rm -rf {} +
	find artifacts -mindepth 1 -not -name README.md -delete
