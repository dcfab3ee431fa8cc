"""Scalar expressions of C: made once each, folded where they are constant, written where they are used."""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

FLOAT, INT, BOOL = np.dtype(np.float32), np.dtype(np.int32), np.dtype(bool)
NAMES = {FLOAT: "float", INT: "int", BOOL: "int"}
LONGEST = 90  # characters of an expression that is written inside another
ATOM, SIGN, PRODUCT, SUM, ORDER, CHOICE = 6, 5, 4, 3, 2, 0  # how strongly operators bind


class Node:
    """An expression. Those that say the same are the same object."""

    def __init__(
        self, operator: str, inputs: tuple["Node", ...], kind: np.dtype, text: str, value: Any, index: bool
    ) -> None:
        """By `leaf`, `number` and `node` alone."""
        self.operator, self.inputs, self.kind = operator, inputs, kind
        self.text = text  # of a leaf; with "@" where the index of its place among others comes
        self.value = value  # of a constant
        self.index = index  # depends on the index that is open


_made = functools.lru_cache(maxsize=1 << 18)(Node)


def leaf(text: str, kind: np.dtype = FLOAT) -> Node:
    """Something that C knows by this text; "@" stands for the index that is open."""
    return _made("leaf", (), kind, text, None, "@" in text)


INDEX = leaf("@", INT)  # the open one


def number(value: Any, kind: np.dtype) -> Node:
    """A constant."""
    value = kind.type(value).item()
    return _made("constant", (), kind, repr(value), value, False)


FOLDED: dict[str, Callable[..., object]] = {
    **{"add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.true_divide, "neg": np.negative},
    **{"eq": np.equal, "ne": np.not_equal, "lt": np.less, "le": np.less_equal, "gt": np.greater},
    **{"ge": np.greater_equal, "and": np.logical_and, "or": np.logical_or, "not": np.logical_not},
    **{"max": np.maximum, "min": np.minimum, "rem": np.fmod},
}


def node(operator: str, kind: np.dtype, *inputs: Node) -> Node:
    """An expression, or what it comes to."""
    values = [one.value for one in inputs]
    if operator in FOLDED and None not in values:
        with np.errstate(all="ignore"):
            folded = FOLDED[operator](*(one.kind.type(one.value) for one in inputs))
        return number(np.asarray(folded).item(), kind)
    if operator in ("max", "min") and values[0] is not None:
        inputs = inputs[::-1]
    simple = _simple(operator, kind, inputs)
    return simple or _made(operator, inputs, kind, "", None, any(one.index for one in inputs))


def _simple(operator: str, kind: np.dtype, inputs: tuple[Node, ...]) -> Node | None:
    """A simpler expression that comes to the same for finite numbers."""
    if operator == "select":
        return _chosen(*inputs)
    if operator == "cast":
        (only,) = inputs
        return number(only.value, kind) if only.value is not None else only if only.kind == kind else None
    if len(inputs) != 2:
        return None
    first, second = inputs
    if first.value is not None and operator in ("add", "mul", "max", "min", "and", "or"):
        first, second = second, first  # the constant comes second
    if second.value is not None:
        return _with_constant(operator, kind, first, second)
    if operator in ("add", "sub") and second.operator == "neg":
        return node("sub" if operator == "add" else "add", kind, first, second.inputs[0])
    if operator == "add" and first.operator == "neg":
        return node("sub", kind, second, first.inputs[0])
    return None


def _chosen(condition: Node, no: Node, yes: Node) -> Node | None:
    if condition.value is not None:
        return yes if condition.value else no
    return no if no is yes else None


def _with_constant(operator: str, kind: np.dtype, first: Node, constant: Node) -> Node | None:
    """Whose second input is a constant."""
    value = constant.value
    if operator in ("and", "or"):
        return first if bool(value) == (operator == "and") else constant
    if (operator in ("mul", "div") and value == 1) or (operator in ("add", "sub") and value == 0):
        return first
    if operator == "mul" and value in (0, -1):
        return node("neg", kind, first) if value else constant
    if operator == "lt" and value == 0 and is_natural(first):
        return number(False, BOOL)
    if operator == "eq" and value == 0 and first.text == "num_gates":
        return number(False, BOOL)
    if operator == "min" and first.operator == "max" and first.inputs[1].value is not None:
        return node("clip", kind, *first.inputs, constant)
    return None


NATURAL = ("state->next_gate", "num_gates")  # whole numbers that are never below 0


def is_natural(one: Node) -> bool:
    """Whether a whole number cannot be below 0."""
    if one.kind != INT:
        return False
    if one.operator in ("add", "rem"):
        return all(map(is_natural, one.inputs))
    return one.text in NATURAL or (one.value is not None and one.value >= 0)


def placed(one: Node, at: Node, memo: dict[Node, Node]) -> Node:
    """An expression with another index in place of the open one."""
    if not one.index:
        return one
    if one not in memo:
        if one is INDEX:
            memo[one] = at
        elif one.operator == "leaf":
            memo[one] = _made("at", (at,), one.kind, one.text, None, at.index)
        elif one.operator == "at":
            inner = placed(one.inputs[0], at, memo)
            memo[one] = _made("at", (inner,), one.kind, one.text, None, inner.index)
        else:
            memo[one] = node(one.operator, one.kind, *(placed(each, at, memo) for each in one.inputs))
    return memo[one]


def literal(value: float) -> str:
    """A float of C that reads back as the same number."""
    if not math.isfinite(value):
        return "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "(-INFINITY)"
    number, size = np.float32(value), abs(value)
    if size == 0 or 1e-3 <= size < 1e7:
        return f"{np.format_float_positional(number, unique=True, trim='0')}f"
    return f"{np.format_float_scientific(number, unique=True, trim='0', exp_digits=1)}f"


BINARY = {
    **{"mul": ("*", PRODUCT), "div": ("/", PRODUCT), "add": ("+", SUM), "sub": ("-", SUM)},
    **{"lt": ("<", ORDER), "le": ("<=", ORDER), "gt": (">", ORDER), "ge": (">=", ORDER)},
    **{"eq": ("==", ORDER), "ne": ("!=", ORDER)},
}
FUNCTIONS = {
    **{name: f"{name}f" for name in ("sqrt", "sin", "cos", "tan", "tanh", "exp", "log", "floor", "ceil", "pow", "erf")},
    **{name: f"{name}f" for name in ("asin", "acos", "atan", "atan2", "sinh", "cosh", "log1p", "expm1", "cbrt")},
    "abs": "fabsf",
    "round": "rintf",
}
OWN_FUNCTIONS = ("max", "min", "clip")  # that the header defines


class Text(NamedTuple):
    """Of an expression, and how strongly its outermost operator binds."""

    text: str
    binds: int

    def inside(self, binds: int) -> str:
        """The text in an operator that binds so strongly."""
        return self.text if self.binds >= binds else f"({self.text})"


def written(one: Node, inputs: list[Text], prefix: str) -> Text:  # noqa: PLR0911  (one for each kind of operator)
    """The text of an expression, given those of its inputs."""
    operator = one.operator
    if operator == "constant":
        assert one.value is not None
        return Text(literal(one.value) if one.kind == FLOAT else str(int(one.value)), ATOM if one.value >= 0 else SIGN)
    if operator == "leaf":
        return Text(one.text.replace("@", "i"), ATOM)
    if operator == "at":
        return Text(one.text.replace("@", inputs[0].text), ATOM)
    if operator in BINARY:
        sign, binds = BINARY[operator]
        left = binds + (binds == ORDER)
        return Text(f"{inputs[0].inside(left)} {sign} {inputs[1].inside(binds + 1)}", binds)
    if operator in ("and", "or"):
        return Text(f" {'&&' if operator == 'and' else '||'} ".join(one.inside(ORDER) for one in inputs), ORDER - 1)
    if operator in ("neg", "not"):
        return Text(f"{'-' if operator == 'neg' else '!'}{inputs[0].inside(SIGN + 1)}", SIGN)
    if operator == "select":
        condition, no, yes = inputs
        return Text(f"{condition.inside(ORDER - 1)} ? {yes.inside(CHOICE + 1)} : {no.inside(CHOICE)}", CHOICE)
    if operator == "cast":
        if one.kind == BOOL:
            return Text(f"{inputs[0].inside(ORDER + 1)} != 0", ORDER)
        return Text(f"({NAMES[one.kind]}){inputs[0].inside(SIGN)}", SIGN)
    if operator == "rem":
        if one.kind == INT:
            return Text(f"{inputs[0].inside(PRODUCT)} % {inputs[1].inside(SIGN)}", PRODUCT)
        return Text(f"fmodf({inputs[0].text}, {inputs[1].text})", ATOM)
    name = f"{prefix}_{operator}" if operator in OWN_FUNCTIONS else FUNCTIONS[operator]
    return Text(f"{name}({', '.join(one.text for one in inputs)})", ATOM)
