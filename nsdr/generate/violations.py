"""Pairs of videos, one lawful and one in which a single law of their world is broken, with their truth and questions."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from msgspec import Meta

from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.questions import Choice, Question, SceneQuestions
from nsdr.errors import DataError
from nsdr.generate.dataset import (
    SCENES_PER_SEED,
    DatasetConfig,
    Files,
    SplitName,
    generate_dataset,
    write_split_questions,
)
from nsdr.generate.physics.scene import SimulatedScene, simulate_scene
from nsdr.generate.physics.violations import SIZES, break_law
from nsdr.io.limits import limits
from nsdr.types import LAWS
from nsdr.validation import Share, one_of

SCENES_PER_PAIR = 400
"""Most scenes that are tried for one pair, because not every scene gives an occasion to break every law. Large data sets try
fewer: a seed has only `SCENES_PER_SEED` scenes."""
PARTS = 4
"""Number of equal parts of a video; a question asks in which part something impossible begins."""


@dataclass(frozen=True)
class ViolationsConfig(DatasetConfig):
    """Pairs of videos to generate: videos 2 k and 2 k + 1 of the split are pair k, and the first of them is lawful.

    Successive pairs go through all combinations of a law and a size, again and again.

    Attributes:
        videos: number of videos, two for each pair.
        first_scene: number of the scene of the first pair. Scenes that give no occasion to break the law are skipped.
        splits: the split of all videos, such as {test: 1}; there is one.
        questions: always null: the questions are about what is impossible.
        laws: laws to break, from `nsdr.types.LAWS`.
        sizes: how clearly they are broken: "clear", "small" or "limit".
    """

    unit: ClassVar[str] = "pair"
    videos_per_job: ClassVar[int] = 2

    videos: Annotated[int, Meta(ge=2, le=limits().videos, multiple_of=2)] = 60
    splits: Mapping[SplitName, Share] = field(default_factory=lambda: {"validation": 1.0})
    questions: Literal[None] = None
    laws: Annotated[tuple[Annotated[str, one_of(LAWS)], ...], Meta(min_length=1)] = tuple(LAWS)
    sizes: Annotated[tuple[Annotated[str, one_of(SIZES)], ...], Meta(min_length=1)] = SIZES

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.counterfactual_videos:
            raise DataError("counterfactual_videos: expected 0, as counterfactual videos are lawful")
        if sum(share > 0 for share in self.splits.values()) != 1:
            raise DataError(f"splits: expected one split, as both videos of a pair are in it; got {dict(self.splits)}")

    @property
    def has_questions(self) -> bool:
        """Always true: the questions are about what is impossible."""
        return True

    def made(self, index: int) -> tuple[SimulatedScene, dict[str, Any]]:
        """The scene of a video. Every second one breaks a law, and its truth file says which (`violation`)."""
        return self.made_together(index)[self._place(index) % 2]

    def made_together(self, first: int) -> Sequence[tuple[SimulatedScene, dict[str, Any]]]:
        """Both videos of a pair."""
        pair = self._place(first) // 2
        size, law = (names[k % len(names)] for names, k in ((self.sizes, pair // len(self.laws)), (self.laws, pair)))
        n_pairs = self.videos // 2
        tried = min(SCENES_PER_PAIR, (SCENES_PER_SEED - self.first_scene) // n_pairs)
        for attempt in range(tried):
            seed = self.scene_seed(pair + attempt * n_pairs)
            scene = simulate_scene(seed, self.scene, removals=False, world=self.own_world)
            found = break_law(scene, law, size, seed)
            if found is not None:
                broken, violation = found
                return [(scene, {}), (broken, {"violation": asdict(violation)})]
        raise DataError(f"pair {pair}: {tried} scenes gave no occasion to break {law} ({size}); another seed may")

    def _place(self, index: int) -> int:
        """Position of a video in its split."""
        return index - next(r.start for r in self.indices().values() if len(r))


def generate_violations(config: ViolationsConfig, keep_going: bool = False) -> Path:
    """Generate pairs of videos and return their folder; finished videos are kept.

    The folder is a data set like those of `generate_dataset`. `truth_N.json` of the second video of each pair has a `violation`
    (`nsdr.types.Violation`). The question file asks whether each video is possible, and what in it is impossible, and when.
    The answers about the test split are only in `truth/questions_test.json`.

    Raises:
        DataError: see `generate_dataset`; or no scene gives an occasion to break a law.
    """
    root = generate_dataset(config, keep_going)
    for split, indices in config.indices().items():
        if indices:
            pairs = [[Files(root, split, first + k).truth for k in (0, 1)] for first in indices[::2]]
            paths = [path for pair in pairs if pair[1].exists() for path in pair]
            scenes = [_questions(read_truth_file(path)) for path in paths]
            write_split_questions(root, split, scenes)
    return root


def _questions(truth: Mapping[str, Any]) -> SceneQuestions:
    """Questions about whether a video is possible, which objects do something impossible, and when."""
    index, violation = truth["scene_index"], truth.get("violation")
    answer = "yes" if violation is None else "no"
    questions = [
        Question(0, "Is what happens in this video physically possible?", "descriptive", "possible", answer=answer)
    ]
    objects = [f"The {o['color']} {o['material']} {o['shape']}" for o in truth["objects"]]
    wrong = [] if violation is None else [objects[i] for i in violation["objects"]]
    questions.append(_choices(1, "Which objects move or change in an impossible way?", objects, wrong))
    ends = np.linspace(0, truth["n_frames"], PARTS + 1).round().astype(int).tolist()
    parts = [f"From frame {a} to frame {b - 1}" for a, b in pairwise(ends)]
    if violation is None or violation["law"] != "arrow":
        first = [] if violation is None else [parts[int(np.searchsorted(ends, violation["frame"], side="right")) - 1]]
        questions.append(_choices(2, "When does something impossible begin?", parts, first))
    return SceneQuestions(index, f"video_{index:05d}.mp4", tuple(questions))


def _choices(number: int, text: str, options: Sequence[str], right: Sequence[str]) -> Question:
    choices = [Choice(k, o, answer="correct" if o in right else "wrong") for k, o in enumerate(options)]
    return Question(number, text, "explanatory", choices=tuple(choices))
