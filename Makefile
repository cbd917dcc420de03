# The project's commands. Each sets up .venv by itself; `make` alone lists them.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
# Stages run with the PATH's python: let it be ours.
export PATH := $(CURDIR)/.venv/bin:$(PATH)
WORKERS ?= 2

.venv/installed: requirements.lock pyproject.toml .ci/setup
	@.ci/setup

.PHONY: help
help: ## list these commands
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 27

.PHONY: setup
setup: .venv/installed ## make .venv and nothing else (the commands below do it by themselves)

.PHONY: repro
repro: .venv/installed ## run the pipeline (what changed of it) and end with the report's path and five figures
	@python -m stages.check
	@dvc repro
	@python -m stages.headline

.PHONY: test
test: .venv/installed ## run the tests
	@pytest -n $(WORKERS) --dist worksteal

.PHONY: bounds
bounds: .venv/installed ## run the rod's tests with every index of a kernel held against its array
	@QD_DEBUG=1 pytest -n $(WORKERS) --dist worksteal tests/sim

.PHONY: lint
lint: .venv/installed ## ruff, mypy strict on dlolib and stages, import layers
	@ruff check .
	@ruff format --check .
	@mypy
	@lint-imports

.PHONY: compare
compare: .venv/installed ## hold this tree's metrics against the committed ones, each within its tolerance
	@python -m stages.compare

.PHONY: calibrate
calibrate: .venv/installed ## camera and obstacles from boards and markers in DATA=DIR, into CAPTURE=DIR where given
	@[ -n "$(DATA)" ] || { echo "make calibrate: DATA is not set; say where the frames lie: make calibrate DATA=DIR" >&2; exit 2; }
	@python -m stages.calibrate "$(DATA)" $(if $(CAPTURE),"$(CAPTURE)")

.PHONY: cables
cables: .venv/installed ## identify the four real cables in DATA=DIR and write reports/cables.json
	@[ -n "$(DATA)" ] || { echo "make cables: DATA is not set; say where the recordings lie: make cables DATA=DIR" >&2; exit 2; }
	@python -m stages.cables "$(DATA)"

.PHONY: sweeps
sweeps: .venv/installed ## diagnose two sweeps and settled poses of one real cable in DATA=DIR together, or CASE=...: reports/sweeps.json
	@[ -n "$(DATA)" ] || { echo "make sweeps: DATA is not set; say where the recordings lie: make sweeps DATA=DIR" >&2; exit 2; }
	@python -m stages.sweeps "$(DATA)" $(CASE)

.PHONY: clouds
clouds: COUNT = 300
clouds: .venv/installed ## chains of the real clouds in DATA=DIR, and of COUNT=300 laid out anew with crossings: reports/clouds.json
	@[ -n "$(DATA)" ] || { echo "make clouds: DATA is not set; say where the captures lie: make clouds DATA=DIR" >&2; exit 2; }
	@python -m stages.clouds "$(DATA)" "$(COUNT)"

.PHONY: deform
deform: .venv/installed ## fit two cables swung fast by two arms, in DATA=DIR, and foretell others open loop: reports/deform.json
	@[ -n "$(DATA)" ] || { echo "make deform: DATA is not set; say where the recordings lie: make deform DATA=DIR" >&2; exit 2; }
	@python -m stages.deform "$(DATA)" $(CASE)

.PHONY: elastic
elastic: .venv/installed ## the laboratory with an elastic rope: is the EI that comes out the one that went in?
	@python -m stages.elastic

.PHONY: solvers
solvers: .venv/installed ## the paper's iterative solver beside the direct one on an exactly known rope (5 minutes)
	@python -m stages.solvers

.venv/bench: requirements-bench.lock .venv/installed
	@python -m pip --disable-pip-version-check --no-input install -qq --no-compile --require-hashes -r $<
	@touch $@

.PHONY: bench
bench: .venv/bench ## how fast and how right the rod is, beside its peers: reports/bench.json (4 minutes); KEYS=... for some
	@python -m stages.bench $(KEYS)

.PHONY: chain-bench
chain-bench: .venv/installed ## the chain on rendered ropes of known axis: reports/chain_bench.json (8 minutes)
	@python -m stages.chain_bench $(CASES)

COUNT ?= 10000
.PHONY: robustness
robustness: .venv/installed ## COUNT=10000 random roll-outs of the rod: reports/robustness.json (half an hour)
	@python -m stages.robustness "$(COUNT)"

.PHONY: damaged
damaged: COUNT = 500
damaged: .venv/installed ## COUNT=500 damaged recordings of every source: reports/damaged.json (a minute)
	@python -m stages.damaged "$(COUNT)"

SHARDS ?= 1
SIZE ?= 50
.PHONY: proof
proof: .venv/installed ## the blind proof: SHARDS of SIZE recordings drawn from secret seeds, diagnosed and scored
	@python -m stages.proof --shards $(SHARDS) --size $(SIZE)

.PHONY: proof-without
proof-without: .venv/installed ## what was found alone once more, its effect taken out of the library [ONLY="shard ..."]
	@python -m stages.proof --without $(ONLY)

.PHONY: proof-same
proof-same: .venv/installed ## whether this version of what diagnoses is judged as that of SHARD="shard_...", in all or but for intervals
	@python -m stages.proof_same $(SHARD)

.PHONY: proof-calibration
proof-calibration: .venv/installed ## recordings of the proof's laboratory with their answers, to set thresholds by
	@python -m stages.proof --calibration

.PHONY: proof-refinement
proof-refinement: .venv/installed ## what a finer laboratory with harder obstacles would change
	@python -m stages.proof_refinement

.PHONY: proof-sizes
proof-sizes: COUNT = 100
proof-sizes: .venv/installed ## COUNT=100 effects planted at exactly the size that `detectable` names (3 hours)
	@python -m stages.proof_sizes --count "$(COUNT)"

.PHONY: proof-screen
proof-screen: SEED = 1
proof-screen: COUNT = 12
proof-screen: .venv/installed ## what the screen of pairs misses, on COUNT=12 recordings of the calibration of SEED=1
	@python -m stages.proof_screen --seed "$(SEED)" --count "$(COUNT)"

.PHONY: proof-touch
proof-touch: SEED = 1
proof-touch: COUNT = 20
proof-touch: NULLS = 60
proof-touch: .venv/installed ## how hidden obstacles are found in COUNT=20 recordings, and by chance in NULLS=60 (an hour)
	@python -m stages.proof_touch --seed "$(SEED)" --count "$(COUNT)" --nulls "$(NULLS)"

.PHONY: proof-images
proof-images: COUNT = 40
proof-images: .venv/installed ## COUNT=40 recordings as of the proof, but from rendered depth images (2 hours)
	@python -m stages.proof_images --count "$(COUNT)"

.PHONY: proof-next
proof-next: .venv/installed ## the motions that ties of the scored shards ask for, played and diagnosed with the first recording [ONLY="shard ..."]
	@python -m stages.proof_next --only $(ONLY)

.PHONY: proof-heldout
proof-heldout: .venv/installed ## whether the laboratory's own rope foretells the held-out frames of the scored shards [ONLY="shard ..."]
	@python -m stages.proof_heldout --only $(ONLY)

.PHONY: practice
practice: .venv/installed ## diagnose recordings in DATA=DIR whose truth.json lies beside them, and score them
	@[ -n "$(DATA)" ] || { echo "make practice: DATA is not set; say where the recordings lie: make practice DATA=DIR" >&2; exit 2; }
	@python -m stages.concealed practice "$(DATA)"

.PHONY: sealed
sealed: .venv/installed ## diagnose recordings in DATA=DIR whose answers are kept elsewhere: reports/sealed, made once
	@[ -n "$(DATA)" ] || { echo "make sealed: DATA is not set; say where the recordings lie: make sealed DATA=DIR" >&2; exit 2; }
	@python -m stages.concealed sealed "$(DATA)"

.PHONY: validation
validation: .venv/installed ## the rod against theory: docs/validation.md and its figures
	@python -m stages.validation

.PHONY: agreement
agreement: COUNT = 3
agreement: .venv/installed ## `dlo simulate` of every effect, COUNT=3 ropes each, against the proof's laboratory: reports/agreement.json
	@python -m stages.agreement "$(COUNT)"

.PHONY: lock
lock: ## pin requirements.lock anew from pyproject.toml (needs uv)
	@uv pip compile --quiet --universal --fork-strategy fewest --python-version 3.11 --generate-hashes \
		--no-annotate --no-header --extra dev --upgrade pyproject.toml --output-file requirements.lock
	@printf "%s\n" "cosseratbench>=0.3,<0.4" "pyelastica>=1,<2" | uv pip compile --quiet --universal --python-version 3.11 \
		--generate-hashes --no-annotate --no-header --constraint requirements.lock - --output-file requirements-bench.lock
