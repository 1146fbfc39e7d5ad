"""Judged videos as HTML: which laws each breaks, on a timeline and in frames with boxes around the objects."""

import html
import math
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.io.fingerprint import fingerprint
from nsdr.io.notes import unsaid
from nsdr.io.video import write_video
from nsdr.pipeline import Pipeline
from nsdr.tracking.tracker import track
from nsdr.types import LAWS, Judgement, VideoTracks, Violation
from nsdr.types.answers import percent
from nsdr.types.judgements import OF_ALL
from nsdr.validation import convert
from nsdr.visualize.html_parts import notes_html, thumbnail, video_html, write_page
from nsdr.visualize.timeline import LANE_HEIGHT, TIMELINE_STYLE, frame_x, lanes_html, seek_script

AROUND_FRAMES = 8
"""Frames from a violation to the pictures before and after it."""
PICTURE_WIDTH_PX = 360
"""Width of the pictures (pixels)."""
VIOLATIONS_STYLE = (
    TIMELINE_STYLE
    + """
.timeline .event rect.broken { fill: #d33 } .timeline .event path.broken { fill: #d33; stroke: #fff }
.violation { margin: .6em 0 } details.violation summary { cursor: pointer; font-weight: 600; color: inherit;
opacity: 1 }
.violation p { margin: .2em 0 } .violation .cards { grid-template-columns: repeat(3, 1fr) }
"""
)
"""Style sheet of judgements."""
VIDEO_CRFS = (23, 36, 51)
"""H.264 rate factors to try in turn until a video is within its limit. A clip of CLEVRER's needs the first."""
MAX_VIDEO_BYTES, MAX_VIDEO_FRAMES = 2_000_000, 500
"""Limits of the video in a report; frames of longer videos are left out evenly."""
LEGEND = (
    "<p><small>Pale bars: an object is seen. Diamonds: a violation begins; red bars: it lasts. Yellow boxes: objects that "
    "break the law; thin ones are where an object that is not seen was seen last, or is seen next.</small>"
)


@dataclass(frozen=True)
class JudgedVideo:
    """A row of a report.

    Attributes:
        path: the video.
        judgement: of it; None if it was refused.
        shown: HTML of the violations, or the text of the reason for which it was refused.
    """

    path: str
    judgement: Judgement | None
    shown: str = ""


def judgement_of_row(row: Mapping[str, Any]) -> Judgement:
    """The judgement in a row of a report of `nsdr judge`, without an `error`."""
    return convert({f.name: row[f.name] for f in fields(Judgement)}, Judgement)


def judged_video(pipeline: Pipeline, row: Mapping[str, Any]) -> JudgedVideo:
    """A row of a report of `nsdr judge`, with the video and pictures if it breaks a law.

    Raises:
        DataError: PyAV is missing.
        VideoError: see `Pipeline.proposals`.
    """
    path = str(row["video"])
    if "error" in row:
        return JudgedVideo(path, None, row["error"])
    judgement = judgement_of_row(row)
    if not judgement.violations:
        return JudgedVideo(path, judgement)
    frames = np.stack(list(pipeline.frames(path, beyond_cuts=True, note=unsaid)))  # the judgement has the notes
    tracks = track(pipeline.proposals(path)[0], pipeline.tracker)
    name = f"video-{fingerprint(inputs=[path])}"
    player = f"<div id={name}>{_player(frames, tracks.world.timeline.fps)}</div>"
    return JudgedVideo(path, judgement, player + judgement_html(judgement, tracks, frames, f"#{name} video"))


def _player(frames: NDArray[np.uint8], fps: int) -> str:
    """The video at its speed, within `MAX_VIDEO_BYTES`; "" if it is too large even at the lowest quality."""
    step = math.ceil(len(frames) / MAX_VIDEO_FRAMES)
    for crf in VIDEO_CRFS:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "video.mp4"
            write_video(file, frames[::step], Fraction(fps, step), crf)
            if file.stat().st_size <= MAX_VIDEO_BYTES:
                return video_html(file.read_bytes())
    return ""


def write_judgements(path: str | Path, videos: Sequence[JudgedVideo]) -> None:
    """Write an HTML page about judged videos, the one that most probably breaks a law first; it needs no other file.

    Args:
        path: HTML file to write.
        videos: in any order.
    """
    judged = [(v, v.judgement) for v in videos if v.judgement is not None]
    judged.sort(key=lambda row: -row[1].probability)
    broken = [(v, j) for v, j in judged if j.violations]
    lawful = [(v, j) for v, j in judged if not j.violations]
    refused = [v for v in videos if v.judgement is None]
    laws = Counter(law for _, j in broken for law in {v.law for v in j.violations})
    kinds = ", ".join(f"{law} {n}" for law, n in laws.most_common())
    title = f"{len(broken)} of {len(judged)} judged videos break a law"
    body = [f"<h1>{title}</h1>", f"<p>{kinds}</p>" * bool(kinds)]
    body += [f"<h2>{html.escape(v.path)}</h2>{v.shown}" for v, _ in broken]
    for head, rows in (
        ("No law broken", [f"<td>{html.escape(v.path)}<td>{_verdict(j)}{notes_html(j.notes)}" for v, j in lawful]),
        ("Not judged", [f"<td>{html.escape(v.path)}<td>{html.escape(v.shown)}" for v in refused]),
    ):
        if rows:
            body.append(f"<h2>{head}</h2><table><tr>{'<tr>'.join(rows)}</table>")
    write_page(path, title, "".join(body), VIOLATIONS_STYLE)


def judgement_html(judgement: Judgement, tracks: VideoTracks, frames: NDArray[np.uint8], video: str = "") -> str:
    """What a video breaks: a timeline of the violations, and of each the law, and frames before, at and after it.

    A thin box is where an object that is not seen in a frame was seen last, or is seen next.

    Args:
        judgement: of the video.
        tracks: of the proposals that were judged.
        frames: (T, height, width, 3) uint8 RGB of it.
        video: CSS selector of the page's video, which a click on a violation moves to its frame, and only the most probable
            violation is unfolded; "" for none, and all are.
    """
    marks, details = [], []
    most = max((v.probability for v in judgement.violations), default=0.0)
    for number, v in enumerate(judgement.violations):
        seek = seek_script(v.frame, video, tracks.world.timeline.fps) if video else ""
        marks.append(_mark(v, number, judgement, seek))
        text = html.escape(judgement.describe(v))
        images = "".join(_picture(frames, f, tracks, v) for f in _frames_of(v, len(frames)))
        opened = " open" if not video or v.probability == most else ""
        details.append(
            f'<details class=violation data-violation={number}{opened}><summary onclick="{seek}">{text}</summary>'
            f"<p>The law: {LAWS[v.law]}<div class=cards>{images}</div></details>"
        )
    visible = np.zeros((len(judgement.objects), judgement.n_frames), bool)
    for t in tracks.tracks:
        visible[t.object.id, t.frame_index] = True
    of_video = judgement.objects, visible, None, judgement.n_frames
    lanes = lanes_html(*of_video, "".join(marks), "violations", tracks.world)
    shown = f"<div class=timeline>{lanes}</div>{LEGEND}{''.join(details)}" if judgement.violations else ""
    return f"<div class=judged><p>{_verdict(judgement)}</p>{notes_html(judgement.notes)}{shown}</div>"


def _verdict(judgement: Judgement) -> str:
    """For example "3 objects in 128 frames. Probability that a law is broken: 98 %"."""
    seen = f"{len(judgement.objects)} objects in {judgement.n_frames} frames"
    return html.escape(f"{seen}. Probability that a law is broken: {percent(judgement.probability)}")


def _mark(v: Violation, number: int, judgement: Judgement, seek: str) -> str:
    """A diamond in the lane of each object at the first frame, and a bar as long as the violation lasts."""
    x, end = (frame_x(f, judgement.n_frames) for f in (v.frame, v.end))
    lanes = [LANE_HEIGHT * i + LANE_HEIGHT / 2 for i in v.objects]
    top, bottom = min(lanes), max(lanes)
    shape = f"<line x1={x} x2={x} y1={top} y2={bottom} />"
    for y in lanes:
        shape += f"<rect class=broken x={x} y={y - 1.5} width={round(end - x, 1)} height=3 />"
        shape += f"<path class=broken d='M{x} {y - 7}l6 7l-6 7l-6 -7z' />"
    shape += f"<rect class=hit x={x - 7} y={top - 9} width=14 height={bottom - top + 18} />"
    title = html.escape(judgement.describe(v))
    unfold = f"this.closest('.judged').querySelector('[data-violation=&quot;{number}&quot;]').open=true;{seek}"
    return f'<g class=event tabindex=0 role=button onclick="{unfold}"><title>{title}</title>{shape}</g>'


def _frames_of(v: Violation, n_frames: int) -> list[int]:
    """Frames before, at and after a violation; of time that runs backwards, the video's first, middle and last one."""
    if v.law == "arrow":
        return sorted({0, n_frames // 2, n_frames - 1})
    return sorted({max(v.frame - AROUND_FRAMES, 0), v.frame, min(v.frame + AROUND_FRAMES, n_frames - 1)})


def _picture(frames: NDArray[np.uint8], frame: int, tracks: VideoTracks, v: Violation) -> str:
    boxed = () if v.law in OF_ALL else v.objects
    source = thumbnail(frames[frame], frame, tracks, boxed, PICTURE_WIDTH_PX)
    return f"<div><img alt='frame {frame}' src='{source}'><b>frame {frame}</b></div>"
