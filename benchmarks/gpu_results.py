"""Each part's results on a GPU beside the CPU's, for `benchmarks/gpu.py`; and the setting that its rows are measured in."""

import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from filelock import FileLock
from pycocotools import mask as rle

from nsdr import Answer, DynamicsPrediction, Pipeline, VideoProposals
from nsdr.baselines.trained import TrainedBaseline
from nsdr.clevrer.dataset import CLEVRER, Split
from nsdr.clevrer.example import QUESTIONS, VIDEO
from nsdr.clevrer.files.questions import read_questions
from nsdr.dynamics.base import VideoPixels
from nsdr.dynamics.collisions.network import TrackCollisionDetector
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.dynamics.registry import load_backend
from nsdr.frame_parser.parser import FrameParser
from nsdr.io.checkpoint import find_checkpoint
from nsdr.io.video import read_frames
from nsdr.language.texts import TEXT_KINDS, sample
from nsdr.pipeline import PipelineConfig
from nsdr.question_parser.grammar import GrammarParser
from nsdr.question_parser.network import QuestionParser
from nsdr.tracking.tracker import track
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX

SIMULATED = "simulated"
"""The device of `tests/second_device.py`."""
CONFIGS = Path(__file__).parent.parent / "configs"
MASK_IOU = 0.95
"""Smallest intersection over union of a mask and the CPU's (0-1)."""
PROBABILITY = 1e-3
"""Largest difference of a collision's probability from the CPU's."""

Result = tuple[str, bool]
"""What was found, and whether it is as expected."""
T = TypeVar("T")


@dataclass(frozen=True)
class Setting:
    """Where rows are measured, and on how much.

    Attributes:
        device: of torch, or `SIMULATED`.
        work: folder of the data set and the runs.
        small: few frames, videos and steps.
        made: folder with the data of `data`, made before; None makes them in `work`.
    """

    device: str
    work: Path
    small: bool = False
    made: Path | None = None

    @property
    def real(self) -> str:
        """The device of commands and of the training loop, which know no simulated one."""
        return "cpu" if self.device == SIMULATED else self.device

    @contextmanager
    def there(self) -> Iterator[str]:
        """The device, which exists within the block."""
        if self.device == SIMULATED:
            from tests.second_device import second_device

            with second_device() as device:
                yield str(device)
        else:
            yield self.device

    def both(self, part: Any, run: Callable[[], T]) -> tuple[T, T]:
        """What `run` gives with a part on the device, and with it on the CPU, where it comes from."""
        expected = run()
        with self.there() as device:
            part.to(device)
            return run(), expected

    def data(self) -> Path:
        """A generated data set in `set`, and what trainings read of it in `motion`, `frames` and `features`; made once."""
        folder = self.made or self.work / ("small" if self.small else "data")
        folder.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(folder.with_suffix(".lock")):  # rows that are measured at once ask for it
            if not (folder / "features").is_dir():
                root, options = folder / "set", ["--splits", '{"train": 1}', "--videos", 2 if self.small else 8]
                nsdr("generate", "dataset", "--config", CONFIGS / "generate/preview.yaml", "-o", root, *options)
                nsdr("data", "motion", root, "--split", "train", "-o", folder / "motion")
                proposals = ["--proposals", root / "derender_proposals", "--every", 8]
                nsdr("data", "frames", root / "videos", *proposals, "-o", folder / "frames")
                nsdr("extract-features", "--from", "truth", "--root", root, "-o", folder / "features")
        return folder

    def videos(self) -> Split:
        """The data set's videos with proposals, annotations and questions."""
        return CLEVRER(self.data() / "set").split("train")


def nsdr(*arguments: Any, launcher: Sequence[str] = (), watch: Callable[[], None] | None = None) -> None:
    """Run a command; `watch` is called ten times a second meanwhile.

    Raises:
        RuntimeError: it failed; with the last line that it wrote.
    """
    with tempfile.TemporaryFile("w+") as written:
        command = [sys.executable, *launcher, "-m", "nsdr.cli.main", *map(str, arguments)]
        process = subprocess.Popen(command, stdout=written, stderr=written)
        while process.poll() is None:
            time.sleep(0.1)
            if watch is not None:
                watch()
        written.seek(0)
        if process.returncode:
            raise RuntimeError(f"nsdr {arguments[0]} failed: {written.read().strip().splitlines()[-1:]}")


def frame_parser(setting: Setting, precision: str) -> Result:
    """Detections in the example's frames, beside the CPU's in float32."""
    frames = list(read_frames(VIDEO))[:: 64 if setting.small else 4]
    expected = FrameParser.from_pretrained(device="cpu", precision="float32").parse(frames)
    parser = FrameParser.from_pretrained(device="cpu", precision=precision)
    with setting.there() as device:
        return same_detections(parser.to(device).parse(frames), expected)


def same_detections(found: VideoProposals, expected: VideoProposals) -> Result:
    """Whether they are of the same frames and attributes, with nearly the same masks."""
    ours, theirs = (_described(p) for p in (found, expected))
    if [x[:2] for x in ours] != [x[:2] for x in theirs]:
        return f"{len(ours)} detections, on the CPU {len(theirs)}, in other frames or of other attributes", False
    pairs = [*zip(ours, theirs, strict=True)]
    overlap = min((float(rle.iou([a[4]], [b[4]], [0])[0, 0]) for a, b in pairs), default=1.0)
    apart = max((abs(a[3] - b[3]) for a, b in pairs), default=0.0)
    return (
        f"the same {len(ours)} detections; mask IoU from {overlap:.3f}, scores within {apart:.1g}",
        overlap >= MASK_IOU,
    )


def _described(p: VideoProposals) -> list[tuple[Any, ...]]:
    """Frame, attribute, column, score and mask of each detection, in this order."""
    assert p.masks is not None
    masks = [{"size": [HEIGHT_PX, WIDTH_PX], "counts": mask} for mask in p.masks]
    columns = (p.frame_index.tolist(), p.attribute.tolist(), p.centroid_px[:, 0].tolist(), p.score.tolist(), masks)
    return sorted(zip(*columns, strict=True), key=lambda row: row[:3])


def question_parser(setting: Setting) -> Result:
    """Programs of texts by the networks."""
    rng, size = random.Random(0), 20 if setting.small else 500
    texts = {kind: [sample(kind, rng)[0] for _ in range(size)] for kind in TEXT_KINDS}
    parser = QuestionParser.from_pretrained(device="cpu")
    pairs = [
        *zip(*setting.both(parser, lambda: [x for k in texts for x in parser.candidates(texts[k], k)]), strict=True)
    ]
    differing = sum(ours != theirs for (ours, _), (theirs, _) in pairs)
    apart = max(abs(p - q) for (_, p), (_, q) in pairs)
    return f"{differing} of {len(pairs)} programs differ; probabilities within {apart:.1g}", not differing


def collision_network(setting: Setting) -> Result:
    """Probabilities of collisions."""
    split = setting.videos()
    states = [states_from_tracks(track(split.proposals(i))) for i in split.entries("videos")]
    detector = TrackCollisionDetector.from_pretrained(device="cpu")

    def probabilities() -> list[float]:
        return [p for s in states for _, p in sorted(detector.collision_candidates(s), key=lambda x: x[0].objects)]

    apart = max(abs(p - q) for p, q in zip(*setting.both(detector, probabilities), strict=True))
    return f"probabilities of pairs in {len(states)} videos within {apart:.1g}", apart <= PROBABILITY


def dynamics(setting: Setting, name: str) -> Result:
    """Rollouts of a backend."""
    split = setting.videos()
    tracks = {i: track(split.proposals(i)) for i in [*split.entries("videos")][: 1 if setting.small else None]}
    backend: Any = load_backend(find_checkpoint(), name)

    def predictions() -> list[DynamicsPrediction]:
        if name != "paper_images":
            return [backend.predict(of_video) for of_video in tracks.values()]
        pixels = {i: VideoPixels(read_frames(split.video(i)), split.proposals(i)) for i in tracks}
        return [backend.predict(of_video, None, pixels[i]) for i, of_video in tracks.items()]

    both = (
        [r for p in of for r in (p.observed, *p.counterfactual.values())] for of in setting.both(backend, predictions)
    )
    pairs = [*zip(*both, strict=True)]
    differing = sum(a.collisions != b.collisions for a, b in pairs)
    apart = max(float(np.nanmax(abs(a.location_world - b.location_world))) for a, b in pairs)
    return f"collisions differ in {differing} of {len(pairs)} rollouts; positions within {apart:.1g}", not differing


def pipeline(setting: Setting) -> Result:
    """Answers about the example from its video; each pipeline is a new one, as it keeps what it saw."""
    config = PipelineConfig(stride=8 if setting.small else 1, precision="float32")
    asked = [(q.text, [c.text for c in q.choices] or None) for s in read_questions(QUESTIONS) for q in s.questions]
    on_cpu, moved = (Pipeline.from_pretrained(config=config, device="cpu") for _ in range(2))
    expected = [on_cpu.answer(VIDEO, *question) for question in asked]
    with setting.there() as device:
        moved.to(device)
        return same_answers([moved.answer(VIDEO, *question) for question in asked], expected)


def baseline(setting: Setting, name: str) -> Result:
    """Answers of a baseline that ships; the programs that it needs are parsed by rules."""
    split = setting.videos()
    system = TrainedBaseline.from_pretrained(f"baselines/{name}", device="cpu")
    index = min(split.entries("videos"))
    source = split.video(index) if name.startswith("pixels") else split.path("annotations", index)
    parser = GrammarParser()
    texts = ("How many collisions happen?", "What is the shape of the first object to enter the scene?")
    return same_answers(*setting.both(system, lambda: [system.answer(source, text, parser=parser) for text in texts]))


def same_answers(found: Sequence[Answer], expected: Sequence[Answer]) -> Result:
    """Whether the answers, and those to the choices, are the same."""
    pairs = [*zip(*([x for a in answers for x in (a.choices or (a,))] for answers in (found, expected)), strict=True)]
    differing = sum(a.answer != b.answer for a, b in pairs)
    apart = max(abs((a.probability or 0) - (b.probability or 0)) for a, b in pairs)
    return f"{differing} of {len(pairs)} answers differ; probabilities within {apart:.1g}", not differing
