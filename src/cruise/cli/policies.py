"""`cruise policies`: the shipped policies and where they come from."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.table import Column, Table

from cruise.cli.console import make_console

if TYPE_CHECKING:
    from cruise.storage.policy_file import PolicyMeta


@dataclass(frozen=True)
class Policies:
    """List the shipped policies."""

    def run(self) -> int:
        """Print a table of the policies, how they were trained, and what was measured of them."""
        from cruise.storage.policy_file import list_policies  # noqa: PLC0415  (imports JAX)

        policies = list_policies()
        if not policies:
            print("no policies are shipped with this installation")
            return 0
        make_console().print(policy_table(policies))
        return 0


def policy_table(policies: "dict[str, PolicyMeta]") -> Table:
    """One row per policy."""
    titles = ("steps", "seed", "success", "lap", "speed")
    columns = (Column("policy", no_wrap=True), *(Column(title, justify="right") for title in titles), Column("version"))
    table = Table(*columns, box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)  # a name is whole in 80 columns
    for name, meta in policies.items():
        success, lap, speed = (measured(meta, key) for key in ("success_rate", "flying_lap_time", "mean_speed"))
        results = (
            "-" if success is None else f"{100 * success:.1f} %",
            "-" if lap is None else f"{lap:.2f} s",
            "-" if speed is None else f"{speed:.2f} m/s",
        )
        numbers = (f"{meta.all_steps / 1e6:.1f} M", str(meta.seed), *results)
        table.add_row(name, *numbers, meta.version)
    return table


def measured(meta: "PolicyMeta", key: str) -> float | None:
    """Mean of a measured quantity; None where it was not measured."""
    found: Any = meta.results.get(key)
    mean = found.get("mean") if isinstance(found, dict) else None
    return float(mean) if isinstance(mean, int | float) else None
