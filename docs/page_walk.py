"""Makes the pictures of docs/page.md: a walk through the page in Chromium (extra `browser`, .ci/install-browser).

python docs/page_walk.py -o docs/images
"""

import argparse
import io
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

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
    page.wait_for_selector("#timeline svg")
    page.wait_for_function("document.querySelector('#tracks video').readyState >= 2")
    page.locator("#timeline .event").nth(4).dispatch_event("click")
    picture(page, folder / "page_found.png")

    page.get_by_role("button", name="What will happen without").click()
    page.wait_for_selector("#answer .answer")
    page.locator("#answer summary").first.click()
    picture(page, folder / "page_answer.png", "#asking")

    page.get_by_role("tab", name="What if").click()
    choose(page, "#change", "heavier or lighter")
    page.get_by_text("times the mass").wait_for()
    choose(page, "#object", "purple metal cube")
    page.click("#simulate")
    page.wait_for_selector("#compared video")
    page.wait_for_function("document.querySelector('#compared video').readyState >= 2")
    page.evaluate("const v = document.querySelector('#compared video'); v.pause(); v.currentTime = 3.4")
    picture(page, folder / "page_what_if.png", "#compared")


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
