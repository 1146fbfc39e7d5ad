"""The page to ask on: see what was found in a clip, ask, try interventions, and judge. Made with Gradio.

Everything stays on this machine: no analytics, no fonts or scripts from outside (a Content-Security-Policy forbids them), and
uploads are deleted after an hour. `nsdr.apps.guard` limits what visitors may send.
"""

import logging
import os
import secrets
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from nsdr.apps import menus
from nsdr.apps.clips import Clip, Clips
from nsdr.apps.comparison import write_comparison
from nsdr.apps.guard import Guard
from nsdr.apps.panels import STYLE, answer_panel, difference_panel, notes_panel, refusal_panel
from nsdr.apps.strangers import MAX_CHOICES_CHARACTERS, MAX_QUESTION_CHARACTERS, check_asked, without_folders
from nsdr.errors import DataError, MachineError, NsdrError, QuestionError
from nsdr.io.notes import unsaid
from nsdr.io.video import read_frames
from nsdr.types.interventions import Intervention
from nsdr.visualize.annotate import write_annotated_video, write_image
from nsdr.visualize.timeline import timeline_html
from nsdr.visualize.violations import judgement_html

log = logging.getLogger(__name__)

QUEUE = 20
"""How many clips and simulations may wait. Visitors with more are asked to come back. Questions do not wait for them."""
THREADS = 8
"""Threads for visitors' work. Clips and simulations take one at a time. Replies to requests have their own."""
CLEANUP_SECONDS = (60, 3600)
"""How often old uploads are deleted, and their age at that time (seconds)."""
KEPT_VIDEOS = 30
"""Videos that are kept on the disk, besides those of clips."""
THUMBNAILS = 60
"""Clips to pick from; of a folder with more, the first ones."""
PRESET = "veryfast"
"""The preset of the videos, see `nsdr.io.video.write_video`: visitors wait for them."""
INTRODUCTION = """# Ask a video
See what was found in a clip of colliding objects, ask, change something and see what happens, or see which laws it breaks."""


def serve(
    clips: Clips,
    files: Mapping[str, Path],
    started: Callable[[str], None],
    host: str = "127.0.0.1",
    port: int = 7860,
    max_megabytes: int = 50,
) -> None:
    """Run the page until the process is interrupted.

    Args:
        clips: does the work.
        files: clips to pick from, by the names that visitors see. The page opens with the first one, which is looked at before.
        started: called with the page's address when it is there.
        host: address to listen on.
        port: TCP port.
        max_megabytes: size of the largest upload.

    Raises:
        DataError: the address cannot be listened on.
    """
    with tempfile.TemporaryDirectory(prefix="nsdr-page-") as folder:
        videos, uploads = Path(folder) / "videos", Path(folder) / "uploads"
        videos.mkdir()
        os.environ |= {"GRADIO_ANALYTICS_ENABLED": "False", "GRADIO_TEMP_DIR": str(uploads)}
        import gradio as gr

        gr.set_static_paths(videos)  # sent as they are, and not copied
        visited = _Page(gr, clips, files, videos, uploads)
        visited.look_at_first()
        page = visited.build()
        page.queue(max_size=QUEUE, api_open=False)
        megabytes = max_megabytes * 10**6
        guard = {"uploads": uploads, "max_file_bytes": megabytes, "max_bytes": (QUEUE + 1) * megabytes}
        try:
            _, address, _ = page.launch(
                server_name=host,
                server_port=port,
                max_file_size=f"{max_megabytes}mb",
                share=False,
                prevent_thread_lock=True,
                quiet=True,
                ssr_mode=False,
                enable_monitoring=False,
                footer_links=[],
                theme=gr.themes.Default(font=["system-ui", "sans-serif"], font_mono=["ui-monospace", "monospace"]),
                css=STYLE,
                max_threads=THREADS,
                app_kwargs={"middleware": [(Guard, (), guard)]},
            )
        except OSError as e:
            where = f"--host {host} --port {port}"
            raise DataError(f"{where}: cannot be listened on, or is in use; choose another port") from e
        try:
            started(address)
            threading.Event().wait()
        finally:
            page.close(verbose=False)


class _Page:
    """The page's components and what they do. A visitor's state is the key of the clip."""

    def __init__(self, gr: Any, clips: Clips, files: Mapping[str, Path], folder: Path, uploads: Path) -> None:
        self.gr, self.clips, self.folder, self.uploads = gr, clips, folder, uploads
        self.files = dict(islice(files.items(), THUMBNAILS))
        self.left_out = len(files) - len(self.files)
        self.shown: WeakKeyDictionary[Clip, tuple[Path, str]] = WeakKeyDictionary()
        self.judged: WeakKeyDictionary[Clip, str] = WeakKeyDictionary()
        self.first: Clip | None = None
        self.first_refused = ""

    def look_at_first(self) -> None:
        """Look at the first clip, which every visitor sees first; if it is refused, they see why."""
        try:
            self.first = self.clips.watch(next(iter(self.files.values())))
            self._drawn(self.first)
        except (NsdrError, MachineError) as e:
            self.first_refused = _refusal(e)

    def build(self) -> Any:
        gr = self.gr
        with gr.Blocks(title="nsdr", analytics_enabled=False, fill_width=True, delete_cache=CLEANUP_SECONDS) as page:
            gr.Markdown(INTRODUCTION + f" {self.left_out} more clips of the folder are left out." * bool(self.left_out))
            self.clip = gr.State("")
            with gr.Row(elem_id="clips"):
                self.picks = [gr.Button(name, icon=self._thumbnail(path)) for name, path in self.files.items()]
                self.upload = gr.UploadButton(
                    "Upload a clip", file_types=["video", ".gif", ".webp"], elem_id="upload", variant="secondary"
                )
            self.refused = gr.HTML(elem_id="refused")
            with gr.Row(elem_id="columns"):
                with gr.Column(scale=6, elem_id="seen"):
                    self.video = gr.Video(
                        label="What was found", show_label=False, interactive=False, buttons=[], elem_id="tracks"
                    )
                    self.notes = gr.Markdown(elem_id="notes")
                    self.timeline = gr.HTML(elem_id="timeline")
                with gr.Column(scale=5, elem_id="asking"):
                    with gr.Tab("Ask"):
                        self._ask_tab()
                    with gr.Tab("What if"):
                        self._what_if_tab()
                    with gr.Tab("Laws") as self.laws_tab:
                        self.laws = gr.HTML(elem_id="laws")
            self._connect(page)
        return page

    def _ask_tab(self) -> None:
        gr = self.gr
        with gr.Row(equal_height=True):
            self.question = gr.Textbox(
                label="Question", max_length=MAX_QUESTION_CHARACTERS, elem_id="question", scale=4, min_width=200
            )
            self.ask = gr.Button("Ask", variant="primary", elem_id="ask", scale=1, min_width=80)
        self.answer = gr.HTML(elem_id="answer")
        self.suggested = [gr.Button(visible=False, size="sm", elem_id=f"suggested-{i}") for i in range(menus.QUESTIONS)]
        with gr.Accordion("Choices of your own, one a line", open=False):
            self.choices = gr.Textbox(
                label="Choices (a multiple-choice question without any gets some)",
                lines=2,
                max_lines=10,
                max_length=MAX_CHOICES_CHARACTERS,
                elem_id="choices",
            )

    def _what_if_tab(self) -> None:
        gr, last = self.gr, self.clips.pipeline.world.timeline.frames - 1
        with gr.Row():
            self.change = gr.Dropdown(list(menus.KINDS), label="Change", elem_id="change")
            self.object = gr.Dropdown([], label="Object", elem_id="object")
        self.sliders = [gr.Slider(visible=False, elem_id=f"slider-{i}") for i in range(menus.MAX_SLIDERS)]
        self.from_frame = gr.Slider(0, last, 0, step=1, label="From frame", elem_id="from-frame")
        self.simulate = gr.Button("Simulate", variant="primary", elem_id="simulate")
        self.difference = gr.HTML(elem_id="difference")
        self.compared = gr.Video(
            label="Original and changed world, from the camera and from above",
            interactive=False,
            buttons=[],
            autoplay=True,
            elem_id="compared",
        )

    def _connect(self, page: Any) -> None:
        bar = self.gr.Progress()

        def picked(name: str, progress: Any = bar) -> Any:
            return self._told(self.refused, lambda: self._watch(self.files[name], progress))

        def uploaded(path: str | None, progress: Any = bar) -> Any:
            return self._told(self.refused, lambda: self._watch(self._upload_of(path), progress))

        def simulated(
            key: str, kind: str, name: str, frame: float, a: float, b: float, c: float, d: float, progress: Any = bar
        ) -> Any:
            try:
                yield from self._simulate(key, menus.intervention(kind, name, [a, b, c, d]), frame, progress)
            except Exception as e:
                yield {self.difference: _refusal(e), self.compared: None}

        def judged(key: str, progress: Any = bar) -> Any:
            return self._told(self.laws, lambda: {self.laws: self._judge(self._clip(key), progress)})

        private = {"api_visibility": "private"}
        work = {**private, "concurrency_id": "work", "concurrency_limit": 1}
        quick = {**private, "queue": False}  # so it does not wait for the other work
        silent = {**quick, "show_progress": "hidden"}
        change_parts = [self.object, *self.sliders, self.difference]
        answered = [self.answer, *self.suggested]
        found = [self.clip, self.refused, self.video, self.notes, self.timeline, self.question, self.choices, *answered]
        found += [self.compared, self.from_frame, self.change, *change_parts, self.laws]
        page.load(self._opened, None, found, **silent)
        looks = [
            button.click(partial(picked, name), None, found, show_progress_on=self.video, **work)
            for name, button in zip(self.files, self.picks, strict=True)
        ]
        looks.append(self.upload.upload(uploaded, self.upload, found, show_progress_on=self.video, **work))
        for look in looks:
            look.then(judged, self.clip, self.laws, **work)
        self.laws_tab.select(judged, self.clip, self.laws, **work)

        asked = [self.clip, self.question, self.choices]
        self.ask.click(self._ask, asked, answered, **quick)
        self.question.submit(self._ask, asked, answered, **quick)
        for button in self.suggested:
            pressed = button.click(lambda text: (text, ""), button, [self.question, self.choices], **silent)
            pressed.then(self._ask, asked, answered, **quick)
        changed = lambda key, kind: self._told(self.difference, lambda: self._change(self._clip(key), kind))  # noqa: E731
        self.change.input(changed, [self.clip, self.change], change_parts, **silent)
        given = [self.clip, self.change, self.object, self.from_frame, *self.sliders]
        self.simulate.click(simulated, given, [self.difference, self.compared], show_progress_on=self.compared, **work)

    def _told(self, place: Any, work: Callable[[], dict[Any, Any]]) -> dict[Any, Any]:
        """New values of components, or the reason why there are none at a place of the page."""
        try:
            return work()
        except Exception as e:
            return {place: _refusal(e)}

    def _upload_of(self, path: str | None) -> Path:
        """A visitor's upload. A request may name another file that Gradio serves, such as another visitor's video."""
        if not path or not Path(path).resolve().is_relative_to(self.uploads.resolve()):
            raise DataError("no file was uploaded")
        return Path(path)

    def _clip(self, key: str) -> Clip:
        """The clip of a visitor's state. The first one is never forgotten."""
        return self.first if self.first is not None and key == self.first.key else self.clips.kept(key)

    def _thumbnail(self, path: Path) -> str | None:
        """A picture of a clip; None for a file that cannot be read, which is refused when it is picked."""
        picture = self.folder / f"{secrets.token_hex(16)}.jpg"
        with suppress(NsdrError):
            write_image(picture, next(read_frames(path, note=unsaid, world=self.clips.pipeline.world)))
            return str(picture)
        return None

    def _opened(self) -> dict[Any, Any]:
        """What a visitor sees first."""
        return {self.refused: self.first_refused} if self.first is None else self._found(self.first)

    def _watch(self, path: Path, progress: Callable[..., Any]) -> dict[Any, Any]:
        clip = self.clips.watch(path, lambda share, text: progress(share, desc=text))
        progress(1.0, desc="drawing what was found")
        return self._found(clip)

    def _found(self, clip: Clip) -> dict[Any, Any]:
        """New values of everything that depends on the clip."""
        video, timeline = self._drawn(clip)
        change = menus.KINDS[0]
        return {
            **dict.fromkeys([self.refused, self.question, self.choices, self.answer, self.difference, self.laws], ""),
            self.clip: clip.key,
            self.video: str(video),
            self.notes: notes_panel(clip),
            self.timeline: timeline,
            self.compared: None,
            **self._suggestions(menus.questions(clip.perception.scene)),
            self.change: change,
            **self._change(clip, change),
            self.from_frame: self.gr.update(maximum=clip.perception.scene.n_frames - 1, value=0),
        }

    def _drawn(self, clip: Clip) -> tuple[Path, str]:
        """The annotated video and the timeline."""
        if clip not in self.shown:
            p, video, frames = clip.perception, self._new_file(), clip.frames()
            assert p.tracks is not None
            write_annotated_video(video, frames, p.proposals, p.tracks, p.scene, PRESET)
            self.shown[clip] = (video, timeline_html(p, frames, "#tracks video"))
        return self.shown[clip]

    def _suggestions(self, texts: Sequence[str]) -> dict[Any, Any]:
        """The buttons with questions."""
        texts, update = list(texts)[: len(self.suggested)], self.gr.update
        hidden = [update(visible=False)] * (len(self.suggested) - len(texts))
        return dict(zip(self.suggested, [update(value=text, visible=True) for text in texts] + hidden, strict=True))

    def _judge(self, clip: Clip, progress: Callable[..., Any]) -> str:
        """Which laws a clip breaks; raises why it is not judged."""
        if clip not in self.judged:
            progress(0.0, desc="looking for broken laws")
            judgement, tracks, frames = self.clips.judge(clip)
            scene = clip.perception.scene
            judgement = replace(judgement, notes=tuple(n for n in judgement.notes if n not in scene.notes))
            video = "#tracks video" if len(frames) == scene.n_frames else ""
            self.judged[clip] = f"<div class=panel>{judgement_html(judgement, tracks, frames, video)}</div>"
        return self.judged[clip]

    def _ask(self, key: str, question: str | None, choices: str | None) -> dict[Any, Any]:
        """The answer, or why there is none with the nearest questions."""
        nearest: Sequence[str] = ()
        try:
            clip = self._clip(key)
            texts = [line.strip() for line in (choices or "").splitlines() if line.strip()]
            check_asked(question or "", texts)
            said = answer_panel(self.clips.answer(clip, question or "", texts), clip)
        except Exception as e:
            said = _refusal(e)
            nearest = e.nearest if isinstance(e, QuestionError) else ()
        with suppress(DataError):  # there is no clip
            nearest = nearest or menus.questions(self._clip(key).perception.scene)
        return {self.answer: said, **self._suggestions(nearest)}

    def _change(self, clip: Clip, kind: str | None) -> dict[Any, Any]:
        """The objects and sliders of a kind of change."""
        if kind not in menus.KINDS:
            raise DataError("no change is chosen")
        names = menus.changed_objects(kind, clip.perception.scene)
        updates = {self.object: self.gr.update(choices=names, value=next(iter(names), None))}
        sliders = menus.changes(clip.perception.scene.world)[kind].sliders
        for part, slider in zip(self.sliders, sliders, strict=False):
            numbers = {"minimum": slider.low, "maximum": slider.high, "step": slider.step, "value": slider.start}
            updates[part] = self.gr.update(label=slider.label, visible=True, **numbers)
        return updates | {part: self.gr.update(visible=False) for part in self.sliders[len(sliders) :]}

    def _simulate(
        self, key: str, change: Intervention, frame: float, progress: Callable[..., Any]
    ) -> Iterator[dict[Any, Any]]:
        """What differs, and then a video of it."""
        clip = self._clip(key)
        progress(0.0, desc="simulating")
        simulation = self.clips.simulate(clip, [change], int(frame))
        yield {self.difference: difference_panel(simulation, clip), self.compared: None}
        video = self._new_file()

        def drawing(done: int, total: int) -> None:
            progress(done / total, desc=f"drawing frame {done}")

        write_comparison(video, list(clip.frames()), simulation, True, drawing)
        yield {self.compared: str(video)}

    def _new_file(self) -> Path:
        """A file for a video, whose name no visitor can guess; the oldest ones are deleted."""
        files = sorted(self.folder.glob("*.mp4"), key=lambda file: file.stat().st_mtime)
        for old in files[: max(len(files) - KEPT_VIDEOS, 0)]:
            if all(old != video for video, _ in self.shown.values()):
                old.unlink()
        return self.folder / f"{secrets.token_hex(16)}.mp4"


def _reason(error: Exception) -> str:
    """What a visitor reads about an error. Those of the program's own are only logged in full."""
    if isinstance(error, NsdrError | MachineError):
        return without_folders(error.reason if isinstance(error, QuestionError) else str(error))
    log.error("a visitor's request failed", exc_info=error)
    if isinstance(error, OSError):
        return f"The server cannot do that now: {error.strerror}. Try again in a few minutes."
    return "That failed by a bug in nsdr; the server's output says where."


def _refusal(error: Exception) -> str:
    return refusal_panel(_reason(error))
