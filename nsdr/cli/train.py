"""`nsdr train PART` and `nsdr extract-features`: their arguments are fields of a configuration."""

import argparse
import logging
from importlib import import_module

from nsdr.cli.common import HELP, KEEP_GOING, KEEP_GOING_HELP, Command, configured, left_out, print_parts
from nsdr.errors import DataError

PARTS = {
    "frame-parser": ("frame_parser", "the detector of objects in frames"),
    "dynamics": ("dynamics", "the paper's network for motion"),
    "collisions": ("collisions", "the network that finds collisions in tracks"),
    "question-parser": ("question_parser", "the networks from texts to programs"),
    "baseline": ("baselines", "a system that answers without programs or without scenes"),
}
"""Of each part the module of `nsdr.training` with its `main(argv)`, and what it is."""


def train(arguments: list[str]) -> int:
    """Train a part from its command-line arguments."""
    part, *rest = arguments or ["nothing"]
    if part in HELP:
        usage = "nsdr train PART [--config configs/….yaml] [--field value] … [--device auto|cpu|cuda|cuda:N]"
        print_parts(usage, PARTS, "nsdr train PART --help shows the fields; --device is short for --loop.device.")
        return 0
    if part not in PARTS:
        raise DataError(f"nsdr train: expected one of {', '.join(PARTS)}, got {part!r}")
    logging.getLogger("nsdr").setLevel(logging.INFO)
    print(import_module(f"nsdr.training.{PARTS[part][0]}").main(rest))
    return 0


def extract_features(arguments: list[str]) -> int:
    """Extract features of videos for the baselines, or make them of the words and boxes of their objects."""
    from nsdr.baselines.features.extraction import FeatureExtraction, WordExtraction, extract_features as extract
    from nsdr.baselines.features.files import SOURCES
    from nsdr.io.files import check_output_folder

    if arguments[:1] in ([name] for name in HELP):
        print("nsdr extract-features [--from videos|truth|proposals] --root DATA -o OUTPUT [--field value] …\n")
        print("  --from         what features are made from (default: videos); with --help after it, shows its fields")
        print(f"  {KEEP_GOING_HELP}")
        return 0
    own = argparse.ArgumentParser("nsdr extract-features", add_help=False, allow_abbrev=False)
    own.add_argument("--from", dest="source", choices=("videos", *SOURCES), default="videos")
    own.add_argument(KEEP_GOING, action="store_true")
    options, fields = own.parse_known_args(arguments)
    if any(argument.partition("=")[0] == "--features.source" for argument in fields):
        raise DataError("--features.source: --from says what features are made from; leave it out")
    extraction: FeatureExtraction | WordExtraction = (
        configured(FeatureExtraction, fields, "extract-features", KEEP_GOING_HELP)
        if options.source == "videos"
        else configured(
            WordExtraction, [*fields, "--features.source", options.source], "extract-features", KEEP_GOING_HELP
        )
    )
    check_output_folder(extraction.output)
    count = extract(extraction, options.keep_going)
    print(f"{extraction.output}: features of {count} videos")
    return left_out(extraction.output)


FUNCTIONS = {
    "extract-features": Command(extract_features),
    "train": Command(train),
}
"""What runs the commands of this file."""
