"""The roofline: the arithmetic a program asks for, the bytes it moves, and how near they come to this machine's best.

Both are counted in the program as it is written, its loops unrolled, before XLA fuses it; XLA's own count takes what a
loop repeats once. Bytes are those that the best fusion still reads and writes: what a loop carries, takes and leaves in
every round, operands and results of matrix products, and what is read by index. Chains of elementwise operations move
nothing.
"""

import math
from collections.abc import Iterable
from functools import reduce
from typing import NamedTuple

import jax.numpy as jnp
from jax.extend import core

# One operation per number of the result, or of the operand where that is summed or compared.
ELEMENTWISE = frozenset(
    {"abs", "add", "clamp", "div", "floor", "integer_pow", "max", "min", "mul", "neg", "rem", "round", "sign", "sub"}
    | {"acos", "asin", "atan", "atan2", "cos", "exp", "exp2", "expm1", "log", "log1p", "logistic", "pow", "rsqrt"}
    | {"sin", "sqrt", "square", "tan", "tanh"}
)
REDUCTIONS = frozenset({"cumprod", "cumsum", "reduce_max", "reduce_min", "reduce_prod", "reduce_sum"})
BY_INDEX = frozenset({"dynamic_slice", "gather"})


class Cost(NamedTuple):
    """Of a program, or of one unit of what it does."""

    flop: float  # floating-point operations
    bytes: float  # read and written

    def times(self, factor: float) -> "Cost":
        """So many of it."""
        return Cost(self.flop * factor, self.bytes * factor)


class Ceiling(NamedTuple):
    """What this machine does at most, measured in the same rounds."""

    flop_per_s: float  # of a large matrix product
    bytes_per_s: float  # of going once over a large array, read and written


def count(program: core.ClosedJaxpr) -> Cost:
    """What a traced program (`jax.jit(f).trace(...).jaxpr`) costs, on all devices together.

    Of a condition the cheapest branch counts.

    Raises:
        ValueError: how often one of its loops runs is not known beforehand.
    """
    return _of_program(program.jaxpr)


def shares(cost: Cost, per_second: float, ceiling: Ceiling) -> dict[str, float]:
    """The cost of one unit and, at so many units per second, how near they come to either ceiling."""
    return {
        "flop": cost.flop,
        "bytes": cost.bytes,
        "flop_share": per_second * cost.flop / ceiling.flop_per_s,
        "copy_share": per_second * cost.bytes / ceiling.bytes_per_s,
    }


def _of_program(program: core.Jaxpr) -> Cost:
    return _total(map(_of_equation, program.eqns))


def _total(costs: Iterable[Cost]) -> Cost:
    return reduce(lambda a, b: Cost(a.flop + b.flop, a.bytes + b.bytes), costs, Cost(0.0, 0.0))


def _of_equation(equation: core.JaxprEqn) -> Cost:
    name = equation.primitive.name
    inner = [_of_program(program) for program in core.jaxprs_in_params(equation.params)]
    if name == "scan":
        return _of_loop(equation, inner[0])
    if name == "while":
        raise ValueError("how often a `while` loop runs is not known beforehand")
    if name == "shard_map":
        return inner[0].times(equation.params["mesh"].size)
    return min(inner) if inner else Cost(_flop(equation), _moved(equation))


def _of_loop(equation: core.JaxprEqn, body: Cost) -> Cost:
    """Every round of it, with what passes into a round and out of it; what all rounds share stays where it is."""
    program = equation.params["jaxpr"].jaxpr
    passing = [*program.invars[equation.params["num_consts"] :], *program.outvars]
    return _total([body, Cost(0.0, sum(map(_size, passing)))]).times(equation.params["length"])


def _flop(equation: core.JaxprEqn) -> float:
    name, result = equation.primitive.name, equation.outvars[0].aval
    if not jnp.issubdtype(result.dtype, jnp.floating):
        return 0.0
    if name == "dot_general":
        (contracted, _), _ = equation.params["dimension_numbers"]
        return 2.0 * math.prod(equation.invars[0].aval.shape[axis] for axis in contracted) * result.size
    if name in ELEMENTWISE:
        return float(result.size)
    return float(equation.invars[0].aval.size) if name in REDUCTIONS else 0.0


def _moved(equation: core.JaxprEqn) -> float:
    if equation.primitive.name == "dot_general":
        return sum(map(_size, (*equation.invars, *equation.outvars)))
    return 2.0 * sum(map(_size, equation.outvars)) if equation.primitive.name in BY_INDEX else 0.0


def _size(variable: core.Var | core.Literal) -> float:
    """Of an array [bytes]."""
    return float(variable.aval.size * variable.aval.dtype.itemsize)
