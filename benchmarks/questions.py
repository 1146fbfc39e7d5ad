"""How the question parser reads texts in people's words: `python benchmarks/questions.py FILE.json ... --rules 200`.

A file is a list of rows `{"kind", "text", "program"}` with a kind of text, and postfix tokens or null for a text that must be
refused; `also` lists other programs that are right. Prints, for each file and kind, the shares that are right, refused, and
accepted and wrong, and those of the texts that must be refused, with 95 % intervals. Three sets ship:
`benchmarks/questions_by_hand.json` and `nsdr/language/paraphrases.json` were used to tune the rules;
`benchmarks/questions_blind.json` was written by someone who had not seen the parser, and nobody who tunes it may read it.
"""

import argparse
import warnings
from collections.abc import Sequence
from typing import Any

from rewordings import drawn_rows

from nsdr.errors import DataError, QuestionError
from nsdr.evaluation.measures import wilson_interval
from nsdr.io.reading import read_json
from nsdr.question_parser.parser import QuestionParser

RIGHT, REFUSED, WRONG = "right", "refused", "accepted and wrong"


def outcome(parser: QuestionParser, row: dict[str, Any]) -> tuple[str, str]:
    """What becomes of a text, and its program or the error."""
    try:
        program = str(parser.parse(row["text"], row["kind"]))
    except (QuestionError, DataError) as e:
        return REFUSED, str(e)
    return (RIGHT if program in (row["program"], *row.get("also", ())) else WRONG), program


def shares(outcomes: Sequence[str]) -> str:
    """Each outcome's share in percent, with its interval."""
    texts = []
    for name in (RIGHT, REFUSED, WRONG):
        share = outcomes.count(name) / max(1, len(outcomes))
        low, high = wilson_interval(share, len(outcomes))
        texts.append(f"{name} {100 * share:5.1f} ({100 * low:.1f}-{100 * high:.1f})")
    return f"{len(outcomes):>5}  " + "  ".join(texts)


def report(parser: QuestionParser, name: str, rows: Sequence[dict[str, Any]], is_listed: bool) -> None:
    """Print the table of one set, and each failure if `is_listed`."""
    found = [outcome(parser, row) for row in rows]
    print(name)
    for kind in ("descriptive", "multiple_choice", "choice", "all"):
        of_kind = [(r, f[0]) for r, f in zip(rows, found, strict=True) if kind in (r["kind"], "all")]
        print(f"  {kind:<16} {shares([f for r, f in of_kind if r['program']])}")
    traps = [f for r, f in zip(rows, found, strict=True) if not r["program"]]
    print(f"  {'to be refused':<16} {shares([f[0] for f in traps])}")
    for row, (what, text) in zip(rows, found, strict=True) if is_listed else ():
        if what != (RIGHT if row["program"] else REFUSED):
            print(f"  {what}: {row['text']!r} -> {text}")


def main() -> None:
    """Read the sets and print their tables."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("files", nargs="*", help="sets of texts")
    arguments.add_argument("--rules", type=int, default=0, help="also so many texts made by rule")
    arguments.add_argument("--seed", type=int, default=0, help="seed of these")
    arguments.add_argument("--checkpoint", default="default", help="checkpoint of the parser")
    arguments.add_argument("--min_probability", type=float, default=None, help="instead of the parser's own threshold")
    arguments.add_argument("--list", action="store_true", help="print each failure")
    options = arguments.parse_args()
    parser = QuestionParser.from_pretrained(options.checkpoint)
    if options.min_probability is not None:
        parser.min_probability = options.min_probability
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for path in options.files:
            report(parser, path, read_json(path), options.list)
        if options.rules:
            rows = drawn_rows(options.rules, options.seed)
            report(parser, f"{options.rules} texts by rules, seed {options.seed}", rows, options.list)


if __name__ == "__main__":
    main()
