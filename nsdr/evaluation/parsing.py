"""Programs of the texts of an evaluation."""

from collections.abc import Iterable, Sequence

from nsdr.clevrer.questions import SceneQuestions
from nsdr.errors import EndpointError, NsdrError
from nsdr.evaluation.score import Parse
from nsdr.symbolic import Program

__all__ = ["endpoint_parse", "parse_all"]


def parse_all(checkpoint: str, device: str, questions: Iterable[SceneQuestions], types: Sequence[str]) -> Parse:
    """Parse every distinct text once, in batches, and look the programs up.

    Args:
        checkpoint: of the question parser.
        device: where it runs.
        questions: whose texts are parsed.
        types: question types that are answered.

    Raises:
        CheckpointError: missing or corrupt weights.
    """
    from nsdr.question_parser.network import QuestionParser

    texts: dict[str, dict[str, None]] = {"descriptive": {}, "multiple_choice": {}, "choice": {}}
    for question in (q for s in questions for q in s.questions if q.type in types):
        texts["descriptive" if question.type == "descriptive" else "multiple_choice"][question.text] = None
        texts["choice"].update(dict.fromkeys(c.text for c in question.choices))
    parser = QuestionParser.from_pretrained(checkpoint, device)
    known: dict[tuple[str, str], Program | NsdrError] = {}
    for kind, listed in texts.items():
        programs = parser.parse_each(list(listed), kind)
        known |= {(text, kind): program for text, program in zip(listed, programs, strict=True)}

    def parse(text: str, kind: str) -> Program:
        program = known[text, kind]
        if isinstance(program, NsdrError):
            raise program
        return program

    return parse


def endpoint_parse(url: str, model: str) -> Parse:
    """The parser on a server; an error of the server is none of a question, and ends the evaluation.

    Raises:
        QuestionError, EndpointError: as of `EndpointParser.connect`.
    """
    from nsdr.question_parser.endpoint import EndpointParser

    parser = EndpointParser.connect(url, model)

    def parse(text: str, kind: str) -> Program:
        try:
            return parser.parse(text, kind)
        except EndpointError as e:
            raise ConnectionError(str(e)) from e

    return parse
