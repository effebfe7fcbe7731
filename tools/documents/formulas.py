"""Formulas of the documents, as GitHub writes them in Markdown, as MathML, which browsers draw
without a script.
"""

import re

from latex2mathml.converter import convert

_FENCE = re.compile(r"^```.*?^```\s*$", re.M | re.S)
_MATH_FENCE = re.compile(r"^```math\s*\n(.*?)^```\s*$", re.M | re.S)
_INLINE = re.compile(r"\$`(.+?)`\$", re.S)


def mathml(source: str, *, display: bool = False) -> str:
    """A formula of LaTeX as a MathML element, on one line; ValueError naming it if it is none."""
    try:
        return convert(source.strip(), display="block" if display else "inline").replace("\n", " ")
    except Exception as error:
        raise ValueError(f"formula {source.strip()!r}: {error}") from error


def with_formulas(markdown: str) -> str:
    """Markdown with its formulas as MathML; those in other fenced code stay as they are."""
    blocks = _MATH_FENCE.sub(
        lambda match: f'<div class="formula">{mathml(match[1], display=True)}</div>', markdown
    )
    parts: list[str] = []
    position = 0
    for fence in _FENCE.finditer(blocks):
        parts += [_inline(blocks[position : fence.start()]), fence[0]]
        position = fence.end()
    return "".join([*parts, _inline(blocks[position:])])


def _inline(text: str) -> str:
    # within a span, or it would be a paragraph of its own at the beginning of a line
    return _INLINE.sub(lambda match: f"<span>{mathml(match[1])}</span>", text)
