# Makes data and weights of a world: `make world NAME=pucks` for one that ships, `make world NAME=mine WORLD=mine.yaml` for your own.
# VIDEOS are for training. What is finished is not made again; the same command resumes what was killed. Data and runs are written
# below RUNS, the weights to OUTPUT. STEPS=2 VIDEOS=4 only tries all commands, in a folder of its own.
NSDR ?= nsdr
NAME ?= pucks
WORLD ?= $(NAME)
VIDEOS ?= 160
STEPS ?=
RUNS ?= runs/worlds/$(NAME)$(if $(STEPS),/try)
OUTPUT ?= $(RUNS)/checkpoint

TRY := $(if $(STEPS),--loop.steps $(STEPS) --loop.warmup-steps 0)
DATA := $(RUNS)/data

.PHONY: world

world: $(OUTPUT)/frame_parser.json $(OUTPUT)/collisions.json $(OUTPUT)/question_parser.json

$(DATA)/statistics.md: $(wildcard $(WORLD))
	$(NSDR) generate dataset --world $(WORLD) -o $(@D) --videos $(VIDEOS) --seed 1 --splits '{"train": 1}' --questions null

$(RUNS)/frames/world.json: $(DATA)/statistics.md
	$(NSDR) data frames $(DATA)/videos/train --proposals $(DATA)/derender_proposals -o $(@D)

$(RUNS)/motion/truth.json.gz: $(DATA)/statistics.md
	$(NSDR) data motion $(DATA) --split train -o $(@D)

$(OUTPUT)/frame_parser.json: $(RUNS)/frames/world.json
	$(NSDR) train frame-parser --config world --frames $(<D) --run-dir $(RUNS)/frame_parser --output $(@D) $(TRY)

$(OUTPUT)/collisions.json: $(RUNS)/motion/truth.json.gz
	$(NSDR) train collisions --config collisions_world --proposals $(<D)/proposals.npz --truth $< --run-dir $(RUNS)/collisions --output $(@D) $(TRY)

$(OUTPUT)/question_parser.json:
	$(NSDR) train question-parser --config default --world $(WORLD) --run-dir $(RUNS)/question_parser --output $(@D) $(TRY)
