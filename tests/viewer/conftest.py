"""A real browser, one for all tests, and a page that shows a race known in closed form."""

import os

import pytest

from cruise.viewer.page import write_replay
from tests.viewer.browser import Page, chromium, find_chromium
from tests.viewer.races import FIELD, circle_race


@pytest.fixture(scope="session")
def browser():
    """Chromium; where there is none the tests are skipped, unless they were said to be required."""
    if find_chromium() is None:
        reason = "no Chromium found: install it (Debian: apt-get install chromium) or name it in CRUISE_CHROMIUM"
        (pytest.fail if os.environ.get("CRUISE_REQUIRE_BROWSER") else pytest.skip)(reason)
    with chromium() as started:
        yield started


@pytest.fixture(scope="session")
def race():
    return circle_race()


@pytest.fixture(scope="session")
def race_file(tmp_path_factory, race):
    """Three races in one page: the one known in closed form, one of one drone, one with a winner."""
    path = tmp_path_factory.mktemp("replay") / "race.html"
    races = [race, circle_race((FIELD[1],), seconds=3.0), circle_race(seconds=12.0, laps=1)]
    write_replay(path, races, ["first", "second", "third"])
    return path


@pytest.fixture
def open_page(browser, request):
    """Opens pages; at the end of the test none of them may have complained or asked the network for anything."""
    pages = []

    def open_(address, **options):
        pages.append(Page(browser, address, **options))
        return pages[-1]

    yield open_
    for page in pages:
        page.close()
    assert [complaint for page in pages for complaint in page.complaints] == []
