"""Tables and lines for people: names that people gave to tracks, pilots and policies are written as they are."""

from rich.console import Console


def make_console(stderr: bool = False, quiet: bool = False) -> Console:
    """A console to which "[red]" and ":cat:" are letters, not markup."""
    return Console(stderr=stderr, quiet=quiet, markup=False, emoji=False)
