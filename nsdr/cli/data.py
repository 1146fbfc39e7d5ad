"""`nsdr data`: CLEVRER's files, and training data made from them."""

from typing import Any

from nsdr.cli.status import left_out
from nsdr.errors import DataError
from nsdr.io.files import check_output_folder

__all__ = ["data"]

SHOWN_MISSING = 5
TAKES: dict[str, dict[str, Any]] = {
    "verify": {},
    "download": {"split": None, "what": ["videos", "annotations", "questions"], "trust_first_use": False},
    "frames": {"proposals": None, "output": None, "every": 8, "keep_going": False},
    "motion": {"output": None, "split": "train", "engine": "processes", "workers": 0, "keep_going": False},
}
"""The options of each action, and their defaults; None for those that must be given."""


def data(options: Any) -> int:
    """`nsdr data verify|download|frames|motion`."""
    action, takes = options.action, TAKES[options.action]
    for name in sorted({name for values in TAKES.values() for name in values}):
        if getattr(options, name) is None:
            setattr(options, name, takes.get(name))
            if name in takes and takes[name] is None:
                raise DataError(f"nsdr data {action}: --{name.replace('_', '-')} is missing")
        elif name not in takes:
            raise DataError(f"nsdr data {action}: --{name.replace('_', '-')} does nothing here")
    return {"verify": _verify, "download": _download, "frames": _frames, "motion": _motion}[action](options)


def _download(options: Any) -> int:
    from nsdr.clevrer.download import download

    for path in download(options.root, options.split, options.what, trust_first_use=options.trust_first_use):
        print(path)
    return 0


def _frames(options: Any) -> int:
    from nsdr.frame_parser.training_frames import write_frames

    check_output_folder(options.output)
    count = write_frames(options.root, options.proposals, options.output, options.every, keep_going=options.keep_going)
    print(f"{options.output}: {count} frames")
    return left_out(options.output)


def _motion(options: Any) -> int:
    from nsdr.clevrer.compact_files import PROPOSALS_FILE, TRUTH_FILE, write_compact_files

    o = options
    check_output_folder(o.output)
    count = write_compact_files(o.root, o.output, o.split, o.engine, o.workers, o.keep_going)
    print(f"{o.output}: {PROPOSALS_FILE} and {TRUTH_FILE} of {count} videos")
    return left_out(o.output)


def _verify(options: Any) -> int:
    from nsdr.clevrer.dataset import CLEVRER

    rows, complete = CLEVRER(options.root).inventory(), True
    print(f"{'split':<12}{'kind':<14}{'found':>7}{'expected':>10}  first missing")
    for row in rows:
        complete &= row.found == row.expected
        first = ", ".join(str(i) for i in row.missing[:SHOWN_MISSING])
        first += ", ..." if len(row.missing) > SHOWN_MISSING else ""
        print(f"{row.split:<12}{row.kind:<14}{row.found:>7}{row.expected:>10}  {first}")
    print("complete" if complete else "incomplete: `nsdr data download` fetches videos, annotations and questions")
    return 0 if complete else 1
