"""`import cruise.gym` registers the races with Gymnasium, as `gymnasium.make("cruise.gym:cruise/Race-v0")` does itself.

The second form needs no import anywhere: it is the one for workers in other processes.
"""

from cruise.adapters.doors import adapter

gymnasium = adapter("gymnasium")

RACE = "cruise/Race-v0"
FIELD = "cruise/Field-v0"
ENTRIES = {
    RACE: {
        "entry_point": "cruise.adapters.gymnasium_env:RaceEnv",
        "vector_entry_point": "cruise.adapters.gymnasium_vector:VectorRaceEnv",
    },
    FIELD: {"vector_entry_point": "cruise.adapters.gymnasium_vector:VectorFieldEnv"},
}

for _name, _entry in ENTRIES.items():
    if _name not in gymnasium.registry:
        gymnasium.register(_name, **_entry)
