"""Gates and solids of the track that a race was flown on, as its log keeps them."""

from cruise.config import Gate
from cruise.racing.motion import motion_of_row
from cruise.racing.solids import Outline
from cruise.storage.race_log import RaceLog


def gates_of(log: RaceLog) -> tuple[Gate, ...]:
    """In the order of flight; those that move where they are at rest."""
    turns = (log.gate_yaw, log.gate_roll, log.gate_pitch)
    columns = (log.gate_position, *turns, log.gate_size, log.gate_shape, log.gate_motion)
    return tuple(
        Gate((x, y, z), yaw, width, height, roll, pitch, shape, motion_of_row(row))
        for (x, y, z), yaw, roll, pitch, (width, height), shape, row in zip(*(c.tolist() for c in columns), strict=True)
    )


def solids_of(log: RaceLog) -> tuple[Outline, ...]:
    """Poles, walls and what else stood there."""
    columns = (log.solid_kind, log.solid_shape, log.solid_position, log.solid_size, log.solid_yaw)
    return tuple(
        Outline(kind, shape, (x, y, z), (length, width, height), yaw)
        for kind, shape, (x, y, z), (length, width, height), yaw in zip(*(c.tolist() for c in columns), strict=True)
    )
