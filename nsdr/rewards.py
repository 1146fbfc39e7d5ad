"""Rewards for training language models on CLEVRER's questions, as TRL's `GRPOTrainer` calls them.

    >>> trainer = GRPOTrainer(model, reward_funcs=[exact, per_option, answer_format, evidence], ...)

A reward gets the completions of a batch (texts, or lists of messages) and the columns of the data set as lists. The columns are
those of `nsdr export`: `solution` (`nsdr.clevrer.solution`), `options` (the texts of the question's options; empty for an open
question) and, for `evidence`, `program`, `option_programs` and `scene` (path of a file with the video's scene). See
`docs/rewards.md`.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from nsdr.claims.narration import narrate
from nsdr.claims.statements import PAST_KINDS
from nsdr.claims.verification import OTHER_COURSES, TOLERANCE_FRAMES, Claim, verify
from nsdr.clevrer.answers.responses import TAG, Response, read_response
from nsdr.clevrer.files.scenes import iterate_scenes
from nsdr.errors import DataError, ExecutionError
from nsdr.io.reading import read_json
from nsdr.io.storage import load
from nsdr.symbolic import Executor
from nsdr.types import Scene

__all__ = ["answer_format", "evidence", "exact", "per_option", "read_scene"]

Completion = str | Sequence[Mapping[str, Any]]
"""A text, or messages with `role` and `content`, as conversational data sets have them; the last message counts."""
Options = Sequence[str]
"""Texts of a question's options; none for an open question."""
ProgramTokens = str | Sequence[str]
"""A program's postfix tokens, also as one text."""
EXPECTED = {
    "solution": "right answers, so leave out questions without one, such as those of the test split",
    "options": "texts of options",
    "program": "programs, so leave out questions without one",
    "option_programs": "programs of options",
    "scene": "paths of scenes, which `nsdr export --scenes` writes",
}
"""What each column holds."""
_ENDS_WITH_TAGS = re.compile(r"<answer>.*</answer>\s*\Z", re.DOTALL)


def exact(
    completions: Sequence[Completion], solution: Sequence[str], options: Sequence[Options], **columns: Any
) -> list[float]:
    """1 where the answer is the right one, with all of its options, else 0; also 0 where no answer can be read.

    Args:
        completions: one per sample.
        solution: right answers in their tags, such as "<answer>A,C</answer>".
        options: of each question.
        columns: other columns and what the trainer adds; not used.

    Raises:
        DataError: the columns' lengths differ, a value is None, or a solution cannot be read.
    """
    return [float(given.answer == right) for given, right, _ in _read(completions, solution, options)]


def per_option(
    completions: Sequence[Completion], solution: Sequence[str], options: Sequence[Options], **columns: Any
) -> list[float]:
    """The share of options that are judged rightly (0-1); an open question counts as one option.

    Where no answer can be read, it is 0. Arguments and errors are those of `exact`.
    """
    rewards = []
    for given, right, n_options in _read(completions, solution, options):
        if isinstance(given.answer, frozenset) and isinstance(right, frozenset):
            rewards.append(1 - len(given.answer ^ right) / n_options)
        else:
            rewards.append(float(given.answer == right))
    return rewards


def answer_format(completions: Sequence[Completion], options: Sequence[Options], **columns: Any) -> list[float]:
    """1 where the completion ends with its only answer in `<answer>` tags, and it can be read, right or wrong; else 0.

    Arguments and errors are those of `exact`, without `solution`.
    """
    rewards = []
    for completion, choices in _rows(completions, options=options):
        text = _text(completion)
        readable = read_response(text, _checked(choices)).answer is not None
        rewards.append(float(readable and len(TAG.findall(text)) == 2 and _ENDS_WITH_TAGS.search(text) is not None))
    return rewards


def evidence(
    completions: Sequence[Completion],
    solution: Sequence[str],
    options: Sequence[Options],
    program: Sequence[ProgramTokens],
    option_programs: Sequence[Sequence[ProgramTokens]],
    scene: Sequence[str | Path],
    **columns: Any,
) -> list[float | None]:
    """How well the reasoning shows what the right answer rests on (0-1): an F-measure; 0 where the answer is wrong.

    What it rests on are these facts of the answer that `nsdr.narrate` tells from the program's steps:

    - events at their frames ("Frame 43: the red cube enters."), and what led to what, with the frames;
    - which objects move or rest, at a frame or in the whole video;
    - what happens after the video, and what happens without an object but not in the video. They count only beside one of
      the others, because the options name them.

    Recall is the share of these that the completion states. Precision is their share of all such facts that it states,
    repeated ones included, and of all else in it that is false. What else is true counts neither way: what restates the
    question or the answer, denials, events without a frame. Neither does what cannot be read or checked.

    Args:
        completions: one per sample.
        solution: right answers in their tags, such as "<answer>A,C</answer>".
        options: of each question.
        program: of each question.
        option_programs: of each option; none for an open question.
        scene: of each sample, the path of a file that `read_scene` reads. Files that were read are kept in memory and must not
            change.
        columns: other columns and what the trainer adds; not used.

    Returns:
        One reward per sample; None, which TRL passes over, where the answer rests on nothing of the video ("no cube enters")
        or the scene does not give it (annotations do not know what happens after the video).

    Raises:
        DataError: the columns' lengths differ, a value is None, or a solution or scene cannot be read.
        ProgramError: a program is not well-formed.
    """
    answers = _read(completions, solution, options)
    rows = _rows(completions, options=options, program=program, option_programs=option_programs, scene=scene)
    rewards: list[float | None] = []
    for (given, right, _), (completion, texts, asked, choices, path) in zip(answers, rows, strict=True):
        if not isinstance(path, str | Path):
            raise DataError(f"column scene: expected paths, got {path!r:.60}")
        programs = [asked, *choices] if isinstance(choices, Sequence) else []
        if len(programs) != len(texts) + 1 or not all(isinstance(p, str | Sequence) for p in programs):
            raise DataError(
                f"columns program, option_programs: expected programs of the question and its {len(texts)} options, "
                f"got {asked!r:.60} and {choices!r:.60}"
            )
        known = read_scene(str(path))
        needed = _needed(known, asked, list(zip(texts, choices, strict=True)), right)
        if not needed:
            rewards.append(None)
            continue
        claims = verify(_text(completion), known).claims
        stated = [c for c in claims if _is_fact(c, known)]
        found = [fact for fact in needed if any(_same(fact, claim) for claim in stated)]
        is_shown = given.answer == right and any(fact.kind not in OTHER_COURSES for fact in found)
        n_false = sum(claim.holds is False for claim in claims)
        rewards.append(2 * len(found) * is_shown / (len(needed) + len(stated) + n_false))
    return rewards


@lru_cache(maxsize=1024)
def read_scene(path: str) -> Scene:
    """The scene in a file: a generated video's `truth_N.json`, an annotation, or a scene saved by `nsdr.save`.

    An annotation knows only observed events, so claims about what follows or would happen cannot be checked with it.

    Raises:
        DataError: the file is none of these; names it and what was expected.
    """
    content = read_json(path)
    if isinstance(content, dict) and content.get("type") == "Scene":
        return load(path, Scene)
    scenes = [scene for _, _, scene in iterate_scenes(path)]
    if len(scenes) != 1:
        raise DataError(f"{path}: expected a truth file, an annotation or a saved scene, got {len(scenes)} scenes")
    return scenes[0]


def _needed(
    scene: Scene, program: ProgramTokens, choices: Sequence[tuple[str, ProgramTokens]], right: str | frozenset[str]
) -> list[Claim]:
    """The facts that the right answer rests on; none without one of the video, or where the scene gives another answer."""
    executor = Executor(scene)
    try:
        answer = executor.answer_choices(program, choices) if choices else executor.answer(program)
    except ExecutionError:
        return []
    text = narrate(answer, scene)
    if read_response(text, [option for option, _ in choices], scene.world.vocabulary).answer != right:
        return []
    facts = [claim for claim in verify(text, scene).claims if _is_fact(claim, scene)]
    return facts if any(fact.kind not in OTHER_COURSES for fact in facts) else []


def _is_fact(claim: Claim, scene: Scene) -> bool:
    """Whether a claim is true and of those that `evidence` counts."""
    said = claim.statement
    if not claim.holds or said.negated or said.number is not None:
        return False
    if said.kind == "counterfactual":
        return claim.event is not None and all(e.objects != claim.event.objects for e in scene.events)
    if said.kind in ("motion", "future"):
        return True
    return said.kind in (*PAST_KINDS.values(), "cause") and all(e.frame is not None for e in said.events)


def _same(fact: Claim, claim: Claim) -> bool:
    """Whether two claims of `_is_fact` state the same."""
    first, second = ((c.kind, c.statement.words, c.event, set(c.objects)) for c in (fact, claim))
    if fact.frame is None or claim.frame is None:
        return first == second and fact.frame == claim.frame
    return first == second and abs(fact.frame - claim.frame) <= TOLERANCE_FRAMES


def _read(
    completions: Sequence[Completion], solution: Sequence[str], options: Sequence[Options]
) -> list[tuple[Response, str | frozenset[str], int]]:
    """Of each sample what was read, the right answer and the number of options."""
    read = []
    for completion, right, choices in _rows(completions, solution=solution, options=options):
        texts = _checked(choices)
        if not isinstance(right, str):
            raise DataError(f"column solution: expected texts, got {right!r:.60}")
        expected = read_response(right, texts)
        if expected.answer is None:
            example = "expected such as <answer>red</answer> or <answer>A,C</answer>"
            raise DataError(f"solution {right!r}: {expected.problem}; {example}")
        read.append((read_response(_text(completion), texts), expected.answer, len(texts)))
    return read


def _rows(completions: Sequence[Completion], **columns: Sequence[Any]) -> Iterator[tuple[Any, ...]]:
    """Each completion with its values of the columns, which are checked."""
    for name, values in columns.items():
        if len(values) != len(completions):
            raise DataError(f"column {name}: expected {len(completions)} values, one per completion, got {len(values)}")
        if any(value is None for value in values):
            raise DataError(f"column {name}: has values that are null; expected {EXPECTED[name]}")
    return zip(completions, *columns.values(), strict=True)


def _checked(options: Options) -> Options:
    if isinstance(options, str) or not isinstance(options, Sequence) or not all(isinstance(o, str) for o in options):
        raise DataError(f"column options: expected lists of texts, got {options!r:.60}")
    return options


def _text(completion: Completion) -> str:
    """The text of a completion; of messages the last one's, whose content may be parts with text."""
    if isinstance(completion, str):
        return completion
    if not isinstance(completion, Sequence) or not all(isinstance(message, Mapping) for message in completion):
        raise DataError(f"completions: expected texts or lists of messages, got {completion!r:.60}")
    last: Any = completion[-1] if completion else {}
    content = last.get("content") or ""
    if isinstance(content, str):
        return content
    if not isinstance(content, Sequence):
        raise DataError(f"completions: expected a text or a list of parts as a message's content, got {content!r:.60}")
    return "\n".join(str(p.get("text", "")) for p in content if isinstance(p, Mapping) and p.get("type") == "text")
