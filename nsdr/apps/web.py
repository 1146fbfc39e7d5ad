"""The page to ask on: pick or drop a clip, see what was found, ask, try interventions, and judge. Made with Gradio.

Everything stays on this machine: no analytics, no fonts or scripts from outside (a Content-Security-Policy forbids them), and
uploads are deleted after an hour. `nsdr.apps.guard` limits what visitors may send.
"""

import html
import logging
import os
import secrets
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from nsdr.apps import menus
from nsdr.apps.clips import Clip, Clips
from nsdr.apps.comparison import write_comparison
from nsdr.apps.guard import Guard
from nsdr.apps.panels import STYLE, answer_panel, difference_panel, notes_panel
from nsdr.apps.strangers import MAX_CHOICES_CHARACTERS, MAX_QUESTION_CHARACTERS, check_asked, without_folders
from nsdr.errors import DataError, MachineError, NsdrError, VideoError
from nsdr.types.interventions import Intervention
from nsdr.visualize.annotate import write_annotated_video
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
ERROR_SECONDS = 20
"""How long an error is shown, unless the visitor closes it (seconds)."""
DROP_PX = 120
"""Height of the place where videos are dropped (pixels)."""
EXAMPLES = 5
"""Buttons with questions about the clip."""
PRESET = "veryfast"
"""The preset of the videos, see `nsdr.io.video.write_video`: visitors wait for them."""
INTRODUCTION = """# Ask a video
Pick or upload a clip of colliding objects, look at what was found in it, then ask, change something and see what happens, or
see which laws it breaks."""


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
        files: clips to pick from, by the names that visitors see.
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
        page = _Page(gr, clips, files, videos, uploads).build()
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
        self.gr, self.clips, self.files, self.folder, self.uploads = gr, clips, files, folder, uploads
        self.shown: WeakKeyDictionary[Clip, tuple[Path, str]] = WeakKeyDictionary()

    def build(self) -> Any:
        gr = self.gr
        with gr.Blocks(title="nsdr", analytics_enabled=False, fill_width=True, delete_cache=CLEANUP_SECONDS) as page:
            gr.Markdown(INTRODUCTION)
            self.clip = gr.State("")
            with gr.Row():
                with gr.Column(scale=6):
                    self._clip_column()
                with gr.Column(scale=5):
                    with gr.Tab("Ask"):
                        self._ask_tab()
                    with gr.Tab("What if"):
                        self._what_if_tab()
                    with gr.Tab("Laws"):
                        self.drop = gr.File(label="Video", file_types=["video"], height=DROP_PX, elem_id="drop")
                        self.laws = gr.HTML(elem_id="laws")
            self._connect()
        return page

    def _clip_column(self) -> None:
        gr = self.gr
        with gr.Row(equal_height=True):
            self.pick = gr.Dropdown(list(self.files), value=None, label="Clip", elem_id="pick", scale=3)
            self.upload = gr.UploadButton(
                "Upload a clip", file_types=["video", ".gif", ".webp"], elem_id="upload", scale=1
            )
        self.video = gr.Video(label="What was found", interactive=False, buttons=[], elem_id="tracks")
        self.notes = gr.Markdown(elem_id="notes")
        self.timeline = gr.HTML(elem_id="timeline")

    def _ask_tab(self) -> None:
        gr = self.gr
        with gr.Group():
            hint = "How many collisions happen?"
            self.question = gr.Textbox(
                label="Question", placeholder=hint, max_length=MAX_QUESTION_CHARACTERS, elem_id="question"
            )
            self.choices = gr.Textbox(
                label="Choices, one a line (of questions such as: what caused …, what happens next, what if …)",
                lines=2,
                max_lines=10,
                max_length=MAX_CHOICES_CHARACTERS,
                elem_id="choices",
            )
        self.ask = gr.Button("Ask", variant="primary", elem_id="ask")
        self.buttons = [gr.Button(visible=False, size="sm", elem_id=f"example-{i}") for i in range(EXAMPLES)]
        self.answer = gr.HTML(elem_id="answer")

    def _what_if_tab(self) -> None:
        gr = self.gr
        with gr.Row():
            self.change = gr.Dropdown(list(menus.CHANGES), label="Change", elem_id="change")
            self.object = gr.Dropdown([], label="Object", elem_id="object")
        self.sliders = [gr.Slider(visible=False, elem_id=f"slider-{i}") for i in range(menus.MAX_SLIDERS)]
        self.from_frame = gr.Slider(0, 127, 0, step=1, label="From frame", elem_id="from-frame")
        self.simulate = gr.Button("Simulate", variant="primary", elem_id="simulate")
        self.compared = gr.Video(
            label="Original and changed world, from the camera and from above",
            interactive=False,
            buttons=[],
            autoplay=True,
            elem_id="compared",
        )
        self.difference = gr.HTML(elem_id="difference")

    def _connect(self) -> None:
        told = self._told()
        bar = self.gr.Progress()

        def picked(name: str | None, progress: Any = bar) -> Any:
            with self._told():
                if name is None or name not in self.files:
                    raise DataError("no clip is picked")
                yield from self._looked_at(self.files[name], progress)

        def uploaded(path: str | None, progress: Any = bar) -> Any:
            with self._told():
                yield from self._looked_at(self._upload_of(path), progress)

        def simulated(
            key: str, kind: str, name: str, frame: float, a: float, b: float, c: float, d: float, progress: Any = bar
        ) -> Any:
            with self._told():
                return self._simulate(key, menus.intervention(kind, name, [a, b, c, d]), frame, progress)

        private = {"api_visibility": "private"}
        work = {**private, "concurrency_id": "work", "concurrency_limit": 1}
        quick = {**private, "queue": False}  # so it does not wait for the other work
        silent = {**quick, "show_progress": "hidden"}
        change_parts = [self.object, *self.sliders]
        found = [self.clip, self.video, self.notes, self.timeline, self.answer, self.compared, self.difference]
        found += [*self.buttons, self.from_frame, self.change, *change_parts, self.laws]
        # Of Gradio's events, only "change" comes with the mouse and the keyboard alike, and once.
        some = self.pick.change(self._some, self.pick, None, **silent)
        some.success(picked, self.pick, found, show_progress_on=self.video, **work)
        for place in (self.upload, self.drop):
            looked = place.upload(uploaded, place, found, show_progress_on=self.video, **work)
            looked.success(lambda: None, None, self.pick, **silent)  # so that the same clip can be picked again
            looked.then(lambda: None, None, self.drop, **silent)  # makes room for the next one

        asked = [self.clip, self.question, self.choices]
        self.ask.click(self._ask, asked, self.answer, **quick)
        self.question.submit(self._ask, asked, self.answer, **quick)
        for index, button in enumerate(self.buttons):
            example = told(partial(self._example, index))
            filled = button.click(example, self.clip, [self.question, self.choices], **silent)
            filled.then(self._ask, asked, self.answer, **quick)
        self.change.input(told(self._change), [self.clip, self.change], change_parts, **silent)
        given = [self.clip, self.change, self.object, self.from_frame, *self.sliders]
        outputs = [self.difference, self.compared]
        changed = self.simulate.click(simulated, given, outputs, show_progress_on=self.compared, **work)
        changed.failure(lambda: ("", None), None, outputs, **silent)

    def _some(self, name: str | None) -> None:
        """End a chain of events silently where nothing is picked any more."""
        if name is None:
            raise self.gr.Error("no clip is picked", visible=False, print_exception=False)

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Show a visitor the errors within as one line. Gradio does so for work of its queue only."""
        try:
            yield
        except Exception as e:
            raise self.gr.Error(_reason(e), print_exception=False, duration=ERROR_SECONDS) from e

    def _upload_of(self, path: str | None) -> Path:
        """A visitor's upload. A request may name another file that Gradio serves, such as another visitor's video."""
        if not path or not Path(path).resolve().is_relative_to(self.uploads.resolve()):
            raise DataError("no file was uploaded")
        return Path(path)

    def _looked_at(self, path: Path, progress: Callable[..., Any]) -> Iterator[dict[Any, Any]]:
        """Yield what is found in a clip, and then which laws it breaks; or the reason why it is refused."""
        try:
            yield self._watch(path, progress)
        except (NsdrError, MachineError) as e:
            yield {self.laws: _not_judged(e)}
            raise
        yield {self.laws: self._judge(path)}

    def _watch(self, path: Path, progress: Callable[..., Any]) -> dict[Any, Any]:
        """Look at a clip; returns new values of everything that depends on it."""
        clip = self.clips.watch(path, lambda share, text: progress(share, desc=text))
        if clip not in self.shown:
            progress(1.0, desc="drawing what was found")
            p, video = clip.perception, self._new_file()
            frames = clip.frames()
            assert p.tracks is not None
            write_annotated_video(video, frames, p.proposals, p.tracks, p.scene, PRESET)
            self.shown[clip] = (video, timeline_html(p, frames, "#tracks video"))
        video, timeline = self.shown[clip]
        scene = clip.perception.scene
        texts, update = [example.question for example in menus.examples(scene)], self.gr.update
        buttons = [update(value=text, visible=True) for text in texts]
        buttons += [update(visible=False)] * (EXAMPLES - len(texts))
        change = next(iter(menus.CHANGES))
        return {
            **dict.fromkeys([self.answer, self.difference, self.laws], ""),
            self.clip: clip.key,
            self.video: str(video),
            self.notes: notes_panel(clip),
            self.timeline: timeline,
            self.compared: None,
            **dict(zip(self.buttons, buttons, strict=True)),
            self.change: change,
            **self._change(clip.key, change),
            self.from_frame: update(maximum=scene.n_frames - 1, value=0),
        }

    def _judge(self, path: Path) -> str:
        """Which laws a clip breaks, or why it is not judged."""
        try:
            judgement, tracks, frames = self.clips.judge(path)
            scene = self.clips.watch(path).perception.scene
            judgement = replace(judgement, notes=tuple(n for n in judgement.notes if n not in scene.notes))
            whole = len(frames) == scene.n_frames
        except VideoError as e:
            return _not_judged(e)
        return f"<div class=panel>{judgement_html(judgement, tracks, frames, '#tracks video' if whole else '')}</div>"

    def _ask(self, key: str, question: str | None, choices: str | None) -> str:
        """The answer, or why there is none."""
        try:
            clip = self.clips.kept(key)
            texts = [line.strip() for line in (choices or "").splitlines() if line.strip()]
            check_asked(question or "", texts)
            return answer_panel(self.clips.answer(clip, question or "", texts), clip)
        except Exception as e:
            return f"<div class=panel><p class=error>{html.escape(_reason(e))}</p></div>"

    def _example(self, index: int, key: str) -> tuple[str, str]:
        """Question and choices of an example's button."""
        examples = menus.examples(self.clips.kept(key).perception.scene)
        if index >= len(examples):
            raise DataError("this clip has no such question")
        example = examples[index]
        return example.question, "\n".join(example.choices)

    def _change(self, key: str, kind: str | None) -> dict[Any, Any]:
        """The objects and sliders of a kind of change."""
        if kind not in menus.CHANGES:
            raise DataError("no change is chosen")
        names = menus.changed_objects(kind, self.clips.kept(key).perception.scene)
        updates = {self.object: self.gr.update(choices=names, value=next(iter(names), None))}
        sliders = menus.CHANGES[kind].sliders
        for part, slider in zip(self.sliders, sliders, strict=False):
            numbers = {"minimum": slider.low, "maximum": slider.high, "step": slider.step, "value": slider.start}
            updates[part] = self.gr.update(label=slider.label, visible=True, **numbers)
        return updates | {part: self.gr.update(visible=False) for part in self.sliders[len(sliders) :]}

    def _simulate(self, key: str, change: Intervention, frame: float, progress: Callable[..., Any]) -> tuple[str, str]:
        clip = self.clips.kept(key)
        progress(0.0, desc="simulating")
        simulation = self.clips.simulate(clip, [change], int(frame))
        video = self._new_file()

        def drawing(done: int, total: int) -> None:
            progress(done / total, desc=f"drawing frame {done}")

        write_comparison(video, list(clip.frames()), simulation, PRESET, drawing, clip.perception.camera)
        return difference_panel(simulation, clip), str(video)

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
        return without_folders(str(error))
    log.error("a visitor's request failed", exc_info=error)
    if isinstance(error, OSError):
        return f"The server cannot do that now: {error.strerror}. Try again in a few minutes."
    return "That failed by a bug in nsdr; the server's output says where."


def _not_judged(reason: Exception) -> str:
    return f"<div class=panel><p>Not judged: {html.escape(without_folders(str(reason)))}</p></div>"
