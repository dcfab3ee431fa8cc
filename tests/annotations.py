"""How annotations are checked in the tests: as mypy reads them, an `int` may stand where a `float` is asked for."""

from beartype import BeartypeConf, beartype

checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
