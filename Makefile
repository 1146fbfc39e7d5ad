# The commands a newcomer needs. Each makes .venv when it is missing.
PYTHON ?= python3
BIN ?= .venv/bin

.PHONY: demo test check robustness browser docs bench gpu weights world notebooks wheel wheel-check clean

demo: .venv/installed
	$(BIN)/nsdr demo -o demo/nsdr_demo.png

test: .venv/installed-dev
	$(MAKE) check

# The steps of `make test`, with the tools in BIN.
check:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile -m "not robustness and not docs and not real_data and not browser and not render and not rl"

robustness: .venv/installed-dev
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile -m robustness
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.robustness.campaign

# Needs Chromium: .ci/install-browser.
browser: .venv/installed-browser
	OMP_NUM_THREADS=1 $(BIN)/pytest -m browser

# Takes half an hour on a machine that does nothing else. DATA is a folder with clips/ (videos and proposals) and real/ (official
# proposals as proposals_dev.npz, truth_dev.json.gz, questions/mixed_dev.json); without it, what needs them is left out.
bench: .venv/installed-dev
	$(BIN)/python -m benchmarks.speed -o results/speed.md $(if $(DATA),--data $(DATA))

# Runs the notebooks and keeps what they print and draw: about twenty-five minutes.
notebooks: .venv/installed-dev
	OMP_NUM_THREADS=1 $(BIN)/python .ci/notebooks.py notebooks/*.ipynb

# Everything that runs on a GPU. ARGS="--device cuda:1" takes another one; ARGS=--small tries it on few frames, without a GPU on a
# simulated one and the CPU.
gpu: .venv/installed-dev
	$(BIN)/python -m benchmarks.gpu -o results/gpu.md $(ARGS)

# Makes every shipped weight: about ten hours, the sum of the times in docs/training.md. WHAT=weights-propnet-patches makes one part
# (configs/weights.mk).
# DATA is a folder with frames/ and real/; STEPS=2 only tries the commands.
WHAT ?= weights
weights: .venv/installed-dev
	OMP_NUM_THREADS=1 $(MAKE) -f configs/weights.mk $(WHAT) NSDR=$(BIN)/nsdr

# Makes data and weights of a world that ships, such as NAME=pucks, or of your own (configs/world.mk).
world: .venv/installed-dev
	OMP_NUM_THREADS=1 $(MAKE) -f configs/world.mk NSDR=$(BIN)/nsdr $(foreach name,NAME WORLD VIDEOS RUNS OUTPUT STEPS,$(if $($(name)),$(name)='$($(name))'))

# Builds the site, and runs the commands and examples of its pages, and the notebooks.
docs: .venv/installed-docs .venv/installed-dev
	$(BIN)/mkdocs build --strict --site-dir site
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile -m docs
	OMP_NUM_THREADS=1 NSDR_NOTEBOOK_VIDEOS=2 $(BIN)/pytest -n 2 --nbmake notebooks

# What is published: an sdist and, built from it, a wheel.
wheel: .venv/installed-release
	rm -rf dist
	$(BIN)/python -m build
	$(BIN)/twine check --strict dist/*

# The wheel in a new environment of its own, away from the repository (about 6 GB on Linux for a while: PyTorch with CUDA).
wheel-check: wheel
	$(BIN)/python .ci/check_wheel.py dist/*.whl

.venv/installed: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed: make PYTHON=python3.11") if sys.version_info < (3, 11) else 0'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet -e .
	touch $@

.venv/installed-dev: .venv/installed
	$(BIN)/pip install --quiet -e '.[dev]'
	touch $@

.venv/installed-browser: .venv/installed
	$(BIN)/pip install --quiet -e '.[browser]'
	touch $@

.venv/installed-docs: .venv/installed
	$(BIN)/pip install --quiet -e '.[docs]'
	touch $@

.venv/installed-release: .venv/installed
	$(BIN)/pip install --quiet -e '.[release]'
	touch $@

clean:
	rm -rf .venv demo dist site
