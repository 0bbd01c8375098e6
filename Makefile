# Common commands. `make` without a target lists them.

export PATH := $(PATH):$(HOME)/.cargo/bin

CARGO_RUN := cargo run --release --locked --quiet
NATIVE := --no-default-features
FIGURE := scenes/csma2013/fig4.toml

say = @printf '==> %s\n' '$(1)'

.DEFAULT_GOAL := help
.PHONY: help setup run test unit-tests lints-native documentation python test-long stability report bench table static deb wheels release accuracy clean

help: ## list these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-9s  %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: ## install missing packages that the build needs
	@scripts/setup.sh

run: ## build, simulate the paper's figure 4 to the second impact, draw it, compare with PETSc
	$(call say,about six minutes on two cores the first time: all but some seconds are the build)
	@scripts/setup.sh
	$(call say,build)
	@cargo build --release --locked
	$(call say,simulate $(FIGURE) to t = 0.25 s)
	@$(CARGO_RUN) -- run $(FIGURE) --set time.end=0.25 --set output.fields_every=1000 --out runs/first
	$(call say,compare engines and contact solvers to t = 0.06 s)
	@$(CARGO_RUN) -- compare $(FIGURE) --set time.end=0.06 --set time.step=1e-5
	@$(CARGO_RUN) -- plot runs/first >/dev/null
	@$(CARGO_RUN) -- report runs/first >/dev/null
	$(call say,a picture of the run: runs/first/plots/snapshots.png)
	$(call say,a report for the browser: runs/first/report.html)

test: setup ## check format, lints, tests and documentation, with and without PETSc
	$(call say,format)
	@cargo fmt --check
	$(call say,spelling)
	@scripts/check_spelling.sh
	$(call say,weight)
	@scripts/weight.py --check
	$(call say,lints)
	@cargo clippy --release --all-targets --locked -- -D warnings
	$(call say,build of the tests)
	@cargo test --release --locked --test '*' --no-run
	$(call say,tests)
# Programs in examples/ are not linked: a test program contains them.
# The compiler works in the time that tests leave. Ranks of a parallel job exchange messages all the
# time, and a compiler of the same priority would hold each of them up for milliseconds. It begins
# when the test programs run and cargo has unlocked the folder of the build.
	@(sleep 5; nice -n 19 $(MAKE) --no-print-directory unit-tests lints-native documentation python) > target/meanwhile.log 2>&1 & meanwhile=$$!; \
	    cargo test --release --locked --test '*' --no-fail-fast && cargo test --release --locked --doc; tests=$$?; \
	    wait $$meanwhile; lints=$$?; cat target/meanwhile.log; exit $$((tests + lints))
	$(call say,planted faults)
	@scripts/planted_faults.py --texts
	$(call say,fields read back by VTK)
	@scripts/check_vtk.sh
	$(call say,energies of the paper at steps down to 1e-5 s)
	@$(CARGO_RUN) --example csma2013_table -- 1e-5
	$(call say,cost of effects)
	@cargo bench --locked --bench effects -- --report
	$(call say,all passed)

# Without optimisation the tests within src/ are ready after 90 s instead of 400 s, and run for 4 s.
unit-tests:
	$(call say,tests within src/)
	@cargo test --release --locked --lib --config profile.release.package.rebond.opt-level=0

lints-native:
	$(call say,lints without default features)
	@cargo clippy --release $(NATIVE) --all-targets --locked -- -D warnings

documentation:
	$(call say,documentation)
	@RUSTDOCFLAGS="-D warnings --html-in-header docs/katex/header.html" cargo doc --release --no-deps --locked
	@scripts/check_equations.sh

python: setup ## build the wheel of the Python package, and test it beside the program
	$(call say,Python package)
	@cargo fmt --check --manifest-path python/Cargo.toml
	@scripts/check_python.sh

test-long: setup ## run what make test omits: long tests, tests without default features, planted faults
	$(call say,tests without default features)
	@cargo test --release $(NATIVE) --locked
	$(call say,long tests)
	@cargo test --release --locked --tests -- --ignored
	$(call say,planted faults)
	@scripts/planted_faults.py

stability: setup ## recompute the tables of docs/stability.md, natively and on PETSc (12 min)
	$(call say,native)
	@$(CARGO_RUN) -- stability > docs/stability/table.txt
	$(call say,PETSc with each contact solver)
	@for with in petsc petsc:snes petsc:tao; do $(CARGO_RUN) -- stability --with $$with || exit; echo; done > docs/stability/petsc.txt

report: setup ## write the report of the paper's plate, and check it in headless Chromium
	@scripts/check_report.sh

bench: setup ## time steps and their parts, effects, sweeps, other programs, more ranks; tables into docs/performance
	$(call say,benchmarks)
	@cargo bench --locked --bench effects --bench field
	$(call say,steps)
	@cargo bench --locked --bench step | tee docs/performance/steps.txt
	@cargo bench --locked --bench substructures | tee docs/performance/substructures.txt
	$(call say,sweeps)
	@scripts/sweep_speed.py --rounds 5 --before 46a1d2c | tee docs/performance/sweeps.txt
	$(call say,other programs)
	@benches/peers/compare.py | tee docs/performance/peers.txt
	$(call say,PETSc on fine meshes)
	@scripts/scaling.py | tee docs/performance/scaling.txt

table: setup ## recompute the table of the paper
	$(call say,table)
	@$(CARGO_RUN) --example csma2013_table

# The C library musl is part of the program, which then needs no file of the system.
STATIC := $(shell uname -m)-unknown-linux-musl

static: ## build the native program as one file that runs on any Linux, target/*-musl/release/rebond
	$(call say,static program)
	@rustup --quiet target add $(STATIC)
	@cargo build --release --locked $(NATIVE) --target $(STATIC)
	@ls -sh target/$(STATIC)/release/rebond

# dpkg-dev finds the packages that the program depends on.
deb: ## build a Debian package in target/debian, with manual pages and completions
	@scripts/setup.sh dpkg-dev
	$(call say,package)
	@cargo deb --version >/dev/null 2>&1 || cargo install --quiet --locked cargo-deb
	@cargo build --release --locked
	@target/release/rebond man --out target/pages > target/pages.txt
	@target/release/rebond completions bash > target/pages/rebond.bash
	@cargo deb --no-build --locked

wheels: setup ## build a wheel of the Python package for any Linux, and its sources, in target/wheels
	$(call say,wheel)
	@scripts/wheels.sh

release: static deb wheels ## make all files of a release in target/dist; TAG=v0.2.0 must name the version
	$(call say,files of the release)
	@scripts/release.sh $(TAG)

accuracy: setup ## recompute the studies and figures of docs/accuracy.md
	$(call say,accuracy)
	@scripts/accuracy.sh

clean: ## remove build products; runs stay
	$(call say,clean)
	@cargo clean --quiet
