"""Writes an export: checks the data set before anything is written, then resumes or writes its files."""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
from tqdm import tqdm

from nsdr.clevrer.answers.prompts import option_letters
from nsdr.clevrer.dataset import CLEVRER, SPLITS, Split
from nsdr.clevrer.files.questions import Question, SceneQuestions, read_questions
from nsdr.clevrer.files.scenes import iterate_scenes
from nsdr.errors import DataError
from nsdr.generate.dataset import SCENES_PER_SEED, Files, SceneSeed
from nsdr.generate.export.formats import ABOUT, FORMATS, Sample, is_unanswered, reasoner
from nsdr.generate.export.pairs import copy_once, write_pairs
from nsdr.io.files import atomic_path, check_output_folder, json_text, locked, remove_partial_files, write_json
from nsdr.io.fingerprint import fingerprint
from nsdr.io.reading import read_json
from nsdr.io.video import even_frames, spaced
from nsdr.io.worlds import store_world
from nsdr.validation import Count, PositiveCount, Settings, convert, one_of
from nsdr.world.world import World

MANIFEST = "export.json"
"""File of an export's folder with its settings and counts."""
VERSION = 5
"""Of the files of an export: raised when they change."""
FRAME_WIDTH_PX = 240
"""Usual width of frames (pixels)."""
PAIRS = "pairs"
"""The format that is no table of columns but a data set of pairs of videos."""
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ExportConfig(Settings):
    """An export.

    Attributes:
        root: folder of the data set, generated or in the official layout.
        output: folder to write; an interrupted export resumes there.
        format: one of `FORMATS`, or "pairs".
        splits: which splits; () for train and validation, as far as they have questions.
        questions: question file in place of the split's own, such as `truth/questions_test.json`; needs one split.
        videos: "copy" copies the videos into the output, "none" only writes their paths.
        frames: number of frames that stand for a video, for formats with images; 0 for the format's own number.
        frame_width: their width (pixels), at most that of the world's images; the height follows from the video's shape. None
            for `FRAME_WIDTH_PX`, or the images' width if that is smaller.
        prefix: written before each path, such as the output's folder as training sees it.
        limit: first n videos of each split; 0 for all.
        reasoning: "short" or "long" for checkable sentences that lead to each answer, from the true scenes; "" for none.
        scenes: whether to give the true scenes, too, which `nsdr.rewards.evidence` reads.
    """

    root: str
    output: str
    format: Annotated[str, one_of((*FORMATS, PAIRS))]
    splits: tuple[str, ...] = ()
    questions: str = ""
    videos: Literal["copy", "none"] = "copy"
    frames: Count = 0
    frame_width: PositiveCount | None = None
    prefix: str = ""
    limit: Count = 0
    reasoning: Literal["", "short", "long"] = ""
    scenes: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.questions and len(self.splits) != 1:
            raise DataError("questions: a question file is of one split; name it (--split)")
        if len(set(self.splits)) < len(self.splits):
            raise DataError(f"splits: {', '.join(self.splits)} names one twice")
        given = {"--scenes": self.scenes, "--videos none": self.videos == "none", "--reasoning": self.reasoning}
        for option in (option for option, value in given.items() if value and self.format == PAIRS):
            raise DataError(f"format {PAIRS} holds videos and questions only; leave out {option}")
        if self.frames and not self.n_frames:
            with_images = ", ".join(name for name, form in FORMATS.items() if form.n_frames)
            raise DataError(
                f"format {self.format} takes videos, no frames; leave out --frames, or choose {with_images}"
            )

    @property
    def n_frames(self) -> int:
        """Number of frames that stand for a video; 0 where the format takes the video."""
        own = FORMATS[self.format].n_frames if self.format in FORMATS else 0
        return self.frames or own if own else 0


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


@dataclass(frozen=True)
class _Item:
    """The questions about a video, and the files of the data set that they are about.

    Attributes:
        questions: at least one question.
        video: the video. It may be missing with `videos` "none"; then this is its place in the official layout.
        scene: the true scene; None where it is not needed.
    """

    questions: SceneQuestions
    video: Path
    scene: Path | None


def export_dataset(config: ExportConfig) -> dict[str, SplitSummary]:
    """Write an export; a finished one is left as it is, an interrupted one is finished.

    Returns:
        What it holds of each split.

    Raises:
        DataError: a split has no questions, a video or true scene is missing, a video is of another split, or the folder holds
            other files, an export with other settings or one of other data.
    """
    check_output_folder(config.output)
    data, folder = CLEVRER(config.root), Path(config.output)
    if (config.frame_width or 0) > (most := data.world.camera.width):
        raise DataError(f"frame_width {config.frame_width}: expected {most} or less, as wide as the world's images are")
    files = _question_files(config, data)
    items = {split: _items(config, data, split, file) for split, file in files.items()}
    seed = _first_seed(data)

    def write() -> dict[str, list[SceneQuestions]]:
        questions = {split: [item.questions for item in listed] for split, listed in items.items()}
        if config.format == PAIRS:
            return write_pairs(data, questions, folder)
        form = FORMATS[config.format]
        store_world(folder, data.world)
        for split, listed in items.items():
            path = folder / f"{split}{form.suffix}"
            if not path.exists():
                WRITERS[form.suffix](path, map(form.row, _samples(config, split, listed, seed, data.world)))
        return questions

    sizes = [_sizes(config, item) for listed in items.values() for item in listed]
    values = {k: v for k, v in asdict(config).items() if k not in ("root", "output", "questions")}
    inputs = fingerprint(inputs=list(files.values()), config=[VERSION, seed, sizes])
    with locked(folder):
        summaries = _finish(folder, values | {"splits": list(files), "inputs": inputs}, write)
    for split, summary in summaries.items():
        if summary.unanswered:
            share = f"{summary.unanswered} of {summary.questions} questions"
            log.warning("%s: %s have no answer in their file and were exported without a solution", split, share)
    return summaries


def _question_files(config: ExportConfig, data: CLEVRER) -> dict[str, Path]:
    """The question file of each split that is exported."""
    if config.questions:
        return {config.splits[0]: Path(config.questions)}
    files = {name: data.split(name).question_file for name in config.splits or SPLITS}
    if not config.splits:
        files = {name: file for name, file in files.items() if name != "test" and file is not None}
    if not files:
        raise DataError(f"{config.root}: has no questions/train.json and no questions/validation.json")
    found = {name: file for name, file in files.items() if file is not None}
    for name in files.keys() - found.keys():
        raise DataError(f"{config.root}: has no questions/{name}.json; leave out --split {name}")
    return found


def _items(config: ExportConfig, data: CLEVRER, split: str, file: Path) -> list[_Item]:
    """The videos of a split that have questions, after a check that everything that is exported is there."""
    source = data.split(split)
    videos = source.entries("videos")
    asked = [scene for scene in read_questions(file) if scene.questions][: config.limit or None]
    items = []
    for scene in asked:
        index = scene.scene_index
        if index not in source.indices:
            has = f"{source.indices.start} to {source.indices.stop - 1}" if source.indices else "no videos"
            raise DataError(f"{file}: scene_index {index}: the data set's {split} split has {has}")
        if (config.videos == "copy" or config.n_frames) and index not in videos:
            missing = f"has no video_{index:05d}.mp4 ({split})"
            remedy = "fetch it" if config.n_frames else "fetch it, or give --videos none"
            raise DataError(f"{config.root}: {missing}; {remedy}")
        for question in scene.questions:
            try:
                option_letters(len(question.choices))
            except DataError as e:
                raise DataError(f"{file}: scene {index}, question {question.id}: {e}") from e
        true = _scene_file(source, index) if config.reasoning or config.scenes else None
        items.append(_Item(scene, videos.get(index, Files(data.root, split, index).video), true))
    return items


def _scene_file(source: Split, index: int) -> Path:
    """The file with the true scene: a truth file, or else an annotation."""
    truth = Files(source.root, source.name, index).truth
    if truth.is_file():
        return truth
    try:
        return source.path("annotations", index)
    except DataError as e:
        raise DataError(f"no {truth}; {e}; or export without --reasoning and --scenes") from e


def _sizes(config: ExportConfig, item: _Item) -> list[int]:
    """Sizes (bytes) of the files that an item is made from."""
    video = [item.video] if config.videos == "copy" or config.n_frames else []
    return [path.stat().st_size for path in (*video, *([item.scene] if item.scene else []))]


def _samples(
    config: ExportConfig, split: str, items: Sequence[_Item], seed: int | None, world: World
) -> Iterator[Sample]:
    """Yield the samples of a split, and show progress; the files of a video are copied before its first sample."""
    root, folder = Path(config.root), Path(config.output)
    for item in tqdm(items, unit="video", desc=split):
        index, video, scene = item.questions.scene_index, item.video, item.scene if config.scenes else None
        if config.videos == "copy":
            video = Files(root, split, index).video  # in the export, videos lie as in the official layout
            copy_once(item.video, folder / video.relative_to(root))
            if scene is not None:
                copy_once(scene, folder / scene.relative_to(root))
        images = _write_frames(config, split, item, world) if config.n_frames else []
        tell = _tell(item.scene, index, config.reasoning) if item.scene is not None and config.reasoning else None
        for question in item.questions.questions:
            yield Sample(
                question,
                split,
                index,
                config.prefix + video.relative_to(root).as_posix(),
                None if seed is None else seed + index,
                None if tell is None else tell(question),
                None if scene is None else config.prefix + scene.relative_to(root).as_posix(),
                [config.prefix + image for image in images],
                world,
            )


def _write_frames(config: ExportConfig, split: str, item: _Item, world: World) -> list[str]:
    """Write the frames that stand for a video, unless they are there; returns their paths in the export, in order."""
    folder = Path("frames", split, f"video_{item.questions.scene_index:05d}")
    names = [(folder / f"{i:03d}.jpg").as_posix() for i in range(config.n_frames)]
    paths = [Path(config.output, name) for name in names]
    if not all(path.exists() for path in paths):
        frames = even_frames(item.video, world)
        width = config.frame_width or min(FRAME_WIDTH_PX, world.camera.width)
        size = width, round(width * frames.shape[1] / frames.shape[2])
        for path, index in zip(paths, spaced(len(frames), config.n_frames), strict=True):
            image = cv2.resize(frames[index], size, interpolation=cv2.INTER_AREA)
            encoded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
            with atomic_path(path) as temporary:
                temporary.write_bytes(encoded.tobytes())
    return names


def _write_json_lines(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        for row in rows:
            file.write(json_text(row, path) + "\n")


def _write_parquet(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows of verl, whose types are fixed: those of a split without options or seeds must not differ from another's."""
    try:
        import pyarrow as pa
        from pyarrow.parquet import ParquetWriter
    except ImportError as e:
        raise DataError("parquet files need pyarrow: pip install 'nsdr[rl]'") from e
    text, texts, number = pa.string(), pa.list_(pa.string()), pa.int64()
    about = dict.fromkeys(ABOUT, text) | dict.fromkeys(("options", "letters", "tags", "program"), texts)
    about |= {"scene_index": number, "question_id": number, "seed": number, "option_programs": pa.list_(texts)}
    schema = pa.schema(
        {
            "data_source": text,
            "prompt": pa.list_(pa.struct({"role": text, "content": text})),
            "videos": pa.list_(pa.struct({"video": text})),
            "ability": text,
            "reward_model": pa.struct({"style": text, "ground_truth": text}),
            "extra_info": pa.struct({"index": number, **about}),
        }
    )
    with atomic_path(path) as temporary, ParquetWriter(temporary, schema) as writer:
        left = iter(rows)
        while batch := list(islice(left, ROWS_PER_GROUP)):
            writer.write_table(pa.Table.from_pylist(batch, schema))


WRITERS: Mapping[str, Callable[[Path, Iterable[Mapping[str, Any]]], None]] = {
    ".jsonl": _write_json_lines,
    ".parquet": _write_parquet,
}
"""What writes the rows of a format, by the suffix of its files."""
ROWS_PER_GROUP = 1000
"""Rows of a parquet file that are held in memory."""


def _tell(path: Path, index: int, length: Literal["short", "long"]) -> Callable[[Question], str | None]:
    scenes = {number: scene for number, _, scene in iterate_scenes(path)}
    if list(scenes) != [index]:
        raise DataError(f"{path}: scene_index: expected {index} alone, got {list(scenes)}")
    return reasoner(scenes[index], length)


def _first_seed(data: CLEVRER) -> int | None:
    """The number from which video 0 of a generated data set is simulated (`DatasetConfig.scene_seed`); None of other data."""
    if data.manifest is None or "config" not in data.manifest:
        return None
    where = f"{data.root / 'manifest.json'}: config."
    config = convert(data.manifest["config"], dict[str, Any], where)
    seed, first = (convert(config.get(name), SceneSeed, f"{where}{name}: ") for name in ("seed", "first_scene"))
    return int(seed * SCENES_PER_SEED + first)


def _finish(
    folder: Path, settings: Mapping[str, Any], write: Callable[[], Mapping[str, Sequence[SceneQuestions]]]
) -> dict[str, SplitSummary]:
    """Write what the folder lacks, unless it is complete; returns what it holds of each split.

    Args:
        folder: the export's folder.
        settings: everything that the files depend on.
        write: writes the files, skips those that are there, and returns the questions of each split.
    """
    path = folder / MANIFEST
    if path.exists():
        manifest = read_json(path, dict[str, Any])
        existing = convert(manifest.get("settings"), dict[str, Any], f"{path}: settings: ")
        if changed := sorted(name for name, value in settings.items() if existing.get(name) != value):
            raise DataError(f"{path}: was made with other settings ({', '.join(changed)}); choose another folder")
        if "splits" in manifest:
            return convert(manifest["splits"], dict[str, SplitSummary], f"{path}: splits: ")
        remove_partial_files(folder)
    elif any(not file.name.startswith(".") for file in folder.iterdir()):
        raise DataError(f"{folder}: holds files that are no export; choose an empty or new folder")
    write_json(path, {"settings": settings}, indent=1)
    summaries = {split: _summary(scenes) for split, scenes in write().items()}
    write_json(path, {"settings": settings, "splits": {k: asdict(v) for k, v in summaries.items()}}, indent=1)
    return summaries


def _summary(scenes: Sequence[SceneQuestions]) -> SplitSummary:
    questions = [question for scene in scenes for question in scene.questions]
    return SplitSummary(len(scenes), len(questions), sum(map(is_unanswered, questions)))
