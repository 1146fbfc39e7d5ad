"""The page to ask on in a real browser: Debian's Chromium, driven by Playwright (`.ci/install-browser`, extra `browser`)."""

import os
import re
import shutil
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nsdr.clevrer.example import VIDEO
from nsdr.io.video import read_video, write_video

pytestmark = pytest.mark.browser

WATCHED_MS, ANSWERED_MS = 300_000, 120_000
"""How long perception and answers may take on a busy machine."""
SERVER = """
import sys
LOCAL = ("127.0.0.1", "localhost", "::1", "0.0.0.0", None, "", b"localhost", b"127.0.0.1")
def listen(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo"):
        address = arguments[1] if event == "socket.connect" else arguments
        if isinstance(address, tuple) and address[0] not in LOCAL:
            open(sys.argv[1], "a").write(f"{event} {address}\\n")
sys.addaudithook(listen)
from nsdr.cli.main import main
sys.exit(main(["serve", "--port", sys.argv[2], "--max-seconds", "6", "--max-megabytes", "1"]))
"""
"""`nsdr serve` that writes down whatever else than this machine it asks for."""


@dataclass
class Server:
    address: str
    outside: Path
    output: Path


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("server")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    outside, output = folder / "outside.txt", folder / "output.txt"
    arguments = [sys.executable, "-c", SERVER, str(outside), str(port)]
    environment = {k: v for k, v in os.environ.items() if not k.lower().endswith("_proxy")}
    with output.open("w") as file, subprocess.Popen(arguments, stdout=file, stderr=file, env=environment) as process:
        try:
            for _ in range(1800):
                if "Ctrl-C" in output.read_text() or process.poll() is not None:
                    break
                with pytest.raises(subprocess.TimeoutExpired):
                    process.wait(0.1)
            assert process.poll() is None, output.read_text()
            yield Server(f"http://127.0.0.1:{port}/", outside, output)
        finally:
            process.terminate()
            process.wait(60)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    path = shutil.which("chromium")
    assert path is not None, "Chromium is missing: .ci/install-browser"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def visit(chromium: Any, server: Server) -> Iterator[Callable[[], Any]]:
    """Opens the page as another visitor each time. Whatever a page fetches must come from the server itself."""
    requests: list[str] = []
    contexts = []

    def open_page() -> Any:
        contexts.append(chromium.new_context(viewport={"width": 1300, "height": 1000}))
        page = contexts[-1].new_page()
        page.on("request", lambda request: requests.append(request.url))
        page.goto(server.address)
        page.wait_for_selector("#pick")
        return page

    yield open_page
    for context in contexts:
        context.close()
    foreign = [url for url in requests if not url.startswith((server.address, "data:", "blob:"))]
    assert requests
    assert not foreign


@pytest.fixture(scope="module")
def short_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The beginning of the example, in which its last object has not come yet."""
    path = tmp_path_factory.mktemp("clips") / "beginning.mp4"
    write_video(path, read_video(VIDEO)[:64], preset="veryfast")
    return path


def upload(page: Any, path: Path) -> None:
    with page.expect_file_chooser() as chooser:
        page.click("#upload")
    chooser.value.set_files(str(path))


def watch_example(page: Any) -> None:
    page.click("#pick input")
    page.get_by_role("option", name=VIDEO.name).click()
    page.wait_for_selector("#timeline svg", timeout=WATCHED_MS)


def choose(page: Any, menu: str, entry: str) -> None:
    page.click(f"{menu} input")
    page.get_by_role("option", name=entry, exact=True).click()


def test_upload_shows_tracks_and_a_timeline_that_moves_the_video(visit: Callable[[], Any]) -> None:
    page = visit()
    upload(page, VIDEO)
    page.wait_for_selector("#timeline svg", timeout=WATCHED_MS)
    assert "128 frames, 6 objects" in page.inner_text("#notes")
    assert "the brown metal cylinder and the cyan metal sphere collide" in page.inner_text("#timeline")
    assert page.locator("#timeline .event").count() == page.locator("#timeline .cards button").count()
    page.wait_for_function("document.querySelector('#tracks video').readyState >= 2", timeout=ANSWERED_MS)
    card = page.locator("#timeline .cards button").first
    frame = int(re.search(r"frame (\d+)", card.inner_text())[1])  # type: ignore[index]
    page.locator("#timeline .event").first.dispatch_event("click")
    assert page.evaluate("document.querySelector('#tracks video').currentTime * 25") == pytest.approx(
        frame + 0.5, abs=0.3
    )
    page.locator("#timeline .event").first.dispatch_event("mouseover", {"bubbles": True})
    assert "marked" in (card.get_attribute("class") or "")


def test_typed_question(visit: Callable[[], Any]) -> None:
    page = visit()
    watch_example(page)
    page.fill("#question textarea, #question input", "How many collisions happen?")
    page.click("#ask")
    page.wait_for_selector("#answer .answer", timeout=ANSWERED_MS)
    said = page.inner_text("#answer")
    assert re.search(r"Answer: 4 \(\D?\d+ %\)", said)
    assert "count: 4" in said  # the program tree
    assert page.locator("#answer .cards img").count() == 4
    page.fill("#question textarea, #question input", "How many unicorns dance?")
    page.click("#ask")
    page.get_by_text("the nearest questions").first.wait_for(timeout=ANSWERED_MS)
    page.locator("#answer .answer").wait_for(state="detached", timeout=ANSWERED_MS)  # it was another question's
    assert "Traceback" not in page.inner_text("body")


def test_the_keyboard_picks_and_leaves_clips(visit: Callable[[], Any], server: Server, short_clip: Path) -> None:
    page = visit()
    for _ in range(4):
        page.keyboard.press("Tab")
        page.wait_for_timeout(300)
    page.fill("#question textarea, #question input", "How many collisions happen?")
    page.click("#ask")
    page.get_by_text("there is no clip yet").first.wait_for(timeout=ANSWERED_MS)
    said = page.inner_text("body")
    assert "bug" not in said
    assert "no clip is picked" not in said
    assert "KeyError" not in server.output.read_text()
    page.click("#pick input")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    page.wait_for_selector("#timeline svg", timeout=WATCHED_MS)
    upload(page, short_clip)
    page.locator("#notes", has_text="beginning.mp4").wait_for(timeout=WATCHED_MS)
    page.wait_for_function("document.querySelector('#pick input').value == ''", timeout=WATCHED_MS)
    choose(page, "#pick", VIDEO.name)
    page.locator("#notes", has_text=VIDEO.name).wait_for(timeout=WATCHED_MS)


@pytest.fixture
def requests_to(server: Server) -> Iterator[tuple[Any, dict[str, int]]]:
    """A client of the server's address, and the numbers of the functions of buttons by the identifier of their element."""
    import httpx

    with httpx.Client(base_url=server.address, timeout=120) as client:
        config = client.get("config").json()
        names = {part["id"]: part["props"].get("elem_id") for part in config["components"]}
        yield (
            client,
            {
                names[part]: function["id"]
                for function in config["dependencies"]
                for part, event in function["targets"]
                if event in ("click", "upload")
            },
        )


def test_what_the_page_limits_is_limited_on_the_server(requests_to: Any) -> None:
    client, numbers = requests_to

    def post(button: str, *data: Any) -> Any:
        body = {"data": data, "fn_index": numbers[button], "session_hash": "someone"}
        return client.post("gradio_api/run/predict", json=body)

    assert "there is no clip yet" in post("ask", None, "How many collisions happen?", "").text
    for data in (
        (None, None, None),
        (None, "?" * 600, ""),
        (None, "Why?", "a\n" * 40),
        (None, "Why?", 9),
        (None, {}, []),
    ):
        assert "class=error" in post("ask", *data).text
    for button in ("upload", "simulate"):
        assert post(button, None).status_code == 404  # only by the queue


def test_slow_work_and_refused_uploads_leave_the_page_free(requests_to: Any, tmp_path: Path) -> None:
    client, numbers = requests_to
    (tmp_path / "text.mp4").write_text("This is a text.\n" * 9)

    def upload(name: str) -> Any:
        return client.post("gradio_api/upload", files={"files": (name, (tmp_path / "text.mp4").read_bytes())}).json()[0]

    kept = [upload(f"{k}.mp4") for k in range(25)]
    joined = [
        client.post(
            "gradio_api/queue/join",
            json={
                "data": [{"path": path, "meta": {"_type": "gradio.FileData"}}],
                "fn_index": numbers["upload"],
                "session_hash": f"visitor{k}",
            },
        ).status_code
        for k, path in enumerate(kept)
    ]
    assert set(joined) <= {200, 503}
    body = {"data": [None, "How many collisions happen?", ""], "fn_index": numbers["ask"], "session_hash": "other"}
    with ThreadPoolExecutor(45) as threads:
        replies = list(threads.map(lambda _: client.post("gradio_api/run/predict", json=body), range(45)))
        assert all("there is no clip yet" in reply.text for reply in replies)
        assert client.get("").status_code == 200
    with client.stream("GET", "gradio_api/queue/data", params={"session_hash": "visitor0"}) as messages:
        assert any("is a text file" in line for line in messages.iter_lines())


def test_examples_bring_their_choices(visit: Callable[[], Any]) -> None:
    page = visit()
    watch_example(page)
    page.get_by_role("button", name="What will happen without the brown metal cylinder?").click()
    page.wait_for_selector("#answer table", timeout=ANSWERED_MS)
    verdicts = page.locator("#answer table").first.inner_text()
    assert "The brown rubber cube collides with the purple metal cube" in verdicts
    assert re.search(r"correct \(", verdicts)


def test_intervention_runs_beside_the_original(visit: Callable[[], Any]) -> None:
    page = visit()
    watch_example(page)
    page.get_by_role("tab", name="What if").click()
    choose(page, "#change", "heavier or lighter")
    page.get_by_text("times the mass").wait_for(timeout=ANSWERED_MS)
    choose(page, "#change", "remove")
    page.get_by_text("times the mass").wait_for(state="hidden", timeout=ANSWERED_MS)
    choose(page, "#object", "brown metal cylinder")
    page.click("#simulate")
    page.get_by_text("drawing frame").first.wait_for(timeout=ANSWERED_MS)
    page.wait_for_selector("#compared video", timeout=WATCHED_MS)
    said = page.inner_text("#difference")
    assert said.startswith("From frame 0: without the brown metal cylinder")
    assert "no longer: the brown metal cylinder and the cyan metal sphere collide" in said
    page.wait_for_function("document.querySelector('#compared video').videoWidth == 960", timeout=ANSWERED_MS)


def test_a_dropped_video_is_judged(visit: Callable[[], Any], tmp_path: Path) -> None:
    page = visit()
    page.get_by_role("tab", name="Laws").click()
    write_video(tmp_path / "back.mp4", read_video(VIDEO)[::-1], preset="veryfast")
    page.set_input_files("#drop input", str(tmp_path / "back.mp4"))
    page.wait_for_selector("#laws .violation", timeout=WATCHED_MS)
    assert "frame 0: arrow, all objects" in page.inner_text("#laws")
    assert page.locator("#laws .violation img").count() == 3
    page.locator("#laws .violation summary").click()
    page.locator("#laws .violation img").first.wait_for(state="hidden")
    page.locator("#laws .timeline .event").dispatch_event("click")
    page.locator("#laws .violation img").first.wait_for(state="visible")
    (tmp_path / "notes.mp4").write_text("This is a text.\n" * 9)
    page.wait_for_selector("#drop input", state="attached", timeout=ANSWERED_MS)
    page.set_input_files("#drop input", str(tmp_path / "notes.mp4"))
    page.get_by_text("Not judged: notes.mp4: is a text file").wait_for(timeout=ANSWERED_MS)


def test_wrong_files_are_refused_in_one_line(visit: Callable[[], Any], tmp_path: Path) -> None:
    page = visit()
    (tmp_path / "notes.mp4").write_text("This is a text.\n" * 9)
    upload(page, tmp_path / "notes.mp4")
    page.get_by_text("notes.mp4: is a text file; expected a video").wait_for(timeout=ANSWERED_MS)
    write_video(tmp_path / "long.mp4", [np.full((320, 480, 3), 120, np.uint8)] * 200, preset="veryfast")
    upload(page, tmp_path / "long.mp4")
    page.get_by_text("long.mp4: lasts 8 s; clips of up to 6 s are taken").wait_for(timeout=ANSWERED_MS)
    write_video(tmp_path / "grey.mp4", [np.full((320, 480, 3), 120, np.uint8)] * 100, preset="veryfast")
    upload(page, tmp_path / "grey.mp4")
    page.get_by_text("grey.mp4: not a video of CLEVRER's scene").wait_for(timeout=ANSWERED_MS)
    (tmp_path / "large.mp4").write_bytes(np.random.default_rng(0).bytes(2_000_000))
    upload(page, tmp_path / "large.mp4")
    page.get_by_text(re.compile("size|large", re.IGNORECASE)).first.wait_for(timeout=ANSWERED_MS)
    text = page.inner_text("body")
    assert "Traceback" not in text
    assert "/tmp" not in text
    page = visit()
    page.click("#ask")
    page.get_by_text(re.compile("there is no clip yet.*pick or upload one")).wait_for(timeout=ANSWERED_MS)


def test_two_visitors_see_their_own_clips(visit: Callable[[], Any], short_clip: Path) -> None:
    first, second = visit(), visit()
    upload(second, short_clip)
    watch_example(first)
    second.wait_for_selector("#timeline svg", timeout=WATCHED_MS)
    assert "video_500002.mp4: 128 frames, 6 objects" in first.inner_text("#notes")
    assert "beginning.mp4: 64 frames, 5 objects" in second.inner_text("#notes")
    for page in (first, second):
        page.fill("#question textarea, #question input", "How many collisions happen?")
    first.click("#ask")
    second.click("#ask")
    answers = []
    for page in (first, second):
        page.wait_for_selector("#answer .answer", timeout=ANSWERED_MS)
        answers.append(page.inner_text("#answer .answer"))
    assert [answer[: len("Answer: 4")] for answer in answers] == ["Answer: 4", "Answer: 3"]


def test_a_port_in_use_is_refused(server: Server) -> None:
    port = server.address.rstrip("/").rpartition(":")[2]
    command = [sys.executable, "-m", "nsdr.cli.main", "serve", "--port", port]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.endswith(
        f"error: --host 127.0.0.1 --port {port}: cannot be listened on, or is in use; choose another port\n"
    )


def test_nothing_leaves_this_machine(server: Server) -> None:
    with urllib.request.urlopen(server.address) as reply:
        assert "default-src 'self'" in reply.headers["content-security-policy"]
    assert not server.outside.exists(), server.outside.read_text()
    assert "Traceback" not in server.output.read_text()
