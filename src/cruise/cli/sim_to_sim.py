"""`cruise sim-to-sim`: pilots flown unchanged in simulators that are not ours."""

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rich.table import Column, Table

from cruise.cli.compilation import prepare_flight
from cruise.cli.console import make_console
from cruise.cli.evaluate import counted, number
from cruise.cli.line_up import LineUp
from cruise.config import OUR_SIMULATOR
from cruise.errors import CruiseError
from cruise.extras import how_to_install

if TYPE_CHECKING:
    from cruise.evaluation.sim_to_sim import Flown


@dataclass(frozen=True)
class SimToSim:
    """Fly the same races in our simulator, MuJoCo, RotorPy, Crazyflow and Betaflight."""

    line_up: LineUp = field(default_factory=LineUp)
    episodes: int = 100
    """Races in each simulator, from the same starts."""
    seed: int = 0
    """Seed of the starts, which are never those of training."""
    json: bool = False
    """Print one JSON object instead of a table."""

    def run(self) -> int:
        """Fly the races and print what they show."""
        if self.line_up.simulator != OUR_SIMULATOR:
            raise CruiseError("sim-to-sim flies in all simulators: leave out --simulator")
        prepare_flight()
        from cruise.evaluation.sim_to_sim import fly_everywhere  # noqa: PLC0415  (imports JAX)

        found = list(fly_everywhere(self.line_up.match(), self.episodes, self.seed))
        if self.json:
            print(json.dumps({one.simulator: _plain(one) for one in found}, indent=2, allow_nan=False))
        else:
            make_console().print(simulator_table(found))
        return 0


def simulator_table(found: "list[Flown]") -> Table:
    """One row per simulator; laps beside ours."""
    ours = found[0].evaluation
    assert ours is not None
    title = f"{ours.policy} on {ours.track}: {counted(ours.episodes, 'race')} of {ours.drones}, seed {ours.seed}"
    numbers = (Column(name, justify="right") for name in ("finished %", "flying lap [s]", "to ours"))
    table = Table("simulator", *numbers, "what differs", title=title)
    for one in found:
        if one.evaluation is None:
            table.add_row(one.simulator, "-", "-", "-", f"not installed: {how_to_install(one.simulator)}")
            continue
        success, lap = one.evaluation.success_rate, one.evaluation.flying_lap_time.mean
        change = 100 * (lap / ours.flying_lap_time.mean - 1)
        cells = (f"{100 * success.mean:.1f}", number(lap), "" if one is found[0] else f"{change:+.1f} %")
        table.add_row(one.simulator, *cells, one.differs)
    return table


def _plain(one: "Flown") -> dict[str, Any] | None:
    return None if one.evaluation is None else one.evaluation.to_dict() | {"differs": one.differs}
