"""The entry point of the `glpath` script and of `python -m glpath`."""

import os
import sys


def main() -> None:
    """Run the command. An interrupt while its modules load ends it without a traceback, as one later does."""
    try:
        from glpath.cli.main import run_and_end
    except KeyboardInterrupt:
        sys.stderr.write("Interrupted.\n")
        sys.stderr.flush()
        os._exit(130)
    run_and_end()


if __name__ == "__main__":
    main()
