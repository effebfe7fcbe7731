"""Entry point of the `laisn` command, past whatever else a user's machine calls `sim`, `models` or `experiments`."""

import sys
from pathlib import Path


def main() -> None:
    """Run the command with this project's packages, also where PYTHONPATH leads to others of the same names."""
    sys.path.insert(0, str(Path(__file__).resolve().parent))
    from experiments.command.cli import main as command

    command()
