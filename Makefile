# Every target starts from nothing but Python 3.11 or newer with pip and venv.
.DEFAULT_GOAL := help
.PHONY: encounters ground returns glide mutants page-test page-vendor mavproxy-test rerun-test interrupted tables real garbage intercepted fuzzer corruptions image help venv lock audit fuzz fly warm test coverage pythons explore test-long torture campaigns bench reachability hostile soak docs lint format clean

PYTHON ?= $(shell for name in python3 python3.13 python3.12 python3.11; do \
	$$name -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$name && break; done)
BIN := .venv/bin
STAMP := .venv/stamp
MISSION ?= mission_configs/paper-3d.yaml
FLAGS ?=
N ?= 1000
MINUTES ?= 120
RUNS ?= 10
SEEDS ?= 2
# Which mutants are drawn.
SEED ?= 1
# Processes that share the tests: as many as there are processors, unless it is said.
JOBS ?= logical
WHOLE := not slow and not bench and not real and not page and not mavproxy
QUICK := $(WHOLE) and not thorough
# Tests of kernels, which numba hides from coverage where it compiles them.
PLAIN := tests/kernels
COVERAGE_MIN ?= 92
# What is installed comes from these files alone, each package with its hash: make lock renews them.
LOCKS := requirements
PIP := -m pip install --quiet --disable-pip-version-check
SECONDS ?= 3600

help: ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-10s %s\n", $$1, $$2 }' Makefile

venv: $(STAMP) ## make .venv with everything in it

$(STAMP): pyproject.toml $(LOCKS)/dev.txt .ci/install
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed; name it: make PYTHON=/path/to/python3" >&2; exit 1; }
	.ci/install $(PYTHON) .venv
	$(BIN)/companion warm-up
	touch $@

COMPILE = $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-strip-extras --no-annotate --no-header

# All other files take their versions from the first. make lock LOCK=--upgrade takes the newest there are.
lock: $(STAMP) ## renew requirements/*.txt from pyproject.toml; LOCK=--upgrade for newer versions
	$(COMPILE) $(LOCK) --extra dev --extra plot --extra dask --group build pyproject.toml -o $(LOCKS)/dev.txt
	$(COMPILE) -c $(LOCKS)/dev.txt --extra metrics --extra plot --group build pyproject.toml -o $(LOCKS)/service.txt
	$(COMPILE) $(LOCK) -c $(LOCKS)/dev.txt --group fuzz -o $(LOCKS)/fuzz.txt
	$(COMPILE) $(LOCK) -c $(LOCKS)/dev.txt --extra rerun pyproject.toml -o $(LOCKS)/rerun.txt
	$(COMPILE) $(LOCK) -c $(LOCKS)/dev.txt --group sbom -o $(LOCKS)/sbom.txt
	$(COMPILE) $(LOCK) -c $(LOCKS)/dev.txt --group site -o $(LOCKS)/site.txt

audit: $(STAMP) ## look for known vulnerabilities of what is installed; fails on one
	.ci/audit

fly: $(STAMP) ## fly MISSION in the simulator, with FLAGS for companion sitl; AIRCRAFT=4 is a team; PAGE=1 shows one on http://127.0.0.1:8080
	$(BIN)/companion sitl $(MISSION) $(if $(AIRCRAFT),--aircraft $(AIRCRAFT)) $(if $(PAGE),--page $(if $(filter 1,$(PAGE)),8080,$(PAGE))) $(FLAGS)

warm: $(STAMP)
	@$(BIN)/companion warm-up # once, not in every process of the suite

test: warm ## run the test suite, in JOBS processes
	$(BIN)/pytest -q -m '$(QUICK)' -n $(JOBS) --dist loadgroup --durations=15

coverage: warm ## branch coverage: kernels as Python, then the whole suite compiled; fails below COVERAGE_MIN
	rm -f .coverage .coverage.*
	NUMBA_DISABLE_JIT=1 COVERAGE_FILE=.coverage.plain $(BIN)/pytest -q -m '$(WHOLE) and not compiled' \
		-n $(JOBS) --dist loadgroup --cov --cov-report= $(PLAIN)
	COVERAGE_FILE=.coverage.compiled $(BIN)/pytest -q -m '$(WHOLE)' -n $(JOBS) --dist loadgroup --cov --cov-report=
	$(BIN)/coverage combine -q
	$(BIN)/coverage report --fail-under=$(COVERAGE_MIN)

pythons: $(STAMP) ## test with every Python of 3.11 to 3.13 that is installed
	JOBS=$(JOBS) .ci/pythons

page-test: $(STAMP) ## drive the page in headless Chromium; needs Debian's chromium and chromium-driver
	@command -v chromedriver > /dev/null && command -v chromium > /dev/null || { \
		echo "headless Chromium is needed: apt-get install chromium chromium-driver" >&2; exit 1; }
	$(BIN)/pytest -q -m page tests/ui/page tests/ui/editor

mavproxy-test: $(STAMP) ## look at MAVProxy's map with our module; MAVPROXY=/path/to/mavproxy.py, Xvfb, ImageMagick
	@command -v Xvfb > /dev/null && command -v import > /dev/null && command -v "$${MAVPROXY:-mavproxy.py}" > /dev/null || { \
		echo "MAVProxy with wxPython (MAVPROXY=...), xvfb and imagemagick are needed" >&2; exit 1; }
	$(BIN)/pytest -q -m mavproxy tests/integrations

# In an environment of its own: the package brings 680 MB that nothing else here needs.
rerun-test: $(STAMP) ## test the export for rerun with the package itself, in .venv-rerun
	.ci/install $(PYTHON) .venv-rerun $(LOCKS)/rerun.txt
	.venv-rerun/bin/pytest -q tests/recording/test_rerun_export.py

page-vendor: ## make the page's libraries anew from packaging/page; needs node and npm
	packaging/page/make_vendor.sh

explore: $(STAMP) ## run the property tests with examples that were never tried before
	HYPOTHESIS_PROFILE=explore $(BIN)/pytest -q -m 'hypothesis and not slow' -n $(JOBS) --dist loadgroup

test-long: $(STAMP) ## run the tests that take long
	$(BIN)/pytest -q -m 'slow or thorough'

ground: $(STAMP) ## fly N random missions over real and generated ground
	$(BIN)/python -m tests.ground -n $(N) --jobs $(patsubst logical,2,$(JOBS))

returns: $(STAMP) ## N returns at random moments; WITHOUT=--without: straight home beside them
	$(BIN)/python -m tests.returns -n $(N) --jobs $(patsubst logical,2,$(JOBS)) $(WITHOUT)

torture: $(STAMP) ## break uploads off everywhere, fly N random fault schedules, 500 with senses gone, 300 in the wind; prints counts
	$(BIN)/python -m tests.torture -n $(N) --jobs $(patsubst logical,1,$(JOBS))
	$(BIN)/python -m tests.torture senses -n 500 --jobs $(patsubst logical,1,$(JOBS))
	$(BIN)/python -m tests.torture wind --jobs $(patsubst logical,1,$(JOBS))

campaigns: $(STAMP) ## fly over a lossy link, with the service killed, with a pilot who takes over; prints counts
	$(BIN)/python -m tests.torture losses -n 100
	$(BIN)/python -m tests.torture kills -n 50
	$(BIN)/python -m tests.torture pilots -n 50

glide: $(STAMP) ## stop the engine anywhere in N flights over random fields, on both autopilots; FLAGS=--ground: over maps; prints where they end
	$(BIN)/python -m tests.glide -n $(N) --jobs $(patsubst logical,1,$(JOBS)) $(FLAGS)

# RECORDINGS: tables of ADS-B as traffic's Flight.to_csv or the OpenSky Network write them; not part of this project.
.PHONY: traffic-replay
traffic-replay: $(STAMP) ## replay the real aircraft of RECORDINGS='a.csv b.csv' about flights; prints what was told, missed and told wrongly
	$(BIN)/python -m tests.traffic_replay $(RECORDINGS) --jobs $(patsubst logical,1,$(JOBS)) $(FLAGS)

mutants: warm ## change the program at 360 random places drawn by SEED: do the tests notice 9 of 10? FLAGS=--again for survivors
	$(BIN)/python -m tests.mutants --seed $(SEED) $(FLAGS)

bench: $(STAMP) ## measure what must be fast, against the stored baseline or the checkout BESIDE
	$(BIN)/python -m tests.bench $(if $(BESIDE),--beside $(BESIDE))

.PHONY: release
release: $(STAMP) .venv-sbom/stamp ## build and try sdist, wheel and, as root, Debian package of this commit; SBOM, checksums and notes in dist
	$(BIN)/python packaging/make_release.py $(FLAGS)

.PHONY: deb
deb: $(STAMP) ## build the Debian package of this commit and try it in a clean Debian; needs root, debootstrap and lintian
	$(BIN)/python packaging/make_deb.py

# Programs with many packages of their own, in environments of their own: .venv-NAME from requirements/NAME.txt.
.venv-%/stamp: $(LOCKS)/%.txt
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed; name it: make PYTHON=/path/to/python3" >&2; exit 1; }
	$(PYTHON) -m venv .venv-$*
	.venv-$*/bin/python $(PIP) --only-binary :all: --require-hashes -r $<
	touch $@

# Pages lie as in the repository, so that every link between them holds as it does in a forge's view of the files.
# The variable silences an announcement of mkdocs-material's authors at each start.
.PHONY: site
site: .venv-site/stamp ## build the documentation as a site in build/site/html: search, reference, every link checked
	rm -rf build/site
	mkdir -p build/site/pages
	git ls-files -z '*.md' docs mission_configs LICENSE | xargs -0 cp --parents -t build/site/pages
	NO_MKDOCS_2_WARNING=1 .venv-site/bin/mkdocs build --quiet -f packaging/site/mkdocs.yml

.PHONY: energy
energy: $(STAMP) ## fly N with a worn battery, with and without the section energy; prints how many come home
	$(BIN)/python -m tests.energy -n $(if $(filter file,$(origin N)),100,$(N)) --jobs $(patsubst logical,1,$(JOBS))

.PHONY: team-fast
team-fast: $(STAMP) ## fly RUNS teams of AIRCRAFT (128) that share their plans, in fast time; FLAGS=--straight: that do not
	$(BIN)/python -m sim.team --runs $(RUNS) --aircraft $(or $(AIRCRAFT),128) --jobs $(patsubst logical,1,$(JOBS)) $(FLAGS)

.PHONY: team-goals
team-goals: $(STAMP) ## fly N (50) teams of four that share goals, of which one is gone at a random moment; FLAGS=--px4
	$(BIN)/python -m tests.mission.team -n $(if $(filter file,$(origin N)),50,$(N)) --jobs $(patsubst logical,1,$(JOBS)) $(FLAGS)

.PHONY: team-maps
team-maps: $(STAMP) ## fly N (50) teams of two to eight over random maps, paper-2d and city-block, with shared plans and without
	$(BIN)/python -m tests.mission.team maps -n $(if $(filter file,$(origin N)),50,$(N)) --jobs $(patsubst logical,1,$(JOBS)) $(FLAGS)

.PHONY: team-streets
team-streets: $(STAMP) ## fly N (50) teams in streets that one circle fills, in the wind, a fifth of messages lost
	$(BIN)/python -m tests.mission.team streets -n $(if $(filter file,$(origin N)),50,$(N)) --jobs $(patsubst logical,1,$(JOBS)) $(FLAGS)

.PHONY: team-torture
team-torture: $(STAMP) ## fly N (50) teams whose pilots switch modes, whose members are gone and whose radios fall silent
	$(BIN)/python -m tests.mission.team disturbed -n $(if $(filter file,$(origin N)),50,$(N)) --jobs $(patsubst logical,1,$(JOBS)) $(FLAGS)

# Rows and tables lie in flights/encounters; FLAGS=--resume goes on with what was stopped.
encounters: $(STAMP) ## fly encounters with the models of MIT Lincoln Laboratory in the folder MODELS, and print their tables
	MODELS='$(abspath $(MODELS))' $(BIN)/companion campaign campaigns/encounters/lincoln.yaml \
		--jobs $(patsubst logical,2,$(JOBS)) --out flights/encounters $(FLAGS)
	$(BIN)/companion results flights/encounters
	cat flights/encounters/results.md

reachability: $(STAMP) ## renew docs/figures/reachability.*: 1,000 pursuits against the RS estimators
	$(BIN)/python -m tests.proofs.pursuits

hostile: $(STAMP) ## an hour of hostile traffic into the service, and what became of it
	$(BIN)/python -m tests.hostile.hostile_hour

garbage: $(STAMP) ## floods of the worst known sort beside a flight in real time, ten minutes
	$(BIN)/python -m tests.hostile.garbage $(FLAGS)

intercepted: $(STAMP) ## flights with a man in the middle: 500 with a key, 500 without
	$(BIN)/python -m tests.hostile.intercepted --jobs $(patsubst logical,1,$(JOBS)) $(FLAGS)
	$(BIN)/python -m tests.hostile.intercepted --unsigned --jobs $(patsubst logical,1,$(JOBS)) $(FLAGS)

soak: $(STAMP) ## MINUTES of flights back to back, faults on: what grows?
	$(BIN)/python -m tests.soak --minutes $(MINUTES)

fuzzer: $(STAMP)
	$(BIN)/python $(PIP) --only-binary :all: --require-hashes -r $(LOCKS)/fuzz.txt

# Corpora grow in .fuzz from run to run; FLAGS=--keep stores what reaches further, a target's name runs it alone.
fuzz: fuzzer ## fuzz all that reads what others send, for SECONDS altogether, JOBS at once; fails on a find
	$(BIN)/python -m tests.fuzz --seconds $(SECONDS) --jobs $(patsubst logical,1,$(JOBS)) $(FLAGS)

docs: $(STAMP) ## write docs/mission-file.md, docs/pilot-messages.md, the pictures of docs/architecture.md and docs/offline.ipynb anew
	$(BIN)/python -m companion.config.reference docs/mission-file.md
	$(BIN)/python -m tests.docs.write_pilot_messages
	$(BIN)/python -m tests.docs.draw_architecture
	$(BIN)/python -m tests.docs.run_notebook

interrupted: $(STAMP) ## kill campaigns and their Dask workers, fill the disk: the rows are those of undisturbed ones
	$(BIN)/pytest -q -m slow tests/research/campaign/test_campaign_run.py tests/research/campaign/test_dask_engine.py

tables: $(STAMP) ## write docs/tables.md anew from the rows in campaigns/results
	$(BIN)/python -m companion results campaigns/results --page docs/tables.md

corruptions: $(STAMP) ## replay N damaged copies of each recording of a real autopilot; prints counts
	$(BIN)/python -m tests.service.replay.corruptions -n $(N)

image: ## carry the Dockerfile out in a clean Debian; needs root and debootstrap
	$(PYTHON) packaging/prove_image.py

# Paths of your own binaries: make real ARDUPLANE=… PARM=…,… PX4=…; a half whose binary is not named is left out.
real: $(STAMP) ## fly beside real autopilots: ARDUPLANE, PARM and PX4 name yours; JOBS at once, SEEDS of each
	ARDUPLANE='$(ARDUPLANE)' PARM='$(PARM)' PX4='$(PX4)' $(BIN)/python -m tests.real \
		--jobs $(if $(filter-out logical,$(JOBS)),$(JOBS),1) --seeds $(SEEDS) $(FLAGS)

lint: $(STAMP) ## check style, types, the layers, dead code and dependencies
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/vulture
	$(BIN)/deptry .

format: $(STAMP) ## put the source into its format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean: ## remove what the targets made
	rm -rf .venv .venv-* .fuzz .mutants .coverage .coverage.* build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
