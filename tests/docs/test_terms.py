"""The tables of observations and rewards in the documentation are those that the declarations give."""

import pytest

from docs.write_terms import DOCS, PAGES, page


@pytest.mark.parametrize("name", PAGES)
def test_the_committed_page_is_the_generated_one(name):
    assert (DOCS / name).read_text() == page(name), "run python -m docs.write_terms"
