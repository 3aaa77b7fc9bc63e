# make demo      set up what is missing, then make a small dataset, its Rerun recording and a picture
# make test      set up what is missing, then run every check
# make test-all  the same, with the tests marked slow
# make coverage  run the tests under coverage; the report is in output/coverage
# make setup     set up only; with MITSUBA=1 the backend that traces paths without a GPU, too
# make lock      renew requirements.lock
# make wheels    build all wheels and try them in an empty environment
# make bench     measure every figure against a peer or a limit; some ten minutes on two cores

SCENARIO := ui_fog_day_sparse
FRAMES := 30
PACKAGE :=
OUTPUT := output/demo

ADVERCITY := .venv/bin/advercity
RECORDING := $(OUTPUT)/$(SCENARIO)_$(FRAMES).rrd
SHEET := $(OUTPUT)/contact_sheet.png

.PHONY: demo test test-all coverage setup lock wheels bench

demo: setup
	$(ADVERCITY) compile library --output compiled
	@$(ADVERCITY) assets install $(if $(PACKAGE),--from $(PACKAGE)) || \
	  echo "missing models and photographs are generated (--allow-missing-models);" \
	    "with the packages on this machine: make demo PACKAGE=FOLDER"
	$(ADVERCITY) run compiled/$(SCENARIO).json --profile preview --frames 0:$(FRAMES) \
	  --output $(OUTPUT) --allow-missing-models $(if $(wildcard $(RECORDING)),,--rrd $(RECORDING))
	$(ADVERCITY) sheet $(OUTPUT)/$(SCENARIO) --output $(SHEET)
	@echo
	@echo "dataset (OPV2V):  $(OUTPUT)/$(SCENARIO)"
	@echo "all cameras:      $(SHEET)"
	@echo "recording:        $(RECORDING), to open with: $(ADVERCITY) view $(RECORDING)"

test: setup
	@scripts/check

test-all: setup
	@scripts/check -m ""

coverage: setup
	.venv/bin/pytest -n 2 --cov --cov-report=term:skip-covered --cov-report=html:output/coverage

setup:
	@scripts/setup
	@$(if $(MITSUBA),scripts/setup_mitsuba)

lock: setup
	scripts/lock

wheels:
	scripts/wheels dist

bench: setup
	.venv/bin/python benchmarks/bench.py --output output/bench
