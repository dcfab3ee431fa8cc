"""Figures on a screen."""

from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

# What a line shows: its title, the figure, the factor and the unit.
LINES = (
    ("environment", "env_drone_steps_per_s", 1e-6, "M drone-steps/s"),
    ("environment, 100 k races", "env_drone_steps_per_s_100k_races", 1e-6, "M drone-steps/s"),
    ("training", "train_steps_per_s", 1e-3, "k steps/s"),
    ("matrix products", "matmul_gflops", 1.0, "GFLOP/s"),
    ("copying", "copy_gb_per_s", 1.0, "GB/s"),
    ("environment, its arithmetic as a share of products", "env_flop_share", 100.0, "%"),
    ("environment, its bytes as a share of copying", "env_copy_share", 100.0, "%"),
    ("training, its networks' products as a share of products", "train_roofline_share", 100.0, "%"),
    ("training, its bytes as a share of copying", "train_copy_share", 100.0, "%"),
    ("compile training", "compile_s", 1.0, "s"),
    ("training, first update, cold", "cold_start_s", 1.0, "s"),
    ("training, first update, warm", "warm_start_s", 1.0, "s"),
    ("peak memory, training", "peak_memory_mb", 1.0, "MB"),
)
TITLES = {
    "environment_races": "environment over races, 4 drones",
    "environment_drones": "environment over drones",
    "environment_gates": "environment over gates, 4 drones, 4096 races",
    "environment_observations": "environment, 4 drones, 4096 races",
    "training_drones": "training over drones",
    "training_networks": "training over networks",
    "evaluations": "evaluation, 3 laps of the ring",
    "planner": "SE-IBR planning, ring",
    "interfaces": "through other libraries' interfaces",
    "commands": "whole commands",
}


def show(figures: dict[str, Any], console: Console) -> None:
    """Print the headline, then every table there is."""
    machine, versions = figures["machine"], figures["versions"]
    console.print(f"{machine['processor']}, {figures['cores']} cores, device {machine['device']}", highlight=False)
    console.print(", ".join(f"{name} {number}" for name, number in versions.items()), highlight=False)
    console.print(headline_table(figures))
    for name, rows in figures.get("tables", {}).items():
        if rows:
            console.print(rows_table(TITLES[name], rows))


def headline_table(figures: dict[str, Any]) -> Table:
    """One line per figure."""
    table = Table("", Column("", justify="right"), "", title="CRUISE, how fast it is", show_header=False)
    for title, key, factor, unit in LINES:
        if key not in figures:
            continue
        value = figures[key]
        table.add_row(title, "-" if value is None else readable(value * factor), unit)
    return table


def rows_table(title: str, rows: list[dict[str, Any]]) -> Table:
    """One row per case; every row has the same keys."""
    table = Table(*(Column(name.replace("_", " "), justify="right") for name in rows[0]), title=title)
    for row in rows:
        table.add_row(*(escape(readable(value)) for value in row.values()))
    return table


def readable(value: object) -> str:
    """A number in three or four digits; a tuple of layer sizes joined; nothing as a dash."""
    if value is None:
        return "-"
    if isinstance(value, tuple):
        return "-".join(str(size) for size in value)
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return str(value)
