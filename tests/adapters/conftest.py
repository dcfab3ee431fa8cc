"""The adapters' step compiled without LLVM's optimisations, in half the time: its logic is tested, on few races."""

import equinox as eqx
import pytest

from cruise.adapters import compiled, races


@pytest.fixture(autouse=True, scope="package")
def quickly_compiled():
    step = eqx.filter_jit(compiled.fly_step.__wrapped__, compiler_options={"xla_backend_optimization_level": 0})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(races, "fly_step", step)
        yield
