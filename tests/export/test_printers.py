"""What is printed as ONNX or C computes what the function computes in JAX, operation by operation."""

import subprocess

import jax
import jax.numpy as jnp
import numpy as np
import onnxruntime
import pytest

from cruise.errors import CruiseError
from cruise.export.c_arrays import Arrays
from cruise.export.c_expressions import BOOL, FLOAT, leaf
from cruise.export.c_harness import FLAGS, compiler
from cruise.export.c_printer import statements
from cruise.export.c_program import run
from cruise.export.onnx_printer import OPSET, write
from cruise.export.trace import trace
from cruise.vector import norm, sin_cos, stored

WEIGHT = np.random.default_rng(1).normal(size=(20, 6)).astype(np.float32)
BACK = np.random.default_rng(2).normal(size=(6, 20)).astype(np.float32)


def gru(x, flags):
    """A gated step: slices, sums and products of long vectors."""
    hidden = jnp.tanh(WEIGHT @ x)
    gates = jax.nn.sigmoid(jnp.concatenate([hidden, hidden * 0.5]) + jnp.linspace(-1, 1, 40))
    update, reset = gates[:20], gates[20:]
    return BACK @ ((1 - update) * hidden + update * jnp.tanh(reset * hidden))


FUNCTIONS = {
    "arithmetic": lambda x, flags: (x + 1) * x / (x * x + 2) - 3 * x,
    "powers": lambda x, flags: x**2 - x**3 + jnp.abs(x) ** 0.5 + jax.lax.rsqrt(x * x + 1),
    "functions": lambda x, flags: (
        jnp.exp(-x) + jnp.tanh(x) + jnp.floor(x) + jnp.round(x) + jnp.sign(x) * jnp.log(x * x + 1)
    ),
    "angles": lambda x, flags: jnp.stack(sin_cos(x)).sum(0) + jnp.arctan2(x, 1 + x * x),
    "choices": lambda x, flags: jnp.where(flags & (x > 0) | ~flags & (x <= -1), x, jnp.clip(x, -0.5, 0.5)),
    "extremes": lambda x, flags: (
        jnp.maximum(x, 0.1) + jnp.minimum(x, x[::-1]) + x.max() - x.min() + flags.any() + flags.all()
    ),
    "moves": lambda x, flags: jnp.concatenate([jnp.roll(x, 2)[:3], x.reshape(2, 3).T.ravel()[1:4]]) + stored(norm(x)),
    "ranking": lambda x, flags: jax.lax.top_k(jnp.where(flags, x, -9.0), 4)[0].repeat(2)[:6],
    "looking up": lambda x, flags: x.take(jax.lax.top_k(x, 6)[1], mode="clip"),
    "matrices": lambda x, flags: (x.reshape(2, 3) @ x.reshape(3, 2)).ravel().repeat(2)[:6] + x[:3] @ x[3:],
    "network": lambda x, flags: BACK @ jnp.tanh(WEIGHT @ x + jnp.linspace(-1, 1, 20)),
    "pieces": lambda x, flags: jnp.concatenate(jnp.split(x, 3)[::-1]),
    "memory": gru,
}
SHAPES = {"x": jax.ShapeDtypeStruct((6,), np.float32), "flags": jax.ShapeDtypeStruct((6,), np.bool_)}
ROWS = 40


@pytest.fixture(scope="module")
def inputs():
    draw = np.random.default_rng(0)
    return draw.normal(size=(ROWS, 6)).astype(np.float32), draw.random((ROWS, 6)) < 0.5


@pytest.fixture(scope="module")
def wanted(inputs):
    return {name: np.asarray(jax.vmap(function)(*inputs)) for name, function in FUNCTIONS.items()}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_onnx(name, inputs, wanted):
    """For any number of rows."""
    rows = jax.export.symbolic_shape("B")[0]
    shapes = {key: jax.ShapeDtypeStruct((rows, *one.shape), one.dtype) for key, one in SHAPES.items()}
    graph = write(trace(lambda v: {"y": jax.vmap(FUNCTIONS[name])(v["x"], v["flags"])}, shapes))
    helper, kinds = graph.onnx.helper, graph.onnx.TensorProto
    ports = [
        helper.make_tensor_value_info(*port) for port in (("x", kinds.FLOAT, ["B", 6]), ("flags", kinds.BOOL, ["B", 6]))
    ]
    output = helper.make_tensor_value_info("y", kinds.FLOAT, ["B", 6])
    made = helper.make_graph(graph.nodes, name, ports, [output], graph.constants)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
    (given,) = onnxruntime.InferenceSession(model.SerializeToString()).run(
        None, dict(zip(("x", "flags"), inputs, strict=True))
    )
    np.testing.assert_allclose(given, wanted[name], atol=3e-6, rtol=3e-6)


MAIN = """
int main(void) {
    float x[6], y[6];
    unsigned char flags[6];
    while (fread(x, sizeof x, 1, stdin) == 1 && fread(flags, sizeof flags, 1, stdin) == 1) {
%s
    }
    return 0;
}
"""
HEAD = """#include <math.h>
#include <stdio.h>
static float p_clip(float value, float low, float high) { return value < low ? low : value > high ? high : value; }
static float p_max(float a, float b) { return a > b || a != a ? a : b; }
static float p_min(float a, float b) { return a < b || a != a ? a : b; }
static void p_product(const float *m, int rows, int columns, const float *in, float *out) {
    for (int r = 0; r < rows; ++r) {
        out[r] = 0.0f;
        for (int c = 0; c < columns; ++c) out[r] += m[r * columns + c] * in[c];
    }
}
void unused(void) { (void)p_clip; (void)p_max; (void)p_min; (void)p_product; }
void unused(void);
"""


def leaves(name, kind):
    array = np.empty(6, object)
    array[:] = [leaf(f"{name}[{i}]", kind) for i in range(6)]
    return array


@pytest.mark.skipif(compiler() is None, reason="no C compiler here")
def test_c(inputs, wanted, tmp_path):
    tables, calls = [], []
    for number, (name, function) in enumerate(FUNCTIONS.items()):
        arrays = Arrays(f"p{number}")
        program = trace(lambda v, function=function: {"y": function(v["x"], v["flags"])}, SHAPES)
        out = run(arrays, program, {"x": leaves("x", FLOAT), "flags": leaves("flags", BOOL)})["y"]
        arrays.prefix = "p"
        lines = statements(arrays, {"y": out})
        calls.append(f"/* {name} */ {{\n" + "\n".join(lines) + "\nfwrite(y, sizeof y, 1, stdout);\n}")
        for table, values in arrays.constants.items():
            row = ", ".join(f"{value:.9e}f" for value in values.ravel())
            tables.append(f"static const float {table}[] = {{{row}}};")
    (tmp_path / "p.c").write_text(
        "\n".join(
            [
                HEAD.replace("void unused(void) {", "static void unused(void) {", 1).replace(
                    "void unused(void);\n", ""
                ),
                *tables,
            ]
        )
        + MAIN % "\n".join(["    unused();", *calls])
    )
    subprocess.run([compiler(), *FLAGS, "p.c", "-o", "p", "-lm"], cwd=tmp_path, check=True)
    rows = b"".join(x.tobytes() + flags.astype(np.uint8).tobytes() for x, flags in zip(*inputs, strict=True))
    given = subprocess.run([tmp_path / "p"], input=rows, capture_output=True, check=True).stdout
    given = np.frombuffer(given, np.float32).reshape(ROWS, len(FUNCTIONS), 6)
    for number, name in enumerate(FUNCTIONS):
        np.testing.assert_allclose(given[:, number], wanted[name], atol=3e-6, rtol=3e-6, err_msg=name)


def test_what_is_not_known_is_said():
    with pytest.raises(CruiseError, match="cannot be exported to ONNX: cumsum"):
        write(trace(lambda v: {"y": jnp.cumsum(v["x"])}, SHAPES))
    with pytest.raises(CruiseError, match="cannot be exported to C: cumsum"):
        run(Arrays("p"), trace(lambda v: {"y": jnp.cumsum(v["x"])}, SHAPES), {"x": leaves("x", FLOAT)})
