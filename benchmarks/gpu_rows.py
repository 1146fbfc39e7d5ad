"""The rows of `benchmarks.gpu`: results and trainings on a GPU beside the CPU's, and frames per second."""

import json
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from unittest.mock import patch

import numpy as np
import torch
from accelerate.utils import send_to_device
from filelock import FileLock
from pycocotools import mask as rle
from torch import nn

from benchmarks.shared import load_default
from nsdr import Answer, Pipeline, VideoProposals
from nsdr.baselines.base import BASELINES
from nsdr.baselines.features.files import KINDS
from nsdr.clevrer.dataset import CLEVRER, Split
from nsdr.clevrer.example import QUESTIONS, VIDEO
from nsdr.clevrer.files.questions import read_questions
from nsdr.dynamics.collisions.network import TrackCollisionDetector
from nsdr.dynamics.motion_states import VideoPixels, states_from_tracks
from nsdr.frame_parser.parser import FrameParser
from nsdr.io.video import read_frames
from nsdr.language.texts import TEXT_KINDS, sample
from nsdr.pipeline import PipelineConfig
from nsdr.question_parser.network import QuestionParser
from nsdr.tracking.tracker import track
from nsdr.training.baselines import BaselineTask, BaselineTraining
from nsdr.training.collisions import CollisionTask, CollisionTraining
from nsdr.training.dynamics import PropNetTask
from nsdr.training.frame_parser import FrameParserTask, FrameParserTraining
from nsdr.training.loop import LoopConfig, Task, train
from nsdr.training.patch_dynamics import ImagePropNetTask, PatchPropNetTask
from nsdr.training.question_parser import QuestionParserTask, QuestionParserTraining
from nsdr.training.run_folder import parse_training
from nsdr.training.track_task import DynamicsTraining
from nsdr.types import Rollout
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX
from nsdr.world.world import CLEVRER_WORLD

SIMULATED = "simulated"
"""The device of `tests/second_device.py`."""
CONFIGS = Path(__file__).parent.parent / "configs"
MASK_IOU = 0.95
"""Smallest intersection over union of a mask and the CPU's (0-1)."""
PROBABILITY = 1e-3
"""Largest difference of a collision's probability from the CPU's."""
LOSS, SAMPLED_LOSS = 0.01, 0.05
"""Largest relative difference of a loss from the CPU's; the larger one for the frame parser, which samples regions by scores
that differ by rounding."""
RESUMED_LOSS = 1e-3
"""Largest relative difference of the losses of two runs on one device: some sums have no fixed order on CUDA."""
SMALL_LOSS = 0.01
"""Differences of losses below this are relative to it."""
STEPS = 4
"""Steps of a resumed run."""
RANDPERM = torch.randperm
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
                nsdr("data", "features", "--from", "truth", "--root", root, "-o", folder / "features")
        return folder

    def videos(self) -> Split:
        """The data set's videos with proposals, annotations and questions."""
        return CLEVRER(self.data() / "set").split("train")


def nsdr(*arguments: Any, watch: Callable[[], None] | None = None) -> None:
    """Run a command; `watch` is called ten times a second meanwhile.

    Raises:
        RuntimeError: it failed; with the last line that it wrote.
    """
    with tempfile.TemporaryFile("w+") as written:
        command = [sys.executable, "-m", "nsdr.cli.main", *map(str, arguments)]
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
    texts = {kind: [sample(kind, rng, CLEVRER_WORLD.vocabulary)[0] for _ in range(size)] for kind in TEXT_KINDS}
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
    split, backend = setting.videos(), load_default(name)
    tracks = {i: track(split.proposals(i)) for i in [*split.entries("videos")][: 1 if setting.small else None]}

    def rollouts() -> list[Rollout]:
        found = []
        for i, of_video in tracks.items():
            is_seen = name == "propnet_images"
            pixels = VideoPixels(read_frames(split.video(i)), split.proposals(i), of_video) if is_seen else None
            prediction = backend.explain(states_from_tracks(of_video, pixels)).prediction
            found += [prediction.observed, *prediction.counterfactual.values()]
        return found

    pairs = [*zip(*setting.both(backend, rollouts), strict=True)]
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


def same_answers(found: Sequence[Answer], expected: Sequence[Answer]) -> Result:
    """Whether the answers, and those to the choices, are the same."""
    pairs = [*zip(*([x for a in answers for x in (a.choices or (a,))] for answers in (found, expected)), strict=True)]
    differing = sum(a.answer != b.answer for a, b in pairs)
    apart = max(abs((a.probability or 0) - (b.probability or 0)) for a, b in pairs)
    return f"{differing} of {len(pairs)} answers differ; probabilities within {apart:.1g}", not differing


def trainings() -> dict[str, list[str]]:
    """Part, configuration and other arguments of `nsdr train`; DATA stands for the folder of `Setting.data`."""
    motion = "--proposals DATA/motion/proposals.npz --truth DATA/motion/truth.json.gz --evaluation-scenes 1"
    lines = {
        "frame-parser": "frame-parser frame_parser/default --frames DATA/frames --evaluation-frames 2",
        "collisions": f"collisions dynamics/collisions {motion}",
        "question-parser": "question-parser question_parser/default --evaluation-texts 4",
        "dynamics on states": f"dynamics dynamics/propnet {motion}",
        "dynamics on masks": f"dynamics dynamics/propnet_patches {motion}",
        "dynamics on images": "dynamics dynamics/propnet_images --data DATA/set --evaluation-scenes 1",
    }
    questions = "--questions DATA/set/questions/train.json --validation DATA/set/questions/train.json --plain-steps 0"
    for name in BASELINES.names():
        features = "--features DATA/features" if BASELINES[name].needs & set(KINDS) else ""
        lines[f"baseline {name}"] = f"baseline baselines/small/{name} {questions} {features}"
    return {name: line.split() for name, line in lines.items()}


def arguments_of(setting: Setting, name: str, folder: Path, steps: int) -> list[str]:
    """Arguments of `nsdr train` for a few steps in an empty folder, with a checkpoint in the middle."""
    shutil.rmtree(folder, ignore_errors=True)
    part, config, *rest = trainings()[name]
    data = str(setting.data()) if any("DATA" in argument for argument in rest) else ""
    loop = f"--loop.steps {steps} --loop.save-every {steps // 2} --loop.log-every 1 --loop.evaluate-every 0"
    loop += " --loop.batch-size 2" if setting.small else ""
    where = ["--run-dir", str(folder), "--loop.device", setting.real, *loop.split()]
    return [part, "--config", f"{CONFIGS}/{config}.yaml", *(x.replace("DATA", data) for x in rest), *where]


def task_of(arguments: Sequence[str]) -> tuple[Task, LoopConfig]:
    """What `nsdr train` with these arguments trains, and how."""
    of_network: dict[str, Callable[[DynamicsTraining], Task]]
    of_network = {"propnet": PropNetTask, "propnet_patches": PatchPropNetTask, "propnet_images": ImagePropNetTask}
    kinds: dict[str, tuple[type[Any], Callable[[Any], Task]]] = {
        "frame-parser": (FrameParserTraining, FrameParserTask),
        "collisions": (CollisionTraining, CollisionTask),
        "question-parser": (QuestionParserTraining, QuestionParserTask),
        "dynamics": (DynamicsTraining, lambda config: of_network[config.network](config)),
        "baseline": (BaselineTraining, BaselineTask),
    }
    part, *options = arguments
    kind, make = kinds[part]
    config = parse_training(kind, options, part)
    return make(config), config.loop


def one_step(setting: Setting, name: str) -> Result:
    """Losses before and after a step in float32, without dropout."""
    task, loop = task_of(arguments_of(setting, name, setting.work / "step" / name.replace(" ", "_"), STEPS))
    for module in task.model.modules():
        if isinstance(module, nn.Dropout):
            module.p = 0.0
        if isinstance(module, nn.RNNBase):
            module.dropout = 0.0
    start = {key: value.clone() for key, value in task.model.state_dict().items()}
    batch = task.collate(task.draw(loop.batch_size, np.random.default_rng(0), 0))

    def losses(device: str) -> list[float]:
        model, moved, found = task.model.to(device).train(), send_to_device(batch, device), list[float]()
        optimizer = torch.optim.AdamW(model.parameters(), 1e-4)
        for _ in range(2):
            # The frame parser's samples are drawn on the device, whose random numbers are others.
            with patch("torch.randperm", lambda n, device=None, **_: RANDPERM(n).to(device)):
                torch.manual_seed(0)
                means = [term.total / term.items for term in task.losses(model, moved).values()]
            total = torch.stack(means).sum()
            optimizer.zero_grad()
            total.backward()
            optimizer.step()
            found.append(total.item())
        return found

    expected = losses("cpu")
    task.model.load_state_dict(start)
    with setting.there() as device:
        found = losses(device)
    apart = most_apart(found, expected)
    text = f"losses {found[0]:.4g} and {found[1]:.4g}, within {apart:.1g} of the CPU's"
    return text, apart <= (SAMPLED_LOSS if name == "frame-parser" else LOSS)


def most_apart(found: Sequence[float], expected: Sequence[float]) -> float:
    """The largest difference, relative to the loss or to `SMALL_LOSS`."""
    return max(abs(a - b) / max(abs(b), SMALL_LOSS) for a, b in zip(found, expected, strict=True))


def resumed(setting: Setting, name: str) -> Result:
    """Losses of a run that goes on from the checkpoint in its middle, beside those of the uninterrupted one."""
    folder = setting.work / "resumed" / name.replace(" ", "_")
    arguments = arguments_of(setting, name, folder, STEPS)

    def run() -> list[float]:
        task, loop = task_of(arguments)
        train(task, loop, folder, {})
        lines = (folder / "metrics.jsonl").read_text().splitlines()
        return [json.loads(line)["loss"] for line in lines]

    expected = run()
    for path in folder.glob(f"step_{STEPS:07d}.*"):
        path.unlink()
    apart = most_apart(run(), expected)
    return f"losses of {STEPS} steps within {apart:.1g}", apart <= RESUMED_LOSS
