"""The version that results carry: of the package, and of every source that may change a number."""

import hashlib
from functools import cache
from importlib.metadata import version
from pathlib import Path

_PACKAGES = ("models", "laisn", "sim")
_ENGINE = ("campaign.py", "cells.py", "lane_metrics.py", "lane_sensors.py", "montecarlo.py")
_SUFFIXES = {".py", ".xml", ".json"}


@cache
def code_version() -> str:
    """Such as 0.1.0+3f2a9c81d0e4: results of different versions are never mixed."""
    root = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    sources = [p for package in _PACKAGES for p in (root / package).rglob("*") if p.suffix in _SUFFIXES]
    sources += [root / "experiments" / name for name in _ENGINE]
    for path in sorted(sources):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return f"{version('laisn-sim')}+{digest.hexdigest()[:12]}"
