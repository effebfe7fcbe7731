"""Tables as results from Python: short to print, and ready for pandas, polars and NumPy."""

from __future__ import annotations

import html
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.campaign.store import arrow_table
from laisn.failure import LaisnError

if TYPE_CHECKING:
    import numpy.typing as npt

_SHOWN = 5
"""Rows of a table in a notebook."""
_NAMED = 12
"""Columns that a table names when it is printed."""


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


class Table:
    """Columns of a result by name.

    `table["e_p_m"]` is a NumPy array; `polars.DataFrame(table)` and `pandas.DataFrame.from_arrow(table)` take it as it
    is.

    Attributes:
        arrow: the table as pyarrow has it.
    """

    def __init__(self, arrow: Any) -> None:
        """Wrap a `pyarrow.Table`."""
        self.arrow = arrow

    @classmethod
    def read(cls, path: Path) -> Table:
        """The table in a Parquet file that a study wrote; LaisnError if it is not what was written."""
        return cls(arrow_table(path))

    @property
    def columns(self) -> list[str]:
        """Names of the columns, in their order."""
        return list(self.arrow.column_names)

    def __len__(self) -> int:
        return int(self.arrow.num_rows)

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        """Values of a column, shape (rows,); LaisnError listing the columns if there is none of that name."""
        if name not in self.columns:
            raise LaisnError(f"unknown column {name!r}; available: {', '.join(self.columns)}")
        return np.asarray(self.arrow[name].to_numpy())

    def rows(self) -> list[dict[str, Any]]:
        """Every row as a dictionary."""
        return list(self.arrow.to_pylist())

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame` of it; LaisnError if there is no pandas."""
        try:
            return self.arrow.to_pandas()
        except ModuleNotFoundError:
            raise LaisnError("to_pandas needs pandas: pip install pandas") from None

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Arrow's protocol, by which other libraries take a table without a copy."""
        return self.arrow.__arrow_c_stream__(requested_schema)

    def __repr__(self) -> str:
        named = self.columns[:_NAMED] + ["…"] * (len(self.columns) > _NAMED)
        return f"<Table: {len(self)} rows, {len(self.columns)} columns: {', '.join(named)}>"

    def _repr_html_(self) -> str:
        heads = "".join(f"<th>{html.escape(name)}</th>" for name in self.columns)
        shown = self.arrow.slice(0, _SHOWN).to_pylist()
        rows = "".join(
            f"<tr>{''.join(f'<td>{html.escape(_text(v))}</td>' for v in row.values())}</tr>" for row in shown
        )
        more = f"<caption>{len(self)} rows</caption>"
        return f"<table>{more}<thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"
