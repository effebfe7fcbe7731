"""How many examples a property test tries: apart from `conftest`, whose import would choose the
profile again.
"""

from hypothesis import settings

_USUAL = 100
"""Examples of a property in the profile that tests run with; `make fuzz` has one with more."""


def examples(count: int) -> settings:
    """Settings of a property with expensive examples: their number, in proportion larger in a
    search for new ones.
    """
    return settings(max_examples=max(1, count * settings().max_examples // _USUAL))
