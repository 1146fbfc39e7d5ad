"""What all formats have in common: settings, the data set's questions and videos, the registry, and the run that writes one."""

import logging
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta
from tqdm import tqdm

from nsdr.clevrer.answers.prompts import option_letters
from nsdr.clevrer.dataset import CLEVRER, SPLITS
from nsdr.clevrer.files.questions import Question, SceneQuestions, read_questions
from nsdr.clevrer.files.scenes import iterate_scenes
from nsdr.errors import DataError
from nsdr.generate.dataset import SCENES_PER_SEED, Files, SceneSeed
from nsdr.generate.export.records import Record, reasoner, scene_records
from nsdr.io.files import (
    atomic_path,
    check_installed,
    check_output_folder,
    json_text,
    locked,
    remove_partial_files,
    write_json,
)
from nsdr.io.fingerprint import fingerprint
from nsdr.io.reading import read_json
from nsdr.io.registry import Registry
from nsdr.validation import Count, Settings, convert, one_of

MANIFEST = "export.json"
"""File of an export's folder with its settings and counts."""
VERSION = 2
"""Of the records of an export: raised when they change."""
VIDEOS = ("copy", "none")
REASONING = ("", "short", "long")
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ExportConfig(Settings):
    """An export.

    Attributes:
        root: folder of the data set, generated or in the official layout.
        output: folder to write; an interrupted export resumes there.
        format: one of `EXPORTERS`.
        splits: which; () for train and validation, as far as they have questions.
        questions: question file in place of the split's own, such as one with tags or `truth/questions_test.json`; needs one
            split.
        videos: "copy" them into the output, or "none" (only their paths are written).
        limit: first n videos of each split; 0 for all.
        shard_mb: webdataset: largest size of a shard (10^6 bytes), unless one video is larger.
        reasoning: "short" or "long" for checkable sentences that lead to each answer, from the true scenes; "" for none.
        scenes: whether to give the true scenes, too, which `nsdr.rewards.evidence` reads.
    """

    root: str
    output: str
    format: str
    splits: tuple[str, ...] = ()
    questions: str = ""
    videos: Annotated[str, one_of(VIDEOS)] = "copy"
    limit: Count = 0
    shard_mb: Annotated[int, Meta(ge=1, le=10**6)] = 1000
    reasoning: Annotated[str, one_of(REASONING)] = ""
    scenes: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.questions and len(self.splits) != 1:
            raise DataError("questions: a question file is of one split; name it (--split)")
        if len(set(self.splits)) < len(self.splits):
            raise DataError(f"splits: {', '.join(self.splits)} names one twice")


@dataclass(frozen=True)
class SplitSummary:
    """What an export holds of a split.

    Attributes:
        videos: videos with questions.
        questions: questions about them.
        unanswered: questions among them that have no answer in their file, and so no solution.
    """

    videos: int
    questions: int
    unanswered: int


class Export:
    """An export in progress, as a format's writer gets it.

    Args:
        config: the settings.

    Attributes:
        data: the data set.
        folder: where to write. A file that is there is finished: write atomically, and skip what exists.
        splits: what there is to export of each split, by name. A format that writes something else puts that here.
        is_generated: whether the data set has a manifest, as generated ones do.

    Raises:
        DataError: a split has no questions, a video or true scene is missing, or a video is of another split; names the file
            and the remedy.
    """

    def __init__(self, config: ExportConfig) -> None:
        self.config, self.folder = config, Path(config.output)
        self.data = CLEVRER(config.root)
        self._sources = {name: self.data.split(name) for name in config.splits or SPLITS}
        if not config.splits:
            self._sources = {n: s for n, s in self._sources.items() if n != "test" and s.question_file is not None}
        if not self._sources:
            raise DataError(f"{config.root}: has no questions/train.json and no questions/validation.json")
        self.is_generated = self.data.manifest is not None
        self._seed = _first_seed(self.data)
        self._videos: dict[str, dict[int, Path]] = {}
        self._bytes: dict[str, int] = {}
        self.splits = {name: self._summary(name) for name in self._sources}

    def questions(self, split: str) -> Iterator[SceneQuestions]:
        """Yield the split's videos that have questions, one by one."""
        found = (scene for scene in read_questions(self._question_file(split)) if scene.questions)
        return islice(found, self.config.limit or None)

    def scenes(self, split: str) -> Iterator[tuple[Path | None, tuple[Record, ...]]]:
        """Yield each video's file (None if the export has no videos) and at least one record, and show progress."""
        total = self.splits[split].videos
        for scene in tqdm(self.questions(split), total=total, unit="video", desc=split):
            index = scene.scene_index
            seed = None if self._seed is None else self._seed + index
            name = self._scene_name(split, index) if self.config.scenes else None
            tell = self._tell(split, index) if self.config.reasoning else None
            video = None if self.config.videos == "none" else self._sources[split].video(index)
            yield video, scene_records(scene, split, self._video_name(split, index), seed, tell, name)

    def records(self, split: str) -> Iterator[Record]:
        """Yield the split's records; each video is copied before its first record."""
        for video, records in self.scenes(split):
            first = records[0]
            if video is not None:
                copy_once(video, self.folder / first.video)
                if first.scene is not None:
                    copy_once(self.data.root / first.scene, self.folder / first.scene)
            yield from records

    def settings(self) -> dict[str, Any]:
        """Everything that the output depends on."""
        values = {k: v for k, v in asdict(self.config).items() if k not in ("root", "output", "questions")}
        files = [self._question_file(name) for name in self.splits]
        inputs = fingerprint(inputs=files, config=[VERSION, self._seed, self._bytes])
        return values | {"splits": list(self.splits), "inputs_and_code": inputs}

    def _summary(self, split: str) -> SplitSummary:
        source = self._sources[split]
        self._videos[split] = entries = source.entries("videos")
        n_videos = n_questions = n_unanswered = 0
        questions = self._question_file(split)
        for scene in self.questions(split):
            index = scene.scene_index
            if index not in source.indices:
                first, last = source.indices.start, source.indices.stop - 1
                has = f"{first} to {last}" if source.indices else "no videos"
                raise DataError(f"{questions}: scene_index {index}: the data set's {split} split has {has}")
            if self.config.videos != "none":
                if index not in entries:
                    missing = f"has no video_{index:05d}.mp4 ({split})"
                    raise DataError(f"{self.config.root}: {missing}; fetch it, or give --videos none")
                self._bytes[f"video {index}"] = entries[index].stat().st_size
            for question in scene.questions:
                try:
                    option_letters(len(question.choices))
                except DataError as e:
                    raise DataError(f"{questions}: scene {index}, question {question.id}: {e}") from e
            if self.config.reasoning or self.config.scenes:
                scene_file = self.data.root / self._scene_name(split, index)
                self._bytes[f"scene {index}"] = scene_file.stat().st_size
            n_videos += 1
            n_questions += len(scene.questions)
            n_unanswered += sum(map(is_unanswered, scene.questions))
        return SplitSummary(n_videos, n_questions, n_unanswered)

    def _question_file(self, split: str) -> Path:
        path = Path(self.config.questions) if self.config.questions else self._sources[split].question_file
        if path is None:
            raise DataError(f"{self.config.root}: has no questions/{split}.json; leave out --split {split}")
        return path

    def _video_name(self, split: str, index: int) -> str:
        """Where the official layout has a video; without copied videos, where the data set has it."""
        root = self.data.root
        if self.config.videos == "none":
            video = self._videos[split].get(index)
            if video is not None:
                return video.relative_to(root).as_posix()
        return Files(root, split, index).video.relative_to(root).as_posix()

    def _scene_name(self, split: str, index: int) -> str:
        """Where the data set has the true scene: a truth file, or else an annotation."""
        truth = Files(self.data.root, split, index).truth
        if truth.is_file():
            return truth.relative_to(self.data.root).as_posix()
        annotation = self._sources[split].entries("annotations").get(index)
        if annotation is None:
            where = f"{truth}, and no annotation_{index:05d}.json beside it"
            raise DataError(
                f"{where}: no such file; export without --reasoning and --scenes, or fetch and unzip annotations"
            )
        return annotation.relative_to(self.data.root).as_posix()

    def _tell(self, split: str, index: int) -> Callable[[Question], str | None]:
        path = self.data.root / self._scene_name(split, index)
        scenes = {number: scene for number, _, scene in iterate_scenes(path)}
        if list(scenes) != [index]:
            raise DataError(f"{path}: scene_index: expected {index} alone, got {list(scenes)}")
        return reasoner(scenes[index], self.config.reasoning)  # type: ignore[arg-type]


def is_unanswered(question: Question) -> bool:
    """Whether a question, or one of its options, has no answer."""
    return None in ([c.answer for c in question.choices] or [question.answer])


def copy_once(source: Path, target: Path) -> None:
    """Copy a file, atomically, unless the target is there."""
    if not target.exists():
        with atomic_path(target) as temporary:
            shutil.copyfile(source, temporary)


@dataclass(frozen=True)
class Exporter:
    """A format.

    Attributes:
        write: writes the export's files into its folder.
        needs: package that it needs, and extra of nsdr that brings it; "" for none.
        refuses: options of "--scenes", "--videos none" and "--reasoning" that do not fit what its files hold.
    """

    write: Callable[[Export], None]
    needs: str = ""
    refuses: tuple[str, ...] = ()


def write_json_lines(export: Export, row: Callable[[Record], Mapping[str, Any]]) -> None:
    """Write SPLIT.jsonl of every split, with one row for each record."""
    for split in export.splits:
        path = export.folder / f"{split}.jsonl"
        if not path.exists():
            with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as file:
                for record in export.records(split):
                    file.write(json_text(row(record), path) + "\n")


def _first_seed(root: CLEVRER) -> int | None:
    """The number from which video 0 of a generated data set is simulated (`DatasetConfig.scene_seed`); None of other data."""
    if root.manifest is None or "config" not in root.manifest:
        return None
    where = f"{root.root / 'manifest.json'}: config."
    config = convert(root.manifest["config"], dict[str, Any], where)
    seed, first = (convert(config.get(name), SceneSeed, f"{where}{name}: ") for name in ("seed", "first_scene"))
    return int(seed * SCENES_PER_SEED + first)


EXPORTERS: Registry[Exporter] = Registry(
    "export format",
    "nsdr.exporters",
    {
        "grpo": "nsdr.generate.export.json_lines:GRPO",
        "chat": "nsdr.generate.export.json_lines:CHAT",
        "pairs": "nsdr.generate.export.pairs:PAIRS",
        "parquet": "nsdr.generate.export.parquet:PARQUET",
        "webdataset": "nsdr.generate.export.webdataset:WEBDATASET",
    },
)
"""Formats by name; another package adds one by an entry point of the group `nsdr.exporters`."""


def export_dataset(config: ExportConfig) -> dict[str, SplitSummary]:
    """Write an export; a finished one is left as it is, an interrupted one is finished.

    Returns:
        What it holds of each split.

    Raises:
        DataError: an unknown format, its package is not installed, a split has no questions, a video is missing, or the folder
            holds other files, an export with other settings or one of other data.
    """
    exporter = EXPORTERS[config.format]
    if exporter.needs:
        check_installed(exporter.needs, f"format {config.format} needs {exporter.needs}", exporter.needs)
    given = {"--scenes": config.scenes, "--videos none": config.videos == "none", "--reasoning": config.reasoning != ""}
    for option in exporter.refuses:
        if given[option]:
            raise DataError(f"format {config.format} holds videos and questions only; leave out {option}")
    check_output_folder(config.output)
    export = Export(config)
    with locked(export.folder):
        _write(export, exporter)
    for name, summary in export.splits.items():
        if summary.unanswered:
            share = f"{summary.unanswered} of {summary.questions} questions"
            log.warning("%s: %s have no answer in their file and were exported without a solution", name, share)
    return export.splits


def _write(export: Export, exporter: Exporter) -> None:
    path, settings = export.folder / MANIFEST, export.settings()
    if path.exists():
        manifest = read_json(path, dict[str, Any])
        existing = convert(manifest.get("settings"), dict[str, Any], f"{path}: settings: ")
        changed = sorted(k for k, v in settings.items() if existing.get(k) != v)
        if changed:
            raise DataError(f"{path}: was made with other settings ({', '.join(changed)}); choose another folder")
        if manifest.get("complete"):
            export.splits = convert(manifest.get("splits"), dict[str, SplitSummary], f"{path}: splits: ")
            return
        remove_partial_files(export.folder)
    elif any(not file.name.startswith(".") for file in export.folder.iterdir()):
        raise DataError(f"{export.folder}: holds files that are no export; choose an empty or new folder")

    def told(complete: bool) -> None:
        splits = {name: asdict(summary) for name, summary in export.splits.items()}
        write_json(path, {"settings": settings, "splits": splits, "complete": complete}, indent=1)

    told(False)
    exporter.write(export)
    told(True)
