"""Gates and solids of the track that a race was flown on, as its log keeps them."""

from cruise.config import Gate
from cruise.racing.solids import Outline
from cruise.storage.race_log import RaceLog


def gates_of(log: RaceLog) -> tuple[Gate, ...]:
    """In the order of flight."""
    columns = (log.gate_position, log.gate_yaw, log.gate_size, log.gate_roll, log.gate_pitch, log.gate_shape)
    return tuple(
        Gate((x, y, z), yaw, width, height, roll, pitch, shape)
        for (x, y, z), yaw, (width, height), roll, pitch, shape in zip(*(c.tolist() for c in columns), strict=True)
    )


def solids_of(log: RaceLog) -> tuple[Outline, ...]:
    """Poles, walls and what else stood there."""
    columns = (log.solid_kind, log.solid_shape, log.solid_position, log.solid_size, log.solid_yaw)
    return tuple(
        Outline(kind, shape, (x, y, z), (length, width, height), yaw)
        for kind, shape, (x, y, z), (length, width, height), yaw in zip(*(c.tolist() for c in columns), strict=True)
    )
