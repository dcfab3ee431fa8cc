"""How the commands start JAX: wide vectors, compiled programs kept between runs, every core a device of its own."""

from cruise.compilation_cache import use_compilation_cache
from cruise.errors import CruiseError, one_line
from cruise.processor import use_wide_vectors


def prepare_training(cores: int | None = None) -> None:
    """What must be settled before JAX is first used, where policies are trained: on all cores, or on so many.

    JAX is not started: other processes may have to be met, or cores chosen, before.
    """
    from cruise.training.devices import use_cores  # noqa: PLC0415  (imports JAX)

    use_cores(cores)
    settle_flight()


def prepare_flight() -> None:
    """Start JAX as every command that flies needs it."""
    settle_flight()
    start_jax()


def settle_flight() -> None:
    """What must be settled before JAX is first used."""
    from cruise.precision import use_single_precision  # noqa: PLC0415  (imports JAX)

    use_wide_vectors()
    use_single_precision()
    use_compilation_cache()


def start_jax() -> None:
    """Let JAX find its devices. Raises CruiseError where there are none of the platform it was told to use."""
    import jax  # noqa: PLC0415

    try:
        jax.devices()
    except (AssertionError, RuntimeError) as error:
        wanted = jax.config.values["jax_platforms"]
        reason = one_line(error) or "there is no such device, or JAX was installed without it"
        raise CruiseError(f"JAX cannot use JAX_PLATFORMS={wanted}: {reason}; unset it, or choose cpu") from None
