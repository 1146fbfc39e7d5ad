"""`nsdr extract-features`: features of videos for the baselines."""

from collections.abc import Sequence

from nsdr.baselines.features.extraction import FeatureExtraction, extract_features
from nsdr.io.configuration import parse_config
from nsdr.io.files import check_output_folder

__all__ = ["main"]

KEEP_GOING = "--keep-going"
"""Flag: leave out the videos that failed."""


def main(argv: Sequence[str]) -> str:
    """Extract features as the arguments say (`-o` is short for `--output`); returns the folder that was written.

    Raises:
        DataError: as of `extract_features`.
    """
    arguments = ["--output" if a == "-o" else a for a in argv if a != KEEP_GOING]
    extraction = parse_config(FeatureExtraction, arguments, "nsdr extract-features")
    check_output_folder(extraction.output)
    count = extract_features(extraction, KEEP_GOING in argv)
    print(f"{extraction.output}: features of {count} videos")
    return extraction.output
