"""Tables in files of Apache Parquet."""

from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from laisn.errors import LaisnError


def arrow_table(path: Path) -> Any:
    """The `pyarrow.Table` in a file that `write_table` of `experiments.campaign.store` wrote;
    LaisnError if the file is damaged.
    """
    try:
        # in this thread: one of Arrow's own that still reads when the process ends would abort it
        return pq.ParquetFile(path, page_checksum_verification=True).read(use_threads=False)
    except (ValueError, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        reason = " ".join(str(error).split())
        raise LaisnError(
            f"{path}: it is damaged: {reason}; the command that wrote it writes it again"
        ) from None
