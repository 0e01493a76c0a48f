"""The entry point of the `glpath` script and of `python -m glpath`."""

# Other modules are imported in `main`, which reports Ctrl-C. Python itself has imported these two.
import os
import sys


def main() -> None:
    """Run the command line, and report Ctrl-C without a traceback, even while modules are loading.

    With --checkpoint or --resume, a scheduler's signal while modules are loading ends the process with exit code
    75. This code means that the command is to be started again.
    """
    try:
        _open_standard_streams()
        # Workers of a cluster start by `python -c`. Without this variable, they would import modules from the
        # current folder first.
        os.environ.setdefault("PYTHONSAFEPATH", "1")
        from glpath.cli.signals import asks_to_resume, resume_later_while_loading

        if asks_to_resume(sys.argv[1:]):
            resume_later_while_loading()
        from glpath.cli.main import run_and_end

        run_and_end()
    except (KeyboardInterrupt, RuntimeError) as stop:
        try:
            import select

            from glpath.system.signals import is_interruption

            if not is_interruption(stop):
                raise stop

            if os.name == "nt" or select.select([], [2], [], 1.0)[1]:  # a write to a full pipe would block
                os.write(2, b"Interrupted.\n")
        except (OSError, KeyboardInterrupt):
            pass
        os._exit(130)


def _open_standard_streams() -> None:
    """Open the null device for standard streams that are closed.

    If standard error stayed closed, the next opened file would get descriptor 2, and drivers would write messages
    into that file.
    """
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    if sys.stderr is None:
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - open until the process ends


if __name__ == "__main__":
    main()
