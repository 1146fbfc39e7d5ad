"""The reward for reasoning: how well a text shows the facts of the video that the right answer rests on."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from nsdr.claims.narration import narrate
from nsdr.claims.statements import PAST_KINDS
from nsdr.claims.verification import OTHER_COURSES, TOLERANCE_FRAMES, Claim, verify
from nsdr.clevrer.answers.responses import read_response
from nsdr.clevrer.files.scenes import iterate_scenes
from nsdr.errors import DataError, ExecutionError
from nsdr.io.reading import read_json
from nsdr.io.storage import load
from nsdr.rewards.answers import Completion, Options, read, rows, text_of
from nsdr.symbolic import Executor
from nsdr.types import Scene

ProgramTokens = str | Sequence[str]
"""A program's postfix tokens, also as one text."""


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
    given_columns = (solution, options, program, option_programs, scene)
    names = ("solution", "options", "program", "option_programs", "scene")
    rewards: list[float | None] = []
    for completion, expected, texts, asked, choices, path in rows(
        completions, **dict(zip(names, given_columns, strict=True))
    ):
        if not isinstance(path, str | Path):
            raise DataError(f"column scene: expected paths, got {path!r:.60}")
        known = read_scene(str(path))
        ((given, right, _),) = read([completion], [expected], [texts], known.world)
        programs = [asked, *choices] if isinstance(choices, Sequence) else []
        if len(programs) != len(texts) + 1 or not all(isinstance(p, str | Sequence) for p in programs):
            raise DataError(
                f"columns program, option_programs: expected programs of the question and its {len(texts)} options, "
                f"got {asked!r:.60} and {choices!r:.60}"
            )
        needed = _needed(known, asked, list(zip(texts, choices, strict=True)), right)
        if not needed:
            rewards.append(None)
            continue
        claims = verify(text_of(completion), known).claims
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
    if read_response(text, [option for option, _ in choices], scene.world).answer != right:
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
