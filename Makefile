# glpath from a fresh checkout. `make` lists the targets.
#
# The set-up is done once: each stamp in .venv says that what it names is installed as pyproject.toml wants it.

SPP    ?= 128
BENCH  ?= path-buffer
FIGURE ?= path-buffer-7
SCALE  ?= 1
JOBS   ?= auto
PYTHON ?=
export PYTHON

# Images of containers set it. Every process of the tests would compile all modules anew.
unexport PYTHONDONTWRITEBYTECODE

BIN    := .venv/bin
STAMPS := .venv/.glpath

.PHONY: help render test coverage lint evidence release-check bench figure docs gallery wheel clean
.NOTPARALLEL:
.DELETE_ON_ERROR:

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "make %-14s %s\n", $$1, $$2}' Makefile
	@echo "Variables: SPP=128 (make render), BENCH=path-buffer (make bench), FIGURE=path-buffer-7 (make figure), JOBS=auto (make test: processes),"
	@echo "           PYTHON=python3.12 (which one to use)"

render: $(STAMPS) ## set up, then render the Cornell box to out: raw by the path-buffer (.png, .exr), and as by default
	@mkdir -p out
	@echo "Rendering the Cornell box with the path-buffer (Walter and Lengyel 1995), without a denoiser."
	$(BIN)/glpath render cornell-box --integrator path-buffer --no-denoise -o out/cornell-box.png -o out/cornell-box.exr --spp $(SPP)
	@echo "And as \`glpath render\` does it without options: the engine that is clean soonest, denoised."
	$(BIN)/glpath render cornell-box -o out/cornell-box-default.png

test: lint ## set up, check style and types, run the tests and the notebooks, whose results the site shows
	@rm -rf out/executing && mkdir -p out && cp -r notebooks out/executing
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile -m "not evidence" --nbmake --overwrite --nbmake-timeout=240 \
		tests out/executing
	@rm -rf out/notebooks && mv out/executing out/notebooks

coverage: $(STAMPS)-test ## run the test suite and print which branches of the package it takes; kernels count as not run
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile -m "not evidence" --cov=glpath --cov-branch \
		--cov-report=term:skip-covered tests

lint: $(STAMPS)-test ## only check the style, the words, the prose, the types and who imports whom
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python .ci/words.py
	$(BIN)/python .ci/prose.py
	$(BIN)/mypy
	$(BIN)/lint-imports

evidence: $(STAMPS)-reference ## set up with Mitsuba, Blender, Radiance and a browser, then run the slow comparisons
	DRJIT_LIBLLVM_PATH="$$(sh .ci/setup --llvm)" GLPATH_PEERS_PYTHON="$$(sh .ci/setup --peers)" \
		sh .ci/evidence $(BIN)/python $(JOBS)

release-check: $(STAMPS)-reference ## set up, then go as readers go from nothing to a result, attack the program and render for long
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile -m release $$(grep -rl --include="test_*.py" "pytest.mark.release" tests)

bench: $(STAMPS) ## measure; beside Mitsuba where make evidence has installed it
	DRJIT_LIBLLVM_PATH="$$(sh .ci/setup --llvm)" $(BIN)/python -m benchmarks bench $(BENCH)

figure: $(STAMPS)-test ## make a figure of the papers again into out/figures: FIGURE=path-buffer-7, SCALE below 1 is quicker
	$(BIN)/python -m benchmarks figure $(FIGURE) --scale $(SCALE)

docs: $(STAMPS)-test ## build the site into out/docs, with the results of the notebooks that make test has stored
	$(BIN)/python .ci/docs.py out/docs

gallery: $(STAMPS)-test ## render the pictures of the site's gallery again, and time each
	$(BIN)/python -m benchmarks gallery

wheel: ## build the wheel into dist; needs Python alone, none of the set-up
	sh .ci/setup --wheel dist

clean: ## remove all that the other targets made
	rm -rf .venv out dist build .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .coverage*
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(STAMPS): pyproject.toml
	sh .ci/setup
	@touch $@

$(STAMPS)-test: pyproject.toml
	sh .ci/setup test
	@touch $(STAMPS) $@

$(STAMPS)-reference: pyproject.toml
	sh .ci/setup test,reference,browser,gltf,ktx2
	@touch $(STAMPS) $(STAMPS)-test $@
