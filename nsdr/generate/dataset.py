"""Complete data sets in CLEVRER's layout, with the ground truth that the release withholds."""

import json
import platform
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any, ClassVar

import cv2
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from tqdm import tqdm

from nsdr.clevrer.dataset import SPLITS, sub_folder
from nsdr.clevrer.files.annotations import read_truth_file, write_annotation
from nsdr.clevrer.files.questions import SceneQuestions, without_answers, write_questions
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.errors import DataError
from nsdr.generate import VERSION
from nsdr.generate.physics.changed import TruthSimulator
from nsdr.generate.physics.scene import SimulatedScene, removals_by_effect, scene_without, simulate_scene
from nsdr.generate.physics.scene_config import SceneConfig
from nsdr.generate.questions.selection import QuestionConfig, find_candidates, select_questions
from nsdr.generate.render.blender import check_assets_fit
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import RenderConfig, View, view_of
from nsdr.generate.scene_files import annotation_document, proposal_document, solids_at, truth_document
from nsdr.generate.statistics import count_scenes, write_question_statistics, write_statistics
from nsdr.io.files import check_installed, locked, write_json
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, run_jobs
from nsdr.io.limits import limits
from nsdr.io.reading import read_json
from nsdr.io.tasks import ENGINES, run_in_order
from nsdr.io.video import spaced, write_video
from nsdr.io.worlds import read_world, stored_world
from nsdr.language.reserved import check_vocabulary
from nsdr.validation import Count, Settings, Share, convert, expect, one_of
from nsdr.world.world import CLEVRER_WORLD, World

RENDERERS = ("preview", "blender", "none")
VERSIONS_OF = ("nsdr", "pybullet", "bpy", "numpy", "opencv-python-headless", "av")
"""Packages whose versions the manifest records."""
SCENES_PER_SEED = 1_000_000
"""Scene `n` of seed `s` is simulated from the number `s * SCENES_PER_SEED + n`, which `truth_N.json` keeps as `seed`."""
LARGEST_SEED = 10**12
"""Largest seed for which the numbers of all scenes fit into 64 bits."""
SceneSeed = Annotated[int, Meta(ge=0, le=LARGEST_SEED)]
LAST_FIRST_SCENE = SCENES_PER_SEED - SPLITS["test"].stop
"""Largest first scene. Another `seed` gives more scenes."""
SplitName = Annotated[str, one_of(SPLITS)]


@dataclass(frozen=True)
class DatasetConfig(Settings):
    """A data set to generate.

    Attributes:
        output: folder of the data set; an interrupted generation resumes there.
        videos: number of videos over all splits.
        seed: selects the scenes; data sets with different seeds have no scenes in common.
        first_scene: number of the scene that video 0 shows; video `i` shows scene `first_scene + i` of the seed.
        splits: share of the videos in train, validation and test (normalised before use).
        renderer: "preview" (fast), "blender" with `render.assets`, or "none" for data sets without videos.
        masks: whether to write exact masks as mask proposals (about 0.3 MB per video).
        questions: settings of the questions of each split; "null" (None in Python) for a data set without questions. The
            answers to the test split's questions are only in `truth/questions_test.json`.
        counterfactual_videos: number of videos without one of the objects that are written for each video, in data sets of
            their own below `counterfactual/` (see `Files`), beginning with the objects whose removal changes most
            (see `removals_by_effect`).
        world: the world of the videos: a file (see `nsdr.read_world`), the name of one that ships, or a `World`.
        scene: what scenes look like, where it is not as the world says.
        render: rendering options.
        engine: "processes" or "ray".
        workers: number of processes; 0 is one per CPU core.
    """

    unit: ClassVar[str] = "video"
    """What one job makes, as the progress bar calls it."""
    videos_per_job: ClassVar[int] = 1

    output: str
    videos: Annotated[int, Meta(ge=1, le=limits().videos)] = 100
    seed: SceneSeed = 0
    first_scene: Annotated[int, Meta(ge=0, le=LAST_FIRST_SCENE)] = 0
    splits: Mapping[SplitName, Share] = field(default_factory=lambda: {"train": 0.5, "validation": 0.25, "test": 0.25})
    renderer: Annotated[str, one_of(RENDERERS)] = "preview"
    masks: bool = True
    questions: QuestionConfig | None = field(default_factory=QuestionConfig)
    counterfactual_videos: Count = 0
    world: str | World = "clevrer"
    scene: SceneConfig = field(default_factory=SceneConfig)
    render: RenderConfig = field(default_factory=RenderConfig)
    engine: Annotated[str, one_of(ENGINES)] = "processes"
    workers: Count = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.splits.values()):
            raise DataError(f"splits: expected shares of {', '.join(SPLITS)}, got {dict(self.splits)}")
        world = read_world(self.world) if isinstance(self.world, str) else self.world
        object.__setattr__(self, "world", world)  # read once, as the file may change
        self._check_world(world)
        changed = self.scene.world_of(world)
        fewest = min(n for n, share in changed.layout.objects if share)
        expected = f"at most {fewest}, the fewest objects of a scene"
        expect(self.counterfactual_videos <= fewest, "counterfactual_videos", expected, self.counterfactual_videos)
        if self.renderer == "blender" and not self.render.assets:
            raise DataError(
                "render.assets: renderer blender needs CLEVR's Blender files, the folder image_generation/data of "
                "https://github.com/facebookresearch/clevr-dataset-gen"
            )

    def _check_world(self, world: World) -> None:
        """Raise `DataError` unless the scenes and the renderer fit the world."""
        self.scene.triples_in(world)
        self.render.size_in(world)
        check_vocabulary(world.vocabulary)  # without questions, too: they may be asked later
        if self.renderer == "blender":
            check_assets_fit(world)

    @property
    def own_world(self) -> World:
        """The world of the videos."""
        assert isinstance(self.world, World)
        return self.world

    @property
    def has_questions(self) -> bool:
        """Whether the data set has question files."""
        return self.questions is not None

    def scene_seed(self, index: int) -> int:
        """The number from which the scene of a video is simulated. No other seed or scene has the same number."""
        return self.seed * SCENES_PER_SEED + self.first_scene + index

    def made(self, index: int) -> tuple[SimulatedScene, dict[str, Any]]:
        """The scene of a video, and additional entries of its truth file."""
        return simulate_scene(self.scene_seed(index), self.scene, world=self.own_world), {}

    def made_together(self, first: int) -> Sequence[tuple[SimulatedScene, dict[str, Any]]]:
        """What `made` returns for each video of the job that begins with video `first`."""
        return [self.made(first)]

    def indices(self) -> dict[str, range]:
        """Video indices of each split, counted from the start of the split's range in the release."""
        total = sum(self.splits.values())
        ends = np.cumsum([self.splits.get(name, 0.0) for name in SPLITS]) / total * self.videos
        counts = np.diff(np.rint(ends), prepend=0).astype(int)
        result = {}
        for (name, official), count in zip(SPLITS.items(), counts, strict=True):
            if count > len(official):
                raise DataError(f"videos: {count} are too many for {name}, which has indices for {len(official)}")
            result[name] = range(official.start, official.start + int(count))
        return result


class Files:
    """Paths of one video's files.

    Args:
        root: folder of the data set.
        split: the video's split.
        index: its index.
        counterfactual: 0 for the video itself. Counterfactual videos 1, 2, … show the same scene without one of its objects;
            their files are in `counterfactual/1` and so on, under the same names. `removed` in their truth files is the id that
            the missing object has in the video itself.

    Attributes:
        video: the video (mp4).
        annotation: the annotation, which the test split lacks.
        proposals: exact masks, as mask proposals.
        truth: the complete ground truth. It is written last, so it marks a finished video.
    """

    def __init__(self, root: str | Path, split: str, index: int, counterfactual: int = 0) -> None:
        root = self.root_of(Path(root), counterfactual)
        self.video = root / "videos" / split / sub_folder("video", index) / f"video_{index:05d}.mp4"
        self.annotation = (
            root / "annotations" / split / sub_folder("annotation", index) / f"annotation_{index:05d}.json"
        )
        self.proposals = root / "derender_proposals" / f"proposal_{index:05d}.json"
        self.truth = root / "truth" / split / f"truth_{index:05d}.json"

    @staticmethod
    def root_of(root: Path, counterfactual: int) -> Path:
        """The folder of the data set itself, or of one of its data sets of counterfactual videos."""
        return root / "counterfactual" / str(counterfactual) if counterfactual else root


def generate_dataset(config: DatasetConfig, keep_going: bool = False) -> Path:
    """Generate a data set and return its folder. Finished videos are kept.

    A data set has `videos/`, `annotations/` (not for the test split, as in the release), `derender_proposals/`, `questions/`,
    `truth/`, `manifest.json`, statistics beside those of the release, and optionally `counterfactual/` (see `Files`).

    Args:
        config: what to generate.
        keep_going: if videos fail, write questions and statistics about the others.

    Raises:
        DataError: PyBullet is not installed, the folder holds a data set with another configuration, another process is
            writing to it, or some videos failed (the others are written).
    """
    check_installed("pybullet", "simulating needs PyBullet", "generate")
    root = Path(config.output)
    with locked(root):
        _write_manifests(config, root)
        _generate(config, root, keep_going)
    return root


def _write_manifests(config: DatasetConfig, root: Path) -> None:
    """Write the manifests of the data set and of those of counterfactual videos, which have no questions."""
    manifest, path = _manifest(config), root / "manifest.json"
    if path.exists():
        found = read_json(path, dict[str, Any])
        existing = convert(found.get("config"), dict[str, Any], f"{path}: config: ") | _world_of(found)
        wanted = manifest["config"] | _world_of(manifest)
        changed = sorted(k for k in {*existing, *wanted} if existing.get(k) != wanted.get(k))
        if changed:
            raise DataError(f"{path}: was made with another {', '.join(changed)}; choose another folder")
    write_json(path, manifest, indent=1)
    manifest["kinds"] = [kind for kind in manifest["kinds"] if kind != "questions"]
    for number in range(1, config.counterfactual_videos + 1):
        write_json(Files.root_of(root, number) / "manifest.json", manifest, indent=1)


def _world_of(manifest: Mapping[str, Any]) -> dict[str, Any]:
    return {"world": manifest["world"]} if "world" in manifest else {}


def _generate(config: DatasetConfig, root: Path, keep_going: bool) -> None:
    step = config.videos_per_job
    manifest = _manifest(config)
    value = fingerprint(config=[VERSION, manifest["config"], *_world_of(manifest).values()])
    jobs = [
        Job(f"video {video}", (split, range(video, video + step)), Files(root, split, video + step - 1).truth, value)
        for split, indices in config.indices().items()
        for video in indices[::step]
    ]
    summary = run_jobs(partial(_make_videos, config), jobs, root, config.engine, config.workers, config.unit)
    made = [(job.item[0], index) for job in summary.succeeded(jobs, root, keep_going) for index in job.item[1]]
    if config.questions is not None:
        for split in config.indices():
            _write_split_questions(config, split, [index for name, index in made if name == split])
    truths = (read_truth_file(Files(root, *video).truth) for video in made)
    counts = count_scenes(scene_from_truth(t) for t in truths)
    write_statistics(root, counts, f"{len(made)} generated videos", config.own_world)


def _write_split_questions(config: DatasetConfig, split: str, indices: Sequence[int]) -> None:
    assert config.questions is not None
    wanted = config.questions if split == "train" else replace(config.questions, plain_per_video=0)
    if not indices:
        return
    paths = [Files(config.output, split, i).truth for i in indices]
    found = run_in_order(partial(_scene_candidates, wanted), paths, config.engine, config.workers)
    bar = tqdm(found, total=len(paths), unit="scene", desc="questions")
    scenes = list(select_questions(bar, wanted, config.own_world))
    root = Path(config.output)
    if split != "test":
        write_question_statistics(root / "questions" / split, scenes, config.own_world)
    write_split_questions(root, split, scenes)


def write_split_questions(root: Path, split: str, scenes: Sequence[SceneQuestions]) -> None:
    """Write the question file of a split; those of the test split get their answers only in `truth/questions_test.json`."""
    if split == "test":
        write_questions(root / "truth" / "questions_test.json", scenes)
        scenes = [without_answers(scene) for scene in scenes]
    write_questions(root / "questions" / f"{split}.json", scenes)


def _scene_candidates(config: QuestionConfig, path: Path) -> SceneQuestions:
    truth = read_truth_file(path)
    simulate = TruthSimulator(truth) if config.changed_per_video else None
    index = truth["scene_index"]
    return find_candidates((index, f"video_{index:05d}.mp4", scene_from_truth(truth), simulate), config)


def _manifest(config: DatasetConfig) -> dict[str, Any]:
    values, world = asdict(config), config.own_world
    for name in ("output", "engine", "workers", "world"):
        values.pop(name)
    _fill(values["scene"], _scene_values(world))
    if world == CLEVRER_WORLD:
        _fill(values["scene"]["physics"], _clevrer_physics())
    _fill(values["render"], {"width": world.camera.width, "height": world.camera.height})
    values["render"]["assets"] = Path(config.render.assets).name
    kinds = {"annotations": True, "videos": config.renderer != "none", "proposals": config.masks}
    kinds["questions"] = config.has_questions
    versions = {"python": platform.python_version()}
    for name in VERSIONS_OF:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return {
        "generator": "nsdr generate dataset",
        "config": json.loads(json.dumps(values)),  # as `read_json` gives it
        "splits": {name: [r.start, r.stop] for name, r in config.indices().items()},
        "kinds": [kind for kind, is_written in kinds.items() if is_written],
        "n_frames": values["scene"]["n_frames"],
        "versions": versions,
        **json.loads(json.dumps(stored_world(world))),
    }


def _fill(settings: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Put values in place of what settings leave out."""
    settings.update({name: value for name, value in values.items() if settings[name] is None})


def _scene_values(world: World) -> dict[str, Any]:
    """What the world says about settings of scenes, but for `physics`."""
    layout, physics = world.layout, world.physics
    values: dict[str, Any] = {f"{kind}s": words for kind, words in world.vocabulary.words.items()}
    values |= {"objects": dict(layout.objects), "participants": layout.participants}
    values |= {"speed": physics.start_speed_world_per_s, "mass": physics.mass_range}
    return values | {"n_frames": world.timeline.frames}


def _clevrer_physics() -> dict[str, float]:
    """What manifests say about the physics of CLEVRER's world. In others, each shape and material has friction of its own."""
    words = CLEVRER_WORLD.vocabulary
    box, sphere, _ = words.shapes
    frictions = {"friction": box.friction, "sphere_friction": sphere.friction}
    return {"gravity": CLEVRER_WORLD.physics.gravity, **frictions, "restitution": words.materials[0].restitution}


def _make_videos(config: DatasetConfig, job: tuple[str, range], _: Path) -> None:
    """Write all files of a job's videos. The ground truth is last, so that an unfinished video never counts as done."""
    split, indices = job
    for index, (scene, more_truth) in zip(indices, config.made_together(indices[0]), strict=True):
        video = split, index
        for number, removed in enumerate(removals_by_effect(scene)[: config.counterfactual_videos], 1):
            files = Files(config.output, *video, number)
            _write_files(
                config, video, scene_without(scene, removed, config.scene.physics), files, {"removed": removed}
            )
        _write_files(config, video, scene, Files(config.output, *video), more_truth)


def _write_files(
    config: DatasetConfig, video: tuple[str, int], scene: SimulatedScene, files: Files, more_truth: dict[str, Any]
) -> None:
    split, index = video
    world = config.own_world
    view = view_of(config.render, scene.seed, world)
    # Masks and visibility refer to the world's image size, whatever the video's size is.
    camera = replace(view.camera, width=world.camera.width, height=world.camera.height)
    if config.renderer != "none":
        shown = spaced(scene.n_frames, config.render.frames or scene.n_frames)
        frames: Iterator[NDArray[np.uint8]]
        if config.renderer == "preview":
            preset = "veryfast"
            frames = (render_preview(scene.objects, solids_at(scene, int(f)), view) for f in shown)
        else:
            preset = "slow"
            frames = _blender_frames(config.render, scene, view, shown.tolist())
        write_video(files.video, frames, world.timeline.fps, config.render.crf, preset)
    if config.masks:
        write_json(files.proposals, proposal_document(scene, index, files.video.name, camera))
    if split != "test":
        annotation = annotation_document(scene, index, files.video.name, camera)
        write_annotation(files.annotation, annotation)
    write_json(files.truth, truth_document(scene, index, camera) | more_truth)


def _blender_frames(
    config: RenderConfig, scene: SimulatedScene, view: View, shown: Sequence[int]
) -> Iterator[NDArray[np.uint8]]:
    """Render the given frames with Blender."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frame.png"
        for f in shown:
            _blender(config).render(scene.objects, solids_at(scene, f), view, path)
            image = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
            if image is None:
                raise DataError(f"{path}: Blender wrote no readable image")
            yield np.asarray(image, np.uint8)


@lru_cache(maxsize=1)
def _blender(config: RenderConfig) -> Any:
    from nsdr.generate.render.blender import Blender

    return Blender(config)
