"""Operations number by number as nodes of an ONNX graph."""

from typing import Any

import numpy as np

from cruise.errors import CruiseError
from cruise.export.onnx_graph import Graph, Rule, joint_shape
from cruise.export.program import Equation


def _elementwise(operator: str, **attributes: Any) -> Rule:
    def rule(graph: Graph, equation: Equation) -> None:
        tensors = [graph.tensor(atom) for atom in equation.inputs]
        name = graph.node(operator, *(tensor.name for tensor in tensors), **attributes)
        graph.keep(equation.outputs[0], name, joint_shape(tensors))

    return rule


def _logical(operator: str) -> Rule:
    """Of flags; JAX has the same name for whole numbers, bit by bit."""
    plain = _elementwise(operator)

    def rule(graph: Graph, equation: Equation) -> None:
        if equation.outputs[0].dtype != bool:
            raise CruiseError(f"an operation on the bits of whole numbers cannot be exported to ONNX: {operator}")
        plain(graph, equation)

    return rule


def _not_equal(graph: Graph, equation: Equation) -> None:
    tensors = [graph.tensor(atom) for atom in equation.inputs]
    name = graph.node("Not", graph.node("Equal", *(tensor.name for tensor in tensors)))
    graph.keep(equation.outputs[0], name, joint_shape(tensors))


def _remainder(graph: Graph, equation: Equation) -> None:
    _elementwise("Mod", fmod=1)(graph, equation)


def _select(graph: Graph, equation: Equation) -> None:
    which, no, yes = (graph.tensor(atom) for atom in equation.inputs)
    shape = joint_shape([which, no, yes])
    graph.keep(equation.outputs[0], graph.node("Where", which.name, yes.name, no.name), shape)


def _clamp(graph: Graph, equation: Equation) -> None:
    low, value, high = (graph.tensor(atom) for atom in equation.inputs)
    name = graph.node("Min", graph.node("Max", value.name, low.name), high.name)
    graph.keep(equation.outputs[0], name, joint_shape([low, value, high]))


def _integer_power(graph: Graph, equation: Equation) -> None:
    tensor = graph.tensor(equation.inputs[0])
    power = graph.constant(np.array(equation.params["y"], equation.outputs[0].dtype))
    graph.keep(equation.outputs[0], graph.node("Pow", tensor.name, power), tensor.shape)


def _reciprocal_root(graph: Graph, equation: Equation) -> None:
    tensor = graph.tensor(equation.inputs[0])
    graph.keep(equation.outputs[0], graph.node("Reciprocal", graph.node("Sqrt", tensor.name)), tensor.shape)


def _square(graph: Graph, equation: Equation) -> None:
    tensor = graph.tensor(equation.inputs[0])
    graph.keep(equation.outputs[0], graph.node("Mul", tensor.name, tensor.name), tensor.shape)


def _arctangent(graph: Graph, equation: Equation) -> None:
    """Of two numbers, from the arctangent of their quotient."""
    y, x = (graph.tensor(atom).name for atom in equation.inputs)
    zero, half, whole = (graph.constant(np.array(value, np.float32)) for value in (0.0, np.pi / 2, np.pi))
    below = graph.node("Less", y, zero)
    straight = graph.node("Atan", graph.node("Div", y, x))
    behind = graph.node("Where", below, graph.node("Sub", straight, whole), graph.node("Add", straight, whole))
    aside = graph.node("Mul", graph.node("Sign", y), half)
    name = graph.node("Where", graph.node("Less", x, zero), behind, aside)
    name = graph.node("Where", graph.node("Greater", x, zero), straight, name)
    graph.keep(equation.outputs[0], name, joint_shape([graph.tensor(atom) for atom in equation.inputs]))


def _cast(graph: Graph, equation: Equation) -> None:
    (atom,), (var,) = equation.inputs, equation.outputs
    tensor = graph.tensor(atom)
    kind = graph.onnx.helper.np_dtype_to_tensor_dtype(var.dtype)
    same = atom.dtype == var.dtype
    graph.keep(var, tensor.name if same else graph.node("Cast", tensor.name, to=kind), tensor.shape)


def _same(graph: Graph, equation: Equation) -> None:
    graph.keep(equation.outputs[0], *graph.tensor(equation.inputs[0]))


RULES: dict[str, Rule] = {
    **{name: _elementwise(name.capitalize()) for name in ("add", "sub", "mul", "div", "max", "min", "neg", "exp")},
    **{name: _elementwise(name.capitalize()) for name in ("abs", "log", "sin", "cos", "tan", "tanh", "sqrt", "floor")},
    **{name: _elementwise(name.capitalize()) for name in ("ceil", "sign", "pow", "erf", "asin", "acos", "atan")},
    **{name: _logical(name.capitalize()) for name in ("and", "or", "not", "xor")},
    "eq": _elementwise("Equal"),
    "lt": _elementwise("Less"),
    "gt": _elementwise("Greater"),
    "le": _elementwise("LessOrEqual"),
    "ge": _elementwise("GreaterOrEqual"),
    "ne": _not_equal,
    "atan2": _arctangent,
    "logistic": _elementwise("Sigmoid"),
    "round": _elementwise("Round"),
    "rem": _remainder,
    "rsqrt": _reciprocal_root,
    "square": _square,
    "integer_pow": _integer_power,
    "clamp": _clamp,
    "select_n": _select,
    "convert_element_type": _cast,
    "copy": _same,
    "stop_gradient": _same,
}
