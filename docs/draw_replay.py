"""Draws the picture of docs/replay.md, a race of the shipped policies: `python -m docs.draw_replay`; needs Chromium."""

import tempfile
from pathlib import Path

from PIL import Image

import cruise
from tests.viewer.browser import Page, chromium

PICTURE = Path(__file__).parent / "images" / "replay.webp"
SIZE = (1280, 720)
MOMENT = 33.0  # of the race [s]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        page = Page(browser, cruise.replay(cruise.race(), Path(folder) / "race.html").as_uri(), SIZE)
        page.seek(MOMENT, camera="orbit", trail={"length": 8})
        Image.fromarray(page.shown()).save(PICTURE, quality=85)
        page.close()
