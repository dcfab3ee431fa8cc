"""Operations number by number on arrays of expressions."""

import functools
from collections.abc import Callable

import numpy as np

from cruise.export.c_arrays import Arrays, Rule, mapped
from cruise.export.c_expressions import BOOL, FLOAT, FUNCTIONS, Node, node, number
from cruise.export.program import Equation


def _elementwise(operator: str) -> Rule:
    def rule(run: Arrays, equation: Equation) -> np.ndarray:
        (var,) = equation.outputs
        return mapped(run.alike(equation.inputs, var.shape), functools.partial(node, operator, var.dtype))

    return rule


def _composed(function: Callable[..., Node]) -> Rule:
    """From operators that C has."""

    def rule(run: Arrays, equation: Equation) -> np.ndarray:
        return mapped(run.alike(equation.inputs, equation.outputs[0].shape), function)

    return rule


def _float(operator: str, *inputs: Node) -> Node:
    return node(operator, FLOAT, *inputs)


ONE, ZERO = number(1.0, FLOAT), number(0.0, FLOAT)


def _sign(x: Node) -> Node:
    below = node("select", FLOAT, node("lt", BOOL, x, ZERO), ZERO, number(-1.0, FLOAT))
    return node("select", FLOAT, node("gt", BOOL, x, ZERO), below, ONE)


def _power(run: Arrays, equation: Equation) -> np.ndarray:
    power = equation.params["y"]

    def raised(x: Node) -> Node:
        product = functools.reduce(functools.partial(_float, "mul"), [x] * abs(power)) if power else ONE
        return product if power >= 0 else _float("div", ONE, product)

    return mapped(run.alike(equation.inputs, equation.outputs[0].shape), raised)


RULES: dict[str, Rule] = {
    **{name: _elementwise(name) for name in ("add", "sub", "mul", "div", "max", "min", "neg", "rem", "and", "or")},
    **{name: _elementwise(name) for name in ("eq", "ne", "lt", "le", "gt", "ge", "not", *FUNCTIONS)},
    "logistic": _composed(lambda x: _float("div", ONE, _float("add", ONE, _float("exp", _float("neg", x))))),
    "rsqrt": _composed(lambda x: _float("div", ONE, _float("sqrt", x))),
    "square": _composed(lambda x: _float("mul", x, x)),
    "sign": _composed(_sign),
    "clamp": _composed(lambda low, x, high: _float("min", _float("max", x, low), high)),
    "integer_pow": _power,
    "select_n": _elementwise("select"),
    "convert_element_type": _elementwise("cast"),
}
