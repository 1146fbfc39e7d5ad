"""Programs of the texts of an evaluation."""

from collections.abc import Iterable, Sequence

from nsdr.clevrer.files.questions import SceneQuestions
from nsdr.errors import NsdrError
from nsdr.evaluation.score import Parse
from nsdr.question_parser.base import Parser
from nsdr.symbolic import Program

__all__ = ["parse_all"]


def parse_all(parser: Parser, questions: Iterable[SceneQuestions], types: Sequence[str]) -> Parse:
    """Parse every distinct text once, in batches, and look the programs up.

    Args:
        parser: of the texts.
        questions: whose texts are parsed.
        types: question types that are answered.

    Raises:
        EndpointError: the server of the parser fails.
    """
    texts: dict[str, dict[str, None]] = {"descriptive": {}, "multiple_choice": {}, "choice": {}}
    for question in (q for s in questions for q in s.questions if q.type in types):
        texts["descriptive" if question.type == "descriptive" else "multiple_choice"][question.text] = None
        texts["choice"].update(dict.fromkeys(c.text for c in question.choices))
    known: dict[tuple[str, str], Program | NsdrError] = {}
    for kind, listed in texts.items():
        programs = parser.parse_batch(list(listed), kind)
        known |= {(text, kind): program for text, program in zip(listed, programs, strict=True)}

    def parse(text: str, kind: str) -> Program:
        program = known[text, kind]
        if isinstance(program, NsdrError):
            raise program
        return program

    return parse
