"""The one error that means: what the user gave us cannot work, and here is why."""


class CruiseError(ValueError):
    """Bad input. The message is one line: what is wrong, where, and what would be right."""


def one_line(error: BaseException, most: int | None = None) -> str:
    """What an error of a library says, on one line, cut after `most` characters."""
    return " ".join(str(error).split())[:most]
