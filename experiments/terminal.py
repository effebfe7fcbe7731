"""What is shown between a command's start and its end: words of ours may be styled, all others stand as they are."""

from rich.console import Console
from rich.text import Text

from sim.screen import plain


def literal(text: object, style: str = "") -> Text:
    """Text of a file, a path or a user as it is: no markup, no emoji code, no control character of it takes effect."""
    return Text(plain(text), style=style)


def tell(console: Console, text: object, label: str = "", style: str = "yellow") -> None:
    """Print a line of literal text, behind a styled label of ours if there is one."""
    console.print(Text.assemble((f"{label} ", style) if label else "", literal(text)), soft_wrap=True)
