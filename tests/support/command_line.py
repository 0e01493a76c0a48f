"""Calls the command line in the process of the test."""

from __future__ import annotations

from click.testing import Result
from typer.testing import CliRunner

from glpath.cli.main import app


def run(*arguments: object) -> Result:
    """Run `glpath ARGUMENTS`."""
    return CliRunner().invoke(app, [str(a) for a in arguments])
