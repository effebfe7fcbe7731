"""A data set by the name of its file."""

from pathlib import Path

from laisn.failure import LaisnError
from sim.datasets.factor_graph import read_factor_graph
from sim.datasets.range_data import RangeData
from sim.datasets.range_tables import read_range_tables

_READERS = {".pyfg": read_factor_graph, ".mat": read_range_tables, ".txt": read_range_tables, ".csv": read_range_tables}


def read_data_set(path: Path) -> RangeData:
    """The odometry and ranges in a file.

    Raises:
        LaisnError: its name ends in nothing that is known, or it cannot be read.
    """
    reader = _READERS.get(path.suffix)
    if reader is None:
        raise LaisnError(
            f"{path}: the name should end in .pyfg (a factor graph), or be that of a .mat or a _DR.txt (a data set of "
            "ranging radios)"
        )
    return reader(path)
