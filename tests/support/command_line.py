"""The command line, as tests call it: in this process."""

from __future__ import annotations

from click.testing import Result
from typer.testing import CliRunner

from glpath.cli.main import app


def run(*arguments: object) -> Result:
    """`glpath ARGUMENTS`."""
    return CliRunner().invoke(app, [str(a) for a in arguments])
