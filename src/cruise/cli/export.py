"""`cruise export`: a policy for other programs."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from cruise.cli.compilation import prepare_flight
from cruise.cli.line_up import described, usual_track
from cruise.cli.outputs import check_output
from cruise.errors import CruiseError
from cruise.racing.track_file import load_one_track

if TYPE_CHECKING:
    from cruise.export.files import Exported


@dataclass(frozen=True)
class Export:
    """Write a policy as an ONNX model, a C99 header or a controller, compared with the policy on recorded races."""

    policy: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME|PATH")]
    """A shipped policy, a .safetensors file or the folder of a run. It says which vehicle it flies."""
    onnx: Annotated[Path | None, described("FILE")] = None
    """Write an ONNX model: state of all drones and gates in, action and what it commands out."""
    c: Annotated[Path | None, described("FILE")] = None
    """Write a C99 header that does the same, without any dependency."""
    lsy: Annotated[Path | None, described("FILE.py")] = None
    """Write a controller of the LSY drone racing course, one file that needs onnxruntime beside the course itself."""
    network: bool = False
    """Put the bare network into the ONNX model: the scaled observation in, the action in its frame out."""
    track: Annotated[str | None, described("NAME|FILE")] = None
    """Where the races for the comparison are flown. By default where the policy was trained."""
    terms: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, described("FILE.py")] = ()
    """Python file that declares the observation of the policy, where it is one of your own; its code is run."""
    measure: bool = False
    """Tell how long one action takes on one core of this machine."""

    def run(self) -> int:
        """Export, and print what was written and how near it comes to the policy."""
        if self.onnx is None and self.c is None and self.lsy is None:
            raise CruiseError("nothing to write: give --onnx FILE.onnx, --c FILE.h or --lsy FILE.py")
        if self.network and self.onnx is None:
            raise CruiseError("--network is about the ONNX model: give --onnx FILE.onnx with it")
        check_output("--onnx", self.onnx, ".onnx")
        check_output("--c", self.c, ".h")
        check_output("--lsy", self.lsy, ".py")
        prepare_flight()
        from cruise.export.files import Exporter  # noqa: PLC0415  (imports JAX)
        from cruise.pilots.terms_file import load_all_terms  # noqa: PLC0415
        from cruise.storage.policy_file import read_policy  # noqa: PLC0415

        load_all_terms(self.terms)
        policy = read_policy(self.policy)
        track = load_one_track(self.track) if self.track is not None else usual_track(policy.meta)
        exporter = Exporter.of(policy, track)
        if self.onnx is not None:
            print(told(exporter.onnx(self.onnx, "observation" if self.network else "state", self.measure)))
        if self.c is not None:
            print(told(exporter.c(self.c, self.measure)))
        if self.lsy is not None:
            print(told(exporter.lsy(self.lsy)))
        return 0


def told(exported: "Exported") -> str:
    """One line about a file."""
    words = f"{exported.path}: {exported.size / 1e3:.0f} kB"
    if exported.difference is None:
        return f"{words}, not compared: no C compiler here"
    words += f", within {exported.difference:.1e} of the policy in {exported.steps:,} recorded actions"
    return (
        words if exported.seconds_per_call is None else f"{words}, {1e6 * exported.seconds_per_call:.1f} us an action"
    )
