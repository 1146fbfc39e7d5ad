"""How the question parsers read texts in people's words: `python -m benchmarks.questions FILE.json ...`.

A file is a list of rows `{"kind", "text", "program"}` with a kind of text, and postfix tokens or null for a text that must be
refused; `also` lists other programs that are right. A question file in CLEVRER's format counts, too: its texts and programs.
Prints, for each file and parser, the shares that are right, refused, and accepted and wrong, by kind of text, and those of
the texts that must be refused, with 95 % intervals. Parsers: "grammar", the default, and "network", the paper's. The sets
that ship were used to tune the rules, but for `questions_blind4.json`; the blind ones are by people who had not seen the
parser, and were measured before they were opened.
"""

from collections.abc import Sequence
from typing import Any

from benchmarks.shared import parser_of, percent
from nsdr.clevrer.files.questions import read_questions
from nsdr.errors import DataError, NsdrError, QuestionError
from nsdr.io.reading import read_json
from nsdr.language.texts import TEXT_KINDS
from nsdr.question_parser.base import Parser
from nsdr.question_parser.loading import load_parser

RIGHT, REFUSED, WRONG = "right", "refused", "accepted and wrong"
PARSERS = ("grammar", "network")


def read_rows(path: str) -> list[dict[str, Any]]:
    """The rows of a file; of a question file, each text once."""
    content = read_json(path)
    if content and "questions" not in content[0]:
        return content
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    for q in (q for scene in read_questions(path) for q in scene.questions):
        found = [("multiple_choice" if q.choices else "descriptive", q.text, q.program)]
        for kind, text, program in [*found, *(("choice", c.text, c.program) for c in q.choices)]:
            if program:
                rows[kind, text] = {"kind": kind, "text": text, "program": " ".join(program)}
    return list(rows.values())


def outcomes(parser: Parser, rows: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    """What becomes of each text, and its program or the error."""
    found: dict[int, tuple[str, str]] = {}
    for kind in TEXT_KINDS:
        numbers = [i for i, row in enumerate(rows) if row["kind"] == kind]
        for i, program in zip(numbers, parser.parse_batch([rows[i]["text"] for i in numbers], kind), strict=True):
            if isinstance(program, QuestionError | DataError):
                found[i] = REFUSED, str(program)
            elif isinstance(program, NsdrError):
                raise program
            else:
                right = str(program) in (rows[i]["program"], *rows[i].get("also", ()))
                found[i] = (RIGHT if right else WRONG), str(program)
    return [found[i] for i in range(len(rows))]


def shares(found: Sequence[str]) -> str:
    """Each outcome's share in percent, with its interval."""
    return f"{len(found):>5}  " + "  ".join(
        f"{n} {percent(found.count(n), len(found))}" for n in (RIGHT, REFUSED, WRONG)
    )


def report(parser: Parser, name: str, rows: Sequence[dict[str, Any]], is_listed: bool) -> None:
    """Print the table of one set and parser, and each failure if `is_listed`."""
    found = outcomes(parser, rows)
    print(name)
    for kind in (*TEXT_KINDS, "all"):
        of_kind = [(r, f[0]) for r, f in zip(rows, found, strict=True) if kind in (r["kind"], "all")]
        print(f"  {kind:<16} {shares([f for r, f in of_kind if r['program']])}")
    traps = [f for r, f in zip(rows, found, strict=True) if not r["program"]]
    print(f"  {'to be refused':<16} {shares([f[0] for f in traps])}")
    for row, (what, text) in zip(rows, found, strict=True) if is_listed else ():
        if what != (RIGHT if row["program"] else REFUSED):
            print(f"  {what}: {row['text']!r} -> {text}")


def main() -> None:
    """Read the sets and print their tables."""
    arguments = parser_of(__doc__)
    arguments.add_argument("files", nargs="*", help="sets of texts")
    arguments.add_argument("--checkpoint", default="default", help="checkpoint of the networks")
    arguments.add_argument("--parser", nargs="+", choices=PARSERS, default=PARSERS, help="the parsers to measure")
    arguments.add_argument("--list", action="store_true", help="print each failure")
    options = arguments.parse_args()
    sets = {path: read_rows(path) for path in options.files}
    for name in options.parser:
        parser = load_parser(name, options.checkpoint)
        for path, rows in sets.items():
            report(parser, f"{path}, {name}", rows, options.list)


if __name__ == "__main__":
    main()
