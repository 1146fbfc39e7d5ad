"""CLEVRER's question files: `train.json`, `validation.json` and `test.json`."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec.structs import replace

from nsdr.clevrer.files.schema import FileName, Id, Program, RecordId, check_lines, check_unique
from nsdr.errors import DataError
from nsdr.io.files import write_json
from nsdr.io.limits import check_limit
from nsdr.io.reading import is_json_lines, parse_json, parse_json_lines, read_json_bytes
from nsdr.io.worlds import WorldSource, as_world, world_beside
from nsdr.validation import convert, expect, one_of
from nsdr.world.layout import MAX_OBJECTS
from nsdr.world.vocabulary import DIRECTIONS, IMAGE_DIRECTIONS, SPEED_UNIT, STATIONARY, Vocabulary, indefinite
from nsdr.world.world import World

__all__ = [
    "OPTION_TAGS",
    "PAIR_KINDS",
    "PLAIN",
    "QUESTION_TYPES",
    "Choice",
    "Question",
    "SceneQuestions",
    "has_answer",
    "read_questions",
    "without_answers",
    "write_questions",
]

QUESTION_TYPES = ("descriptive", "explanatory", "predictive", "counterfactual")
"""CLEVRER's question types; all but descriptive questions are multiple choice."""
PLAIN = "plain"
"""Subtype of questions about objects alone, which the release does not have; baselines may learn from them first."""
OPTION_TAGS = ("observational", "inferential")
"""Kinds of counterfactual options: those that the recording without the removed object answers rightly (see
`nsdr.baselines.recording`), and those where it fails because the removal changes what else happens."""
PAIR_KINDS = ("changed", "mirrored", "noisy")
"""What the second video of a pair is: the first one without an object, where the answers differ; mirrored; or with other light
and noise, where they are the same."""
VIDEO_KEY = re.compile(r"(?:\w*_)?0*([0-9]{1,9})(\.\w+)?")
"""The name or number of a video as a key: "video_10000.mp4", "sim_10000" or "10000"."""

OTHER_WORLD = (
    "if the questions are of another world, put its world.json beside their file or give `nsdr score` its --world"
)
"""What to do where answers are no words of the world that is assumed."""


@cache
def answer_words(vocabulary: Vocabulary) -> dict[str, frozenset[str]]:
    """Answers of descriptive questions by what is asked for (a `nsdr.symbolic.Kind`)."""
    words = {"number": map(str, range(MAX_OBJECTS + 1)), "boolean": ("yes", "no"), **vocabulary.words}
    return {kind: frozenset(answers) for kind, answers in words.items()}


@cache
def answer_patterns(vocabulary: Vocabulary) -> dict[str, re.Pattern[str]]:
    """Patterns of answers beyond CLEVRER, such as "1.8 world units per second", by what is asked for."""
    patterns = {
        "speed": rf"\d+\.\d {SPEED_UNIT}",
        "direction": "|".join((*DIRECTIONS, *IMAGE_DIRECTIONS, STATIONARY)),
        "name": " ".join(f"(?:{'|'.join(words)})" for words in vocabulary.words.values()),
    }
    return {kind: re.compile(pattern) for kind, pattern in patterns.items()}


def is_answer(text: str, vocabulary: Vocabulary) -> bool:
    """Whether a text is an answer of some descriptive question."""
    known = answer_words(vocabulary).values()
    return any(text in words for words in known) or is_beyond(text, vocabulary)


def is_beyond(text: str, vocabulary: Vocabulary) -> bool:
    """Whether a text is an answer of a descriptive question beyond CLEVRER: a speed, a direction or an object."""
    return any(pattern.fullmatch(text) for pattern in answer_patterns(vocabulary).values())


class Choice(msgspec.Struct, frozen=True, omit_defaults=True, rename={"id": "choice_id", "text": "choice"}):
    """A choice of a multiple-choice question, as in a question file.

    Attributes:
        id: id within the question.
        text: the choice's text.
        program: postfix tokens; None in the test split.
        answer: "correct" or "wrong"; None in the test split.
        tag: one of `OPTION_TAGS` of a counterfactual option; None where it is not known. The release has no tags.
    """

    id: Id
    text: str
    program: Program | None = None
    answer: Annotated[str, one_of(("correct", "wrong"))] | None = None
    tag: Annotated[str, one_of(OPTION_TAGS)] | None = None


_QUESTION_KEYS = {name: f"question_{name}" for name in ("id", "type", "subtype")} | {"text": "question"}


class Question(msgspec.Struct, frozen=True, omit_defaults=True, rename=_QUESTION_KEYS):
    """A question, as in a question file.

    Attributes:
        id: id within the scene.
        text: the question's text.
        type: one of `QUESTION_TYPES`.
        subtype: subtype of a descriptive question; None for multiple choice.
        program: postfix tokens; None in the test split.
        answer: the answer word; None in the test split and for multiple choice.
        choices: the choices; empty for a descriptive question.
        pair: of a question about the second video of a pair, `SCENE_INDEX-QUESTION_ID` of the same question about the first
            one; None of all others. The release has no pairs.
        pair_kind: one of `PAIR_KINDS`, with `pair`.
    """

    id: Id
    text: str
    type: Annotated[str, one_of(QUESTION_TYPES)]
    subtype: str | None = None
    program: Program | None = None
    answer: str | None = None
    choices: tuple[Choice, ...] = ()
    pair: RecordId | None = None
    pair_kind: Annotated[str, one_of(PAIR_KINDS)] | None = None


class SceneQuestions(msgspec.Struct, frozen=True):
    """All questions of one video, as in a question file.

    Attributes:
        scene_index: index of the video.
        video_filename: file name of the video.
        questions: the questions.
    """

    scene_index: Id
    video_filename: FileName
    questions: tuple[Question, ...]


def read_questions(path: str | Path, world: WorldSource | None = None) -> list[SceneQuestions]:
    """Read all scenes of a question file.

    It is a list of scenes, as in the release; an object with the scenes or their lists of questions by video, such as
    `{"video_10000.mp4": […]}`; or JSON Lines with a scene or a question with its `scene_index` in each line. Questions of such
    lists and lines without scenes are gathered by scene. Answers may be numbers or truth values in place of the words.

    Args:
        path: the file.
        world: whose words answers have; None for that of the `world.json` beside the file or of the data set that the file is
            of, and for CLEVRER's if there is neither.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    data, name = read_json_bytes(path), str(path)
    world = world_beside(path) if world is None else as_world(world)
    try:
        scenes = msgspec.json.decode(data, type=list[SceneQuestions])  # the release's form
        places = [f"{name}: [{s}]." for s in range(len(scenes))]
    except msgspec.DecodeError:
        rows = _scene_rows(data, name)
        scenes = [
            convert(row.content, SceneQuestions, f"{row.where}{row.place}{': ' if row.place else ''}") for row in rows
        ]
        places = [f"{row.where}{row.place}{'.' if row.place else ''}" for row in rows]
    if not scenes:
        raise DataError(f"{path}: holds no scenes; expected at least 1 question")
    if not any(scene.questions for scene in scenes):
        raise DataError(f"{path}: expected at least 1 question, but its {len(scenes)} scenes have none")
    seen: set[int] = set()
    for place, scene in zip(places, scenes, strict=True):
        if scene.scene_index in seen:
            raise DataError(f"{place}scene_index: {scene.scene_index} is there twice; expected it once")
        seen.add(scene.scene_index)
        check_unique([q.id for q in scene.questions], f"{place}questions", ".question_id")
        for i, question in enumerate(scene.questions):
            _check_question(question, f"{place}questions[{i}]", world)
    return scenes


@dataclass(frozen=True)
class _Row:
    """A scene of a question file in plain values, and where it stands: the file with the line, and its place there."""

    where: str
    place: str
    content: Any


def _scene_rows(data: bytes, name: str) -> list[_Row]:
    """The scenes of a question file of any form; questions without one are gathered."""
    if is_json_lines(data):
        rows = [_Row(f"{name}, line {number}: ", "", row) for number, row in parse_json_lines(data, name)]
    else:
        content = parse_json(data, name)
        if isinstance(content, list):
            rows = [_Row(f"{name}: ", f"[{i}]", row) for i, row in enumerate(content)]
        elif isinstance(content, dict) and not {"questions", "question"} & content.keys():
            rows = [_Row(f"{name}: ", key, _row_of_video(key, value, name)) for key, value in content.items()]
        else:
            rows = [_Row(f"{name}: ", "", content)]
    scenes, gathered = list[_Row](), dict[str, _Row]()
    for row in rows:
        if not (isinstance(row.content, dict) and "question" in row.content and "questions" not in row.content):
            scenes.append(row)
            continue
        index = row.content.get("scene_index")
        if str(index) not in gathered:
            about = {"scene_index": index, "video_filename": row.content.get("video_filename", _video_name(index))}
            gathered[str(index)] = _Row(row.where, row.place, {**about, "questions": []})
            scenes.append(gathered[str(index)])
        gathered[str(index)].content["questions"].append(row.content)
    for question in (q for row in scenes for q in _listed(row.content, "questions")):
        _spell_out(question, "yes", "no")
        for choice in _listed(question, "choices"):
            _spell_out(choice, "correct", "wrong")
    return scenes


def _row_of_video(key: str, value: Any, name: str) -> Any:
    """The scene of a video's name or number; `value` is the scene, or its list of questions."""
    number = VIDEO_KEY.fullmatch(key)
    if number is None:
        raise DataError(f"{name}: {key!r:.60}: expected the name or number of a video, such as video_10000.mp4, as key")
    index = int(number[1])
    about = {"scene_index": index, "video_filename": key if number[2] else _video_name(index)}
    scene = {**about, "questions": value} if isinstance(value, list) else value
    if isinstance(scene, dict):
        scene = {**about, **scene}
        expect(scene["scene_index"] == index, f"{name}: {key}.scene_index", str(index), scene["scene_index"])
    return scene


def _video_name(index: Any) -> str:
    """The name of a video's file in the release."""
    return f"video_{index:05d}.mp4" if isinstance(index, int) else ""


def _listed(row: Any, key: str) -> list[Any]:
    """The list under a key, if there is one."""
    found = row.get(key) if isinstance(row, dict) else None
    return found if isinstance(found, list) else []


def _spell_out(row: Any, true: str, false: str) -> None:
    """Put the word in place of an answer that is a number or a truth value."""
    answer = row.get("answer") if isinstance(row, dict) else None
    if isinstance(answer, bool):
        row["answer"] = true if answer else false
    elif isinstance(answer, int) and 0 <= answer <= MAX_OBJECTS:
        row["answer"] = str(answer)


def _check_question(q: Question, place: str, world: World) -> None:
    check_lines(place, question=q.text, question_subtype=q.subtype)
    for i, choice in enumerate(q.choices):
        check_lines(f"{place}.choices[{i}]", choice=choice.text)
        check_limit(len(choice.program or ()), "program_tokens", f"{place}.choices[{i}].program")
    check_limit(len(q.program or ()), "program_tokens", f"{place}.program")
    expect((q.pair is None) == (q.pair_kind is None), place, "both pair and pair_kind or neither", "one of them")
    fits = bool(q.choices) != (q.type == "descriptive")
    expect(fits, f"{place}.choices", f"those of {indefinite(q.type)} question", f"{len(q.choices)} choices")
    check_unique([c.id for c in q.choices], f"{place}.choices", ".choice_id")
    expect(len({c.answer is None for c in q.choices}) < 2, f"{place}.choices", "answers of all or none", "of some")
    fits = bool(q.choices) or q.answer is None or is_answer(q.answer, world.vocabulary)
    if not fits:
        expected = f"0 to {MAX_OBJECTS}, yes, no or an attribute word of the world {world.name}"
        raise DataError(f"{place}.answer: expected {expected}, got {q.answer!r:.60}; {OTHER_WORLD}")


def write_questions(path: str | Path, scenes: Iterable[SceneQuestions]) -> None:
    """Write a question file in the official schema, atomically; inverse of `read_questions`.

    Options that are tagged have a `tag`, which other readers skip.
    """
    write_json(path, msgspec.to_builtins(list(scenes)))


def has_answer(question: Question) -> bool:
    """Whether a question's true answer is known, and that of each of its choices; those of the test split are not."""
    return None not in ([c.answer for c in question.choices] or [question.answer])


def without_answers(scene: SceneQuestions) -> SceneQuestions:
    """The same questions without answers, programs and tags, as in the test split."""
    questions = []
    for q in scene.questions:
        choices = tuple(replace(c, program=None, answer=None, tag=None) for c in q.choices)
        questions.append(replace(q, program=None, answer=None, choices=choices))
    return replace(scene, questions=tuple(questions))
