"""What others printed or computed, to hold our figures against. Every number has its source here.

The paper is Akgün, *Curriculum-Based Iterative Self-Play for Scalable Multi-Drone Racing*.
"""

from typing import NamedTuple


class Printed(NamedTuple):
    """A row of the paper's result tables: mean and standard deviation over 100 episodes. None where it says N/A."""

    lap: float | None  # track length / mean speed [s]
    lap_std: float | None
    speed: float | None  # [m/s]
    speed_std: float | None
    success: float  # [%]


# (track, kind, drones): the paper's tables "Performance comparison on the Ring Track" and "... Figure-Eight Track".
TABLES: dict[tuple[str, str, int], Printed] = {
    ("ring", "cruise", 2): Printed(13.3, 0.1, 4.4, 0.0, 100),
    ("ring", "se-ibr", 2): Printed(26.0, 1.0, 2.3, 0.1, 100),
    ("ring", "vanilla", 2): Printed(20.9, 0.0, 2.8, 0.0, 50),
    ("ring", "cruise", 3): Printed(13.4, 0.2, 4.4, 0.1, 91.3),
    ("ring", "se-ibr", 3): Printed(26.2, 0.7, 2.2, 0.1, 90),
    ("ring", "vanilla", 3): Printed(None, None, None, None, 0),
    ("ring", "cruise", 4): Printed(13.6, 0.5, 4.3, 0.2, 93.5),
    ("ring", "se-ibr", 4): Printed(26.1, 0.8, 2.3, 0.1, 50),
    ("ring", "vanilla", 4): Printed(None, None, None, None, 0),
    ("figure-eight", "cruise", 2): Printed(16.1, 0.3, 3.5, 0.1, 98),
    ("figure-eight", "se-ibr", 2): Printed(30.9, 0.8, 1.8, 0.1, 90),
    ("figure-eight", "vanilla", 2): Printed(27.4, 0.1, 2.1, 0.0, 100),
    ("figure-eight", "cruise", 3): Printed(16.2, 1.7, 3.5, 0.4, 98),
    ("figure-eight", "se-ibr", 3): Printed(34.0, 3.7, 1.7, 0.2, 90),
    ("figure-eight", "vanilla", 3): Printed(28.3, 0.2, 2.0, 0.0, 43.3),
    ("figure-eight", "cruise", 4): Printed(16.7, 0.7, 3.4, 0.1, 97),
    ("figure-eight", "se-ibr", 4): Printed(36.6, 6.4, 1.6, 0.3, 100),
    ("figure-eight", "vanilla", 4): Printed(31.1, 0.9, 1.8, 0.1, 30),
}
SPEED_FACTOR = 1.9  # of CRUISE over SE-IBR on both tracks: "nearly double the planner's mean racing speed"

# (track, drones): mean speed after stages 1 to 5 [m/s], read from the result files of the paper's repository
# (github Onurion/CurriculumDroneRacing); its figures "Ablation study on the Ring Track" and "... Figure-Eight Track".
STAGE_SPEEDS: dict[tuple[str, int], tuple[float, ...]] = {
    ("ring", 2): (1.98, 2.77, 3.29, 3.80, 4.45),
    ("ring", 3): (2.12, 2.24, 3.14, 3.86, 4.37),
    ("ring", 4): (1.97, 2.79, 2.47, 3.95, 4.35),
    ("figure-eight", 2): (0.24, 2.03, 2.37, 2.96, 3.51),
    ("figure-eight", 3): (1.46, 2.03, 2.41, 2.65, 3.38),
    ("figure-eight", 4): (1.30, 2.03, 2.42, 3.05, 3.41),
}


class Limit(NamedTuple):
    """The fastest lap of one drone alone, in periodic flight, crossing every gate 0.25 m inside its opening."""

    name: str
    ring: float  # [s]
    figure_eight: float  # [s]

    def lap(self, track: str) -> float:
        """Of a track [s]."""
        return {"ring": self.ring, "figure-eight": self.figure_eight}[track]


# Computed for this project by direct transcription (IPOPT with exact Hessians), checked by refining the grid, by random
# starts and by flying the solution again. "Free" ones are the best found, not proven.
GENTLE = Limit("paper's vehicle, gentle commands (action changes by at most 0.2 a step)", 13.1, 17.35)
FREE = Limit("paper's vehicle, free commands, thrust never negative", 12.1, 15.6)
UNPHYSICAL = Limit("paper's vehicle as printed, thrust may be negative", 10.9, 13.7)
AGILE = Limit("quadrotor with thrust-to-weight 3.3 and body-rate control, without drag", 3.44, 4.35)
LIMITS = (GENTLE, FREE, UNPHYSICAL, AGILE)
