PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed

# One thread in each process, and what is imported is compiled once and kept.
ENVIRONMENT := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
PYTEST := $(ENVIRONMENT) $(BIN)/pytest
FAST := -m "not slow and not peer"
# Annotations become assertions, shapes included: a quarter of the time of a test.
CHECKED := --jaxtyping-packages=xden1k,xden_bench,xden_baselines,xden_builder,typecheck.checked

# The fast tests, a process for each of these (make test-bench is one), two at a time: none imports
# what all together need.
TESTS := builder bench xden1k access baselines docs export
builder := tests/builder builder
bench := tests/bench benchmarks
xden1k := tests/xden1k xden1k
access := tests/access
export := tests/export
baselines := tests/baselines baselines
docs := tests/docs $(wildcard tests/test_*.py)
TWO_AT_A_TIME := $(MAKE) --jobs=2 --keep-going $(if $(filter output-sync,$(.FEATURES)),--output-sync=target)

.PHONY: setup demo test test-all coverage $(TESTS:%=test-%) lint docs speed sample leaderboard pictures curves segments ablations robustness densities kinds loop x-field picks clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=python3.11 ...")'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet -c constraints.txt torch==2.13.0
	$(BIN)/pip install --quiet -c constraints.txt -e ".[build,cluster,dev,docs]"
	touch $@

demo: setup
	$(BIN)/python demo.py

test: setup
	$(TWO_AT_A_TIME) $(TESTS:%=test-%)

$(TESTS:%=test-%): test-%: setup
	COVERAGE_FILE=.coverage.$* $(PYTEST) --quiet $(FAST) $(COVERED) $($*)

test-all: setup
	$(BIN)/pip install --quiet -c constraints.txt -e ".[tables,peers]"
	$(PYTEST) -n 2 --dist loadfile $(CHECKED) --hypothesis-profile all

coverage: setup  # of the fast tests: statements and branches of each area
	$(TWO_AT_A_TIME) $(TESTS:%=test-%) COVERED="--cov --cov-report="
	$(BIN)/coverage combine --quiet
	for area in xden1k benchmarks baselines builder; do \
	  echo $$area && $(BIN)/coverage report --include="$$area/*" | sed -n '1p;$$p'; \
	done

lint: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	PYTHONPATH=benchmarks:baselines:builder $(BIN)/lint-imports
	$(BIN)/xden-bench leaderboard --check
	rm -rf build/wheel
	$(BIN)/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir build/wheel .
	$(BIN)/check-wheel-contents build/wheel/*.whl

docs: setup  # the site, in build/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

speed: setup
	$(BIN)/xden-build speed
	$(BIN)/xden-bench speed
	$(BIN)/xden-bench speed --loading

# Each category of the test split is in the training split too, and new categories change nothing.
CATEGORIES := remote_control,scissors,pliers,smartphone,ballpoint_pen,electric_toothbrush,water_bottle,thermos,hammer,mug,power_drill,dumbbell
SAMPLE := --count 24 --seed 0 --size 192 --categories $(CATEGORIES)

sample: setup  # remake the packaged sample, then: make leaderboard
	$(BIN)/xden-build phantoms xden1k/sample --as-dataset $(SAMPLE)
	$(BIN)/pytest --quiet tests/xden1k/test_manual.py --update-golden

ROWS := build/rows
# Of the same objects as the dataset XDen-P2000.
PHANTOMS := --count 2000 --seed 2026 --size 256 --unseen benchmarks/protocol-v2.toml
METHODS := zero water train-median category-median xray-uniform xray-mean \
  true-mass-uniform label-nominal part-oracle seen-materials seen-materials-hollow
# What is learned once for each seed: from pictures in minutes, or by a network.
FITTED := nerf2physics-style nerf2physics-style-thickness \
  gaussian-property-style gaussian-property-style-weighted gaussian-property-style-parts
TRAINED := geometry-unet colour-unet xray-unet
SEEDED := $(FITTED) $(TRAINED) surface-net gaussian-property-surface-net
SEEDS := 0 1 2
# The builder without the captures' labels and, unranked, with them.
BUILT := blind labels
ROWS_OF = $(foreach row,$(METHODS) $(BUILT),$(ROWS)/$(1)/$(row).npz) \
  $(foreach seed,$(SEEDS),$(SEEDED:%=$(ROWS)/$(1)/%-$(seed).npz))

# Enters the rows of one split; those that are entered are passed over. Command.
ENTERED = for file in $^; do \
	  test -e $$file.entered || { \
	    $(BIN)/xden-bench $(1) $$file --root $(ROWS)/data --split $* && touch $$file.entered; \
	  } || exit 1; \
	done

leaderboard: rows-test rows-unseen  # all rows, use -j2; what is entered already is passed over
	$(BIN)/xden-bench leaderboard

.SECONDARY:
.SECONDEXPANSION:
rows-test rows-unseen: rows-%: $$(call ROWS_OF,%)
	$(call ENTERED,submit)

$(ROWS)/data/manifest.json: | setup
	$(BIN)/xden-bench dataset XDen-P2000 --out $(ROWS)/data

$(ROWS)/%.npz: $(ROWS)/data/manifest.json
	mkdir -p $(@D)
	$(BIN)/xden-bench baseline $(*F) --split $(*D) --root $(ROWS)/data --out $@

# Learned once, when the row of `test` is made. File, method, seed, budget.
define LEARNED_ROWS
$(ROWS)/test/$(1).npz: $(ROWS)/data/manifest.json
	mkdir -p $$(@D) $(ROWS)/fits
	$(BIN)/xden-bench baseline $(2) $(3) $(4) --save $(ROWS)/fits/$(1) --root $(ROWS)/data --out $$@

$(ROWS)/unseen/$(1).npz: $(ROWS)/test/$(1).npz
	mkdir -p $$(@D)
	$(BIN)/xden-bench baseline $(2) --split unseen $(3) --model $(ROWS)/fits/$(1) \
	  --root $(ROWS)/data --out $$@

endef
$(foreach method,$(TRAINED),$(foreach seed,$(SEEDS),$(eval \
  $(call LEARNED_ROWS,$(method)-$(seed),$(method),--seed $(seed),--budget 20epochs))))
$(foreach method,$(FITTED) surface-net,$(foreach seed,$(SEEDS),$(eval \
  $(call LEARNED_ROWS,$(method)-$(seed),$(method),--seed $(seed)))))
# The second takes the network that the first has trained.
$(foreach seed,$(SEEDS),$(eval $(call LEARNED_ROWS,gaussian-property-surface-net-$(seed),\
  gaussian-property-surface-net,--seed $(seed) --set network=$(ROWS)/fits/surface-net-$(seed)/state)))
$(foreach seed,$(SEEDS),$(eval \
  $(ROWS)/test/gaussian-property-surface-net-$(seed).npz: $(ROWS)/test/surface-net-$(seed).npz))

# What seeing materials is worth: the same methods shown flat pictures, compared and not entered.
SHADED := $(FITTED:%=%-0) colour-unet-0 surface-net-0
$(foreach method,$(FITTED) surface-net,$(eval \
  $(call LEARNED_ROWS,$(method)-0-flat,$(method),--seed 0 --pictures flat)))
$(eval $(call LEARNED_ROWS,colour-unet-0-flat,colour-unet,--seed 0 --pictures flat,--budget 20epochs))

pictures: $(foreach split,test unseen,$(ROWS)/$(split)/seen-materials.npz \
    $(foreach row,$(SHADED),$(ROWS)/$(split)/$(row).npz $(ROWS)/$(split)/$(row)-flat.npz))
	for split in test unseen; do \
	  for row in $(SHADED); do \
	    $(BIN)/xden-bench compare $(ROWS)/$$split/$$row.npz $(ROWS)/$$split/$$row-flat.npz \
	      --root $(ROWS)/data --split $$split || exit 1; \
	  done; \
	  $(BIN)/xden-bench appearance $(foreach row,$(SHADED),$(ROWS)/$$split/$(row).npz \
	    $(ROWS)/$$split/$(row)-flat.npz) --eye $(ROWS)/$$split/seen-materials.npz \
	    --root $(ROWS)/data --split $$split || exit 1; \
	done

# What more objects to learn from are worth: networks that learned from some of them in as
# many steps as those of the board, scored and not entered.
COUNTS := 250 500
CURVED := $(TRAINED) surface-net
epochs-250 := 87
epochs-500 := 44
surface-net-epochs-250 := 44
surface-net-epochs-500 := 22
CURVES := $(foreach count,$(COUNTS),$(CURVED:%=%-0-$(count)))
$(foreach method,$(CURVED),$(foreach count,$(COUNTS),$(eval \
  $(call LEARNED_ROWS,$(method)-0-$(count),$(method),--seed 0,--train-objects $(count) \
  --budget $(or $($(method)-epochs-$(count)),$(epochs-$(count)))epochs))))

curves: $(foreach split,test unseen,$(CURVES:%=$(ROWS)/$(split)/%.npz))
	for split in test unseen; do \
	  for row in $(CURVES); do \
	    echo $$row, $$split && $(BIN)/xden-bench score $(ROWS)/$$split/$$row.npz \
	      --root $(ROWS)/data --split $$split || exit 1; \
	  done; \
	done

# The board of segmentation: rows to read others by, and X-Field's variants with one budget each,
# in seconds of the processor.
READING := one-region position-clusters xray-clusters surface-parts density-clusters
FIELDS := x-field x-field-paper x-field-both x-field-rays x-field-voxel \
  x-field-geometry-density x-field-geometry-contrastive
FIELD_BUDGET := 400s
FIELD_SIZE := tiny
SEGMENTED = $(READING:%=$(ROWS)/segments/$(1)/%.npz) \
  $(foreach seed,$(SEEDS),$(FIELDS:%=$(ROWS)/segments/$(1)/%-$(seed).npz))

segments: segments-test segments-unseen  # all rows of segmentation, use -j2; SEEDS=0 for one each
	$(BIN)/xden-bench leaderboard

segments-test segments-unseen: segments-%: $$(call SEGMENTED,%)
	$(call ENTERED,segment submit)

$(ROWS)/segments/%.npz: $(ROWS)/data/manifest.json
	mkdir -p $(@D)
	$(BIN)/xden-bench baseline $(*F) --task segments --split $(*D) --root $(ROWS)/data --out $@

# Learned once, when the row of `test` is made. File, method, settings, budget if another.
define FIELD_ROWS
$(ROWS)/segments/test/$(1).npz: $(ROWS)/data/manifest.json
	mkdir -p $$(@D) $(ROWS)/fits
	$(BIN)/xden-bench baseline $(2) --task segments $(3) --set size=$(FIELD_SIZE) \
	  --budget $(or $(4),$(FIELD_BUDGET)) --save $(ROWS)/fits/$(1) --root $(ROWS)/data --out $$@

$(foreach split,unseen val,$(ROWS)/segments/$(split)/$(1).npz): $(ROWS)/segments/test/$(1).npz
	mkdir -p $$(@D)
	$(BIN)/xden-bench baseline $(2) --task segments --split $$(notdir $$(@D)) $(3) \
	  --model $(ROWS)/fits/$(1) --root $(ROWS)/data --out $$@

$(foreach how,$(DISTURBANCES),$(ROWS)/segments/val-$(how)/$(1).npz): \
  $(ROWS)/segments/val-%/$(1).npz: $(ROWS)/val-%/manifest.json $(ROWS)/segments/test/$(1).npz
	mkdir -p $$(@D)
	$(BIN)/xden-bench baseline $(2) --task segments --split val $(3) \
	  --model $(ROWS)/fits/$(1) --root $$(<D) --out $$@

endef
# Radiographs that are not as they should be, on copies of `val`.
DISTURBANCES := mean swap px1 px3 scale noise mesh
disturb-mean := --mean
disturb-swap := --swap
disturb-px1 := --shift-px 1
disturb-px3 := --shift-px 3
disturb-scale := --scale 1.05
disturb-noise := --noise 2
disturb-mesh := --mesh-error 1 0.1
$(foreach method,$(FIELDS),$(foreach seed,$(SEEDS),$(eval \
  $(call FIELD_ROWS,$(method)-$(seed),$(method),--seed $(seed)))))
$(foreach part,scale attention third,$(eval \
  $(call FIELD_ROWS,x-field-paper-no-$(part),x-field-paper,--set without=$(part))))
$(eval $(call FIELD_ROWS,x-field-paper-long,x-field-paper,--seed 0,1600s))
$(eval $(call FIELD_ROWS,x-field-paper-longer,x-field-paper,--seed 0,3200s))
EXACT := $(foreach error,deg shift scale gain,--set jitter_$(error)=0)
$(eval $(call FIELD_ROWS,x-field-exact,x-field,$(EXACT)))

$(foreach how,$(DISTURBANCES),$(ROWS)/val-$(how)/manifest.json): \
  $(ROWS)/val-%/manifest.json: $(ROWS)/data/manifest.json
	$(BIN)/xden-bench disturb $(ROWS)/data --out $(@D) --split val $(disturb-$*)

# Scored, compared and not entered: the paper's X-Field without one of its parts or trained longer,
# X-Field that learned without errors of alignment, and what disturbed radiographs cost.
ABLATED := x-field-paper-0 x-field-paper-no-scale x-field-paper-no-attention x-field-paper-no-third \
  x-field-paper-long x-field-paper-longer x-field-0 x-field-exact
DISTURBED := x-field-0 x-field-exact x-field-rays-0 x-field-voxel-0 x-field-both-0 x-field-paper-0
UNDISTURBED := $(DISTURBED) x-field-geometry-contrastive-1

ablations: $(ABLATED:%=$(ROWS)/segments/test/%.npz)
	for file in $^; do \
	  $(BIN)/xden-bench segment score $$file --root $(ROWS)/data --split test || exit 1; \
	done

robustness: $(UNDISTURBED:%=$(ROWS)/segments/val/%.npz) \
    $(foreach how,$(DISTURBANCES),$(DISTURBED:%=$(ROWS)/segments/val-$(how)/%.npz))
	for row in $(UNDISTURBED); do \
	  echo $$row && $(BIN)/xden-bench segment score $(ROWS)/segments/val/$$row.npz \
	    --root $(ROWS)/data --split val || exit 1; \
	done
	for how in $(DISTURBANCES); do \
	  for row in $(DISTURBED); do \
	    echo $$row, $$how && $(BIN)/xden-bench segment score $(ROWS)/segments/val-$$how/$$row.npz \
	      --root $(ROWS)/val-$$how --split val || exit 1; \
	  done; \
	done

# Densities of the fits that segment, on the board of `xray`.
DENSE := x-field-0 x-field-paper-longer
DENSE_OF = $(foreach row,$(DENSE),$(ROWS)/$(1)/$(row).npz)
$(foreach split,test unseen,$(foreach row,$(DENSE),$(eval \
  $(ROWS)/$(split)/$(row).npz: $(ROWS)/segments/test/$(row).npz)))
$(foreach split,test unseen,$(DENSE:%=$(ROWS)/$(split)/%.npz)):
	mkdir -p $(@D)
	$(BIN)/xden-bench baseline $(patsubst %-longer,%,$(patsubst %-0,%,$(basename $(@F)))) --split $(notdir $(@D)) \
	  --model $(ROWS)/fits/$(basename $(@F)) --set size=$(FIELD_SIZE) --root $(ROWS)/data --out $@

densities: densities-test densities-unseen
	$(BIN)/xden-bench leaderboard

densities-test densities-unseen: densities-%: $$(call DENSE_OF,%)
	$(call ENTERED,submit)

# Where points are lost, what differs beyond doubt (of each seed, on both splits), and six objects.
LOSING := x-field-0 x-field-geometry-contrastive-0
SIX := soap_dispenser-0009,teapot-0012,scissors-0010,rubber_ball-0006,remote_control-0005,picture_frame-0013
BESIDE := xray-clusters surface-parts
COMPARED = $(foreach seed,$(SEEDS),$(FIELDS:%=%-$(seed)))

kinds: $(foreach split,test unseen,$(patsubst %,$(ROWS)/segments/$(split)/%.npz, \
    $(sort $(LOSING) $(BESIDE) $(COMPARED))))
	for split in test unseen; do \
	  $(BIN)/xden-bench segment kinds $(foreach row,$(LOSING),$(ROWS)/segments/$$split/$(row).npz) \
	    --root $(ROWS)/data --split $$split || exit 1; \
	  for row in $(filter-out x-field-geometry-contrastive-%,$(COMPARED)); do \
	    for other in x-field-geometry-contrastive-$${row##*-} $(BESIDE); do \
	      $(BIN)/xden-bench segment compare $(ROWS)/segments/$$split/$$row.npz \
	        $(ROWS)/segments/$$split/$$other.npz --root $(ROWS)/data --split $$split || exit 1; \
	    done; \
	  done; \
	done
	$(BIN)/xden-bench segment show $(SIX) $(ROWS)/segments/test/x-field-0.npz \
	  $(ROWS)/segments/test/x-field-geometry-contrastive-0.npz --root $(ROWS)/data \
	  --picture docs/images/x-field.png

# Parts that nobody has annotated, rebuilt; 3 is the exit code where single objects are refused.
LOOP := $(ROWS)/loop
loop: $(ROWS)/segments/test/x-field-0.npz
	$(BIN)/xden-build phantoms $(LOOP)/captures --split test \
	  $(subst --count 2000,--count 340,$(PHANTOMS))
	$(BIN)/xden-build run $(LOOP)/captures --out $(LOOP)/whole --outer-only || test $$? = 3
	$(BIN)/python -m xden_baselines.xfield parts $(ROWS)/fits/x-field-0 $(LOOP)/whole \
	  --out $(LOOP)/parts || test $$? = 3
	$(BIN)/xden-build run $(LOOP)/captures --out $(LOOP)/proposed --parts $(LOOP)/parts || test $$? = 3
	$(BIN)/xden-build audit $(LOOP)/proposed --captures $(LOOP)/captures || test $$? = 3
	$(BIN)/xden-build run $(LOOP)/captures --out $(LOOP)/annotated || test $$? = 3
	$(BIN)/xden-build evaluate $(LOOP)/captures --by-voxel --rebuilt $(LOOP)/whole \
	  --rebuilt $(LOOP)/proposed --rebuilt $(LOOP)/annotated

x-field: segments densities ablations robustness kinds loop  # every table of docs/method/x-field.md

# Simulated picks by methods' centres of mass, on the full tier of either split.
PICKING := category-median nerf2physics-style-0 gaussian-property-style-0 colour-unet-0 \
  geometry-unet-0 xray-mean xray-unet-0 blind
PICKS := benchmarks/picks
scenes-test := $(ROWS)/scenes
scenes-unseen := $(ROWS)/scenes-unseen

picks: picks-test picks-unseen
	$(BIN)/xden-bench leaderboard

picks-test picks-unseen: picks-%: $$(foreach row,$$(PICKING),$(ROWS)/%/$$(row).npz) \
    $$(scenes-%)/scenes.json
	$(BIN)/xden-bench manip run $(scenes-$*) $(PICKING:%=$(ROWS)/$*/%.npz) \
	  --root $(ROWS)/data --out $(PICKS)/$*-full --workers 2
	$(BIN)/xden-bench manip table $(PICKS)/$*-full/*.json

$(foreach split,test unseen,$(scenes-$(split))/scenes.json): $(ROWS)/data/manifest.json
	$(BIN)/xden-bench manip prepare $(ROWS)/data \
	  --split $(if $(filter %-unseen,$(@D)),unseen,test) --tier full --out $(@D)

$(foreach split,test unseen,$(BUILT:%=$(ROWS)/$(split)/%.npz)): \
  $(ROWS)/%.npz: $(ROWS)/rebuilt/%/manifest.json $(ROWS)/data/manifest.json
	mkdir -p $(@D)
	$(BIN)/xden-bench baseline root --from $(ROWS)/rebuilt/$* --split $(*D) --root $(ROWS)/data --out $@

$(ROWS)/rebuilt/test/%/manifest.json: $(ROWS)/captures/test/objects.csv
	$(BIN)/xden-build run $(<D) --out $(@D) $(if $(filter blind,$*),--blind)

$(ROWS)/rebuilt/unseen/%/manifest.json: $(ROWS)/captures/unseen/objects.csv
	$(BIN)/xden-build run $(<D) --out $(@D) $(if $(filter blind,$*),--blind)

$(ROWS)/captures/%/objects.csv: | setup
	$(BIN)/xden-build phantoms $(@D) --split $* $(PHANTOMS)

clean:
	rm -rf .venv .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis demo-output build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
