"""`nsdr data verify|download|frames|motion|features` and `nsdr export`: data sets, and what is made of them to train on."""

import argparse
from typing import Any

from jsonargparse.typing import NonNegativeInt, PositiveInt

from nsdr.clevrer.dataset import CLEVRER, SPLITS
from nsdr.clevrer.layout import FOLDERS
from nsdr.cli.common import HELP, KEEP_GOING, KEEP_GOING_HELP, Command, configured, left_out, shared_options
from nsdr.errors import DataError
from nsdr.io.files import check_output_folder

SHOWN_MISSING = 5


def data_verify_options(parser: Any) -> None:
    parser.add_argument("root", help="the data set's folder")


def data_verify(options: Any) -> int:
    """`nsdr data verify`: how many files of each kind there are; status 1 if some are missing."""
    dataset, complete = CLEVRER(options.root), True
    rows = dataset.inventory()
    print(f"{'split':<12}{'kind':<14}{'found':>7}{'expected':>10}  first missing")
    for row in rows:
        complete &= row.found == row.expected
        first = ", ".join(str(i) for i in row.missing[:SHOWN_MISSING])
        first += ", ..." if len(row.missing) > SHOWN_MISSING else ""
        print(f"{row.split:<12}{row.kind:<14}{row.found:>7}{row.expected:>10}  {first}")
    for kind in dict.fromkeys(row.kind for row in rows if row.kind in FOLDERS):
        if not any(row.found for row in rows if row.kind == kind):
            print(f"no {kind}: {dataset.files.expected(kind)}")
    print("complete" if complete else "incomplete: `nsdr data download` fetches videos, annotations and questions")
    return 0 if complete else 1


def data_download_options(parser: Any) -> None:
    add = parser.add_argument
    add("root", help="folder to write to")
    add("--split", default="validation", choices=[*SPLITS], help="which videos")
    kinds = ["videos", "annotations", "questions"]
    add("--what", nargs="+", default=kinds, help="videos, annotations, questions (default: all)")


def data_download(options: Any) -> int:
    """`nsdr data download`: files of a split."""
    from nsdr.clevrer.download import download

    for path in download(options.root, options.split, options.what):
        print(path)
    return 0


def data_frames_options(parser: Any) -> None:
    add = parser.add_argument
    add("root", help="the videos' folder")
    add("--proposals", required=True, help="folder of the videos' mask proposals")
    add("-o", "--output", required=True, help="folder to write")
    add("--every", type=PositiveInt, default=8, help="take every n-th frame (default: 8)")
    shared_options(parser, "failures")


def data_frames(options: Any) -> int:
    """`nsdr data frames`: what `nsdr train frame-parser` reads."""
    from nsdr.frame_parser.training_frames import write_frames

    check_output_folder(options.output)
    count = write_frames(options.root, options.proposals, options.output, options.every, keep_going=options.keep_going)
    print(f"{options.output}: {count} frames")
    return left_out(options.output)


def data_motion_options(parser: Any) -> None:
    add = parser.add_argument
    add("root", help="the data set's folder")
    add("-o", "--output", required=True, help="folder to write")
    add("--split", default="validation", choices=[*SPLITS], help="which videos")
    shared_options(parser, "work", "failures")


def data_motion(options: Any) -> int:
    """`nsdr data motion`: what `nsdr train dynamics` and `nsdr train collisions` read."""
    from nsdr.clevrer.compact_files import PROPOSALS_FILE, TRUTH_FILE, write_compact_files

    o = options
    check_output_folder(o.output)
    count = write_compact_files(o.root, o.output, o.split, o.engine, o.workers, o.keep_going)
    print(f"{o.output}: {PROPOSALS_FILE} and {TRUTH_FILE} of {count} videos")
    return left_out(o.output)


def data_features(arguments: list[str]) -> int:
    """`nsdr data features`: features of videos for the baselines, or of the words and boxes of their objects."""
    from nsdr.baselines.features.extraction import FeatureExtraction, WordExtraction, extract_features as extract
    from nsdr.baselines.features.files import SOURCES
    from nsdr.io.files import check_output_folder

    if arguments[:1] in ([name] for name in HELP):
        print("nsdr data features [--from videos|truth|proposals] --root DATA -o OUTPUT [--field value] …\n")
        print("  --from         what features are made from (default: videos); with --help after it, shows its fields")
        print(f"  {KEEP_GOING_HELP}")
        return 0
    own = argparse.ArgumentParser("nsdr data features", add_help=False, allow_abbrev=False)
    own.add_argument("--from", dest="source", choices=("videos", *SOURCES), default="videos")
    own.add_argument(KEEP_GOING, action="store_true")
    options, fields = own.parse_known_args(arguments)
    if any(argument.partition("=")[0] == "--features.source" for argument in fields):
        raise DataError("--features.source: --from says what features are made from; leave it out")
    extraction: FeatureExtraction | WordExtraction = (
        configured(FeatureExtraction, fields, "data features", "baselines", KEEP_GOING_HELP)
        if options.source == "videos"
        else configured(
            WordExtraction,
            [*fields, "--features.source", options.source],
            "data features",
            "baselines",
            KEEP_GOING_HELP,
        )
    )
    check_output_folder(extraction.output)
    count = extract(extraction, options.keep_going)
    print(f"{extraction.output}: features of {count} videos")
    return left_out(extraction.output)


def export_options(parser: Any) -> None:
    from nsdr.generate.export.formats import FORMATS
    from nsdr.generate.export.writing import PAIRS

    add = parser.add_argument
    add("root", help="the data set's folder: generated, or in the official layout")
    purposes = {name: form.purpose for name, form in FORMATS.items()}
    purposes[PAIRS] = "a data set that asks each question about two videos"
    about = "; ".join(f"{name} ({purpose})" for name, purpose in purposes.items())
    add("--format", required=True, choices=[*purposes], help=about)
    add("-o", "--output", required=True, help="folder to write")
    add(
        "--split",
        dest="splits",
        nargs="+",
        default=[],
        metavar="SPLIT",
        help="which splits (default: train and validation, as far as they are there)",
    )
    add("--questions", default="", help="question file of the one --split, in place of the data set's")
    add("--videos", default="copy", choices=["copy", "none"], help="copy them, or none (paths only)")
    add("--frames", type=NonNegativeInt, default=0, help="number of frames in place of a video (trl; default: 16)")
    width = "width of these frames in pixels (default: 240, or that of the images if they are narrower)"
    add("--frame-width", type=PositiveInt, default=None, help=width)
    add(
        "--prefix", default="", help="written before each path, such as the folder as training sees it, with its last /"
    )
    add("--limit", type=NonNegativeInt, default=0, help="first n videos of each split; 0 for all")
    add(
        "--reasoning",
        default="",
        choices=["", "short", "long"],
        help="sentences that lead to each answer, from true scenes",
    )
    add("--scenes", action="store_true", help="the true scenes, too, for the reward evidence")


def export(options: Any) -> int:
    """`nsdr export`."""
    from nsdr.generate.export import ExportConfig, export_dataset

    config = ExportConfig(**{**vars(options), "splits": tuple(options.splits)})
    for name, summary in export_dataset(config).items():
        print(f"{options.output}: {name}: {summary.questions} questions about {summary.videos} videos")
    return 0


FUNCTIONS = {
    "data verify": Command(data_verify, data_verify_options),
    "data download": Command(data_download, data_download_options),
    "data frames": Command(data_frames, data_frames_options),
    "data motion": Command(data_motion, data_motion_options),
    "data features": Command(data_features),
    "export": Command(export, export_options),
}
"""What runs the commands of this file."""
