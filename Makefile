# demo · unit · test · thorough · long · faults · fuzz · fuzz-guided · kills · check · bench · docs · pages · theory · figures · gallery · napari · screenshots · look · wheel · again ·
# platforms · samples · pins · audit · others: the only entry points. Each makes its own .venv and needs nothing but python3 (3.11 or later), cargo and make.

PYTHON ?= python3
VENV := $(CURDIR)/.venv
BENCH_VENV := $(CURDIR)/.venv-bench
WHEEL_VENV := $(CURDIR)/.venv-wheel
AUDIT_VENV := $(CURDIR)/.venv-audit
RELEASE_VENV := $(CURDIR)/.venv-release
NAPARI_VENV := $(CURDIR)/.venv-napari
BIN := $(VENV)/bin
PIP := -m pip install --quiet --disable-pip-version-check
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt

RUST := Cargo.toml Cargo.lock $(shell find crates -name '*.rs' -o -name Cargo.toml)
WORK ?=

.PHONY: demo unit test thorough long faults fuzz kills check bench docs gallery clean screenshots look wheel audit again platforms pins pages fuzz-guided others samples theory figures napari

demo: $(VENV)/.built
	$(BIN)/fringeworks demo --out demo

# The peak of memory of a call depends on how its threads meet: it is measured while nothing else runs.
ALONE := tests/test_memory.py
# A file stays with one worker, which makes its scenes once; tests/conftest.py puts the slow files first.
WORKERS := -n 3 --dist loadfile --no-loadscope-reorder --ignore tests/test_faults.py --ignore $(ALONE)
OTHERS := $(WORKERS) -m "not (thorough or long)"
UNIT := $(WORKERS) -m "not (statistical or system or thorough or long)"

# Workers and child interpreters share the bytecode of the package and of the tests, whatever the caller's environment says.
TESTED := PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1

# The quick layer: what has neither scenes nor processes.
unit: $(VENV)/.built
	$(TESTED) $(BIN)/python -m pytest $(UNIT)

# All layers, without the tests that take seconds each. Cargo's test profile checks for overflow; the bindings have no tests of their own. Three workers
# for two cores: some tests wait for cameras and pages. One BLAS thread for each: idle ones spin on the cores of the others.
test: $(VENV)/.built
	cargo test --quiet --package fringeworks
	$(TESTED) $(BIN)/python -m pytest $(OTHERS)

# Those tests, which tests/thorough.txt names, and the memory of calls. Both run before a change lands.
thorough: $(VENV)/.built
	$(TESTED) $(BIN)/python -m pytest $(ALONE)
	$(TESTED) $(BIN)/python -m pytest $(WORKERS) -m "thorough and not long"

# Packages for some tests that nothing else installs, because their licences are not permissive; without them
# these tests skip visibly.
others: $(VENV)/.built
	$(BIN)/python $(PIP) -r requirements/other-licences.txt

# Statistics over many captures, and whole grids of which the tests take pairs: an hour.
long: $(VENV)/.built
	$(BIN)/python -m pytest -n 2 --ignore tests/test_faults.py -m long

# The simulators of faults do what they say, and the table of faults for ten plans.
faults: $(VENV)/.built
	$(BIN)/python -m pytest -n 2 tests/test_faults.py
	$(BIN)/python -m benchmarks.fault_table --out benchmarks/faults.json

# What the tests do with few inputs, with many: damaged files for MINUTES minutes, spoiled calls, and spoiled arrays for
# kernels that check for overflow (as a library in target/checked, on Linux). docs/trust.md says what has run.
CHECKED := target/checked
fuzz: $(VENV)/.built
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.fuzz_files --minutes $(or $(MINUTES),30)
	OPENBLAS_NUM_THREADS=1 FRINGEWORKS_CALLS=$(or $(CALLS),1000) $(BIN)/python -m pytest --timeout 7200 tests/test_hostile_calls.py
	cargo build --quiet --package fringeworks-bindings
	rm -rf $(CHECKED) && mkdir -p $(CHECKED) && cp -r src/fringeworks $(CHECKED)/
	cp target/debug/lib_core.so $(CHECKED)/fringeworks/_core.abi3.so
	PYTHONPATH=$(CHECKED) FRINGEWORKS_KERNEL_CALLS=$(or $(KERNEL_CALLS),1000) $(BIN)/python -m pytest --timeout 7200 -W "ignore:fringeworks runs on a debug build:RuntimeWarning" tests/test_hostile_kernels.py

# Damaged files that follow the branches of a reader (atheris), SECONDS_EACH seconds for each of READERS.
READERS ?= cloud.ply cloud.pcd cloud.las map.x3p map.tif mesh.obj model.stl p.mat p.npz plan.toml rig.toml f/a.png
fuzz-guided: $(VENV)/.built
	$(BIN)/python $(PIP) atheris
	for reader in $(READERS); do OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.fuzz_guided $$reader --seconds $(or $(SECONDS_EACH),60) || exit 1; done

# Programs killed while they write, KILLS times in all.
kills: $(VENV)/.built
	SOURCE_DATE_EPOCH=0 OPENBLAS_NUM_THREADS=1 RAYON_NUM_THREADS=1 $(BIN)/python -W ignore::DeprecationWarning -m tests.kills --kills $(or $(KILLS),11500)

check: $(VENV)/.built
	cargo fmt --check
	cargo clippy --quiet --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --quiet --no-deps --package fringeworks
	cargo package --quiet --offline --allow-dirty --package fringeworks
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/oxlint --quiet --deny-warnings src
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest fringeworks._core

# One BLAS thread: the peers solve small systems, and idle BLAS threads spin on our cores.
bench: $(BENCH_VENV)/.built
	OPENBLAS_NUM_THREADS=1 $(BENCH_VENV)/bin/python -m benchmarks $(if $(WORK),--work $(WORK),--out benchmarks/results.json --page docs/benchmarks.md)

docs: $(VENV)/.built
	$(BIN)/python -m mkdocs build --strict --quiet --site-dir site

# docs/theory.pdf, which the site and the release take along; wants Chromium.
theory: $(VENV)/.built
	$(BIN)/python docs/make_theory_pdf.py

# All figures of the documentation anew; wants Chromium and Xvfb. That of the benchmarks belongs to what `make bench` measures.
figures: gallery screenshots napari

# The page and the pictures of the examples, the pictures of docs/concepts.md, and the notebook with its outputs.
gallery: $(VENV)/.built samples
	SOURCE_DATE_EPOCH=0 $(BIN)/python docs/make_gallery.py
	$(BIN)/python docs/make_concepts.py
	$(BIN)/python docs/make_notebook.py

# The screenshot of napari, which has an environment of its own; wants Xvfb.
napari: $(VENV)/.built samples
	$(PYTHON) -m venv $(NAPARI_VENV)
	VIRTUAL_ENV=$(NAPARI_VENV) PATH=$(NAPARI_VENV)/bin:$$PATH PIP_CONSTRAINT= $(NAPARI_VENV)/bin/python $(PIP) '.[napari]' pyqt6
	xvfb-run -a -s '-screen 0 1400x1000x24' $(NAPARI_VENV)/bin/python docs/make_napari.py

# The pictures of docs/report.md, docs/viewer.md and docs/studio.md, and those of the demo; wants Chromium.
screenshots: $(VENV)/.built
	$(BIN)/fringeworks demo --out demo
	$(BIN)/python docs/make_screenshots.py demo/bust.html
	$(BIN)/python docs/make_studio_screenshots.py

# Every page of the studio in light, dark and on a phone, to be looked at, in the folder look/.
look: $(VENV)/.built
	$(BIN)/python docs/make_studio_screenshots.py --look look

# Wheel and source distribution in dist/. The wheel is installed into an empty environment whose path holds nothing but that
# environment, so that neither cargo nor a compiler can help, and is tested there: by the quick layer, or with ALL=1 by the tests of `make test`.
wheel: $(VENV)/.ready
	rm -rf dist $(WHEEL_VENV)
	VIRTUAL_ENV=$(VENV) PATH=$(BIN):$$PATH $(BIN)/python release/build.py --sdist --out dist
	$(PYTHON) -m venv $(WHEEL_VENV)
	PATH=$(WHEEL_VENV)/bin $(WHEEL_VENV)/bin/python $(PIP) --only-binary :all: dist/*.whl
	PATH=$(WHEEL_VENV)/bin $(WHEEL_VENV)/bin/python -I release/installed.py --most-mb 250
	PATH=$(WHEEL_VENV)/bin $(WHEEL_VENV)/bin/python $(PIP) --only-binary :all: -r requirements/test.txt
	$(TESTED) $(WHEEL_VENV)/bin/python -m pytest $(if $(ALL),$(OTHERS),$(UNIT)) tests

# The wheel in dist/ once more, from a copy of the sources in another folder: the bytes must be equal.
again: $(VENV)/.ready
	VIRTUAL_ENV=$(VENV) PATH=$(BIN):$$PATH $(BIN)/python release/build.py --against dist/*.whl

# What was built and what ran on each platform, as docs/platforms.md: the wheels in WHEELS are looked at, and installed into an empty
# environment of each of PYTHONS; TARGETS are built first, with zig, and EMULATE runs Python of another machine, as in
# EMULATE='aarch64=qemu-aarch64 -L /arm /arm/usr/bin/python3.11' or 'musl-x86_64=/musl/bin/python3.11'. The notebook takes the sample data.
WHEELS ?= dist
PYTHONS ?= $(PYTHON)
platforms: $(RELEASE_VENV)/.ready samples
	for target in $(TARGETS); do PATH=$(RELEASE_VENV)/bin:$$PATH $(RELEASE_VENV)/bin/python release/build.py --target $$target --out $(WHEELS) || exit 1; done
	FRINGEWORKS_SAMPLES=$(CURDIR)/samples $(RELEASE_VENV)/bin/python release/platforms.py --wheels $(WHEELS) --pythons $(PYTHONS) $(if $(EMULATE),--emulate "$(EMULATE)")

# The sample data of a release in samples/: an archive whose hash the package knows, or an error.
samples: $(VENV)/.built
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m release.sample_data --out samples --check

# requirements/hashed-*.txt from constraints.txt.
pins: $(RELEASE_VENV)/.ready
	PIP_CONSTRAINT= $(RELEASE_VENV)/bin/python release/pins.py

# The documentation as one more version of a site that holds several, on the branch gh-pages: VERSION, and ALIAS as another name of it.
pages: theory
	$(BIN)/python $(PIP) mike
	PATH=$(BIN):$$PATH $(BIN)/mike deploy --update-aliases $(if $(PUSH),--push) $(VERSION) $(ALIAS)
	PATH=$(BIN):$$PATH $(BIN)/mike set-default --allow-undefined $(if $(PUSH),--push) $(or $(ALIAS),latest)

# Known weaknesses of what is installed and compiled, and a list of it in dist/. Says so and ends without error where no network
# or no cargo-audit is at hand; with STRICT=1, that is an error.
audit: $(VENV)/.built $(AUDIT_VENV)/.ready
	$(BIN)/python release/bill_of_materials.py --out dist/fringeworks.cdx.json
	$(BIN)/python release/audit.py --pip-audit $(AUDIT_VENV)/bin/pip-audit $(if $(STRICT),--strict)

$(AUDIT_VENV)/.ready: constraints.txt
	$(PYTHON) -m venv $(AUDIT_VENV)
	-$(AUDIT_VENV)/bin/python $(PIP) pip-audit
	@touch $@

$(RELEASE_VENV)/.ready: requirements/release.txt requirements/hashed-release.txt
	$(PYTHON) -m venv $(RELEASE_VENV)
	PIP_CONSTRAINT= $(RELEASE_VENV)/bin/python $(PIP) --require-hashes -r requirements/hashed-release.txt
	@touch $@

clean:
	rm -rf $(VENV) $(BENCH_VENV) $(WHEEL_VENV) $(AUDIT_VENV) $(RELEASE_VENV) $(NAPARI_VENV) target site demo dist

$(VENV)/.ready: requirements/dev.txt requirements/test.txt constraints.txt
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) is missing: install Python 3.11 or later"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "$(PYTHON) is too old: install Python 3.11 or later"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "the venv module of $(PYTHON) is missing: install python3-venv"; exit 1; }
	@command -v cargo >/dev/null || { echo "cargo is missing: install Rust 1.87 or later"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python $(PIP) -r requirements/dev.txt
	@touch $@

$(VENV)/.built: $(VENV)/.ready pyproject.toml $(RUST)
	VIRTUAL_ENV=$(VENV) $(BIN)/maturin develop --release --locked --quiet
	@touch $@

$(BENCH_VENV)/.ready: requirements/bench.txt constraints.txt
	@command -v cargo >/dev/null || { echo "cargo is missing: install Rust 1.87 or later"; exit 1; }
	$(PYTHON) -m venv $(BENCH_VENV)
	$(BENCH_VENV)/bin/python $(PIP) -r requirements/bench.txt
	@touch $@

# Peers may install OpenCV without its extra modules, and a peer is one of those. Both are the same Python module: the one that
# is installed last counts.
$(BENCH_VENV)/.built: $(BENCH_VENV)/.ready pyproject.toml $(RUST)
	VIRTUAL_ENV=$(BENCH_VENV) $(BENCH_VENV)/bin/maturin develop --release --locked --quiet
	$(BENCH_VENV)/bin/python $(PIP) --force-reinstall --no-deps opencv-contrib-python-headless
	@touch $@
