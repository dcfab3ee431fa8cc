"""The adapters' step compiled without LLVM's optimisations, in half the time: its logic is tested, on few races."""

import equinox as eqx

from cruise.adapters import compiled

fly_step = eqx.filter_jit(compiled.fly_step.__wrapped__, compiler_options={"xla_backend_optimization_level": 0})
