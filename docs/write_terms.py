"""Writes the tables of observations and reward terms from their declarations: `python -m docs.write_terms`."""

from pathlib import Path

from cruise.dynamics import make_dynamics
from cruise.env.observation import OWN
from cruise.env.term_tables import frames_table, observation_size, observation_table, phases_table, reward_table
from cruise.presets import REWARDS, TRACKS, VEHICLES
from cruise.terms import Setting

DOCS = Path(__file__).parent
BEGIN, END = "<!-- written by docs/write_terms.py -->", "<!-- to here -->"
VEHICLES_SHOWN = {
    "extended": ("paper", "racer"),
    "paper": ("paper",),
    "body": ("racer", "paper"),
    "body-near": ("racer",),
    "body-placed": ("racer",),
    "body-far": ("racer",),
    "racing": ("racer",),
    "racing-near": ("racer",),
    "racing-far": ("racer",),
}
TRACK, DRONES = "ring", 2


def observations() -> str:
    """Every observation of CRUISE, with every number of it."""
    parts = [frames_table()]
    for observation in OWN:
        for vehicle in VEHICLES_SHOWN[observation.name]:
            setting = Setting(DRONES, len(TRACKS[TRACK].gates), make_dynamics(VEHICLES[vehicle]))
            size = observation_size(observation, setting)
            parts.append(f"### `{observation.name}`, vehicle `{vehicle}`")
            parts.append(f"{observation.about} {size} numbers for {DRONES} drones on {TRACK}.")
            parts.append(observation_table(observation, setting))
    return "\n\n".join(parts)


def reward() -> str:
    """The terms of the reward and their weights."""
    weights = (("printed", REWARDS["paper"]), ("default", REWARDS["default"]), ("agile", REWARDS["agile"]))
    return f"{phases_table()}\n\n{reward_table(weights)}"


PAGES = {"observations.md": observations, "reward.md": reward}


def page(name: str) -> str:
    """The page as it should be: what a person wrote, and between the marks what is written here."""
    before, rest = (DOCS / name).read_text().split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n\n{PAGES[name]()}\n\n{END}{after}"


if __name__ == "__main__":
    for name in PAGES:
        (DOCS / name).write_text(page(name))
