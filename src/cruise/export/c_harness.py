"""Compiles an exported header, feeds it recorded states, and measures how long it takes."""

import os
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cruise.errors import CruiseError
from cruise.export.ports import OWN
from cruise.export.recording import Recording

FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic")
SECONDS = 0.3  # measured

MAIN = """\
#include "policy.h"
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static const float *copy(float *into, const float *row, int size) {{
    for (int i = 0; i < size; ++i) into[i] = row[i];
    return row + size;
}}

/* A row: own state, next gate, then position, velocity and presence of every other drone. */
static void read_row(const float *row, {p}_state *state) {{
    row = copy(state->position_w, row, 3);
    row = copy(state->velocity_w, row, 3);
    row = copy(state->{attitude}, row, {attitude_size});
    row = copy(state->angular_velocity_b, row, 3);
    {read_previous}
    state->next_gate = (int)*row++;
#if {P}_OTHERS > 0
    for (int k = 0; k < {P}_OTHERS; ++k) {{
        row = copy(state->others[k].position_w, row, 3);
        row = copy(state->others[k].velocity_w, row, 3);
        state->others[k].airborne = *row++ > 0.0f;
    }}
#endif
}}

int main(int argc, char **argv) {{
    const size_t count = (size_t)atol(argv[1]);
    const double seconds = argc > 2 ? atof(argv[2]) : 0.0;
    float row[{row_size} + 7 * {P}_OTHERS], result[{said_size} + {command_size}];
    {p}_state *states = ({p}_state *)calloc(count, sizeof *states);
    if (states == NULL) return 1;
    for (size_t k = 0; k < count; ++k) {{
        if (fread(row, sizeof row, 1, stdin) != 1) return 1;
        read_row(row, &states[k]);
        {p}_act(&states[k], {p}_gates, {P}_GATES);
        {write_said}
        {p}_{command}(&states[k], result + {said_size});
        if (fwrite(result, sizeof result, 1, stdout) != 1) return 1;
    }}
    if (seconds > 0.0) {{
        double calls = 0.0;
        const clock_t began = clock();
        while ((double)(clock() - began) < seconds * CLOCKS_PER_SEC) {{
            for (size_t k = 0; k < count; ++k) {p}_act(&states[k], {p}_gates, {P}_GATES);
            calls += (double)count;
        }}
        fprintf(stderr, "%.9g", (double)(clock() - began) / CLOCKS_PER_SEC / calls);
    }}
    fprintf(stderr, " %.9g", (double){p}_self_test());
    free(states);
    return 0;
}}
"""


class CRun(NamedTuple):
    """What the compiled header gave for a recording."""

    said: dict[str, np.ndarray]  # by name [M, ...], as `Recording.said`
    command: np.ndarray  # [M, C] what it commands, `Commands.ports` one after the other
    self_test: float  # largest difference that it finds itself
    seconds_per_call: float | None  # where it was measured


def compiler() -> str | None:
    """The C compiler of this machine: that of the variable CC, or cc, gcc, clang; None where there is none."""
    named = os.environ.get("CC")
    return named or next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)


def run_header(header: str, prefix: str, recording: Recording, folder: Path, measure: bool = False) -> CRun:
    """Compile the header in `folder`, strictly, and ask it for every recorded step.

    Raises:
        CruiseError: there is no compiler, or it does not take the header.
    """
    program = _compile(header, MAIN.format(p=prefix, P=prefix.upper(), **_names(recording)), folder)
    rows = input_rows(recording)
    seconds = [str(SECONDS)] if measure else []
    done = subprocess.run(
        [str(program), str(len(rows)), *seconds], input=rows.tobytes(), capture_output=True, check=False, timeout=300
    )
    if done.returncode:
        raise CruiseError(f"the compiled header ended with {done.returncode}")
    result = np.frombuffer(done.stdout, np.float32).reshape(len(rows), -1)
    ends = np.cumsum([rows.shape[1] for rows in recording.said.values()])
    *said, command = np.split(result, ends, axis=1)
    *took, self_test = (float(word) for word in done.stderr.split())
    return CRun(dict(zip(recording.said, said, strict=True)), command, self_test, took[0] if took else None)


def _names(recording: Recording) -> dict[str, str | int]:
    """What the state and what is commanded are called, and of how many numbers they are."""
    attitude = "attitude" if "attitude" in recording.inputs else "euler"
    size, said, previous = recording.inputs[attitude].shape[1], recording.said, recording.previous
    sizes = {name: rows.shape[1] for name, rows in (said | previous).items()}
    ends = dict(zip(said, np.cumsum([0, *(sizes[name] for name in said)]).tolist(), strict=False))
    return {
        "attitude": attitude,
        "attitude_size": size,
        "row_size": 10 + size + sum(sizes[name] for name in previous),
        "read_previous": "\n    ".join(f"row = copy(state->{name}, row, {sizes[name]});" for name in previous),
        "write_said": "\n        ".join(f"copy(result + {ends[one]}, states[k].{one}, {sizes[one]});" for one in said),
        "said_size": sum(sizes[name] for name in said),
        "command": "acceleration" if "acceleration_w" in recording.outputs else "command",
        "command_size": recording.commands.shape[1],
    }


def _compile(header: str, main: str, folder: Path) -> Path:
    cc = compiler()
    if cc is None:
        raise CruiseError("no C compiler found: name one with the variable CC")
    (folder / "policy.h").write_text(header, encoding="utf-8")
    (folder / "main.c").write_text(main, encoding="utf-8")
    program = folder / "main"
    command = [*shlex.split(cc), *FLAGS, "main.c", "-o", program.name, "-lm"]
    try:
        subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True, timeout=300)
    except OSError as error:
        raise CruiseError(f"C compiler {cc!r} cannot be run: {error.strerror}") from None
    except subprocess.CalledProcessError as error:
        raise CruiseError(f"C compiler {cc!r} refused the header: {error.stderr.strip()[:300]}") from None
    return program


def input_rows(recording: Recording) -> np.ndarray:
    """[M, R] float32, as the harness reads them."""
    inputs = recording.inputs
    own = [port.name for port in OWN if port.name in inputs]
    columns = [*(inputs[name] for name in own), *recording.previous.values(), inputs["next_gate"][:, None]]
    if "others_position_w" in inputs:
        each = (inputs["others_position_w"], inputs["others_velocity_w"], inputs["others_airborne"][:, :, None])
        others = np.concatenate(each, axis=2)
        columns.append(others.reshape(len(others), -1))
    return np.ascontiguousarray(np.concatenate(columns, axis=1), np.float32)
