"""The whole system: a video and a question go in, an answer with its trace comes out."""

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.base import Dynamics, Explanation
from nsdr.dynamics.interventions import check_changes
from nsdr.dynamics.motion_states import VideoPixels, states_from_tracks
from nsdr.dynamics.registry import BackendConfig, backend_settings
from nsdr.dynamics.scene import collisions_of, scene_from_prediction
from nsdr.dynamics.simulation import simulate
from nsdr.errors import DataError, QuestionError, VideoError
from nsdr.frame_parser.check.video import VideoConfig, check_video, clip_frames
from nsdr.io.checkpoint import PIPELINE, HasWeights
from nsdr.io.decoding import check_is_video
from nsdr.io.description import described, differing
from nsdr.io.device import resolve_device
from nsdr.io.files import write_json
from nsdr.io.fingerprint import fingerprint
from nsdr.io.images import Video, VideoSource, video_of
from nsdr.io.notes import Note, distinct, unsaid
from nsdr.io.registry import check_part, checked_result
from nsdr.io.stages import stage
from nsdr.io.storage import load
from nsdr.laws.judge import judge_proposals, judge_tracks
from nsdr.perception import Perception, check_tracks
from nsdr.pipeline_config import PipelineConfig, check_weights, load_parts, pipeline_settings, settings_of
from nsdr.question_parser.base import Parser, read_programs
from nsdr.symbolic import Executor
from nsdr.symbolic.program import ProgramSource
from nsdr.tracking.localization import size_notes
from nsdr.tracking.speeds import speed_notes
from nsdr.tracking.tracker import TrackerConfig, existence, track
from nsdr.types import Answer, Judgement, Scene, Simulation, VideoProposals, VideoTracks
from nsdr.types.interventions import Intervention
from nsdr.world.world import CLEVRER_WORLD, World

if TYPE_CHECKING:  # they load torch, and settings are checked without it
    from nsdr.frame_parser.parser import FrameParser

__all__ = ["Perception", "Pipeline", "PipelineConfig", "judge", "pipeline_settings"]

PARTS = {
    "frame_parser": "parse(frames, progress=False) -> VideoProposals",
    "dynamics": "explain(states, collisions=None) -> Explanation",
    "question_parser": "parse(text, kind) -> Program",
}
"""Attributes of a pipeline that can be replaced by objects with the same method, which is named here."""
KEPT_VIDEOS = 16
"""Perceptions that a pipeline keeps."""
PARSER_SETTINGS = ("stride", "precision")
"""Attributes of a frame parser on which its proposals depend, and which may be set between two calls."""


class Pipeline:
    """Frame parser, tracker, dynamics backend, question parser and executor, composed.

    Every part is an attribute and can be replaced by an object with the same method. Perceptions of the most recent videos are
    kept, as long as no part is replaced.

    Args:
        frame_parser: `parse(frames, progress=False) -> VideoProposals`.
        dynamics: `explain(MotionStates, collisions or None) -> Explanation`.
        question_parser: `parse(text, kind) -> Program`.
        tracker: thresholds of the tracker.
        video: what is expected of videos; None for CLEVRER's.
        world: what the videos are of. The weights of the parts are of this world, or of one that differs in nothing that they
            depend on.

    Attributes:
        progress: whether stderr shows the stage and how far it is; False at first.

    Raises:
        DataError: a part that is given or assigned lacks its method, or has weights of another world; says what differs.
    """

    def __init__(
        self,
        frame_parser: "FrameParser",
        dynamics: Dynamics,
        question_parser: Parser,
        tracker: TrackerConfig | None = None,
        video: VideoConfig | None = None,
        world: World = CLEVRER_WORLD,
    ) -> None:
        self.frame_parser = frame_parser
        self.dynamics = dynamics
        self.question_parser = question_parser
        self.tracker = tracker or TrackerConfig()
        self.video = video or VideoConfig()
        for name in PARTS:
            check_weights(getattr(self, name), world)
        self.world = world
        self.progress = False
        self._kept: OrderedDict[str, tuple[tuple[Any, ...], Perception]] = OrderedDict()
        self._kept_proposals: tuple[Any, tuple[VideoProposals, NDArray[np.floating[Any]]]] | None = None

    def __setattr__(self, name: str, value: Any) -> None:
        if name in PARTS:
            check_part(name, value, PARTS[name])
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        parts = {name: described(getattr(self, name)) for name in PARTS}
        settings = {name: getattr(self, name) for name in ("tracker", "video")}
        parts |= {name: described(value) for name, value in settings.items() if differing(value)}
        told = [*(f"{name}={part}" for name, part in parts.items()), *differing(self.world)]
        return f"Pipeline({', '.join(told)})"

    @classmethod
    def from_pretrained(
        cls,
        path_or_id: str | Path = "default",
        dynamics: str | Path | BackendConfig = "",
        config: PipelineConfig | str | Path | None = None,
        device: str = "auto",
    ) -> "Pipeline":
        """Load the parts from a checkpoint.

        A checkpoint may have only some parts, such as the one that was trained. They are used, and a warning says which others
        are those of `default`.

        Args:
            path_or_id: a folder, a name, or a repository of the Hugging Face Hub (see `nsdr.io.checkpoint.find_checkpoint`).
            dynamics: a backend by name ("physics", "propnet", "propnet_patches" or one of another package), a YAML file, or its
                settings; "" for that of `config`.
            config: settings of all parts, their YAML file, or the name of one that ships: "paper" for the paper's system; None
                for those that `save_pretrained` stored in the checkpoint, or the defaults.
            device: "auto" for CUDA where there is one, else "cpu"; or a device such as "cuda:1".

        Raises:
            CheckpointError: missing or corrupt; says what and how to get it.
            DataError: unknown settings or device.
            EndpointError: the server of the question parser does not answer.
        """
        if not isinstance(config, PipelineConfig):
            config = pipeline_settings(config or "", checkpoint=path_or_id)
        if dynamics:
            config = replace(config, dynamics=backend_settings(dynamics))
        pipeline = cls(*load_parts(path_or_id, config, device), config.tracker, config.video, config.world)
        return pipeline.to(device)

    def save_pretrained(self, folder: str | Path) -> None:
        """Write the weights and settings of all parts, for `from_pretrained(folder)`.

        Raises:
            DataError: a part of your own, of which a checkpoint could not say how it is loaded; names it.
        """
        settings = self.settings
        for part in (getattr(self, name) for name in PARTS):
            if isinstance(part, HasWeights):
                part.save_pretrained(folder)
        write_json(Path(folder) / PIPELINE, asdict(settings), indent=1)

    @property
    def settings(self) -> PipelineConfig:
        """The settings with which `from_pretrained` composes these parts again.

        Raises:
            DataError: a part of your own, which is not named by settings; names it.
        """
        about = (self.tracker, self.video, self.world)
        return settings_of(self.frame_parser, self.dynamics, self.question_parser, *about)

    def to(self, device: str) -> "Pipeline":
        """Move the networks to a device ("auto", "cpu", "cuda", …); returns the pipeline.

        Raises:
            DataError: an unknown device, or one that is not there.
        """
        name = str(resolve_device(device))
        for part in (getattr(self, name) for name in PARTS):
            if isinstance(part, HasWeights):
                part.to(name)
        return self

    def _frame_parsing(self) -> tuple[Any, ...]:
        """What proposals depend on beside the files that are read."""
        return self.frame_parser, *(getattr(self.frame_parser, name, None) for name in PARSER_SETTINGS), self.video

    def _seen(self, video: Video) -> list[Video]:
        """What proposals depend on: the video and, where one is set, the image of the empty scene."""
        return [video, *([Path(self.video.background)] if self.video.background else [])]

    def frames(
        self, video: VideoSource, beyond_cuts: bool = False, note: Note | None = None
    ) -> Iterator[NDArray[np.uint8]]:
        """The frames (height, width, 3) uint8 RGB of a video that perception processes, with its errors.

        Args:
            video: see `perceive`.
            beyond_cuts: whether to give those that are judged, also after a cut.
            note: gets what is unusual about the video (see `Scene.notes`); None gives Python warnings.
        """
        return clip_frames(video, self.video, beyond_cuts, note=note, world=self.world)

    def scene(self, video: VideoSource) -> Scene:
        """The symbolic scene of a video. Computed once for each content; arguments and errors are those of `perceive`."""
        return self.perceive(video).scene

    def perceive(
        self,
        video: VideoSource | None = None,
        proposals: VideoProposals | None = None,
        tracks: VideoTracks | None = None,
        explanation: Explanation | None = None,
        true_scene: Scene | None = None,
    ) -> Perception:
        """All stages up to the scene, starting from the latest that is given.

        Args:
            video: a video file; or its frames (F, height, width, 3) uint8 RGB, at the world's rate unless
                `VideoConfig.fps` says otherwise, as an array or as images such as those of Pillow. Another size is
                scaled and noted.
            proposals, tracks, explanation: results of stages, to use instead of computing them.
            true_scene: a scene whose collisions during the video are taken as true, instead of detecting them.

        Raises:
            VideoError: nothing is given, the file cannot be read or is not of CLEVRER's scene (see `VideoConfig`), no object
                was found, or all move too far from frame to frame for the video's frame rate.
        """
        video = None if video is None else video_of(video)
        if not (proposals is None and tracks is None and explanation is None):
            return self._perceived(video, proposals, tracks, explanation, true_scene)
        if video is None:
            raise VideoError("give a video, proposals, tracks or an explanation")
        check_is_video(video)
        parts = (*self._frame_parsing(), self.tracker, self.dynamics, self.world)
        key = fingerprint(inputs=[*self._seen(video), *([] if true_scene is None else [true_scene])])
        if key in self._kept and all(a is b or a == b for a, b in zip(self._kept[key][0], parts, strict=True)):
            self._kept.move_to_end(key)
            return self._kept[key][1]
        notes: list[str] = []
        parsed = self._parsed(self.frames(video, note=notes.append))
        parsed = replace(parsed, notes=distinct(parsed.notes, notes))
        perception = self._perceived(video, parsed, true_scene=true_scene)
        self._kept[key] = (parts, perception)
        if len(self._kept) > KEPT_VIDEOS:
            self._kept.popitem(last=False)
        return perception

    def _perceived(
        self,
        video: Video | None,
        proposals: VideoProposals | None,
        tracks: VideoTracks | None = None,
        explanation: Explanation | None = None,
        true_scene: Scene | None = None,
    ) -> Perception:
        """The stages after the frame parser, as far as their results are not given."""
        probable = None
        if explanation is None:
            if tracks is None:
                assert proposals is not None
                tracks = track(self._of_this_world(proposals), self.tracker)
                probable = existence(tracks)
            self._check_words(tracks)
            refuses = self.video.check == "refuse" and video is not None
            check_tracks(tracks, self.tracker, refuses, "the proposals" if video is None else str(video))
            observed = None if true_scene is None else collisions_of(true_scene, tracks)
            pixels = None
            if video is not None and proposals is not None:
                pixels = VideoPixels(self.frames(video, note=unsaid), proposals, tracks)
            with stage("explaining the motion", self.progress):
                found = self.dynamics.explain(states_from_tracks(tracks, pixels), observed)
            explanation = checked_result(found, Explanation, self.dynamics, "explain")  # type: ignore[type-abstract]
        scene = scene_from_prediction(explanation.prediction, probable)
        if tracks is not None:
            doubts = _doubts(tracks) if self.video.check != "off" else ()
            scene = replace(scene, notes=distinct(tracks.notes, doubts))
        return Perception(proposals, tracks, explanation, scene)

    def simulate(
        self,
        video: VideoSource | VideoProposals | VideoTracks | Perception,
        interventions: Sequence[Intervention],
        from_frame: int = 0,
        frames: int | None = None,
    ) -> Simulation:
        """What happens in a video, and after it, with interventions: "what if the red cube were not there?".

            >>> simulation = pipeline.simulate("video.mp4", [nsdr.SetMass("blue sphere", factor=2), nsdr.Remove("red cube")])
            >>> pipeline.answer(simulation.scene, "How many collisions happen?")

        Args:
            video: a video as `perceive` takes it, a perception of it, or the result of the frame parser or the tracker.
            interventions: instances of `Remove`, `SetMass`, `SetVelocity`, `Move`, `Freeze` and `Add`, all at `from_frame`.
            from_frame: a frame of the video.
            frames: number of frames to simulate, from the start of the video on, and at least those of the video; None for
                the horizon of the world's predictive questions: 180 for a video of CLEVRER, 7/5 of its length.

        Raises:
            VideoError: see `perceive`.
            DataError: no or several objects fit the words, an intervention is impossible (says why with the numbers), or the
                backend does not simulate: networks only remove one object from frame 0.
        """
        check_changes(interventions, self.world)
        if isinstance(video, Perception):
            seen = video
        else:
            name = {VideoProposals: "proposals", VideoTracks: "tracks"}.get(type(video), "video")
            seen = self.perceive(**{name: video})  # type: ignore[arg-type]
        if seen.explanation is None:
            raise DataError("the perception has no explanation, which a simulation starts from; give the video")
        found = simulate(seen.explanation, interventions, from_frame, frames)
        return replace(found, scene=replace(found.scene, notes=distinct(seen.scene.notes, found.notes)))

    def judge(
        self,
        video: VideoSource | None = None,
        proposals: VideoProposals | None = None,
        tracks: VideoTracks | None = None,
    ) -> Judgement:
        """Judge which laws of CLEVRER's world a video breaks, which objects break them, and when.

        The tracks are explained by lawful motion (free sliding between contacts, with masses and restitutions in CLEVRER's
        range and the noise of positions measured in the video) and by motion that breaks a law. Motion that is hidden, cut by
        the image border or short gives little or no evidence.

        Args:
            video: a video file.
            proposals: proposals in the frames of a video, in place of a file.
            tracks: tracks of a video, in place of both, such as those of `nsdr.tracks_from_masks`. If objects seem too fast or
                too large, a note says so.

        Raises:
            VideoError: as in `perceive`; or too few frames were processed, their spacing is too large, or no object is seen.
        """
        if tracks is not None:
            self._check_words(tracks)
            judgement = judge_tracks(tracks)
            doubts = _doubts(tracks) if self.video.check != "off" else ()
            return replace(judgement, notes=distinct(judgement.notes, doubts))
        if proposals is not None:
            return judge_proposals(self._of_this_world(proposals), self.tracker)
        if video is None:
            raise VideoError("give a video, proposals or tracks")
        video = video_of(video)
        wrong = check_video(video, self.video, self.world).unfit
        if not wrong or self.video.check != "refuse":
            found, late = self.proposals(video)
            seen = track(found, self.tracker)
            wrong += _doubts(seen)
        if wrong and self.video.check == "refuse":
            raise VideoError(f"{video}: cannot be judged: {'; '.join(wrong)}. --force judges it all the same")
        try:
            judgement = judge_tracks(seen, found, late)
        except VideoError as e:
            raise VideoError(f"{video}: {e}") from e
        if not judgement.objects:
            raise VideoError(f"{video}: no objects found in more than {self.tracker.min_frames} frames")
        said = judgement.notes if self.video.check == "off" else distinct(judgement.notes, wrong)
        return replace(judgement, notes=said)

    def proposals(self, video: VideoSource) -> tuple[VideoProposals, NDArray[np.floating[Any]]]:
        """What is judged: proposals in all frames of a video, also after a cut, and how much later each of the (F,) frames is
        shown than its number says (frames). Kept until those of another video are asked for.

        Raises:
            VideoError: the file cannot be read or is not of CLEVRER's scene.
        """
        video = video_of(video)
        check_is_video(video)
        key = (fingerprint(inputs=self._seen(video)), *self._frame_parsing())
        if self._kept_proposals is None or self._kept_proposals[0] != key:
            late: list[float] = []
            notes: list[str] = []
            frames = clip_frames(video, self.video, beyond_cuts=True, late=late, note=notes.append, world=self.world)
            proposals = self._parsed(frames)
            proposals = replace(proposals, notes=distinct(proposals.notes, notes))
            self._kept_proposals = key, (proposals, np.array(late[: proposals.n_frames]))
        return self._kept_proposals[1]

    def _parsed(self, frames: Iterator[NDArray[np.uint8]]) -> VideoProposals:
        """What the frame parser finds; raises `DataError` where it gives something else."""
        found = self.frame_parser.parse(frames, progress=self.progress)
        parsed = checked_result(found, VideoProposals, self.frame_parser, "parse")
        self._check_words(parsed)
        return replace(parsed, world=self.world)

    def _of_this_world(self, proposals: VideoProposals) -> VideoProposals:
        """Given proposals, as the pipeline's camera sees them; a world that they name has to be the pipeline's."""
        self._check_words(proposals)
        differing = proposals.world.differences(self.world) if proposals.world != CLEVRER_WORLD else []
        if differing:
            raise DataError(
                f"the proposals are of the world {proposals.world.name}; the pipeline's world {self.world.name} has other "
                f"{', '.join(differing)}: give weights of that world, or the setting world"
            )
        return replace(proposals, world=self.world)

    def _check_words(self, found: VideoProposals | VideoTracks) -> None:
        """Raise `DataError` unless proposals or tracks have the words of the pipeline's world."""
        if found.world.vocabulary.words != self.world.vocabulary.words:
            what, theirs, ours = type(found).__name__, found.world.name, self.world.name
            raise DataError(f"the {what} have the words of the world {theirs}; the pipeline is for the world {ours}")

    def answer(
        self,
        video_or_scene: VideoSource | Scene,
        question: str = "",
        choices: Sequence[str] | None = None,
        program: ProgramSource | None = None,
        choice_programs: Sequence[ProgramSource] | None = None,
    ) -> Answer:
        """Answer a question about a video or scene.

        A choice that fits no program or not the scene has an `error` in place of an answer, and the others are judged.

        Args:
            video_or_scene: a video as `perceive` takes it, a scene from anywhere, or the path of a saved scene (`.json`).
            question: in CLEVRER's English, or a program's text; may be left out when `program` is given.
            choices: options of a multiple-choice question, likewise, or candidates for the answer of a descriptive one.
            program, choice_programs: programs to run instead of parsing the texts.

        Raises:
            VideoError: the video cannot be read.
            QuestionError: the question fits no program (names the nearest questions, for a scene about its objects), or a
                multiple-choice question has no choices.
            ProgramError, ExecutionError: a given program is malformed, or the question's program does not fit the scene.
        """
        if isinstance(video_or_scene, VideoProposals | VideoTracks):
            name = "proposals" if isinstance(video_or_scene, VideoProposals) else "tracks"
            raise DataError(f"expected a video or a scene, got {name}; ask pipeline.perceive({name}=…).scene")
        given = video_or_scene if isinstance(video_or_scene, Scene) else video_of(video_or_scene)
        if isinstance(given, Path) and given.suffix == ".json":
            given = load(given, Scene)
        if not isinstance(given, Scene):
            check_is_video(given)
        if program is None and not question.strip():
            raise QuestionError("the question is empty")
        about = (question, choices, program, choice_programs, given if isinstance(given, Scene) else None)
        parsed, parsed_choices = read_programs(self.question_parser, *about)
        if isinstance(given, Scene):
            executor = Executor(given)
        else:
            perception = self.perceive(given)
            executor = Executor(
                perception.scene, simulate=lambda change, frame: self.simulate(perception, [change], frame).events
            )
        if parsed_choices is None:
            return executor.answer(parsed, question, choices or ())
        texts = choices or [str(p) for p in parsed_choices]
        return executor.answer_choices(parsed, list(zip(texts, parsed_choices, strict=True)), question)


def _doubts(tracks: VideoTracks) -> tuple[str, ...]:
    """Notes on objects that seem too fast or of the wrong size."""
    return (*speed_notes(tracks), *size_notes(tracks))


def judge(
    video: VideoSource | None = None, proposals: VideoProposals | None = None, tracks: VideoTracks | None = None
) -> Judgement:
    """`Pipeline.judge` of the shipped pipeline, which is loaded for it. For many videos, load one pipeline."""
    return Pipeline.from_pretrained().judge(video, proposals, tracks)
