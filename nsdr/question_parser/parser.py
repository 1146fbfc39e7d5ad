"""Programs of questions and choices."""

import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Self

import torch
from torch import nn

from nsdr.errors import CheckpointError, NsdrError, ProgramError, QuestionError
from nsdr.io.checkpoint import PretrainedPart, load_description, load_network
from nsdr.io.device import limit_threads
from nsdr.language.templates import TEXT_KINDS
from nsdr.question_parser.beyond import extension_readings
from nsdr.question_parser.coverage import REMEDY, check_coverage, check_text, readings, refusal
from nsdr.question_parser.model import ParserNetwork, QuestionParserConfig
from nsdr.question_parser.normal import normal_form
from nsdr.question_parser.tokenizer import OTHER, PROGRAM_TOKENS, Tokenizer, split_words
from nsdr.symbolic.program import Program

__all__ = ["QuestionParser", "build_networks", "pad"]

MIN_PROBABILITY = 0.5
"""Programs with a smaller probability are rejected (0-1): such a program is more probable than all others together. What a text
says is checked by rules: with thresholds of 0 and of 0.5, `python benchmarks/questions.py benchmarks/questions_by_hand.json
nsdr/language/paraphrases.json --rules 400 --seed 1 --min_probability 0` prints the same, with 0.9 fewer are
right."""
MAX_BATCH_TEXTS = 512
"""Largest number of texts in one forward pass."""


def pad(rows: Sequence[Sequence[int]]) -> torch.Tensor:
    """Rows of indices -> (B, length of the longest row), padded with zeros on the right."""
    width = max(len(row) for row in rows)
    return torch.tensor([[*row, *[0] * (width - len(row))] for row in rows])


def build_networks(n_words: int, config: QuestionParserConfig) -> nn.ModuleDict:
    """The three networks by kind of text, with random weights."""
    return nn.ModuleDict({kind: ParserNetwork(n_words, len(PROGRAM_TOKENS), config) for kind in TEXT_KINDS})


class QuestionParser(PretrainedPart):
    """Parses descriptive questions, multiple-choice questions and choices, with one network for each kind of text.

    It runs on the device of the networks' weights.

    Args:
        tokenizer: word vocabulary.
        networks: the networks of `build_networks`.
        min_probability: programs with a smaller probability are rejected (0-1).
        constrained: decode well-typed programs only.
        beam: hypotheses of the beam search; 1 is greedy search.
        unknown: what to do with an unknown word: "error", or "ignore" to leave it out with a warning.
        extensions: also parse questions beyond CLEVRER (`grammar.extensions`), by rules alone.

    Raises:
        QuestionError: another value of `unknown`, or a `beam` of less than 1.
    """

    part = "question_parser"

    def __init__(
        self,
        tokenizer: Tokenizer,
        networks: nn.ModuleDict,
        min_probability: float = MIN_PROBABILITY,
        constrained: bool = True,
        beam: int = 1,
        unknown: str = "error",
        extensions: bool = False,
    ) -> None:
        if unknown not in ("error", "ignore"):
            raise QuestionError(f"unknown is {unknown!r}; expected error or ignore")
        if beam < 1:
            raise QuestionError(f"beam is {beam}; expected at least 1")
        self.tokenizer = tokenizer
        self.min_probability = min_probability
        self.constrained, self.beam, self.unknown = constrained, beam, unknown
        self.networks = networks.eval()
        self.extensions = extensions

    @classmethod
    def from_checkpoint(cls, folder: str | Path, **options: Any) -> Self:
        """The question parser of a checkpoint's folder, on the CPU; `options` are arguments of the constructor.

        Raises:
            CheckpointError: `question_parser.safetensors` or `question_parser.json` is missing or corrupt, or the parser was
                trained with other program tokens.
        """
        path, details = Path(folder) / f"{cls.part}.json", load_description(folder, cls.part)
        tokens, words = details.get("program_tokens"), details.get("words")
        if not isinstance(tokens, list) or tuple(tokens) != PROGRAM_TOKENS:
            raise CheckpointError(f"{path}: the question parser was trained with other program tokens; train it again")
        if not isinstance(words, list) or not all(isinstance(w, str) and split_words(w) == [w] for w in words):
            raise CheckpointError(f"{path}: words: expected a list of single words in lower case; restore the file")
        if not words or len(set(words)) < len(words):
            raise CheckpointError(f"{path}: words: expected at least one word, each once; restore the file")
        tokenizer = Tokenizer(words)
        build = partial(build_networks, len(tokenizer))
        networks = load_network(folder, cls.part, QuestionParserConfig, build)
        return cls(tokenizer, networks, **options)

    @property
    def network(self) -> nn.Module:
        """The three networks."""
        return self.networks

    def _description(self) -> tuple[Any, Mapping[str, Any]]:
        network: Any = self.networks[TEXT_KINDS[0]]
        return network.config, {"words": self.tokenizer.words, "program_tokens": PROGRAM_TOKENS}

    def parse(self, text: str, kind: str = "descriptive") -> Program:
        """The program of one text; `parse_batch` parses many at a time.

        Args:
            text: a question or choice in CLEVRER's English.
            kind: "descriptive", "multiple_choice" or "choice".

        Raises:
            QuestionError: an unknown kind, an empty text, an unknown word or character, a text of another kind, or one that no
                program stands for.
            DataError: a text longer than `Limits.text_characters`.
        """
        return self.parse_batch([text], kind)[0]

    def parse_batch(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program]:
        """Programs of many texts of one kind; raises the errors of `parse`."""
        programs = []
        for program in self.parse_each(texts, kind):
            if isinstance(program, NsdrError):
                raise program
            programs.append(program)
        return programs

    def parse_each(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program | NsdrError]:
        """Programs of many texts of one kind; for a text that has none, the error of `parse`.

        Raises:
            QuestionError: an unknown kind.
        """
        if kind not in TEXT_KINDS:
            raise QuestionError(f"kind is {kind!r}; expected one of {', '.join(TEXT_KINDS)}")
        programs: dict[int, Program | NsdrError] = {}
        readable = []
        for i, text in enumerate(texts):
            try:
                check_text(text)
                beyond = _beyond(text, kind) if self.extensions else None
                if beyond is not None:
                    programs[i] = beyond
                    continue
                self._check_words(text, kind)
                readable.append(i)
            except NsdrError as e:
                programs[i] = e
        for i, (tokens, probability) in zip(readable, self.candidates([texts[i] for i in readable], kind), strict=True):
            try:
                programs[i] = self._program(texts[i], tokens, kind, probability)
            except NsdrError as e:
                programs[i] = e
        return [programs[i] for i in range(len(texts))]

    def _check_words(self, text: str, kind: str) -> None:
        """Refuse an empty text and one with unknown words; warn of words that are corrected or left out."""
        normal = normal_form(text, "ignore")
        if not normal.words and not normal.left_out:
            raise QuestionError(f"the text {text!r} is empty")
        if normal.left_out and self.unknown == "error":
            raise QuestionError(f"unknown word {normal.left_out[0]!r}: {refusal(text, kind)}")
        for word in normal.left_out:
            warnings.warn(f"unknown word {word!r} in {text!r} (ignored)", stacklevel=4)
        for word, known in normal.corrections:
            warnings.warn(f"{text!r}: read {word!r} as {known!r}", stacklevel=4)
        outside = [w for w in normal.words if isinstance(w, str) and w not in self.tokenizer]
        if outside:
            raise QuestionError(refusal(text, kind))

    @limit_threads(1)
    def candidates(self, texts: Sequence[str], kind: str = "descriptive") -> list[tuple[list[str], float]]:
        """The most probable tokens of many texts with their probability (0-1), whether or not they form a program.

        Raises:
            QuestionError: an unknown kind, an empty text or an unknown word.
        """
        if kind not in TEXT_KINDS:
            raise QuestionError(f"kind is {kind!r}; expected one of {', '.join(TEXT_KINDS)}")
        network: Any = self.networks[kind]
        found: list[tuple[list[str], float]] = []
        for start in range(0, len(texts), MAX_BATCH_TEXTS):
            batch = [normal_form(text, "ignore").text for text in texts[start : start + MAX_BATCH_TEXTS]]
            words = pad([self.tokenizer.encode(text, self.unknown) for text in batch])
            rows, probabilities = network.search(words, kind if self.constrained else "", self.beam)
            tokens = [[PROGRAM_TOKENS[t] for t in row] for row in rows]
            found += list(zip(tokens, probabilities, strict=True))
        return found

    def _program(self, text: str, tokens: list[str], kind: str, probability: float) -> Program:
        normal = normal_form(text, "ignore")
        if not readings(normal, kind) and not any(readings(normal, k) for k in TEXT_KINDS):
            raise QuestionError(refusal(text, kind, tokens))
        if OTHER in tokens or not readings(normal, kind):
            remedy = {
                "descriptive": "give choices with it if it is a multiple-choice question",
                "multiple_choice": "ask it without choices if it is a descriptive question",
                "choice": 'a choice names an object or event, such as "the presence of the red cube"',
            }
            name = {"descriptive": "descriptive question", "multiple_choice": "multiple-choice question"}.get(
                kind, kind
            )
            raise QuestionError(f"{text!r} is not a {name}; {remedy[kind]}, or {REMEDY}")
        try:
            program = Program.parse(tokens)
        except ProgramError as e:
            raise QuestionError(f"{text!r} fits no program ({e}); {REMEDY}") from e
        check_coverage(text, tokens, self.unknown)
        if probability < self.min_probability:
            raise QuestionError(
                f"{text!r} fits no program (the best one has a probability of {probability:.0%}); {REMEDY}"
            )
        return program


def _beyond(text: str, kind: str) -> Program | None:
    """The program of a question beyond CLEVRER; None if the text is none.

    Raises:
        QuestionError: it has several readings.
    """
    found = extension_readings(text, kind)
    if len(found) > 1:
        texts = " or as ".join(repr(" ".join(tokens)) for tokens in found)
        raise QuestionError(f"{text!r} can be read as {texts}; {REMEDY}")
    return Program.parse(found[0]) if found else None
