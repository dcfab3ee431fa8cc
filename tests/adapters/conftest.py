"""Every test of this folder steps what is compiled quickly."""

import pytest

from cruise.adapters import races
from tests.adapters import quick


@pytest.fixture(autouse=True)
def quickly_compiled(monkeypatch):
    monkeypatch.setattr(races, "fly_step", quick.fly_step)
