"""Records as tables in Markdown."""

from collections.abc import Mapping, Sequence

from reports.findings import Findings

Records = Mapping[str, Findings]


def markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
