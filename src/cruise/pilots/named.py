"""Pilots that a name is enough for."""

from cruise.pilots.base import Pilot
from cruise.pilots.scripted import SCRIPTED
from cruise.pilots.se_ibr import SeIbrPilot

NAMED: dict[str, Pilot] = {
    **SCRIPTED,
    "se-ibr": SeIbrPilot("paper", name="se-ibr"),
    "se-ibr-tuned": SeIbrPilot("tuned", name="se-ibr-tuned"),
}
