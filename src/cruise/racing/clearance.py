"""How far points are from solids, for who plans around them. NumPy, or CasADi's symbols."""

from typing import NamedTuple

from cruise import geometry
from cruise.geometry import Number, Vector
from cruise.racing.solids import Outline


class Clearance(NamedTuple):
    """Beyond the faces of a solid, negative inside [m]; outside is who is beyond either."""

    beside: Number  # its sides; at the corners of a box the larger of the two distances to its sides
    above: Number  # its top, or below its bottom

    @property
    def distance(self) -> Number:
        """The larger of both: to the solid, or a little less at its edges [m]."""
        return geometry.functions(self.beside, self.above).maximum(self.beside, self.above)


def clearance(solid: Outline, point_w: Vector) -> Clearance:
    """Of points, three components each, from one solid."""
    offset = tuple(point_w[axis] - solid.centre_w[axis] for axis in range(3))
    along, across, up = geometry.to_gate(geometry.heading_of(solid.yaw), offset)
    xp = geometry.functions(along, across, up)
    length, thickness, height = solid.size
    if solid.shape == "cylinder":
        beside = xp.sqrt(along * along + across * across) - length / 2
    else:
        beside = xp.maximum(xp.abs(along) - length / 2, xp.abs(across) - thickness / 2)
    return Clearance(beside, xp.abs(up) - height / 2)
