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
        page.wait_for_selector("#timeline svg", timeout=ANSWERED_MS)
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


def ask(page: Any, question: str) -> None:
    page.fill("#question textarea, #question input", question)
    page.click("#ask")


def choose(page: Any, menu: str, entry: str) -> None:
    page.click(f"{menu} input")
    page.get_by_role("option", name=entry, exact=True).click()


def test_the_page_opens_with_a_clip_whose_events_move_the_video(visit: Callable[[], Any]) -> None:
    page = visit()
    assert f"{VIDEO.name}: 128 frames, 6 objects" in page.inner_text("#notes")
    assert "the brown metal cylinder and the cyan metal sphere collide" in page.inner_text("#timeline")
    assert page.locator("[id^=suggested-]").count() == 3
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


def test_a_refusal_replaces_the_answer_and_its_suggestions_can_be_pressed(visit: Callable[[], Any]) -> None:
    page = visit()
    ask(page, "How many collisions happen?")
    page.wait_for_selector("#answer .answer", timeout=ANSWERED_MS)
    assert re.fullmatch(r"Answer: 4 \(\D?\d+ %\)", page.inner_text("#answer .answer"))
    page.get_by_text("Why", exact=True).click()
    assert page.locator("#answer .cards img").count() == 4
    page.get_by_text("program tree").click()
    assert "count: 4" in page.inner_text("#answer")
    ask(page, "How many unicorns dance?")
    page.wait_for_selector("#answer .error", timeout=ANSWERED_MS)
    assert "unicorns" in page.inner_text("#answer")
    assert page.locator("#answer .answer").count() == 0
    assert page.locator(".toast-body").count() == 0
    page.get_by_role("button", name="How many cubes enter the scene?").click()
    page.wait_for_selector("#answer .answer", timeout=ANSWERED_MS)
    assert page.inner_text("#answer .answer").startswith("Answer: 1")
    assert page.input_value("#question textarea, #question input") == "How many cubes enter the scene?"
    assert "Traceback" not in page.inner_text("body")


def test_the_keyboard_reaches_everything_without_an_error(visit: Callable[[], Any], server: Server) -> None:
    page = visit()
    visited = set()
    for tab in ("Ask", "What if", "Laws"):
        page.get_by_role("tab", name=tab).click()
        for _ in range(45):
            page.keyboard.press("Tab")
            visited.add(page.evaluate("document.activeElement.closest('[id]')?.id ?? ''"))
        page.wait_for_timeout(1000)
    assert {"upload", "ask", "suggested-0", "suggested-1", "suggested-2", "simulate"} <= visited
    assert page.locator(".toast-body").count() == 0
    assert "bug" not in page.inner_text("body")
    assert "KeyError" not in server.output.read_text()
    page.get_by_role("tab", name="Ask").click()
    page.focus("#suggested-0")
    page.keyboard.press("Enter")
    page.wait_for_selector("#answer .answer", timeout=ANSWERED_MS)


def test_clips_are_picked_and_uploaded(visit: Callable[[], Any], short_clip: Path) -> None:
    page = visit()
    ask(page, "How many collisions happen?")
    page.wait_for_selector("#answer .answer", timeout=ANSWERED_MS)
    for _ in range(2):
        upload(page, short_clip)
        page.locator("#notes", has_text="beginning.mp4: 64 frames, 5 objects").wait_for(timeout=WATCHED_MS)
        page.locator("#answer .answer").wait_for(state="detached", timeout=ANSWERED_MS)  # it was another clip's
        page.get_by_role("button", name=VIDEO.name).click()
        page.locator("#notes", has_text=VIDEO.name).wait_for(timeout=WATCHED_MS)


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (390, 844)])
def test_the_video_stays_in_view_and_a_phone_scrolls_little(visit: Callable[[], Any], width: int, height: int) -> None:
    page = visit()
    page.set_viewport_size({"width": width, "height": height})
    page.get_by_role("button", name="What will happen without").click()
    page.wait_for_selector("#answer .answer", timeout=ANSWERED_MS)
    page.locator("#answer summary").first.click()
    size = page.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
    assert size[0] == width
    assert size[1] <= 2500
    page.locator("#suggested-2").scroll_into_view_if_needed()
    page.mouse.wheel(0, 200)
    page.wait_for_timeout(500)
    box = page.locator("#tracks").bounding_box()
    assert -10 <= box["y"] < height / 2
    cards = page.locator("#timeline .cards > *").all()
    assert len({card.bounding_box()["y"] for card in cards}) == 1


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


def test_a_counterfactual_question_is_told_event_by_event(visit: Callable[[], Any]) -> None:
    page = visit()
    page.get_by_role("button", name="What will happen without the brown metal cylinder?").click()
    page.wait_for_selector("#answer .answer", timeout=ANSWERED_MS)
    first, *lines = page.inner_text("#answer .answer").splitlines()
    assert first == "Answer:"
    assert "still: the brown rubber cube and the purple metal cube collide (frame 48)" in lines
    assert {line.partition(":")[0] for line in lines} == {"still", "no longer", "new", "other frame"}


def test_intervention_runs_beside_the_original(visit: Callable[[], Any]) -> None:
    page = visit()
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


def test_an_uploaded_video_is_judged(visit: Callable[[], Any], tmp_path: Path) -> None:
    page = visit()
    page.get_by_role("tab", name="Laws").click()
    page.locator("#laws", has_text=re.compile(r"Probability that a law is broken: (<1|\d) %")).wait_for(
        timeout=WATCHED_MS
    )
    write_video(tmp_path / "back.mp4", read_video(VIDEO)[::-1], preset="veryfast")
    upload(page, tmp_path / "back.mp4")
    page.wait_for_selector("#laws .violation", timeout=WATCHED_MS)
    assert "frame 0: arrow, all objects" in page.inner_text("#laws")
    assert page.locator("#laws .violation img").count() == 3
    page.locator("#laws .violation summary").click()
    page.locator("#laws .violation img").first.wait_for(state="hidden")
    page.locator("#laws .timeline .event").dispatch_event("click")
    page.locator("#laws .violation img").first.wait_for(state="visible")


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
    assert VIDEO.name in page.inner_text("#notes")  # the clip before stays


def test_two_visitors_see_their_own_clips(visit: Callable[[], Any], short_clip: Path) -> None:
    first, second = visit(), visit()
    upload(second, short_clip)
    second.locator("#notes", has_text="beginning.mp4").wait_for(timeout=WATCHED_MS)
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
