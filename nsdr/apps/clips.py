"""Clips that several visitors ask about at the same time, over one pipeline."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.apps import menus
from nsdr.errors import DataError, QuestionError, VideoError
from nsdr.io.decoding import check_is_video
from nsdr.io.fingerprint import fingerprint
from nsdr.io.notes import distinct, unsaid
from nsdr.io.video import video_seconds
from nsdr.pipeline import Perception, Pipeline
from nsdr.tracking.tracker import track
from nsdr.types import Answer, Judgement, Scene, Simulation, VideoTracks
from nsdr.types.interventions import Intervention
from nsdr.visualize.html_parts import jpeg

KEPT_CLIPS = 64
"""Clips that are kept: those that were looked at or asked about last."""
Progress = Callable[[float, str], Any]
"""A function that is called with the share that is done (0-1) and what is being done."""


@dataclass(frozen=True, eq=False)
class Clip:
    """A clip that was looked at.

    Attributes:
        key: it is found by this text while it is kept.
        path: its video file, which may be deleted meanwhile.
        perception: what was found in it.
        jpegs: its frames as JPEG files, which takes a hundredth of the memory.
    """

    key: str
    path: Path
    perception: Perception
    jpegs: tuple[bytes, ...]

    def frames(self) -> NDArray[np.uint8]:
        """(T, height, width, 3) uint8 RGB."""
        images = [cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_COLOR) for file in self.jpegs]
        return np.stack(images)[..., ::-1]  # type: ignore[arg-type,return-value]


class Clips:
    """One pipeline for several threads, with the clips that were perceived last.

    One thread at a time perceives or simulates, and one answers; looking up what is known waits for nobody.

    Args:
        pipeline: does the work; nothing else may use it.
        max_seconds: length of the longest clip that is taken (seconds).
    """

    def __init__(self, pipeline: Pipeline, max_seconds: float) -> None:
        self.pipeline, self.max_seconds = pipeline, max_seconds
        self._working, self._asking, self._keeping = threading.Lock(), threading.Lock(), threading.Lock()
        self._kept: dict[str, Clip] = {}

    def watch(self, path: str | Path, progress: Progress | None = None) -> Clip:
        """Perceive a video file, or return at once what is known of one with the same content.

        Raises:
            VideoError: it is too long, or `Pipeline.perceive` refuses it.
        """
        path = Path(path)
        check_is_video(path)
        key = fingerprint(inputs=[path])
        if (known := self._known(key)) is not None:
            return known
        seconds = video_seconds(path, self.pipeline.video.fps)
        if seconds > self.max_seconds:
            raise self._too_long(path, seconds)
        with self._working:
            if (known := self._known(key)) is not None:  # another visitor's, meanwhile
                return known
            clip = self._perceived(key, path, seconds, progress or (lambda share, text: None))
            with self._keeping:
                while len(self._kept) >= KEPT_CLIPS:
                    del self._kept[next(iter(self._kept))]
                self._kept[key] = clip
            return clip

    def kept(self, key: str) -> Clip:
        """A clip that was looked at, by its key. This waits for no work.

        Raises:
            DataError: there is none, or it is no longer kept.
        """
        if (clip := self._known(key)) is None:
            raise DataError("there is no clip yet, or it is no longer kept; pick or upload one")
        return clip

    def _known(self, key: str) -> Clip | None:
        """A kept clip, which is then forgotten last; None if there is none."""
        with self._keeping:
            if (clip := self._kept.pop(key, None)) is not None:
                self._kept[key] = clip
            return clip

    def answer(self, clip: Clip, question: str, choices: Sequence[str] = ()) -> Answer:
        """`Pipeline.answer` about a clip, with its errors. A question that needs choices and has none gets some."""
        assert clip.perception.explanation is not None
        scene = replace(clip.perception.scene, dynamics=clip.perception.explanation.prediction)
        with self._asking:
            return self.pipeline.answer(scene, question, list(choices) or self._choices(scene, question) or None)

    def _choices(self, scene: Scene, question: str) -> list[str]:
        """Choices for a multiple-choice question; none for a descriptive one, and for what is none of both."""
        parser = self.pipeline.question_parser
        with suppress(QuestionError):
            parser.parse(question, "descriptive")
            return []
        with suppress(QuestionError):
            return menus.choices(question, parser.parse(question, "multiple_choice").tokens, scene)
        return []

    def simulate(self, clip: Clip, interventions: Sequence[Intervention], from_frame: int) -> Simulation:
        """`Pipeline.simulate` of a clip, with its errors."""
        with self._working:
            return self.pipeline.simulate(clip.perception, interventions, from_frame)

    def judge(self, clip: Clip) -> tuple[Judgement, VideoTracks, NDArray[np.uint8]]:
        """Which laws a clip breaks, with the tracks and the frames (T, height, width, 3) uint8 RGB in which they are shown.

        Frames after a cut are judged, too, and are looked at for that.

        Raises:
            VideoError: see `Pipeline.judge`; or the clip's file has been deleted.
        """
        path = clip.path
        with self._working:
            judgement, tracker = self.pipeline.judge(path), self.pipeline.tracker
            frames = np.stack(list(self.pipeline.frames(path, beyond_cuts=True, note=unsaid)))
            return judgement, track(self.pipeline.proposals(path)[0], tracker), frames

    def _too_long(self, path: Path, seconds: float) -> VideoError:
        most = f"clips of up to {self.max_seconds:g} s are taken, so cut it"
        return VideoError(f"{path}: lasts {seconds:.0f} s; {most}")

    def _perceived(self, key: str, path: Path, seconds: float, progress: Progress) -> Clip:
        fps, jpegs = self.pipeline.world.timeline.fps, list[bytes]()
        notes: list[str] = []

        def frames() -> Iterator[NDArray[np.uint8]]:
            for index, frame in enumerate(self.pipeline.frames(path, note=notes.append)):
                if index > 1 + self.max_seconds * fps:
                    raise self._too_long(path, index / fps)  # the file's header says less
                progress(min(index / max(seconds * fps, 1), 1.0), f"finding objects: frame {index}")
                jpegs.append(jpeg(frame))
                yield frame

        proposals = self.pipeline.frame_parser.parse(frames())
        progress(1.0, "following objects and fitting their motion")
        perception = self.pipeline.perceive(path, proposals=replace(proposals, notes=distinct(proposals.notes, notes)))
        return Clip(key, path, perception, tuple(jpegs))
