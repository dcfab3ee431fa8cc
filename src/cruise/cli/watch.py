"""The live view of `cruise race` and `cruise train`."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cruise.training.session import Session
    from cruise.training.trainer import Progress
    from cruise.viewer.live_server import LiveServer


@dataclass(frozen=True)
class Watch:
    """Serve a live page."""

    watch: bool = False
    """Serve a page that shows races as they are flown, on this machine alone. Its address is printed."""
    port: int = 0
    """Port of that page; by default a free one."""

    def server(self, title: str) -> "LiveServer":
        """A server whose address has been printed."""
        from cruise.viewer.live_server import LiveServer  # noqa: PLC0415

        server = LiveServer(title, self.port)
        print(f"watch    {server.address}", flush=True)
        return server

    @contextlib.contextmanager
    def training(self, session: "Session") -> Iterator[Callable[["Progress"], None]]:
        """What to call after every update of a run, so that those who watch see the policy race."""
        from cruise.training.hosts import is_first  # noqa: PLC0415  (imports JAX)

        if not (self.watch and is_first()):
            yield lambda progress: None
            return
        from cruise.vehicles import find_vehicle  # noqa: PLC0415
        from cruise.viewer.training_races import TrainingRaces  # noqa: PLC0415

        config, track = session.config, session.track
        with self.server(f"{track.name}, training") as server:
            vehicle, steps = find_vehicle(config.vehicle), session.trainer.total_steps
            races = TrainingRaces(server.broadcast, config, track, vehicle, steps)
            try:
                yield races.offer
            finally:
                races.close()
