"""Makes the pictures of docs/page.md: a walk through the page in Chromium (extra `browser`, .ci/install-browser).

python docs/page_walk.py -o docs/images
"""

import argparse
import io
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

from nsdr.clevrer.example import VIDEO
from nsdr.io.video import read_video, write_video

PORT = 7899
SIZE = {"width": 1240, "height": 960}
"""Size of the browser's window (pixels)."""
PALETTE_COLORS = 256
"""Colours of the pictures, which keeps them small."""
PATIENCE_MS = 300_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder for page_*.png")
    folder = parser.parse_args().output
    command = [sys.executable, "-m", "nsdr.cli.main", "serve", "--port", str(PORT)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            server.stdout.readline()  # the address: it listens
            with sync_playwright() as playwright:
                path = shutil.which("chromium")
                browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
                page = browser.new_page(viewport=SIZE)  # type: ignore[arg-type]
                page.set_default_timeout(PATIENCE_MS)
                walk(page, folder)
                browser.close()
        finally:
            server.terminate()


def walk(page: Any, folder: Path) -> None:
    """Take the pictures one after the other."""
    page.goto(f"http://127.0.0.1:{PORT}")
    choose(page, "#pick", VIDEO.name)
    page.wait_for_selector("#timeline svg")
    page.wait_for_function("document.querySelector('#tracks video').readyState >= 2")
    page.locator("#timeline .event").nth(4).dispatch_event("click")
    page.locator("#timeline .event").nth(4).dispatch_event("mouseover", {"bubbles": True})
    picture(page, folder / "page_found.png")

    page.get_by_role("button", name="What is the color of").click()
    page.wait_for_selector("#answer .answer")
    page.locator("#answer").scroll_into_view_if_needed()
    picture(page, folder / "page_answer.png", "#answer")

    page.get_by_role("button", name="What will happen without").click()
    page.wait_for_selector("#answer .correct")
    picture(page, folder / "page_choices.png", "#answer")

    page.get_by_role("tab", name="What if").click()
    choose(page, "#change", "heavier or lighter")
    page.get_by_text("times the mass").wait_for()
    choose(page, "#object", "purple metal cube")
    page.click("#simulate")
    page.wait_for_selector("#compared video")
    page.wait_for_function("document.querySelector('#compared video').readyState >= 2")
    page.evaluate("const v = document.querySelector('#compared video'); v.pause(); v.currentTime = 3.4")
    page.evaluate("window.scrollTo(0, 0)")
    picture(page, folder / "page_what_if.png")

    with tempfile.TemporaryDirectory() as temporary:
        jump, frames = Path(temporary) / "jump.mp4", read_video(VIDEO)
        write_video(jump, np.concatenate([frames[:60], frames[72:]]), preset="veryfast")
        page.get_by_role("tab", name="Laws").click()
        page.set_input_files("#drop input", str(jump))
        page.wait_for_selector("#laws .violation")
        page.evaluate("window.scrollTo(0, 0)")
        picture(page, folder / "page_laws.png", "#laws")

        wrong = Path(temporary) / "notes.mp4"
        wrong.write_text("This is no video.\n")
        with page.expect_file_chooser() as chooser:
            page.click("#upload")
        chooser.value.set_files(str(wrong))
        page.get_by_text("is a text file").wait_for()
    picture(page, folder / "page_refused.png", ".toast-body")


def choose(page: Any, menu: str, entry: str) -> None:
    """Pick an entry of a menu."""
    page.click(f"{menu} input")
    page.get_by_role("option", name=entry, exact=True).click()


def picture(page: Any, path: Path, part: str = "") -> None:
    """Write what is to be seen, or a part of the page."""
    page.wait_for_timeout(1500)  # animations
    taken = page.locator(part).screenshot() if part else page.screenshot()
    image = Image.open(io.BytesIO(taken)).convert("RGB")
    image = image.crop((0, 0, image.width, min(image.height, SIZE["height"])))
    image.quantize(PALETTE_COLORS, kmeans=3, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
