"""A page in a browser, and where its camera says that things must appear."""

import contextlib
import io
import os
import shutil
import time

import numpy as np
from PIL import Image

SIZE = (800, 560)
# WebGL drawn by the processor, the same on every machine.
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
PATIENCE = 120_000  # for a machine that is busy with other things [ms]


def find_chromium():
    """Its path; None where there is none."""
    return os.environ.get("CRUISE_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)


@contextlib.contextmanager
def chromium():
    """A browser without a window."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=FLAGS)
        yield browser
        browser.close()


class Page:
    """One open page; remembers every complaint and every request but those that are `allowed`."""

    def __init__(self, browser, address, size=SIZE, scheme="dark", allowed=()):
        self.context = browser.new_context(
            viewport={"width": size[0], "height": size[1]}, color_scheme=scheme, reduced_motion="reduce"
        )
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE)
        self.complaints = []
        self.page.on("console", lambda message: self.complaints.append(f"console: {message.text}"))
        self.page.on("pageerror", lambda error: self.complaints.append(f"error: {error}"))
        document = str(address).split("#", 1)[0]
        known = (document, "data:", "blob:", *allowed)
        self.page.on(
            "request",
            lambda request: request.url.startswith(known) or self.complaints.append(f"request: {request.url}"),
        )
        self.page.goto(str(address))
        self.page.wait_for_selector("html[data-ready]")

    def close(self):
        self.context.close()

    def run(self, script, *arguments):
        """What a script gives."""
        return self.page.evaluate(script, *arguments)

    def seek(self, t, **view):
        """The state of the page at a time, seen with camera=, follow=, trail=, theme=."""
        return self.run("([t, view]) => window.replay.seek(t, view)", [t, view])

    def state(self):
        return self.run("window.replay.state()")

    def until(self, script):
        """Wait until an expression is true. (The page forbids the way in which Playwright would look itself.)"""
        end = time.monotonic() + PATIENCE / 1000
        while not self.run(script):
            assert time.monotonic() < end, f"never true: {script}"
            time.sleep(0.02)

    def text(self, selector):
        return self.page.inner_text(selector)

    def shown(self):
        """RGB of what is shown [H, W, 3], a byte each."""
        return np.asarray(Image.open(io.BytesIO(self.page.screenshot(timeout=PATIENCE))).convert("RGB"))


def project(camera, places):
    """Pixels [..., 2] at which a camera of `window.replay.state()` shows places [..., 3] of the world."""
    x, y, z, w = camera["quaternion"]
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    right, up, back = np.moveaxis((np.asarray(places) - camera["position"]) @ rotation, -1, 0)
    width, height = camera["width"], camera["height"]
    focal = height / 2 / np.tan(np.radians(camera["fov"]) / 2)
    middle = np.array([width, height]) / 2 + camera["shift"]
    return middle + focal * np.stack([right, -up], axis=-1) / -back[..., None]


def around(picture, at, reach=2):
    """The pixels within `reach` of a place [n, 3]."""
    column, row = np.rint(at).astype(int)
    part = picture[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
    return part.reshape(-1, 3).astype(float)


def colour(name):
    """RGB of "#rrggbb"."""
    return np.array([int(name[k : k + 2], 16) for k in (1, 3, 5)], float)


def hues(pixels):
    """Directions of colours away from grey [n, 3], of unit length where they are not grey."""
    away = pixels - pixels.mean(axis=-1, keepdims=True)
    return away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9)
