"""How a flag says a vehicle: by name or file, and never number by number."""

from typing import Any

import tyro

from cruise.config import Vehicle
from cruise.vehicles import load_vehicle, name_of, reference_to

METAVAR = "NAME|FILE"


def vehicle_flags() -> tyro.constructors.ConstructorRegistry:
    """What the parser is to know of fields that hold a preset's name or a vehicle of one's own."""
    registry = tyro.constructors.ConstructorRegistry()

    @registry.primitive_rule
    def rule(info: tyro.constructors.PrimitiveTypeInfo) -> tyro.constructors.PrimitiveConstructorSpec[Any] | None:
        if info.type != str | Vehicle:
            return None
        return tyro.constructors.PrimitiveConstructorSpec(
            nargs=1,
            metavar=METAVAR,
            instance_from_str=lambda words: reference_to(load_vehicle(words[0])),
            is_instance=lambda value: isinstance(value, str | Vehicle),
            str_from_instance=lambda value: [name_of(value)],
        )

    return registry
