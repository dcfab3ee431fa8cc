"""Every code block of the README and of the documentation runs."""

import pytest

from tests.docs.blocks import PAGES, run_page
from tests.helpers import terms_forgotten


@pytest.mark.parametrize("page", PAGES)
def test_every_block_of_a_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with terms_forgotten():
        run_page(page, tmp_path)
