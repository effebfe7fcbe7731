"""Entry point of the `laisn` command, past whatever else a user's machine calls `sim`, `models` or `experiments`."""

import os
import sys


def main() -> None:
    """Run the command with this project's packages, also where PYTHONPATH leads to others of the same names."""
    try:
        sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
        from experiments.command.cli import main as command

        command()
    except KeyboardInterrupt:
        # before a command began that would say what is kept
        sys.stderr.write("laisn: interrupted\n")
        sys.exit(130)
