"""The one error that means: what the user gave us cannot work, and here is why."""


class CruiseError(ValueError):
    """Bad input. The message is one line: what is wrong, where, and what would be right."""
