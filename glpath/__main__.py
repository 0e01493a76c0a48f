"""`python -m glpath` is `glpath`."""

from glpath.cli.main import run

if __name__ == "__main__":
    run()
