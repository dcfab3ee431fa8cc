"""The same races in other people's simulators."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from cruise.config import OUR_SIMULATOR
from cruise.evaluation.matches import Match, evaluate_match
from cruise.evaluation.summary import Evaluation
from cruise.interop.flight_controller import rotors_of
from cruise.interop.simulators import SIMULATORS, is_installed


class Flown(NamedTuple):
    """What one simulator showed."""

    simulator: str
    differs: str  # from ours
    evaluation: Evaluation | None  # None: not installed


def fly_everywhere(match: Match, episodes: int, seed: int) -> Iterator[Flown]:
    """Races from the same starts in our simulator and in every other one that is installed.

    Raises:
        CruiseError: the vehicle is not flown by thrust and body rates, or a number is out of range.
    """
    rotors_of(match.vehicle)
    for name, differs in ({OUR_SIMULATOR: ""} | SIMULATORS).items():
        there = name == OUR_SIMULATOR or is_installed(name)
        evaluation = evaluate_match(replace(match, simulator=name), episodes, seed) if there else None
        yield Flown(name, differs, evaluation)
