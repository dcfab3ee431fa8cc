# make race     the shipped policies race: result table, race.png, and race.html to watch it in a browser
# make test     every test
# make firmware builds Betaflight, so that it can fly in the loop: gcc, make, a minute, 236 MB
# make sb3      installs Stable-Baselines3 with PyTorch, trains its PPO on the ring and measures it
# make policies trains the shipped policies anew, about an hour on 2 cores
# make check    formatting, lint, types, import layers
# make pictures draws the pictures of the README and of the replay page anew; needs Chromium
# make peers    installs other libraries, in environments of their own, and times CRUISE beside them
# make clients  installs other learning libraries, with PyTorch, and runs each on the races as its documentation says
# make wheel-check  installs the wheel on every Python that is here and flies a race by it: elsewhere, as nobody, offline
# make speed    compares how fast this state and the commit before are, in turn
# make docs     builds the documentation into build/site
# make viewer   builds the replay page anew from viewer/; needs npm
# Each makes .venv first, with the versions of constraints.txt. PYTHON=... chooses the interpreter (3.11 to 3.14).

SUPPORTED := import sys, venv, ensurepip; sys.exit(not (3, 11) <= sys.version_info < (3, 15))
PYTHON ?= $(firstword $(foreach p,python3.13 python3.12 python3.11 python3.14 python3 python,$(shell $(p) -c '$(SUPPORTED)' 2>/dev/null && echo $(p))))
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable
# Two cores are enough; more workers than cores only compile the same programs more often.
WORKERS ?= 2

.DEFAULT_GOAL := help
.PHONY: help race test check firmware sb3 clients wheel-check viewer check-viewer peers speed policies pictures docs clean

help:
	@sed -n 's/^# \(make .*\)/\1/p' Makefile

race: $(VENV)/.installed
	@$(BIN)/cruise race --vehicle racer --open

test: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder --durations=25

check: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

viewer:
	cd viewer && npm ci --silent && npm run --silent build

docs: $(VENV)/.installed-dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# With the commit before, or with BASE=...
speed: $(VENV)/.installed-dev
	@$(BIN)/python -m benchmarks.against $(or $(BASE),HEAD~1) --rounds $(or $(ROUNDS),2)

pictures: $(VENV)/.installed-dev
	$(BIN)/cruise race --html None --png docs/images/race.png
	$(BIN)/cruise race --vehicle racer --track uzh-2026 --drones 8 --seed 3 --html None --png docs/images/uzh-2026.png
	$(BIN)/cruise race --html None --png None --seed 2 --gif docs/images/race.gif --clip 0 14
	$(BIN)/python -m docs.draw_replay

# The committed page is the one that viewer/ builds.
check-viewer:
	cd viewer && npm ci --silent && npm run --silent check

sb3: $(VENV)/.installed-sb3
	@$(BIN)/python examples/train_sb3.py

# Brax and the others pull in much that CRUISE's own environment need not hold; Crazyflow excludes its version of JAX.
peers: .venv-peers/.installed .venv-crazyflow/.installed
	@.venv-peers/bin/python -m benchmarks.peers --rounds $(or $(ROUNDS),5)

# Some of them exclude each other's versions of Gymnasium. JAXMARL=... names a clone of JaxMARL, whose IPPO then runs.
CLIENTS.torch := stable-baselines3==2.9.2 sb3-contrib==2.9.2 sbx-rl==0.28.0 skrl==2.1.1 SuperSuit==3.11.0 torchrl==0.14.1
CLIENTS.tianshou := tianshou==2.0.1
CLIENTS.rllib := 'ray[rllib]==2.60.0'
CLIENTS.agile := agilerl==2.7.1
CLIENTS.jaxmarl := jaxmarl==0.2.0 gymnax==1.0.1 distrax==0.1.9 hydra-core==1.3.8 wandb==0.31.0
CLIENT_GROUPS := torch tianshou rllib agile jaxmarl

clients: $(CLIENT_GROUPS:%=.venv-clients-%/.installed)
	@for group in $(CLIENT_GROUPS); do .venv-clients-$$group/bin/python -m benchmarks.clients $$group || exit 1; done

.venv-clients-%/.installed: pyproject.toml
	$(PYTHON) -m venv .venv-clients-$*
	.venv-clients-$*/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[gym]' torch==2.13.0 $(CLIENTS.$*)
	@touch $@

# The wheel on every Python that is here, as its users install it.
wheel-check: $(VENV)/.installed
	@$(BIN)/python -m benchmarks.wheel

.venv-peers/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv-peers
	.venv-peers/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable \
	    '.[gym,rotorpy]' stable-baselines3==2.9.2 torch==2.13.0 sbx-rl==0.28.0 brax==0.14.2 torchdiffeq==0.2.5 roma==1.8.0
	@touch $@

.venv-crazyflow/.installed:
	$(PYTHON) -m venv .venv-crazyflow
	.venv-crazyflow/bin/python -m pip install --quiet --disable-pip-version-check crazyflow==0.4.0 jax==0.10.1
	@touch $@

CELLS := ring-2 ring-3 ring-4 figure-eight-2 figure-eight-3 figure-eight-4 racer-ring racer-figure-eight \
    racer-figure-eight-field racer-ring-sturdy racer-figure-eight-sturdy generalist racer-uzh-2026 kolibri-uzh-2026 \
    crazyflie-ring

policies: $(VENV)/.installed $(CELLS:%=runs/%/policy.json)
	@for cell in $(CELLS); do for kind in safetensors json; do \
	  cp runs/$$cell/policy.$$kind src/cruise/policies/$$cell.$$kind; done; done

# Trained while speed counted from v_min.
EXTRA.ring-2 := --speed-zero-at v_min --w-speed 0.005 --learning-rate 2e-3 --final-learning-rate 2e-4
EXTRA.ring-4 := --speed-zero-at v_min --w-speed 0.005 --episode-steps 600
# As fast as the paper's, from the last stage alone: speed is worth more, a crash costs less.
FAST := --speed-zero-at v_min --episode-steps 600 --vanilla --terminal -5
EXTRA.ring-3 := $(FAST)
EXTRA.figure-eight-3 := $(FAST)
EXTRA.figure-eight-4 := $(FAST)
# And nearer to the frames.
EXTRA.figure-eight-2 := $(FAST) --w-speed 0.01 --edge-margin 0.1 --seed 2
# VEHICLE-TRACK: for fields of any size, but racer-figure-eight, which is for a drone alone.
# VEHICLE-TRACK-field: for fields where VEHICLE-TRACK is for a drone alone.
# Made before the recipe of today: it sees less, is judged with no more sight, and starts anew after every crash.
FORMER := --critic-observation '' --value-loss absolute --retry-share 0 --after-crash restart --w-beside 0
BODY := --observation body $(FORMER)
# Of fields one drone learned, against copies of before; what a line says behind it counts.
ONE_LEARNS := --learners one --races 512 --epochs 4 --final-learning-rate 1e-4 --average-updates 0 --evaluate-every 500000 \
    --nominal-share 0
# racer-ring goes on from racer-ring-first on the last stage alone, in smaller steps.
TRAIN.racer-ring-first := $(ONE_LEARNS) --vehicle racer --track ring --drones 8 --step-scale 2.25 --gae-lambda 0.95 $(BODY)
TRAIN.racer-ring := $(ONE_LEARNS) --vehicle racer --track ring --drones 8 --step-scale 0.75 --vanilla \
    --start-from runs/racer-ring-first --learning-rate 3e-4 --final-learning-rate 3e-5 --gae-lambda 0.95 $(BODY)
runs/racer-ring/policy.json: runs/racer-ring-first/policy.json
# What a way through one gate costs shows later than on the ring, so advantages look farther ahead.
TRAIN.racer-figure-eight-first := --vehicle racer --track figure-eight --drones 1 --seed 1 --gae-lambda 0.98 $(BODY)
TRAIN.racer-figure-eight := --vehicle racer --track figure-eight --drones 1 --seed 1 --gae-lambda 0.98 --vanilla \
    --step-scale 0.5 --start-from runs/racer-figure-eight-first --learning-rate 3e-4 --final-learning-rate 3e-5 \
    --terminal -40 --w-edge 20 $(BODY)
runs/racer-figure-eight/policy.json: runs/racer-figure-eight-first/policy.json
# Six gates, no two alike: after six seconds drones have flown one lap, and the second is faster. What learned in short
# episodes crashed in it; what never met a race without any deviation crashed there.
FIELD := $(ONE_LEARNS) --vehicle racer --track figure-eight --drones 8 --gae-lambda 0.98 $(FORMER)
ON_AND_ON := $(FIELD) --vanilla --episode-steps 600 --w-edge 20
TRAIN.racer-figure-eight-field-first := $(FIELD) --observation body --step-scale 4 --terminal -30 --milder-share 0.5
TRAIN.racer-figure-eight-field-second := $(ON_AND_ON) --observation body --start-from runs/racer-figure-eight-field-first \
    --step-scale 1.5 --terminal -40 --learning-rate 3e-4 --final-learning-rate 3e-5 --milder-share 0.5
runs/racer-figure-eight-field-second/policy.json: runs/racer-figure-eight-field-first/policy.json
TRAIN.racer-figure-eight-field-third := $(ON_AND_ON) --observation body --start-from runs/racer-figure-eight-field-second \
    --step-scale 1.5 --terminal -40 --learning-rate 2e-4 --final-learning-rate 2e-5 --nominal-share 0.5
runs/racer-figure-eight-field-third/policy.json: runs/racer-figure-eight-field-second/policy.json
# Safe by now, but slow: a cheaper crash; who leads sees nobody behind; what lines are worth is not drowned by crashes.
FASTER := $(ON_AND_ON) --final-learning-rate 2e-5 --terminal -20 --nominal-share 0.5
TRAIN.racer-figure-eight-field-fourth := $(FASTER) --observation body --start-from runs/racer-figure-eight-field-third \
    --step-scale 1.5 --learning-rate 2e-4
runs/racer-figure-eight-field-fourth/policy.json: runs/racer-figure-eight-field-third/policy.json
TRAIN.racer-figure-eight-field-fifth := $(FASTER) --start-from runs/racer-figure-eight-field-fourth \
    --step-scale 1.5 --learning-rate 3e-4 --observation body-near
runs/racer-figure-eight-field-fifth/policy.json: runs/racer-figure-eight-field-fourth/policy.json
TRAIN.racer-figure-eight-field := $(FASTER) --start-from runs/racer-figure-eight-field-fifth \
    --step-scale 1 --learning-rate 2e-4 --observation body-near --company-distance 6
runs/racer-figure-eight-field/policy.json: runs/racer-figure-eight-field-fifth/policy.json
# For all that a real drone may differ by. The first, which met nothing milder, crashed in every ninth race without any of it.
STURDY := $(ONE_LEARNS) --vehicle racer --vanilla --randomise 1 --final-learning-rate 3e-5 $(BODY)
TRAIN.racer-ring-sturdy-first := $(STURDY) --gae-lambda 0.95 --track ring --drones 8 --step-scale 2 --start-from racer-ring \
    --learning-rate 6e-4
TRAIN.racer-ring-sturdy := $(STURDY) --gae-lambda 0.95 --track ring --drones 8 --step-scale 1 --start-from runs/racer-ring-sturdy-first \
    --learning-rate 3e-4 --milder-share 0.5
runs/racer-ring-sturdy/policy.json: runs/racer-ring-sturdy-first/policy.json
TRAIN.racer-figure-eight-sturdy := $(STURDY) --track figure-eight --drones 1 --step-scale 1.5 --gae-lambda 0.98 \
    --start-from racer-figure-eight --learning-rate 6e-4
# The recipe of today, on tracks that are drawn anew for ever.
TRAIN.generalist := --vehicle racer --track any --drones 1 --step-scale 2 --epochs 2 --final-learning-rate 2e-5 --terminal -10 \
    --evaluate-every 2000000 --average-updates 80
# The same for a field, on the benchmark of the University of Zurich.
TRAIN.racer-uzh-2026 := --vehicle racer --track uzh-2026 --drones 8 --step-scale 3
TRAIN.kolibri-uzh-2026 := --vehicle kolibri --track uzh-2026 --drones 8 --step-scale 3
# Trained before frames cost more and partners were more.
TRAIN.crazyflie-ring := $(ONE_LEARNS) --vehicle crazyflie --track ring --drones 4 --edge-margin 0.2 --w-edge 10 --sparring-share 0.1 \
    --gae-lambda 0.95 $(BODY)
TRACK_AND_DRONES = --track $(shell echo $* | sed 's/-[0-9]*$$//') --drones $(lastword $(subst -, ,$*))

runs/%/policy.json:
	$(BIN)/cruise train $(or $(TRAIN.$*),$(TRACK_AND_DRONES)) --out runs/$* $(EXTRA.$*)

clean:
	rm -rf $(VENV) .jax_cache .mypy_cache .pytest_cache .ruff_cache .hypothesis

$(VENV)/.made:
	@$(if $(PYTHON),,echo "error: no Python 3.11 to 3.14 with the modules venv and ensurepip found; name one with make PYTHON=/path/to/python3" >&2; exit 1)
	@"$(PYTHON)" -c '$(SUPPORTED)' 2>/dev/null || { echo "error: $(PYTHON) is not Python 3.11 to 3.14 with the modules venv and ensurepip" >&2; exit 1; }
	"$(PYTHON)" -m venv --clear $(VENV)
	@touch $@

$(VENV)/.installed: $(VENV)/.made pyproject.toml constraints.txt
	@echo "Installing CRUISE into $(VENV): a minute or two, once."
	@$(INSTALL) . openskill
	@touch $@

firmware: $(VENV)/.installed
	@$(INSTALL) '.[betaflight]'

$(VENV)/.installed-sb3: $(VENV)/.installed
	@echo "Installing Stable-Baselines3 and PyTorch into $(VENV): some minutes, once."
	@$(INSTALL) '.[gym]' 'stable-baselines3==2.9.2' 'torch==2.13.0'
	@touch $@

$(VENV)/.installed-dev: $(VENV)/.made pyproject.toml constraints.txt
	@echo "Installing CRUISE and its development tools into $(VENV): a minute or two, once."
	@$(INSTALL) '.[dev]'
	@touch $@ $(VENV)/.installed
