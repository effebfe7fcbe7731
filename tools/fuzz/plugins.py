"""Navigators, controllers, sensors and currents of one's own that fail in every way, for `laisn
check` and `laisn fly`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from random import Random

from tools.fuzz.case import FuzzCase

# bodies of methods
_ACTIONS = (
    "raise ValueError('x')",
    "raise SystemExit(3)",
    "import sys; sys.exit('bye')",
    "return float('nan')",
    "return None",
    "return 'x'",
    "return [1, 2]",
    "return np.zeros((3, 7))",
    "return np.full(9, np.nan)",
    "return np.array(['a'])",
    "return {}",
    "return self",
    "return object()",
    "return Mine.run(self)",
    "return (lambda f: f(f))(lambda f: f(f))",
    "raise KeyboardInterrupt",
    "raise type('E', (Exception,), {'__str__': lambda s: 1 / 0})()",
    "raise type('E', (BaseException,), {})('base')",
    "raise MemoryError",
    "raise OSError(28, 'No space left')",
    "raise StopIteration",
    "raise GeneratorExit",
    "assert False",
    "1 / 0",
    r"raise Exception('\x1b[31m' + 'x' * 100000)",
    r"raise Exception('\ud800')",
    "yield 1",
    "import nosuchmodule",
    "return self.nosuch",
)
# lines above the class
_TOPS = (
    "raise ValueError('top')",
    "raise SystemExit(5)",
    "import nosuchmodule",
    "def f(): return f()\nf()",
    "x = (",
    "\x00",
    "raise KeyboardInterrupt",
    "from laisn import nosuch",
    "\tx = 1",
    r"x = '\ud800'",
    "(" * 200,
    "x = " + "9" * 6000,
    "return 3",
    "# -*- coding: nosuch -*-",
)
# classes that it is derived from
_BASES = ("laisn_sim.Navigator", "object", "dict", "int", "Exception", "Nosuch", "type")
# lines below it
_TAILS = ("Mine = 3", "Mine = None", "Mine = lambda *a, **k: None", "del Mine", "Mine = Mine()")
# lines at the beginning of its body
_BODIES = ("x: int = 1", "step = 3", "__slots__ = ()", "def __repr__(self): 1 / 0")


@dataclass(frozen=True, kw_only=True)
class _Kind:
    """What a class is for: its methods as they should be, and where a scenario names it."""

    methods: Mapping[str, str]  # bodies by name, of parameters `*a, **k`
    setting: str  # with "{}" for the class
    attributes: tuple[str, ...] = ()  # lines that set them in the class


_KINDS = (
    _Kind(
        methods={"__init__": "self.arguments = a", "step": "return None", "run": "return None"},
        setting="navigation.variant={}",
    ),
    _Kind(
        methods={"__init__": "self.arguments = a", "control": "return 1.0, 1.0, 8.0"},
        setting="followers.0.controller={}",
    ),
    _Kind(
        methods={"true": "return [1.0]", "read": "return a[0]"},
        setting="sensors.custom=[{{sensor='{}'}}]",
        attributes=("name = 'mine'", "stream = 20", "channels = {'x': 'm'}", "normals = 1"),
    ),
    _Kind(
        methods={"velocity": "return 0.1, 0.0"},
        setting="ocean.current.model={}",
    ),
)


def _source(random: Random, kind: _Kind) -> str:
    """A module with a class Mine."""
    methods = {
        name: random.choice(_ACTIONS) if random.random() < 0.5 else default_body
        for name, default_body in kind.methods.items()
        if random.random() < 0.85
    }
    lines = ["import numpy as np", "import laisn_sim"]
    if random.random() < 0.15:
        lines.append(random.choice(_TOPS))
    base = random.choice(_BASES) if random.random() < 0.2 else "object"
    lines.append(f"class Mine({base}):")
    lines.append(f"    {random.choice(_BODIES) if random.random() < 0.3 else 'pass'}")
    lines += [f"    {line}" for line in kind.attributes if random.random() < 0.9]
    for name, action in methods.items():
        lines += [f"    def {name}(self, *a, **k):", f"        {action}"]
    if random.random() < 0.1:
        lines.append(random.choice(_TAILS))
    text = "\n".join(lines)
    return text if random.random() > 0.05 else text[: random.randrange(len(text))]


def make(random: Random) -> FuzzCase:
    """A plugin, which a mission of a second uses."""
    name = f"plugin_{random.randrange(10**9)}"
    kind = random.choice(_KINDS)
    source = _source(random, kind)
    words = ["--plugin", f"{name}.py", "--set", kind.setting.format(f"{name}:Mine")]
    fly = ["fly", "T7", "--no-video", "--out", "out"]
    if "step" in kind.methods:
        fly += ["--set", "motion=kinematic"]
    words = random.choice((["check", "T7", *words], [*fly, "--set", "duration_s=1", *words]))
    return FuzzCase(
        words=words,
        files={f"{name}.py": source.encode("utf-8", "surrogatepass")},
        named=(name, "Mine"),
        may_interrupt="KeyboardInterrupt" in source,
    )
