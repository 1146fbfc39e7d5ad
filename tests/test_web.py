"""What is behind the page to ask on, without a browser and without Gradio."""

import html
import json
import os
import re
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from nsdr import DataError, Event, Executor, QuestionError, Scene, VideoError, read_world
from nsdr.apps import menus, web
from nsdr.apps.clips import KEPT_CLIPS, Clip, Clips
from nsdr.apps.guard import Guard, delete_upload
from nsdr.apps.panels import answer_panel, notes_panel, rests_on
from nsdr.apps.strangers import without_folders
from nsdr.clevrer.example import VIDEO
from nsdr.clevrer.files.proposals import proposals_from_rows
from nsdr.cli import serve
from nsdr.cli.main import main
from nsdr.dynamics.interventions import check_changes
from nsdr.frame_parser import VideoConfig
from nsdr.io.video import video_seconds, write_video
from nsdr.pipeline import Perception
from nsdr.question_parser.grammar import GrammarParser
from nsdr.tracking.tracker import TrackerConfig
from nsdr.types import Add, Judgement, Remove, SetVelocity, VideoProposals
from nsdr.visualize.html_parts import jpeg
from nsdr.world.camera import Camera
from nsdr.world.world import CLEVRER_WORLD, World


class FakePipeline:
    """Counts what it perceives, and notices when two threads perceive at once."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.perceived, self.inside, self.together = scene, 0, 0, False
        self.frame_parser = SimpleNamespace(parse=self._parse)
        self.video, self.world = VideoConfig(), scene.world

    def frames(self, path: Path, note: Callable[[str], object]) -> Any:
        note(f"too dark: {path.name}")
        yield from np.zeros((4, 320, 480, 3), np.uint8)

    def _parse(self, frames: Any) -> VideoProposals:
        self.inside += 1
        self.together |= self.inside > 1
        n = len(list(frames))
        threading.Event().wait(0.05)
        self.inside -= 1
        return proposals_from_rows(n, [])

    def perceive(self, path: Path, proposals: VideoProposals) -> Perception:
        assert proposals.n_frames == 4
        self.perceived += 1
        return Perception(proposals, None, None, replace(self.scene, notes=proposals.notes))


@pytest.fixture
def clip_files(tmp_path: Path) -> list[Path]:
    files = []
    for number in range(3):
        files.append(tmp_path / f"{number}.mp4")
        write_video(files[-1], [np.full((320, 480, 3), 40 * number, np.uint8)] * 10, preset="veryfast")
    return files


def test_clips_are_perceived_once_and_one_at_a_time(small_scene: Scene, clip_files: list[Path]) -> None:
    pipeline: Any = FakePipeline(small_scene)
    clips, said = Clips(pipeline, 5), []
    threads = [threading.Thread(target=clips.watch, args=[file]) for file in clip_files * 2]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert pipeline.perceived == 3
    assert not pipeline.together
    clip = clips.watch(clip_files[0], lambda share, text: said.append(text))
    assert said == []  # known
    assert clip.perception.scene.notes == ("too dark: 0.mp4",)
    assert clips.watch(clip_files[1]).perception.scene.notes == ("too dark: 1.mp4",)
    assert clip.frames().shape == (4, 320, 480, 3)
    fresh = Clips(pipeline, 5)
    fresh.watch(clip_files[0], lambda share, text: said.append((round(share, 1), text)))
    assert said[0] == (0.0, "finding objects: frame 0")
    assert said[-1] == (1.0, "following objects and fitting their motion")


def test_long_clips_and_other_files_are_refused_before_the_work(
    small_scene: Scene, clip_files: list[Path], tmp_path: Path
) -> None:
    pipeline: Any = FakePipeline(small_scene)
    assert video_seconds(VIDEO) == pytest.approx(128 / 25)
    with pytest.raises(VideoError, match=r"lasts 5 s; clips of up to 2 s are taken, so cut it"):
        Clips(pipeline, 2).watch(VIDEO)
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(VideoError, match="is a text file"):
        Clips(pipeline, 2).watch(tmp_path / "text.mp4")
    assert pipeline.perceived == 0


def test_each_note_is_shown_once(small_scene: Scene, tmp_path: Path) -> None:
    """Those of the clip below the video, others beside the result that they are about."""
    scene = replace(small_scene, notes=("it is <dark>",))
    clip = Clip(
        "key", tmp_path / "a.mp4", Perception(None, None, None, scene), (jpeg(np.zeros((320, 480, 3), np.uint8)),)
    )
    program = GrammarParser().parse("How many cubes are there?").with_notes("read 'cueb' as 'cube'")
    answer = answer_panel(Executor(scene).answer(program), clip)
    assert "it is <dark>" in notes_panel(clip)
    assert html.escape("read 'cueb' as 'cube'") in answer
    assert "dark" not in answer


def test_suggested_questions_can_be_answered_with_the_choices_that_they_get(small_scene: Scene) -> None:
    executor, parser = Executor(small_scene), GrammarParser()
    count, cause, without = menus.questions(small_scene)
    assert count == "How many collisions happen?"
    assert cause == "Which of the following is responsible for the blue rubber sphere's exit?"
    assert without == "What will happen without the red metal cube?"
    assert executor.answer(parser.parse(count, "descriptive").tokens).answer == 2
    for question in (cause, without):
        program = parser.parse(question, "multiple_choice")
        texts = menus.choices(question, program.tokens, small_scene)
        assert 2 <= len(texts) <= menus.MAX_CHOICES
        assert question != without or not any("red metal cube" in text for text in texts)
        judged = executor.answer_choices(program.tokens, [(t, parser.parse(t, "choice").tokens) for t in texts])
        assert {choice.error for choice in judged.choices} == {""}
    quiet = replace(small_scene, events=(), predicted=(), counterfactual={})
    assert menus.questions(quiet) == [count, without, "What will happen next?"]
    alone = replace(quiet, objects=small_scene.objects[:1], visible=quiet.visible[:1], moving=quiet.moving[:1])
    assert menus.questions(alone) == [count]


def test_interventions_of_menu_and_sliders(small_scene: Scene) -> None:
    assert menus.intervention("remove", "red metal cube", [9, 9, 9, 9]) == Remove("red metal cube")
    faster = menus.intervention("faster, slower or back", "red metal cube", [2, 9, 9, 9])
    assert faster == SetVelocity("red metal cube", factor=2)
    new = menus.changed_objects("add", small_scene)
    assert len(new) == 48 - len(small_scene.objects)
    assert menus.intervention("add", new[0], [1, 2, -1, 0]) == Add(*new[0].split(), 1, 2, -1, 0)
    for kind, change in menus.changes(small_scene.world).items():
        for slider in change.sliders:
            assert slider.low <= slider.start <= slider.high
        for end in ("low", "high", "start"):
            numbers = [getattr(slider, end) for slider in change.sliders]
            if kind != "add" or end == "start":
                menus.intervention(kind, "red rubber cube", numbers)


@pytest.mark.parametrize("name", ["clevrer", "pucks", "blocks"])
def test_sliders_stay_within_their_world(name: str) -> None:
    world = read_world(name)
    for kind, change in menus.changes(world).items():
        assert len(change.sliders) <= menus.MAX_SLIDERS
        for slider in change.sliders:
            assert slider.low <= slider.start <= slider.high
        if kind in ("add", "other velocity"):
            for end in ("low", "high", "start"):
                numbers = [getattr(slider, end) for slider in change.sliders]
                added = menus.intervention(kind, " ".join(world.vocabulary.triples[0]), numbers)
                check_changes([added], world)


@pytest.mark.parametrize("kind", menus.KINDS)
def test_changes_need_an_object(kind: str) -> None:
    with pytest.raises(DataError, match="no object is chosen; pick or upload a clip"):
        menus.intervention(kind, None, [0.0] * 4)


def test_frames_that_an_answer_rests_on(small_scene: Scene) -> None:
    executor = Executor(small_scene)

    def frames(program: str) -> dict[int, tuple[int, ...]]:
        return rests_on(executor.answer(program).trace, small_scene)

    assert frames("events objects filter_collision count") == {20: (0, 1), 40: (1, 2)}
    first = "events objects green filter_color unique filter_collision first filter_order"
    assert frames(f"{first} objects green filter_color unique get_col_partner query_color") == {40: (1, 2)}
    assert frames("objects cube filter_shape null filter_moving count") == {64: (0,)}


def test_frames_after_a_cut_are_judged_too(small_scene: Scene, clip_files: list[Path]) -> None:
    pipeline: Any = FakePipeline(small_scene)
    none = np.zeros(0, int)
    proposals = VideoProposals(7, none, none, np.zeros(0), np.zeros((0, 2)), none, np.zeros((0, 4), int))

    def frames(path: Path, beyond_cuts: bool = False, note: Any = None) -> Any:
        yield from np.zeros((7 if beyond_cuts else 4, 320, 480, 3), np.uint8)

    pipeline.frames, pipeline.tracker, pipeline.world = frames, TrackerConfig(), CLEVRER_WORLD
    pipeline.proposals, pipeline.judge = lambda path: (proposals, None), lambda path: Judgement((), 7, (), 0.0)
    judgement, tracks, shown = Clips(pipeline, 5).judge(
        Clip("key", clip_files[0], Perception(None, None, None, small_scene), ())
    )
    assert judgement.n_frames == tracks.n_frames == len(shown) == 7


def page_of(clips: Any, folder: Path, files: dict[str, Path] | None = None) -> Any:
    """The page's functions without Gradio: updates are dictionaries, components are their names."""
    page: Any = web._Page(
        SimpleNamespace(update=lambda **values: values), clips, files or {}, folder, folder / "uploads"
    )
    page.laws, page.refused, page.answer, page.suggested = "laws", "refused", "answer", ["first", "second", "third"]
    return page


def test_a_refused_first_clip_leaves_the_page_open(small_scene: Scene, tmp_path: Path) -> None:
    pipeline: Any = FakePipeline(small_scene)
    (tmp_path / "<i>.mp4").write_text("no video")
    page = page_of(Clips(pipeline, 5), tmp_path, {"<i>.mp4": tmp_path / "<i>.mp4"})
    page.look_at_first()
    (place, said), *_ = page._opened().items()
    assert place == "refused"
    assert "&lt;i&gt;.mp4: is a text file; expected a video" in said
    assert page._thumbnail(tmp_path / "<i>.mp4") is None


def test_pictures_of_clips_have_the_size_of_the_worlds_images(small_scene: Scene, tmp_path: Path) -> None:
    world = World("wide", camera=Camera(width=640, height=360))
    pipeline: Any = FakePipeline(replace(small_scene, world=world))
    write_video(tmp_path / "clip.mp4", [np.full((360, 640, 3), 90, np.uint8)] * 10, preset="veryfast")
    picture = page_of(Clips(pipeline, 5), tmp_path)._thumbnail(tmp_path / "clip.mp4")
    assert cv2.imread(picture).shape == (360, 640, 3)


def test_a_refusal_replaces_the_answer_and_brings_the_nearest_questions(small_scene: Scene, tmp_path: Path) -> None:
    pipeline: Any = FakePipeline(small_scene)
    pipeline.question_parser, clips = GrammarParser(), Clips(pipeline, 5)
    clip = Clip("key", tmp_path / "a.mp4", Perception(None, None, None, small_scene), ())

    def refuse(clip: Clip, question: str, choices: list[str]) -> Any:
        raise QuestionError("unknown word <unicorns>", ["How many cubes are there?", "Are there cubes?"])

    clips.kept, clips.answer = lambda key: clip, refuse  # type: ignore[assignment,method-assign]
    said = page_of(clips, tmp_path)._ask("key", "How many unicorns?", "")
    assert "unknown word &lt;unicorns&gt;<" in said["answer"]
    assert said["first"] == {"value": "How many cubes are there?", "visible": True}
    assert said["second"] == {"value": "Are there cubes?", "visible": True}
    assert said["third"] == {"visible": False}


def test_questions_that_need_choices_get_some(small_scene: Scene, tmp_path: Path) -> None:
    asked: list[Any] = []
    pipeline: Any = FakePipeline(small_scene)
    pipeline.question_parser = GrammarParser()
    pipeline.answer = lambda scene, question, choices: asked.append(choices)
    explanation: Any = SimpleNamespace(prediction=None)
    clip = Clip("key", tmp_path / "a.mp4", Perception(None, None, explanation, small_scene), ())
    for question, choices in (
        ("How many collisions happen?", []),
        ("Which of the following is responsible for the blue rubber sphere's exit?", []),
        ("What will happen without the red metal cube?", []),
        ("What will happen without the red metal cube?", ["nothing"]),
        ("Is it a unicorn?", []),
    ):
        Clips(pipeline, 5).answer(clip, question, choices)
    assert asked[0] is None
    assert asked[1][0] == "The presence of the red metal cube"
    assert asked[2:] == [None, ["nothing"], None]


def test_only_uploads_are_looked_at_as_uploads(small_scene: Scene, tmp_path: Path) -> None:
    """A request may name any file that Gradio serves, such as another visitor's annotated video."""
    pipeline: Any = FakePipeline(small_scene)
    page = page_of(Clips(pipeline, 5), tmp_path)
    for path in (tmp_path / "videos" / "v.mp4", page.uploads / ".." / "videos" / "v.mp4", VIDEO, None, ""):
        with pytest.raises(DataError, match="no file was uploaded"):
            page._upload_of(path and str(path))
    assert page._upload_of(str(page.uploads / "0a" / "v.mp4")) == page.uploads / "0a" / "v.mp4"


def test_messages_name_files_without_their_folders() -> None:
    rest = "clip.mp4: is a text file; see docs/errors.md or 1/2"
    assert without_folders(f"/srv/a b/{rest}") == rest
    assert without_folders(f"cannot read /srv/0a/{rest}") == f"cannot read {rest}"
    assert without_folders(f"cannot read '/srv/0a/{rest}', \"/srv/b.mp4\"") == f"cannot read '{rest}', \"b.mp4\""
    assert without_folders("see https://example.org/a/b") == "see https://example.org/a/b"


def test_errors_become_one_line_and_bugs_are_logged(small_scene: Scene, caplog: pytest.LogCaptureFixture) -> None:
    pipeline: Any = FakePipeline(small_scene)
    page = page_of(Clips(pipeline, 5), Path())

    def told(error: Exception) -> str:
        def work() -> Any:
            raise error

        return str(page._told("place", work)["place"])

    said = page._ask("", "How many collisions happen?", None)
    assert re.search("<p class=error[^>]*>there is no clip yet, .*; pick or upload one<", said["answer"])
    assert ">no &lt;b&gt; here; it is in v.mp4<" in told(DataError("no <b> here; it is in /srv/secret/v.mp4"))
    assert caplog.text == ""
    assert "a bug in nsdr" in told(ZeroDivisionError("division by zero"))
    assert "ZeroDivisionError" in caplog.text
    full = told(OSError(28, "No space left on device", "/srv/secret/0.mp4"))
    assert re.search(r"cannot do that now: No space left .* Try again", full)


def test_quick_work_asks_for_kept_clips_only(small_scene: Scene, clip_files: list[Path]) -> None:
    """A clip that was forgotten is not looked at again by a question, which would make other questions wait."""
    pipeline: Any = FakePipeline(small_scene)
    clips = Clips(pipeline, 5)
    clip = clips.watch(clip_files[0])
    clip_files[0].unlink()
    assert clips.kept(clip.key) is clip
    for k in range(2 * KEPT_CLIPS):
        clip_files[1].write_bytes(clip_files[2].read_bytes() + bytes(k))
        clips.watch(clip_files[1])
        if k < KEPT_CLIPS:
            assert clips.kept(clip.key) is clip  # it was asked for, and so is not the oldest
    with pytest.raises(DataError, match="no longer kept; pick or upload one"):
        clips.kept(clip.key)


def test_clips_that_are_longer_than_they_say_are_refused(small_scene: Scene, clip_files: list[Path]) -> None:
    pipeline: Any = FakePipeline(small_scene)
    pipeline.frames = lambda path, note: iter(np.zeros((1000, 320, 480, 3), np.uint8))
    with pytest.raises(VideoError, match=r"lasts 2 s; clips of up to 2 s are taken, so cut it"):
        Clips(pipeline, 2).watch(clip_files[0])


MEGABYTE = 10**6


@pytest.fixture
def guarded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A client of a guarded application that keeps uploads as Gradio does; files called "broken" are not finished.

    Its disk has room whatever else is on this machine's.
    """
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.requests import Request
    from starlette.responses import PlainTextResponse
    from starlette.routing import Route
    from starlette.testclient import TestClient

    folder = tmp_path / "uploads"
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(total=100 * MEGABYTE, free=100 * MEGABYTE))

    async def upload(request: Request) -> PlainTextResponse:
        name, content = request.headers["name"], await request.body()
        (folder / f"tmp{name}").write_bytes(content)
        if name == "broken":
            raise OSError(28, "No space left on device")
        (folder / name).mkdir(exist_ok=True)
        (folder / f"tmp{name}").rename(folder / name / "v.mp4")
        return PlainTextResponse(name)

    async def echo(request: Request) -> PlainTextResponse:
        return PlainTextResponse((await request.body()).decode())

    routes = [Route("/api/upload", upload, methods=["POST"])]
    routes += [Route(path, echo, methods=["POST"]) for path in ("/api/queue/join", "/api/run/predict", "/api/other")]
    routes.append(Route("/{path:path}", echo))
    app = Starlette(routes=routes, middleware=[Middleware(Guard, folder, MEGABYTE, 3 * MEGABYTE)])
    return TestClient(app, base_url="http://here:7860", raise_server_exceptions=False), folder


def test_pages_of_other_sites_may_not_send_anything(guarded: Any) -> None:
    client, folder = guarded
    for origin in ("http://evil.example", "http://here", "http://here:7861", "null", ""):
        for path in ("/api/upload", "/api/queue/join"):
            assert client.post(path, content=b"{}", headers={"origin": origin, "name": "a"}).status_code == 403
    assert not folder.exists()
    for headers in ({}, {"origin": "http://here:7860"}, {"origin": "http://HERE:7860"}):
        reply = client.post("/api/queue/join", content=b'{"data": [1]}', headers=headers)
        assert (reply.status_code, reply.text) == (200, '{"data": [1]}')
        assert "default-src 'self'" in reply.headers["content-security-policy"]


def test_what_the_page_does_not_send_is_refused(guarded: Any) -> None:
    client, _ = guarded
    assert client.post("/api/other", content=b"{}").status_code == 404
    assert client.post("/api/queue/join", content=b" " * 200_000).status_code == 413
    assert client.post("/api/upload", content=bytes(2 * MEGABYTE), headers={"name": "a"}).status_code == 413
    assert client.post("/api/upload", content=iter([b"a"]), headers={"name": "a"}).status_code == 411
    both = {"name": "a", "transfer-encoding": "chunked", "content-length": "1"}
    assert client.post("/api/upload", content=iter([b"a"]), headers=both).status_code == 411
    for path in ("http://evil.example/a", "HTTPS://evil.example"):
        body = json.dumps({"data": [{"meta": {"_type": "gradio.FileData"}, "path": path}]}).replace("p:", "\\u0070:")
        assert client.post("/api/run/predict", content=body).status_code == 403
        for place in ("file=", "file/", "proxy="):
            assert client.get(f"/api/{place}{path}").status_code == 403
    assert client.get("/api/file=/elsewhere/v.mp4").status_code == 200


def test_uploads_fit_into_their_limit(guarded: Any) -> None:
    client, folder = guarded

    def upload(name: str) -> int:
        return client.post("/api/upload", content=bytes(MEGABYTE), headers={"name": name}).status_code

    for k in range(5):
        assert upload(str(k)) == 200
        os.utime(folder / str(k) / "v.mp4", (k, k))
    assert sorted(path.name for path in folder.iterdir()) == ["2", "3", "4"]
    assert upload("broken") == 507
    assert sorted(path.name for path in folder.iterdir()) == ["3", "4"]  # nothing is left of what was broken off
    delete_upload(folder / "3" / "v.mp4")
    assert sorted(path.name for path in folder.iterdir()) == ["4"]


def test_uploads_leave_room_on_the_disk(guarded: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    client, folder = guarded
    kept = lambda: sum(f.stat().st_size for f in folder.rglob("*") if f.is_file())  # noqa: E731
    small = lambda path: SimpleNamespace(total=2 * MEGABYTE, free=2 * MEGABYTE - kept())  # noqa: E731
    monkeypatch.setattr("shutil.disk_usage", small)
    for k in range(4):
        assert client.post("/api/upload", content=bytes(MEGABYTE), headers={"name": str(k)}).status_code == 200
    assert kept() == MEGABYTE
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(total=2 * MEGABYTE, free=0))
    reply = client.post("/api/upload", content=bytes(1000), headers={"name": "a"})
    assert (reply.status_code, reply.text) == (507, "there is no room for this upload now; try again in a few minutes")


def test_folders_of_clips(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    for name in ("a/one.mp4", "two.MP4", "notes.txt", ".unfinished.mp4"):
        (tmp_path / name).write_bytes(b"x")
    assert list(serve._clips(str(tmp_path))) == ["a/one.mp4", "two.MP4"]
    assert list(serve._clips("")) == [VIDEO.name]
    (tmp_path / "b").mkdir()
    with pytest.raises(DataError, match=r"b: no \.mp4, \.gif, \.webp files"):
        serve._clips(str(tmp_path / "b"))
    with pytest.raises(DataError, match="expected a folder of clips, found nothing"):
        serve._clips(str(tmp_path / "c"))


def test_serve_says_what_is_missing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["serve"]) == 2
    assert "the page needs Gradio: pip install 'nsdr[web]'" in capsys.readouterr().err


@pytest.mark.parametrize(("option", "value"), [("--port", "65536"), ("--max-seconds", "inf")])
def test_serve_refuses_what_cannot_be(option: str, value: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["serve", option, value]) == 2
    assert re.search(f"{option}: expected a (whole )?number (from 1 to 65535|>0), got {value}", capsys.readouterr().err)


def test_events_are_marked_in_the_timeline(small_scene: Scene) -> None:
    from nsdr.types import UncertainEvent
    from nsdr.visualize.timeline import timeline_html

    unsure = replace(small_scene, uncertain=(UncertainEvent(Event("collision", 40, (1, 2)), 0.7),))
    page = timeline_html(Perception(None, None, None, unsure), None, "#tracks video")
    assert page.count("<g class=event") == page.count("<button type=button data-event=") == 5
    assert "frame 40: the blue rubber sphere and the green rubber cylinder collide (70 %)" in page
    assert page.count("v.currentTime=0.82") == 2  # the mark and the card of frame 20, in its middle
    assert "currentTime=6" not in page  # nothing to show after the video
    assert "<b>about frame 150, predicted</b>" in page
