"""Draws the picture of docs/replay.md, a race of the shipped policies: `python docs/draw_replay.py`; needs Chromium."""

import io
import os
import shutil
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

import cruise

PICTURE = Path(__file__).parent / "images" / "replay.webp"
SIZE = {"width": 1280, "height": 720}
MOMENT = 33.0  # of the race [s]
WEBGL = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # drawn by the processor


def photograph(page_file: Path) -> bytes:
    """What a browser shows of a replay at MOMENT, as PNG."""
    browser_path = os.environ.get("CRUISE_CHROMIUM") or shutil.which("chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=browser_path, args=WEBGL)
        page = browser.new_page(viewport=SIZE, color_scheme="dark", reduced_motion="reduce")
        page.goto(page_file.as_uri())
        page.wait_for_selector("html[data-ready]")
        page.evaluate("t => window.replay.seek(t, {camera: 'orbit', trail: {length: 8}})", MOMENT)
        picture = page.screenshot()
        browser.close()
    return picture


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        picture = photograph(cruise.replay(cruise.race(), Path(folder) / "race.html"))
    Image.open(io.BytesIO(picture)).convert("RGB").save(PICTURE, quality=85)
