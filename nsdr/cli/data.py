"""`nsdr data`: CLEVRER's files, and training frames from videos."""

from typing import Any

from nsdr.errors import DataError

__all__ = ["data"]

SHOWN_MISSING = 5


def data(options: Any) -> int:
    """`nsdr data verify|download|frames`."""
    return {"verify": _verify, "download": _download, "frames": _frames}[options.action](options)


def _download(options: Any) -> int:
    from nsdr.clevrer.download import download

    if options.split is None:
        raise DataError("nsdr data download: --split is missing; expected train, validation or test")
    for path in download(options.root, options.split, options.what):
        print(path)
    return 0


def _frames(options: Any) -> int:
    from nsdr.frame_parser.training_frames import write_frames

    if options.proposals is None or options.output is None:
        raise DataError("nsdr data frames: --proposals or --output is missing")
    count = write_frames(options.root, options.proposals, options.output, options.every)
    print(f"{options.output}: {count} frames")
    return 0


def _verify(options: Any) -> int:
    from nsdr.clevrer.dataset import CLEVRER

    print(f"{'split':<12}{'kind':<14}{'found':>7}{'expected':>10}  first missing")
    complete = True
    for row in CLEVRER(options.root).inventory():
        complete &= row.found == row.expected
        first = ", ".join(str(i) for i in row.missing[:SHOWN_MISSING])
        first += ", ..." if len(row.missing) > SHOWN_MISSING else ""
        print(f"{row.split:<12}{row.kind:<14}{row.found:>7}{row.expected:>10}  {first}")
    print("complete" if complete else "incomplete: `nsdr data download` fetches videos, annotations and questions")
    return 0
