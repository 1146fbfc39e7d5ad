# Makes every shipped weight: `make weights DATA=FOLDER` from the project's folder, or one part, such as `weights-propnet`.
# DATA is a folder with frames/ (`nsdr data frames … -o DATA/frames`) and motion/ (`nsdr data motion CLEVRER -o DATA/motion`).
# What is finished is not made again; the same command resumes what was killed. The folder of each part's runs, and the weights
# as they ship, are written below WEIGHTS. STEPS=2 tries all commands with two steps each.
NSDR ?= nsdr
DATA ?= data
PROPOSALS ?= $(DATA)/motion/proposals.npz
TRUTH ?= $(DATA)/motion/truth.json.gz
WEIGHTS ?= runs/weights
STEPS ?=

TRY := $(if $(STEPS),--loop.steps $(STEPS) --loop.warmup-steps 0)
MOTION := --proposals $(PROPOSALS) --truth $(TRUTH)
FRAMES := --frames $(DATA)/frames
run = $(NSDR) train $(1) --config configs/$(2).yaml --run-dir $(WEIGHTS)/$(3) $(4) $(TRY)

PARTS := $(addprefix weights-,frame-parser propnet propnet-patches propnet-images collisions question-parser baselines)

.PHONY: weights $(PARTS)

weights: $(PARTS)

weights-frame-parser: $(WEIGHTS)/default/frame_parser.json
weights-propnet: $(WEIGHTS)/default/dynamics.json
weights-propnet-patches: $(WEIGHTS)/propnet_patches/dynamics.json
weights-propnet-images: $(WEIGHTS)/propnet_images/dynamics.json
weights-collisions: $(WEIGHTS)/default/collisions.json
weights-question-parser: $(WEIGHTS)/default/question_parser.json
weights-baselines: $(foreach name,truth/tbd truth/tvqa truth/mac truth/mac_objects pixels/mac_objects,$(WEIGHTS)/baselines/$(name)/baseline.json)

$(WEIGHTS)/frame_parser/checkpoint/frame_parser.json:
	$(call run,frame-parser,frame_parser/default,frame_parser,$(FRAMES))

$(WEIGHTS)/default/frame_parser.json: $(WEIGHTS)/frame_parser/checkpoint/frame_parser.json
	$(call run,frame-parser,frame_parser/second,frame_parser_second,$(FRAMES) --initial $(<D) --output $(@D))

$(WEIGHTS)/dynamics/checkpoint/dynamics.json:
	$(call run,dynamics,dynamics/propnet,dynamics,$(MOTION))

$(WEIGHTS)/default/dynamics.json: $(WEIGHTS)/dynamics/checkpoint/dynamics.json
	$(call run,dynamics,dynamics/propnet_second,dynamics_second,$(MOTION) --initial $(<D) --output $(@D))

$(WEIGHTS)/propnet_patches_first/checkpoint/dynamics.json:
	$(call run,dynamics,dynamics/propnet_patches,propnet_patches_first,$(MOTION))

$(WEIGHTS)/propnet_patches/dynamics.json: $(WEIGHTS)/propnet_patches_first/checkpoint/dynamics.json
	$(call run,dynamics,dynamics/propnet_patches_second,propnet_patches_second,$(MOTION) --initial $(<D) --output $(@D))

$(WEIGHTS)/images/statistics.md:
	$(NSDR) generate dataset --config configs/generate/preview.yaml -o $(@D) --videos $(or $(STEPS),400) --splits '{"train": 1}'

$(WEIGHTS)/propnet_images/dynamics.json: $(WEIGHTS)/images/statistics.md
	$(call run,dynamics,dynamics/propnet_images,propnet_images_run,--data $(<D) --output $(@D))

$(WEIGHTS)/default/collisions.json:
	$(call run,collisions,dynamics/collisions,collisions,$(MOTION) --output $(@D))

$(WEIGHTS)/default/question_parser.json:
	$(call run,question-parser,question_parser/default,question_parser,--output $(@D))

ASKED := $(WEIGHTS)/baseline_data/statistics.md
QUESTIONS := --questions $(WEIGHTS)/baseline_data/questions/train.json --validation $(WEIGHTS)/baseline_data/questions/validation.json
ifdef STEPS
QUESTIONS += --plain-steps 1
FEW := --videos 4 --splits '{"train": 0.5, "validation": 0.5}'
endif
$(ASKED):
	$(NSDR) generate dataset --config configs/generate/baselines.yaml -o $(@D) $(FEW)

$(WEIGHTS)/baselines/truth/%/baseline.json: $(ASKED)
	$(NSDR) data features --from truth --root $(<D) -o $(WEIGHTS)/truth_features
	$(call run,baseline,baselines/small/$*,baselines/truth_$*,--output $(@D) --features $(WEIGHTS)/truth_features $(QUESTIONS))

$(WEIGHTS)/baselines/pixels/%/baseline.json: $(ASKED)
	$(NSDR) data features --config configs/baselines/features.yaml --root $(<D) -o $(WEIGHTS)/pixel_features
	$(call run,baseline,baselines/small/$*,baselines/pixels_$*,--output $(@D) --features $(WEIGHTS)/pixel_features --recolor false $(QUESTIONS))
