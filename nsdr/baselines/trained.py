"""A trained baseline: answers questions about videos from the features of these videos."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import torch
from numpy.typing import NDArray
from torch import Tensor

from nsdr.baselines.base import BASELINES, Baseline
from nsdr.baselines.data import Example, Vocabulary, encoded, make_batch
from nsdr.baselines.features.extraction import features_of
from nsdr.baselines.features.files import KINDS, FeatureCache, Features, check_settings
from nsdr.clevrer.files.questions import QUESTION_TYPES, Choice, Question, SceneQuestions
from nsdr.errors import CheckpointError, DataError, NsdrError
from nsdr.io.checkpoint import PretrainedPart, load_description, load_network
from nsdr.io.notes import distinct
from nsdr.question_parser.base import Parser, read_programs
from nsdr.symbolic.program import Program
from nsdr.types import Answer, ChoiceAnswer
from nsdr.types.answers import answer_from_word
from nsdr.validation import convert
from nsdr.world.vocabulary import CLEVRER, Vocabulary as ObjectWords

TEXTS_PER_BATCH = 64
"""Most texts about one video that are answered at once. Only the use of memory depends on it."""


class TrainedBaseline(PretrainedPart):
    """A baseline with its vocabulary.

    Args:
        system: its name in `BASELINES`.
        network: the network.
        vocabulary: words and answers of its training.
        features: settings of the features that it learnt from (`features` of their manifest); empty if it sees no video.
    """

    part: ClassVar[str] = "baseline"

    def __init__(
        self, system: str, network: Baseline, vocabulary: Vocabulary, features: Mapping[str, Any] | None = None
    ) -> None:
        self.system, self.vocabulary, self.features = system, vocabulary, dict(features or {})
        self._network = network
        self._possible = vocabulary.possible_answers()

    @classmethod
    def from_checkpoint(cls, folder: str | Path, **options: Any) -> Self:
        """The baseline of a checkpoint's folder; there are no options."""
        details = load_description(folder, cls.part)
        try:
            system, sizes = str(details["system"]), details["sizes"]
            objects = convert(details["objects"], ObjectWords, "objects: ") if "objects" in details else CLEVRER
            vocabulary = Vocabulary(tuple(map(str, details["words"])), tuple(map(str, details["answers"])), objects)
            known = vocabulary.sizes(int(sizes["channels"]), (int(sizes["grid"][0]), int(sizes["grid"][1])))
            kind, features = BASELINES[system], dict(details["features"])
        except (KeyError, TypeError, ValueError, IndexError, DataError) as e:
            where = Path(folder) / f"{cls.part}.json"
            raise CheckpointError(f"{where}: not the description of a baseline ({e}); train it again") from e
        network = load_network(folder, cls.part, kind.Config, lambda config: kind(config, known))
        return cls(system, network, vocabulary, features, **options)

    @property
    def network(self) -> Baseline:
        """The network."""
        return self._network

    def _description(self) -> tuple[Any, Mapping[str, Any]]:
        return self.network.config, self.details()

    def details(self) -> dict[str, Any]:
        """Further content of the checkpoint's JSON: system, words, answers, sizes, features and number of parameters.

        `objects` has the words of objects if they are not CLEVRER's.
        """
        sizes, objects = self.network.sizes, self.vocabulary.objects
        return {
            "system": self.system,
            "words": self.vocabulary.words,
            "answers": self.vocabulary.answers,
            **({} if objects == CLEVRER else {"objects": asdict(objects)}),
            "sizes": {name: getattr(sizes, name) for name in ("words", "answers", "channels", "grid")},
            "features": self.features,
            "parameters": sum(p.numel() for p in self.network.parameters()),
        }

    def check_features(self, features: FeatureCache | None) -> None:
        """Refuse features that do not fit, are not used or are missing.

        Raises:
            DataError: the features are refused; says what was expected and what was found.
        """
        needs = self.network.needs
        wanted = ", ".join(sorted(needs & set(KINDS)))
        if features is None:
            if wanted:
                raise DataError(f"{self.system} needs features of the videos ({wanted}); give a folder with them")
            return
        if not wanted:
            raise DataError(f"features {features.folder} would do nothing: {self.system} does not see the video")
        check_settings(features.manifest["features"], self.features, needs, f"{features.folder}: ")

    def answer_questions(
        self, scenes: Iterable[SceneQuestions], features: FeatureCache | None, types: Collection[str] = QUESTION_TYPES
    ) -> Iterator[tuple[SceneQuestions, dict[int, Answer | NsdrError]]]:
        """Answer questions scene by scene, as `nsdr.evaluation.score.score_answers` takes them.

        Args:
            scenes: the questions, with programs if the network needs programs.
            features: features of the videos; None if the network needs none.
            types: question types to answer.

        Yields:
            The scene's questions, and by question id the answer with the softmax's probabilities, or the error.

        Raises:
            DataError: features are missing or do not fit (`check_features`).
        """
        self.check_features(features)
        for scene in scenes:
            asked = [question for question in scene.questions if question.type in types]
            yield scene, self._answered(scene.scene_index, asked, features)

    def answer(
        self, source: str | Path, question: str, choices: Sequence[str] | None = None, parser: Parser | None = None
    ) -> Answer:
        """Answer a question about a video.

        Args:
            source: the video file. A baseline that learnt from features of the truth sees the objects that the default frame
                parser finds in it; it also takes the video's annotation.
            question: the question.
            choices: options of a multiple-choice question.
            parser: makes the programs that modular networks run; None for networks that need none.

        Raises:
            QuestionError: a word that did not occur in training, or a text that fits no program.
            DataError, VideoError: the source cannot be read, or is an annotation for a baseline that learnt from pixels.
            CheckpointError: the weights that features are made with cannot be found, or are others.
        """
        needs, texts = self.network.needs, list(choices or ())
        programs: list[tuple[str, ...] | None] = [None] * (1 + len(texts))
        notes: list[str] = []
        if "program" in needs:
            assert parser is not None, f"{self.system} needs programs"
            asked, of_choices = read_programs(parser, question, choices)
            for program in of_choices or ():
                if isinstance(program, NsdrError):
                    raise program
            read = [p for p in (asked, *(of_choices or ())) if isinstance(p, Program)]
            programs = [p.tokens for p in read]
            notes += distinct(*(p.notes for p in read))
        rows = tuple(
            Choice(i, text, program) for i, (text, program) in enumerate(zip(texts, programs[1:], strict=True))
        )
        row = Question(0, question, "explanatory" if texts else "descriptive", program=programs[0], choices=rows)
        found = features_of(source, self.features, needs, notes.append, str(self.device)) if self.features else {}
        answer = self._answered(0, [row], _OneVideo(found))[0]
        if isinstance(answer, NsdrError):
            raise answer
        return replace(answer, notes=distinct(notes))

    def _answered(
        self, scene_index: int, questions: Sequence[Question], features: Features | None
    ) -> dict[int, Answer | NsdrError]:
        answers: dict[int, Answer | NsdrError] = {}
        examples: dict[int, list[Example]] = {}
        for question in questions:
            try:
                examples[question.id] = encoded(scene_index, question, self.vocabulary, self.network.needs)
            except NsdrError as e:
                answers[question.id] = e
        listed = [e for of_question in examples.values() for e in of_question]
        try:
            parts = [listed[i : i + TEXTS_PER_BATCH] for i in range(0, len(listed), TEXTS_PER_BATCH)]
            rows = iter([row for part in parts for row in self.probabilities(part, features)])
        except NsdrError as e:
            return answers | dict.fromkeys(examples, e)
        for question in questions:
            if question.id in examples:
                answers[question.id] = self._answer(question, [next(rows) for _ in examples[question.id]])
        return answers

    def _answer(self, question: Question, probabilities: list[Tensor]) -> Answer:
        """The answer by the probabilities (answers,) of each of its texts."""
        words = [self.vocabulary.answers[int(row.argmax())] for row in probabilities]
        if question.type == "descriptive":
            answer = answer_from_word(words[0])
            return Answer(question.text, question.program or (), answer, probability=float(probabilities[0].max()))
        correct = self.vocabulary.answers.index("correct")
        choices = [
            ChoiceAnswer(choice.text, word, choice.program or (), (), probability=float(row[correct]))
            for choice, word, row in zip(question.choices, words, probabilities, strict=True)
        ]
        return Answer.of_choices(question.text, question.program or (), choices)

    @torch.no_grad()
    def probabilities(self, examples: Sequence[Example], features: Features | None) -> Tensor:
        """Probabilities (B, answers) of every answer to each example, on the CPU; impossible answers have 0.

        Raises:
            DataError: a video has no features; names it.
        """
        self.network.eval()
        batch = make_batch(examples, features, self.network.needs, self.vocabulary.objects)
        moved = batch._replace(**{name: t.to(self.device) for name, t in batch._asdict().items() if t is not None})
        is_choice = torch.tensor([e.is_choice for e in examples])
        return masked_scores(self.network(moved).float().cpu(), is_choice, self._possible).softmax(1)


@dataclass(frozen=True)
class _OneVideo:
    """`Features` that are those of one video, whatever index is asked for."""

    found: dict[str, NDArray[Any]]

    def get(self, scene_index: int, needs: Collection[str]) -> dict[str, NDArray[Any]]:
        """All features of the video: only those that are needed were made."""
        return self.found


def masked_scores(scores: Tensor, is_choice: Tensor, possible: Tensor) -> Tensor:
    """Scores (B, answers) with minus infinity for impossible answers.

    Args:
        scores: (B, answers).
        is_choice: (B,) bool, which texts are options.
        possible: (2, answers) bool, as in `Vocabulary.possible_answers`.
    """
    return scores.masked_fill(~possible[is_choice.long()], float("-inf"))
