"""The rewards with the signatures of verl, EasyR1, ms-swift and Video-R1, on the rows that `nsdr export` writes for each."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypedDict

from nsdr.errors import DataError
from nsdr.io.reading import parse_json
from nsdr.io.worlds import WorldSource
from nsdr.rewards.answers import Completion, Options, answer_format, exact, per_option
from nsdr.rewards.facts import evidence
from nsdr.world.world import CLEVRER_WORLD

AnswerReward = Literal["exact", "per_option"]
"""The rewards that need the solution and the options alone."""
_LETTER = re.compile(r"[A-Z]\. ")


class _GroundTruth(TypedDict):
    solution: str
    options: list[str]


def verl(
    data_source: str,
    solution_str: str,
    ground_truth: str,
    extra_info: Mapping[str, Any],
    reward: AnswerReward | Literal["evidence"] = "per_option",
    world: WorldSource = CLEVRER_WORLD,
    **other: Any,
) -> dict[str, float]:
    """verl's `compute_score` for one response; all numbers are logged, and `score` is the reward.

    Args:
        data_source: not used.
        solution_str: the response.
        ground_truth: the right answer in its tags.
        extra_info: `options`; for "evidence" also `program`, `option_programs` and `scene`.
        reward: which one is the `score`. Where `evidence` is None, the score is 0: it is None for all responses to a question,
            so that none of them has an advantage.
        world: see `exact`.
        other: what verl adds; not used.

    Returns:
        `score`, `exact`, `per_option` and `format` (0-1).

    Raises:
        DataError: the ground truth cannot be read, or `extra_info` lacks a key.
    """
    scores = _scores(solution_str, ground_truth, list(_column(extra_info, "options")), world)
    if reward == "evidence":
        columns = {name: [_column(extra_info, name)] for name in ("options", "program", "option_programs", "scene")}
        (value,) = evidence([solution_str], [ground_truth], **columns)
        return {"score": value or 0.0, **scores}
    return {"score": scores[reward], **scores}


def easyr1(
    reward_inputs: Sequence[Mapping[str, Any]],
    reward: AnswerReward = "per_option",
    world: WorldSource = CLEVRER_WORLD,
    **other: Any,
) -> list[dict[str, float]]:
    """EasyR1's `compute_score` for a batch; all numbers are logged, and `overall` is the reward.

    Args:
        reward_inputs: for each response, `response` and `ground_truth`, the JSON text of the column `answer`.
        reward: which one is `overall`.
        world: see `exact`.
        other: what EasyR1 adds; not used.

    Returns:
        For each response `overall`, `exact`, `per_option` and `format` (0-1).

    Raises:
        DataError: a ground truth cannot be read.
    """
    scores = []
    for row in reward_inputs:
        known: _GroundTruth = parse_json(str(_column(row, "ground_truth")).encode(), "ground_truth", _GroundTruth)
        found = _scores(_column(row, "response"), known["solution"], known["options"], world)
        scores.append({"overall": found[reward], **found})
    return scores


def video_r1(
    completions: Sequence[Completion],
    solution: Sequence[str],
    options: Sequence[Options],
    world: WorldSource = CLEVRER_WORLD,
    **columns: Any,
) -> list[float]:
    """`per_option` on the rows of Video-R1, whose options begin with their letters.

    Args:
        completions, solution, world, columns: see `exact`.
        options: of each question, such as "A. The red cube exits the scene".
    """
    without_letters = [[_LETTER.sub("", o, count=1) for o in texts] for texts in options]
    return per_option(completions, solution, without_letters, world)


def _orm(reward: Callable[..., Sequence[float | None]]) -> type:
    """A class of ms-swift's kind of rewards (`swift.rewards.ORM`): made with the trainer's arguments, then called."""

    class Reward:
        __doc__ = reward.__doc__

        def __init__(self, args: Any = None, **kwargs: Any) -> None:
            self.args = args

        def __call__(self, completions: Sequence[Completion], **columns: Any) -> Sequence[float | None]:
            return reward(completions, **columns)

    return Reward


SWIFT: Mapping[str, type] = {
    f"clevrer_{reward.__name__}": _orm(reward) for reward in (exact, per_option, answer_format, evidence)
}
"""Rewards by the names that ms-swift's `--reward_funcs` takes, for `swift.rewards.orms.update(SWIFT)` in a plugin."""


def _scores(text: str, solution: str, options: Options, world: WorldSource) -> dict[str, float]:
    one: Any = [text], [solution], [options], world
    return {
        "exact": exact(*one)[0],
        "per_option": per_option(*one)[0],
        "format": answer_format([text], [options], world)[0],
    }


def _column(row: Mapping[str, Any], name: str) -> Any:
    if row is None or row.get(name) is None:
        raise DataError(f"{name}: is missing in the row; `nsdr export` writes it for questions with answers")
    return row[name]
