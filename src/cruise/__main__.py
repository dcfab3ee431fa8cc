"""`python -m cruise`: the command `cruise`."""

import sys

from cruise.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
