"""`cruise observations`: what policies may observe by, number by number."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from cruise.cli.line_up import DEFAULT_TRACK, described
from cruise.errors import CruiseError
from cruise.racing.track_file import load_track
from cruise.vehicles import load_vehicle

MAX_DRONES = 64


@dataclass(frozen=True)
class Observations:
    """List the observations, or print every number of one as a table in Markdown."""

    name: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="NAME")] = None
    """An observation. By default all are listed."""
    track: Annotated[str, described("NAME|FILE")] = DEFAULT_TRACK
    """Where; some observations know the number of its gates."""
    drones: Annotated[int, described("N")] = 2
    """How many drones race."""
    vehicle: Annotated[str, described("NAME|FILE")] = "paper"
    """What flies: it says what it feels of itself."""
    terms: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, described("FILE.py")] = ()
    """Python file that declares observations of your own; its code is run. Repeatable."""

    def run(self) -> int:
        """Print the list or the table."""
        from cruise.dynamics import make_dynamics  # noqa: PLC0415  (imports JAX, as the next three do)
        from cruise.env.observation import OBSERVATIONS, find_observation  # noqa: PLC0415
        from cruise.env.term_tables import markdown, observation_size, observation_table  # noqa: PLC0415
        from cruise.pilots.terms_file import load_all_terms  # noqa: PLC0415
        from cruise.terms import Setting  # noqa: PLC0415

        if not 1 <= self.drones <= MAX_DRONES:
            raise CruiseError(f"--drones must be from 1 to {MAX_DRONES}, got {self.drones}")
        load_all_terms(self.terms)
        setting = Setting(self.drones, len(load_track(self.track).gates), make_dynamics(load_vehicle(self.vehicle)))
        if self.name is not None:
            print(observation_table(find_observation(self.name), setting))
            return 0
        rows = [(one.name, str(observation_size(one, setting)), one.about) for one in OBSERVATIONS.values()]
        print(markdown(("observation", "numbers", "what it is for"), rows))
        return 0
