# The two commands of the README, `make demo` and `make test`, and their parts.
# Everything is installed into .venv; nothing outside this folder is touched.

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
# rustup puts cargo here, and a shell opened before it does not know.
export PATH := $(PATH):$(HOME)/.cargo/bin
# Any of these will do; some distributions keep an older one as python3.
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	"$$p" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo "$$p" && break; done)
VENV := .venv
PY := $(VENV)/bin/python
# pyo3 is compiled anew when its interpreter changes: one for maturin and clippy.
export PYO3_PYTHON := $(CURDIR)/$(PY)
# A virtual environment holds absolute paths: a copied or moved folder would go
# on running the package it was copied from. The stamp is of this place.
STAMP := $(VENV)/installed-$(shell pwd | cksum | cut -d' ' -f1)
# The same with what only the checks need.
TOOLS := $(VENV)/tools-$(notdir $(STAMP))
INSTALL := -m pip install --quiet --disable-pip-version-check
DEMO := out/sheared_cube
# The parallel tests start this Python under mpirun: that of Debian, whose PETSc is compiled
# for it and for NumPy 1, or one of BIPOT_MPI_PYTHON with petsc4py, mpi4py and this package.
MPI_VENV := .venv-mpi
MPI_STAMP := $(MPI_VENV)/$(notdir $(STAMP))
HAS_PETSC := $(shell .ci/petsc find)
# JAX and PyTorch beside the packages of .venv. On Linux pip takes PyTorch with the libraries of
# CUDA, three gigabytes, unless PIP_INDEX_URL or PIP_FIND_LINKS names a source of CPU wheels.
FRAMEWORKS := .venv-frameworks
FRAMEWORKS_STAMP := $(FRAMEWORKS)/$(notdir $(STAMP))
ifdef BIPOT_MPI_PYTHON
MPI_READY :=
else ifneq ($(HAS_PETSC),)
MPI_READY := $(MPI_STAMP)
else
MPI_READY := no-petsc
endif

.PHONY: help
help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1\t\2/p' Makefile | expand -t 18

.PHONY: demo
demo: $(STAMP) ## install, solve the scene sheared_cube, write table, picture and results into out/
	$(PY) -m bipot_rs run sheared_cube --plot --out $(DEMO)
	@echo
	@echo "table of load steps:  $(CURDIR)/$(DEMO)/steps.csv"
	@echo "picture:              $(CURDIR)/$(DEMO)/tractions.png"
	@echo "results:              $(CURDIR)/$(DEMO)/result.h5"
	@echo "for ParaView:         $(CURDIR)/$(DEMO)/result.pvd"

.PHONY: test
test: checks $(STAMP) ## install, then every check: Rust, Python, types, documents
	# A compilation ends on one core, mypy never uses more, and pip waits for the network.
	@$(MAKE) --no-print-directory --jobs 3 --output-sync=target rust-test python-checks $(MPI_READY)
	@$(MAKE) --no-print-directory python-test

.PHONY: python-checks
python-checks:
	@$(MAKE) --no-print-directory python-lint types

# The dependencies are those of `make demo`, compiled once; our own crate is compiled with
# checks of overflow and assertions. clippy compiles it, so that linting costs nothing more.
CHECKED := --release --locked --features python-dependencies \
	--config 'profile.release.package.bipot_rs.opt-level=1' \
	--config 'profile.release.package.bipot_rs.debug-assertions=true' \
	--config 'profile.release.package.bipot_rs.overflow-checks=true'
# Without the job slots of make: cargo counts the cores itself.
LINTED := env -u MAKEFLAGS RUSTC_WORKSPACE_WRAPPER=clippy-driver CLIPPY_ARGS='-Dwarnings'

.PHONY: rust-lint
rust-lint: checks $(STAMP)
	cargo fmt --check
	# The bindings, which the tests do not compile; nothing runs them. A library of Rust has
	# files of its own, so that neither this nor the tests are compiled again without a change.
	$(LINTED) cargo rustc $(CHECKED) --config 'profile.release.package.bipot_rs.opt-level=0' --lib --crate-type rlib --features python
	$(LINTED) cargo test $(CHECKED) --no-run --tests

.PHONY: rust-test
rust-test: rust-lint
	$(LINTED) cargo test $(CHECKED) --tests

.PHONY: python-lint
python-lint: $(TOOLS)
	$(PY) -m ruff format --check .
	$(PY) -m ruff check .

.PHONY: types
types: $(TOOLS)
	$(PY) -m mypy
	$(PY) -m mypy tests/types/public_names.py
	$(PY) -m mypy.stubtest bipot_rs._core

.PHONY: python-test
python-test: $(TOOLS) $(MPI_READY)
	$(PY) -m pytest -n 2 --dist loadgroup

.PHONY: no-petsc
no-petsc:
	@echo "no PETSc here: the parallel tests are skipped (make mpi-test installs it)"

.PHONY: mpi-test
mpi-test: $(TOOLS) ## install PETSc and MPI if they are missing (Debian, Ubuntu), and run the parallel tests
	$(if $(BIPOT_MPI_PYTHON),,.ci/petsc install)
	$(if $(BIPOT_MPI_PYTHON),,@$(MAKE) --no-print-directory $(MPI_STAMP))
	$(PY) -m pytest -m "slow or not slow" tests/python/petsc tests/python/cli/test_mpirun.py

# The package is that of .venv: its core fits any Python from 3.11 on.
$(MPI_STAMP): $(STAMP) .ci/petsc
	/usr/bin/python3 -m venv --clear --system-site-packages $(MPI_VENV)
	$(PY) .ci/requirements.py cli > $(MPI_VENV)/requirements.txt
	$(MPI_VENV)/bin/python $(INSTALL) 'numpy<2' --requirement $(MPI_VENV)/requirements.txt
	cp -r $(VENV)/lib/python3*/site-packages/bipot_rs-*.dist-info $(MPI_VENV)/lib/python3*/site-packages/
	echo '$(CURDIR)/python' > $$(echo $(MPI_VENV)/lib/python3*/site-packages)/bipot_rs.pth
	@touch $@

.PHONY: verify
verify: $(TOOLS) ## larger random classes and slow tests: before a change of numerics is called done
	cargo clippy --release --locked --benches -- -Dwarnings
	$(PY) -m pytest -m slow --timeout 3600
	@$(MAKE) --no-print-directory frameworks-test

.PHONY: frameworks-test
frameworks-test: $(FRAMEWORKS_STAMP) ## install JAX and PyTorch if they can be had, and run their tests
	$(FRAMEWORKS)/bin/python -m pytest -m "slow or not slow" tests/python/frameworks

# The tests of what cannot be installed are skipped. The stamp is made when both are there:
# for an extra that it does not know, pip only prints a warning.
$(FRAMEWORKS_STAMP): $(TOOLS)
	$(PY) -m venv --clear $(FRAMEWORKS)
	printf '%s\n' '$(CURDIR)/python' "$$($(PY) -c 'import sysconfig; print(sysconfig.get_path("purelib"))')" \
		> $$(echo $(FRAMEWORKS)/lib/python3*/site-packages)/bipot_rs.pth
	@all=yes; for extra in jax torch; do \
		$(FRAMEWORKS)/bin/python $(INSTALL) "bipot-rs[$$extra]" \
			&& $(FRAMEWORKS)/bin/python -c "import $$extra" \
		|| { all=no; echo "the extra [$$extra] cannot be installed here: its tests are skipped"; }; \
	done; if [ $$all = yes ]; then touch $@; fi

# The reader must be of the LLVM of rustc, or newer: that of rustup, or a package llvm-22. Both
# kinds of tests count: the Python tests run with a copy of the package that has a counting core, in
# one process, because workers may end without writing their counts.
LLVM ?= $(lastword $(sort $(wildcard /usr/lib/llvm-2[2-9]/bin $(shell rustc --print sysroot)/lib/rustlib/*/bin)))
COVERED := out/coverage
COUNTING := LLVM_PROFILE_FILE='$(CURDIR)/$(COVERED)/%4m.profraw'
COUNTED := RUSTC_WORKSPACE_WRAPPER='$(CURDIR)/.ci/covered' $(COUNTING)
.PHONY: coverage
coverage: $(TOOLS) ## what the tests reach of the solvers (needs llvm-tools of rustup, or llvm-22)
	@test -x '$(LLVM)/llvm-cov' || { echo "no llvm-cov: rustup component add llvm-tools"; exit 1; }
	rm -rf $(COVERED)
	$(COUNTED) cargo test $(CHECKED) --tests
	$(COUNTED) cargo rustc $(CHECKED) --features python --lib --crate-type cdylib
	mkdir -p $(COVERED)
	cp -r python/bipot_rs $(COVERED)
	cp target/release/libbipot_rs.so $(COVERED)/bipot_rs/_core.abi3.so
	# Counting is slow: a test with a limit of time may fail. The table counts what ran.
	-$(COUNTING) PYTHONPATH='$(CURDIR)/$(COVERED)' $(PY) -m pytest \
		tests/python/contact tests/python/theory tests/python/test_fclib.py
	$(LLVM)/llvm-profdata merge --sparse $(COVERED)/*.profraw -o $(COVERED)/merged
	$(LLVM)/llvm-cov export --instr-profile $(COVERED)/merged $(COVERED)/bipot_rs/_core.abi3.so \
		$$(ls -t target/release/deps/core-* | grep -v '\.[a-z]*$$' | head -n 1 | sed 's/^/--object /') \
		| $(PY) .ci/coverage_table.py src/law src/reduced src/solver src/proof

.PHONY: mutations
mutations: $(TOOLS) ## plant faults, one at a time, and see that the tests find each: half an hour
	$(PY) tests/mutations/run_mutations.py

# FCLIB=DIR: a folder with the files of FCLIB, which this repository does not hold.
# BENCH=quick: small sizes of the comparisons with peers, written into out/bench.
BENCH := full
.PHONY: bench
bench: bench-$(BENCH) ## measure the tables of benches/README.md again; BENCH=quick: small sizes, into out/bench

.PHONY: bench-quick
bench-quick: $(STAMP)
	$(PY) benches/whole_job.py --quick
	$(PY) benches/time_against_error.py --quick
	$(PY) benches/whole_job_figure.py --quick
	$(PY) benches/condensation_peers.py --quick
	$(PY) benches/scaling.py --quick
	$(PY) benches/scale.py --quick
	$(PY) benches/several.py --quick
	$(PY) benches/sensitivities.py --quick
	$(PY) benches/identification.py --quick

.PHONY: bench-full
bench-full: $(STAMP)
	$(PY) benches/whole_job.py
	$(PY) benches/time_against_error.py
	$(PY) benches/whole_job_figure.py
	$(PY) benches/condensation_peers.py --large
	$(PY) benches/scaling.py
	$(PY) benches/scale.py
	$(PY) benches/several.py
	$(PY) benches/iterations.py
	$(PY) benches/beside_petsc.py
	$(PY) benches/import_time.py
	$(PY) benches/speed_against_error.py
	$(PY) benches/granular.py
	$(PY) benches/load_paths.py
	$(PY) benches/moving_states.py
	$(PY) benches/sensitivities.py
	$(PY) benches/identification.py
	$(PY) benches/stability.py
	$(if $(FCLIB),$(PY) benches/fclib.py --data $(FCLIB))
	$(PY) benches/ratios.py

.PHONY: verification
verification: $(TOOLS) ## docs/verification.md: answers known from elsewhere, beside ours
	PYTHONPATH=tests/python $(PY) -m cases.verification

# Sphinx is installed when it is first wanted: no test needs it.
SPHINX := $(VENV)/docs-$(notdir $(STAMP))
.PHONY: docs
docs: $(SPHINX) ## the pages of docs/ as a site, in out/docs
	$(PY) -m sphinx --quiet --fail-on-warning --keep-going -d out/docs-cache docs out/docs
	@echo "the site:             $(CURDIR)/out/docs/index.html"

$(SPHINX): pyproject.toml $(STAMP)
	PATH='$(CURDIR)/$(VENV)/bin':"$$PATH" $(PY) $(INSTALL) --no-build-isolation --editable '.[docs]'
	@touch $@

.PHONY: wheel
wheel: | prerequisites ## a wheel for any Linux from 2012 and any Python from 3.11 on, in out/wheels
	$(PYTHON) .ci/release.py build

.PHONY: release-check
release-check: wheel ## the wheel with NumPy and SciPy alone, lowest and newest: the quick tests
	$(PYTHON) .ci/release.py check

# Both linters come as wheels. Without a token zizmor asks no server.
LINT := out/release/lint
.PHONY: lint-workflows
lint-workflows: $(LINT)/bin/zizmor ## the workflows of .github: their schema, and known weaknesses
	$(LINT)/bin/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(LINT)/bin/zizmor --offline --pedantic .github/workflows

$(LINT)/bin/zizmor: | prerequisites
	$(PYTHON) -m venv --clear $(LINT)
	$(LINT)/bin/python $(INSTALL) 'zizmor>=1.32' 'check-jsonschema>=0.39'

.PHONY: picture
picture: $(STAMP) ## the picture of the README
	$(PY) examples/readme_picture.py

.PHONY: versions
versions: | prerequisites
	@uname -sm; cargo --version; rustc --version; $(PYTHON) --version; cc --version | head -n 1

.PHONY: clean
clean: ## remove what was built, installed and written here
	rm -rf target $(VENV) $(MPI_VENV) $(FRAMEWORKS) out python/bipot_rs/_core*.so
	find . -name __pycache__ -prune -exec rm -rf {} +

.PHONY: prerequisites
prerequisites:
	@PYTHON='$(PYTHON)' .ci/prerequisites

.PHONY: checks
checks:
	@PYTHON='$(PYTHON)' .ci/prerequisites test

# Without build isolation maturin runs from this environment, at the same path
# each time: cargo then compiles only what changed. pip looks for maturin in PATH.
# One job more than there are cores: the longest chain of crates then never waits for a core.
$(STAMP): pyproject.toml Cargo.toml Cargo.lock .ci/requirements.py $(shell find src -name '*.rs') | prerequisites
	$(PYTHON) -m venv $(VENV)
	$(PY) $(INSTALL) 'maturin>=1.16,<2'
	@echo "compiling the core and installing: some three minutes, more on a busy machine"
	$(PY) .ci/requirements.py cli > $(VENV)/requirements.txt
	$(PY) $(INSTALL) --requirement $(VENV)/requirements.txt & \
	CARGO_BUILD_JOBS=$$(($$(nproc) + 1)) PATH='$(CURDIR)/$(VENV)/bin':"$$PATH" \
		$(PY) $(INSTALL) --no-build-isolation --no-deps --editable . && wait $$!
	@touch $@

$(TOOLS): $(STAMP)
	$(PY) .ci/requirements.py dev > $(VENV)/requirements.txt
	$(PY) $(INSTALL) --requirement $(VENV)/requirements.txt
	@touch $@
