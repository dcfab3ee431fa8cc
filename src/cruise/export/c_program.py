"""Runs a program over arrays of expressions."""

import numpy as np

from cruise.errors import CruiseError
from cruise.export import c_moves, c_numbers
from cruise.export.c_arrays import Arrays
from cruise.export.program import Program

RULES = c_numbers.RULES | c_moves.RULES


def run(arrays: Arrays, program: Program, inputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Expressions of the outputs. Raises CruiseError where the program has an operation that is not known here."""
    arrays.values |= {var: inputs[name] for name, var in program.inputs.items() if name in inputs}
    for equation in program.equations:
        if equation.primitive not in RULES:
            raise CruiseError(f"an operation cannot be exported to C: {equation.primitive}")
        results = RULES[equation.primitive](arrays, equation)
        results = results if isinstance(results, list) else [results]
        arrays.values |= dict(zip(equation.outputs, results, strict=True))
    return {name: arrays.closed(atom) for name, atom in program.outputs.items()}
