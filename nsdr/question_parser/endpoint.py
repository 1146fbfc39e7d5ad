"""An optional question parser: a language model behind an OpenAI-compatible endpoint proposes the program.

The model is not trusted. Its reply counts only if it holds a program that the signature table permits, whose result is of the
kind of text, and that neither loses nor invents a part of the text (`check_coverage`).
"""

import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, Self

from nsdr.errors import ProgramError, QuestionError
from nsdr.language.templates import TEXT_KINDS
from nsdr.question_parser.chat_client import ChatClient
from nsdr.question_parser.constraint import allowed
from nsdr.question_parser.coverage import check_coverage, check_text
from nsdr.question_parser.tokenizer import END
from nsdr.symbolic.modules import MODULES, WORDS
from nsdr.symbolic.program import Program
from nsdr.symbolic.reference import reference_page

__all__ = ["EXAMPLES", "EndpointParser"]

TIMEOUT_S = 120.0
"""Default of the longest time for a reply (s)."""
KEPT_TEXTS = 1 << 16
"""Texts whose programs a parser keeps: choices are repeated, and the server is slow."""
NO_PROGRAM = "NONE"
"""Reply for a text that no program stands for."""
QUOTED_CHARACTERS = 200
"""Length of what an error quotes of a reply."""
KIND_NAMES = {
    "descriptive": "a descriptive question",
    "multiple_choice": "a multiple-choice question",
    "choice": "a choice",
}
EXAMPLES: dict[str, dict[str, str]] = {
    "descriptive": {
        "How many rubber cubes enter the scene?": (
            "events objects rubber filter_material cube filter_shape filter_in count"
        ),
        "How many collisions happen after the red object exits the scene?": (
            "events events objects red filter_color unique filter_out unique filter_after objects filter_collision count"
        ),
        "Are there any moving spheres when the video ends?": "objects sphere filter_shape end get_frame filter_moving exist",
        "How many stationary objects are there?": "objects null filter_stationary count",
        "What color is the last object to collide with the metal cube?": (
            "events objects metal filter_material cube filter_shape unique filter_collision last filter_order "
            "objects metal filter_material cube filter_shape unique get_col_partner query_color"
        ),
        "What is the shape of the object that is moving when the gray cylinder enters the scene?": (
            "objects events objects gray filter_color cylinder filter_shape unique filter_in unique get_frame "
            "filter_moving unique query_shape"
        ),
        "What material is the first object that exits the scene?": (
            "events objects filter_out first filter_order get_object query_material"
        ),
        "How many cubes are larger than the sphere?": NO_PROGRAM,
    },
    "multiple_choice": {
        "Which of the following is responsible for the collision between the cube and the blue sphere?": (
            "events events objects cube filter_shape unique filter_collision objects blue filter_color sphere filter_shape "
            "unique filter_collision unique filter_ancestor belong_to"
        ),
        "Which of the following is not responsible for the cylinder's exiting the scene?": (
            "events events objects cylinder filter_shape unique filter_out unique filter_ancestor belong_to negate"
        ),
        "What will happen next?": "unseen_events belong_to",
        "Which event will happen if the green sphere is removed?": (
            "all_events objects green filter_color sphere filter_shape unique get_counterfact belong_to"
        ),
        "Without the metal cube, which event will not happen?": (
            "all_events objects metal filter_material cube filter_shape unique get_counterfact belong_to negate"
        ),
        "What will happen if the metal cube is painted red?": NO_PROGRAM,
    },
    "choice": {
        "The red sphere collides with the cube": (
            "all_events objects red filter_color sphere filter_shape unique filter_collision "
            "objects cube filter_shape unique filter_collision unique"
        ),
        "the collision between the red sphere and the cube": (
            "events objects red filter_color sphere filter_shape unique filter_collision "
            "objects cube filter_shape unique filter_collision unique"
        ),
        "the blue cylinder's entrance": "events objects blue filter_color cylinder filter_shape unique filter_in unique",
        "the rubber object's exiting the scene": "events objects rubber filter_material unique filter_out unique",
        "the presence of the yellow metal cube": (
            "objects yellow filter_color metal filter_material cube filter_shape unique"
        ),
        "The red sphere turns blue": NO_PROGRAM,
    },
}
"""Texts and programs that the model is shown, by kind of text."""
_RULES = f"""You translate English about a video of colliding objects into programs.

{reference_page()}
## Rules

- Reply with the tokens of one program in postfix order on one line, and with nothing else. Do not answer the question.
- Use tokens of the first table and of the words only.
- A program says exactly what the text says. Leave out nothing and add nothing: colors, materials, shapes, "first", "last",
  "not", times and conditions. If no program has exactly the text's meaning, or it is no such text, reply {NO_PROGRAM}.
- Filter by color, then material, then shape. `unique` makes the only member of a set of it: "the red cube" is
  `objects red filter_color cube filter_shape unique`, "red cubes" is the same without `unique`.
- descriptive: a question by itself. multiple_choice: a question about a choice that is given elsewhere; its program ends in
  `belong_to` (with `negate` after it for "not"), whose first argument is left open for the choice. choice: an event or object.
"""
_TOKENS = frozenset([*(name for name, module in MODULES.items() if module.in_data_set), *WORDS])


class EndpointParser:
    """Parses texts as `QuestionParser` does, with a language model on a server.

    Args:
        url: base address of an OpenAI-compatible server, such as "http://localhost:8000/v1"; http or https. The environment
            variable OPENAI_API_KEY, if it is set, is sent as the key.
        model: the model's name; "" for the only one that the server has, which is asked for when first needed.
        timeout_s: longest time for a reply (s).

    Raises:
        QuestionError: an address of another form, or a `timeout_s` that is not positive.
    """

    def __init__(self, url: str, model: str = "", timeout_s: float = TIMEOUT_S) -> None:
        self.client = ChatClient(url, timeout_s)
        self.model = model
        self._kept = lru_cache(KEPT_TEXTS)(self._asked)

    @classmethod
    def connect(cls, url: str, model: str = "", **options: Any) -> Self:
        """The parser of a server that is there; `options` are further arguments of the constructor.

        Raises:
            QuestionError: as of the constructor.
            EndpointError: the server does not answer or refuses; without `model`, it has no model or several.
        """
        parser = cls(url, model, **options)
        if model:
            parser.client.models()
        else:
            parser.model = parser.client.only_model()
        return parser

    def parse(self, text: str, kind: str = "descriptive") -> Program:
        """The program of one text.

        Args:
            text: a question or choice in English.
            kind: "descriptive", "multiple_choice" or "choice".

        Raises:
            QuestionError: an unknown kind, an empty text, a character that no question has, or the reply holds no program of
                this kind and text.
            EndpointError: the server is not there, fails, takes too long, or does not have the model.
            DataError: a text longer than `Limits.text_characters`.
        """
        if kind not in TEXT_KINDS:
            raise QuestionError(f"kind is {kind!r}; expected one of {', '.join(TEXT_KINDS)}")
        check_text(text)
        plain = " ".join(text.split())
        if not plain:
            raise QuestionError("the text is empty")
        return self._kept(plain, kind)

    def parse_batch(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program]:
        """Programs of many texts of one kind, one after the other; raises the errors of `parse`."""
        return [self.parse(text, kind) for text in texts]

    def _asked(self, text: str, kind: str) -> Program:
        self.model = self.model or self.client.only_model()
        program = _first_program(self.client.reply(self.model, _messages(text, kind)), text, self.model)
        takes_choice = kind == "multiple_choice"
        if program.needs_choice != takes_choice or not allowed((program.result,), kind, False)[END]:
            raise QuestionError(
                f"{text!r} is not {KIND_NAMES[kind]} (understood: {program}); give choices with a multiple-choice question "
                "only, or word it in another way"
            )
        check_coverage(text, program.tokens)
        return program


def _messages(text: str, kind: str) -> list[dict[str, str]]:
    messages = [{"role": "system", "content": _RULES}]
    for example, program in EXAMPLES[kind].items():
        messages.append({"role": "user", "content": f"{kind}: {example}"})
        messages.append({"role": "assistant", "content": program})
    return [*messages, {"role": "user", "content": f"{kind}: {text}"}]


def _first_program(reply: str, text: str, model: str) -> Program:
    """The first well-formed program of a reply.

    Raises:
        QuestionError: there is none; quotes the reply.
    """
    error: ProgramError | None = None
    for source in _candidates(reply):
        if source == NO_PROGRAM:
            break
        try:
            return Program.parse(source)
        except ProgramError as e:
            error = error or e
    else:
        why = f" ({error})" if error else ""
        raise QuestionError(
            f"{text!r}: the reply of {model!r:.80} holds no program{why}: {reply.strip()!r:.{QUOTED_CHARACTERS}}; word the "
            "text like a CLEVRER question (docs/questions.md), or use another model"
        )
    raise QuestionError(
        f"{text!r} fits no program, says {model!r:.80}; word it like a CLEVRER question (docs/questions.md)"
    )


def _candidates(reply: str) -> Iterator[str]:
    """Lines, their ends after a colon, and quotations in backticks, that hold tokens only; and `NO_PROGRAM`.

    What a reasoning model thinks aloud, up to `</think>`, is passed over.
    """
    for line in reply.rpartition("</think>")[2].splitlines():
        for part in (line.rpartition(":")[2], *re.findall(r"`([^`]+)`", line)):
            names = re.findall(r"\w+", part)
            if names == [NO_PROGRAM]:
                yield NO_PROGRAM
            elif names and _TOKENS.issuperset(name.lower() for name in names):
                yield part.strip(" \t`*'\".,;") if "(" in part else " ".join(names)
