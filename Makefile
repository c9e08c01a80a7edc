# `make demo` and `make test` need Python 3.11 or later and make, nothing else.
PYTHON ?= python3
VENV ?= .venv
JOBS ?=
# Of `make challenge`: a file, or the name of a config that comes with gesturegen.
CONFIG ?= casia_go_2023
BIN = $(VENV)/bin
GESTUREGEN = $(BIN)/gesturegen
FLAGS = $(if $(JOBS),-j $(JOBS))

.PHONY: help install demo ablation test test-slow fuzz challenge challenge-demo lint bench docs notebook picture clean

help:  ## what can be made
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

install: $(VENV)/installed  ## a virtual environment with everything in it

# Compiling the loops once here keeps the first real command from seeming slow.
$(VENV)/installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	$(BIN)/python -m gesturegen.warm_up
	touch $@

demo: install  ## all four commands on a synthetic dataset, in demo/
	rm -rf demo
	$(GESTUREGEN) demo-data demo/data --references 2 --tests 2 --seed 1 $(FLAGS)
	$(GESTUREGEN) preprocess --config configs/demo.yaml $(FLAGS)
	$(GESTUREGEN) build-graph --config configs/demo.yaml $(FLAGS)
	$(GESTUREGEN) reenact --config configs/demo.yaml $(FLAGS)
	$(GESTUREGEN) evaluate --config configs/demo.yaml $(FLAGS)
	$(GESTUREGEN) report --config configs/demo.yaml $(FLAGS)
	@echo
	@echo 'BVH files:    demo/work/reenact/*.bvh'
	@echo 'traces:       demo/work/reenact/*.trace.json'
	@echo 'metric table: demo/work/evaluate/metrics.csv'
	@echo 'to watch:     demo/work/report.html'

ablation: install  ## the paper's Table 2 on a synthetic dataset, in ablation/
	rm -rf ablation
	$(GESTUREGEN) demo-data ablation/data --references 4 --tests 4 --seed 1 $(FLAGS)
	$(GESTUREGEN) preprocess --config casia_go_2023 --data ablation/data --work ablation/work --set data.truth_split=truth $(FLAGS)
	$(GESTUREGEN) ablate --config configs/ablation.yaml --data ablation/data --work ablation/work --set data.truth_split=truth $(FLAGS)
	@echo
	@echo 'table:            ablation/work/ablation/ablation.md, .csv, .json'
	@echo 'bar plot:         ablation/work/ablation/ablation.png'

test: install  ## the fast tests
	$(BIN)/python -m pytest -m 'not slow' -q -n auto --dist loadfile

test-slow: install  ## the tests that take longer
	$(BIN)/python -m pytest -m slow -q -n auto --dist loadfile

# A clip that fails must not keep the others from the table and the report; the exit code still tells.
FULL_CHALLENGE = status=0; for command in 'run --config $(CONFIG)' ablate report; do \
	$(GESTUREGEN) $$command $(1) $(FLAGS) || status=$$?; done; exit $$status

fuzz: install  ## 20,000 damaged and 20,000 made-up inputs for each reader, 20,000 by coverage where atheris installs
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check atheris
	GESTUREGEN_FUZZ_EXAMPLES=20000 $(BIN)/python -m pytest tests/fuzz -q -rA -n auto
	PYTHONPATH=. $(BIN)/python scripts/fuzz_coverage.py --runs 20000

challenge: install  ## the full challenge with the paper's settings: make challenge DATA=genea WORK=out [CONFIG=best]
	@test -n '$(DATA)' -a -n '$(WORK)' || { echo 'give the folders: make challenge DATA=genea WORK=out'; exit 2; }
	$(call FULL_CHALLENGE,--data '$(DATA)' --work '$(WORK)')

challenge-demo: install  ## the same on a synthetic dataset of the challenge's size (4 GB in challenge/)
	test -f challenge/data/tst/metadata.csv || $(GESTUREGEN) demo-data challenge/data --references 70 --tests 70 --challenge $(FLAGS)
	$(call FULL_CHALLENGE,--data challenge/data --work challenge/work --set data.truth_split=truth)

lint: install  ## style and unused names
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

bench: install  ## time and memory of each stage, beside the obvious implementation
	PYTHONPATH=. $(BIN)/python scripts/bench.py

docs: $(VENV)/installed-docs  ## the pages of docs/ as a site in site/; fails where a link or an anchor is broken
	$(BIN)/python scripts/check_links.py README.md CONTRIBUTING.md
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --clean

$(VENV)/installed-docs: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	touch $@

notebook: $(VENV)/installed-notebook  ## run every cell of examples/gesturegen.ipynb on demo data
	$(BIN)/python scripts/run_notebook.py examples/gesturegen.ipynb

$(VENV)/installed-notebook: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[notebook]'
	touch $@

picture: install  ## docs/picture.gif, the moving picture of the README
	rm -rf picture
	$(GESTUREGEN) demo-data picture/data --references 2 --tests 2 --seed 1 --quiet $(FLAGS)
	$(GESTUREGEN) run --data picture/data --work picture/work --quiet $(FLAGS)
	$(BIN)/python scripts/make_picture.py picture/work picture/data docs/picture.gif

clean:  ## delete the environment and everything the demo wrote
	rm -rf $(VENV) demo ablation bench challenge picture site
