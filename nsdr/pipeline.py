"""The whole system: a video and a question go in, an answer with its trace comes out."""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nsdr.dynamics.base import DynamicsBackend
from nsdr.dynamics.registry import BackendConfig, load_backend
from nsdr.dynamics.scene import scene_from_prediction
from nsdr.errors import QuestionError, VideoError
from nsdr.frame_parser.parser import FrameParser
from nsdr.io.checkpoint import find_checkpoint
from nsdr.io.video import read_frames
from nsdr.question_parser.parser import QuestionParser
from nsdr.symbolic import Executor, Program
from nsdr.tracking.tracker import TrackerConfig, track
from nsdr.types import Answer, DynamicsPrediction, Event, Scene, VideoProposals, VideoTracks

__all__ = ["Perception", "Pipeline"]

ProgramSource = str | Sequence[str] | Program
KEPT_VIDEOS = 16


@dataclass(frozen=True)
class Perception:
    """Everything that was found out about a video; stages that were given or skipped are None."""

    proposals: VideoProposals | None
    tracks: VideoTracks | None
    dynamics: DynamicsPrediction | None
    scene: Scene


class Pipeline:
    """Frame parser, tracker, dynamics predictor, question parser and executor, composed.

    Every part is an attribute and can be replaced by an object with the same method. Perceptions are kept for the
    most recent videos, so further questions on a video cost little.

    Args:
        frame_parser: `parse(frames) -> VideoProposals`.
        dynamics: `predict(VideoTracks) -> DynamicsPrediction`; where true collisions are given to `perception`,
            `predict(VideoTracks, collisions)`.
        question_parser: `parse(text, kind) -> Program`.
        tracker: thresholds of the tracker.
        semantics: of the executor.
    """

    def __init__(
        self,
        frame_parser: FrameParser,
        dynamics: DynamicsBackend,
        question_parser: QuestionParser,
        tracker: TrackerConfig | None = None,
        semantics: str = "paper",
    ) -> None:
        self.frame_parser = frame_parser
        self.dynamics = dynamics
        self.question_parser = question_parser
        self.tracker = tracker or TrackerConfig()
        self.semantics = semantics
        self.progress = False
        self._kept: OrderedDict[Any, Perception] = OrderedDict()

    @classmethod
    def from_pretrained(
        cls, path_or_id: str | Path = "default", dynamics: str | Path | BackendConfig = "physics", **options: Any
    ) -> "Pipeline":
        """Load the three parts from a checkpoint folder, its name, or a hub id (see `nsdr.io.checkpoint`).

        Args:
            path_or_id: where the checkpoint is.
            dynamics: a backend by name ("physics", "state" or "paper"), a YAML file, or its settings.
            options: further arguments of the constructor.

        Raises:
            CheckpointError: missing or corrupt; says what and how to get it.
        """
        folder = find_checkpoint(path_or_id)
        return cls(
            FrameParser.from_checkpoint(folder),
            load_backend(folder, dynamics),
            QuestionParser.from_checkpoint(folder),
            **options,
        )

    def scene(self, video: str | Path) -> Scene:
        """The symbolic scene of a video file. Computed once for each content of the file.

        Raises:
            VideoError: the file cannot be read, or no object was found in it.
        """
        return self.perceive(video).scene

    def perceive(
        self,
        video: str | Path | None = None,
        proposals: VideoProposals | None = None,
        tracks: VideoTracks | None = None,
        dynamics: DynamicsPrediction | None = None,
        true_scene: Scene | None = None,
    ) -> Perception:
        """All stages up to the scene, starting from the latest that is given.

        Args:
            video: a video file.
            proposals, tracks, dynamics: results to use instead of computing them.
            true_scene: a scene whose collisions during the video are believed instead of those that are found.

        Raises:
            VideoError: nothing is given, the file cannot be read, or no object was found.
        """
        key = None
        if dynamics is None and tracks is None and proposals is None:
            if video is None:
                raise VideoError("give a video, proposals, tracks or a dynamics prediction")
            key = _file_key(Path(video))
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
            proposals = self.frame_parser.parse(read_frames(video), progress=self.progress)
        if dynamics is None:
            if tracks is None:
                assert proposals is not None
                tracks = track(proposals, self.tracker)
            if not tracks.tracks:
                what = video or "the proposals"
                raise VideoError(
                    f"{what}: no objects found in more than {self.tracker.min_frames} frames; is it a CLEVRER clip?"
                )
            if true_scene is None:
                dynamics = self.dynamics.predict(tracks)
            else:
                dynamics = self.dynamics.predict(tracks, collisions_of(true_scene, tracks))
        perception = Perception(proposals, tracks, dynamics, scene_from_prediction(dynamics))
        if key is not None:
            self._kept[key] = perception
            while len(self._kept) > KEPT_VIDEOS:
                self._kept.popitem(last=False)
        return perception

    def answer(
        self,
        video_or_scene: str | Path | Scene,
        question: str = "",
        choices: Sequence[str] | None = None,
        program: ProgramSource | None = None,
        choice_programs: Sequence[ProgramSource] | None = None,
    ) -> Answer:
        """Answer a question about a video or scene.

        Args:
            video_or_scene: a video file, or a scene from anywhere.
            question: in CLEVRER's English; may be left out when `program` is given.
            choices: options of a multiple-choice question.
            program, choice_programs: programs to run instead of parsing the texts.

        Raises:
            VideoError: the video cannot be read.
            QuestionError: a text fits no program, a multiple-choice question has no choices or the reverse.
            ProgramError, ExecutionError: a given program is malformed, or the program does not fit the scene.
        """
        if program is None and not question.strip():
            raise QuestionError("the question is empty")
        parsed, parsed_choices = self._programs(question, choices, program, choice_programs)
        scene = video_or_scene if isinstance(video_or_scene, Scene) else self.scene(video_or_scene)
        executor = Executor(scene, self.semantics)
        if parsed_choices is None:
            return executor.answer(parsed, question)
        texts = choices or [str(p) for p in parsed_choices]
        return executor.judge(parsed, list(zip(texts, parsed_choices, strict=True)), question)

    def _programs(
        self,
        question: str,
        choices: Sequence[str] | None,
        program: ProgramSource | None,
        choice_programs: Sequence[ProgramSource] | None,
    ) -> tuple[Program, list[Program] | None]:
        """The question's program, and those of the choices (None for a descriptive question)."""
        multiple_choice = bool(choices) or bool(choice_programs)
        if program is not None:
            parsed = Program.parse(program)
        else:
            parsed = self.question_parser.parse(question, "multiple_choice" if multiple_choice else "descriptive")
        if parsed.needs_choice != multiple_choice:
            missing = "give choices with it" if parsed.needs_choice else "ask it without choices"
            kind = "a multiple-choice" if parsed.needs_choice else "a descriptive"
            raise QuestionError(f"{question or str(parsed)!r} is {kind} question; {missing}")
        if not multiple_choice:
            return parsed, None
        if choice_programs is not None:
            if choices is not None and len(choices) != len(choice_programs):
                raise QuestionError(f"{len(choices)} choices but {len(choice_programs)} choice programs")
            return parsed, [Program.parse(p) for p in choice_programs]
        return parsed, [self.question_parser.parse(choice, "choice") for choice in choices or ()]


def collisions_of(scene: Scene, tracks: VideoTracks) -> list[Event]:
    """A scene's collisions during the video with the ids of the tracks of the same names; others are left out."""
    ids = {t.object.name: t.object.id for t in tracks.tracks}
    events = []
    for event in scene.events:
        names = [scene.objects[i].name for i in event.objects]
        if event.kind == "collision" and all(name in ids for name in names):
            events.append(Event("collision", event.frame, tuple(sorted(ids[name] for name in names))))
    return events


def _file_key(path: Path) -> tuple[str, int, int]:
    try:
        status = path.stat()
    except OSError as e:
        raise VideoError(f"{path}: no such file") from e
    return str(path.resolve()), status.st_mtime_ns, status.st_size
