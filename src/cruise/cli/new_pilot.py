"""`cruise new-pilot`: a pilot in Python to start from."""

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated

import tyro

from cruise.errors import CruiseError

TEMPLATE = "pilot_template.py.in"


@dataclass(frozen=True)
class NewPilot:
    """Write a working pilot in plain Python, to change to your liking."""

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE.py")] = Path("my_pilot.py")
    """Where. An existing file is never overwritten."""

    def run(self) -> int:
        """Write it and say how to fly it."""
        from cruise.storage.atomic import write_atomically  # noqa: PLC0415

        if self.file.suffix != ".py":
            raise CruiseError(f"a pilot is a .py file, got {str(self.file)!r}")
        if self.file.exists():
            raise CruiseError(f"{self.file} exists already; name another file")
        write_atomically(self.file, resources.files("cruise.cli").joinpath(TEMPLATE).read_bytes())
        print(f"{self.file} flies the ring. Try it, then change it:")
        print(f"  cruise race --track ring --pilot {self.file}:Pilot")
        print(f"  cruise race --track ring --pilot {self.file}:Pilot --pilot chaser --drones 2")
        print(f"  cruise evaluate --track ring --drones 2 --pilot {self.file}:Pilot --episodes 20")
        return 0
