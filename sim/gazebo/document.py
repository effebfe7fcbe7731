"""Elements of an SDF file, its numbers, and the remarks of an import.

Gazebo's parser knows no namespaces: `gz:type` is a name like any other, declared or not.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError, shortened

DEEPEST = 100  # most levels of nested elements
MAX_ELEMENTS = 200_000
LARGEST = 1e12  # largest magnitude of a number; also refuses infinity
UUV_PLUGIN = "uuv_underwater_object"
GZ_NAMESPACES = ("gz::sim::systems", "ignition::gazebo::systems", "ignition::gazebo", "gz::sim")


def read_document(text: str) -> Element:
    """Root element of an SDF file.

    LaisnError if the text is no XML, is nested too deep or too large, or is another format; the
    message says what converts it.
    """
    root = parse(text)
    if root.tag != "sdf":
        raise LaisnError(_other_format(root))
    return root


def parse(text: str) -> Element:
    """Root element of XML without namespaces; LaisnError if it is none, too deep or too large."""
    builder = TreeBuilder()
    parser = expat.ParserCreate()
    depth = 0
    count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth += 1
        count += 1
        if depth > DEEPEST or count > MAX_ELEMENTS:
            raise LaisnError(
                f"no valid SDF: elements nested more than {DEEPEST} deep"
                if depth > DEEPEST
                else f"more than {MAX_ELEMENTS} elements"
            )
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse_entity(*_: object) -> None:
        raise LaisnError("no valid SDF: it declares entities")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler = refuse_entity
    try:
        parser.Parse(text.encode("utf-8"), True)
    except (expat.ExpatError, UnicodeEncodeError) as error:
        raise LaisnError(f"no valid SDF: {error}") from None
    return builder.close()


def _other_format(root: Element) -> str:
    elements = list(root.iter())
    is_xacro = any(
        element.tag.startswith("xacro:") or "xmlns:xacro" in element.attrib for element in elements
    )
    if root.tag != "robot":
        return f"no SDF: its root is <{root.tag[:40]}>, expected <sdf>"
    conversion = "gz sdf -p model.urdf > model.sdf"
    if is_xacro:
        return f"a xacro file, not SDF: xacro FILE > model.urdf, then {conversion}, converts it"
    if any(UUV_PLUGIN in element.get("filename", "") for element in elements):
        return f"URDF, not SDF: {conversion} converts it; {uuv_advice()}"
    return f"URDF, not SDF: {conversion} converts it"


def uuv_advice() -> str:
    """What to do with coefficients of uuv_simulator, whose plugins gz-sim does not have."""
    return (
        "its coefficients are those of uuv_simulator's libuuv_underwater_object plugin, which is "
        "not read: write <added_mass>, <linear_damping> and <quadratic_damping> as xDotU, xU, "
        "xUabsU … (added mass with a minus sign) into a Hydrodynamics plugin of gz-sim, <volume> "
        "as a collision, each thruster into a Thruster plugin"
    )


def numbers(text: str | None, count: int, label: str, largest: float = LARGEST) -> Floats:
    """So many numbers within ± `largest`; LaisnError names the label and what was given."""
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.zeros(0)
    # `not … <=` refuses NaN too
    if values.size != count or not np.all(np.abs(values) <= largest):
        plural = "s" if count > 1 else ""
        raise LaisnError(
            f"{label}: expected {count} number{plural} (given: {shortened(text or '', 40)!r})"
        )
    return values


def child_number(parent: Element, name: str, default: float, largest: float = LARGEST) -> float:
    """Number of a child element within ± `largest`, or the default where there is none."""
    child = parent.find(name)
    if child is None:
        return default
    return float(numbers(child.text, 1, f"<{name}>", largest)[0])


def child_text(parent: Element, path: str) -> str:
    """Text of a child element without blanks around it; empty: there is none."""
    return (parent.findtext(path) or "").strip()


def is_true(text: str | None) -> bool:
    """Truth as SDF has it."""
    return (text or "").strip().lower() in ("1", "true")


@dataclass
class Remarks:
    """What was assumed or left out, in sentences; what holds for several parts is said once."""

    # by what is said, the names of the parts; none: of the model
    _sentences: dict[str, list[str]] = field(default_factory=dict)
    # by kind of plugin or part and reason, the elements that have no effect
    _unused: dict[tuple[str, str], list[str]] = field(default_factory=dict)

    def add(self, text: str) -> None:
        """Add a sentence, once."""
        self._sentences.setdefault(text, [])

    def add_for_part(self, kind: str, name: str, text: str) -> None:
        """Add what holds for a part of a kind; parts with the same text share a sentence."""
        names = self._sentences.setdefault(f"{kind} {{}}: {text}", [])
        if name not in names:
            names.append(name)

    def add_unused(self, kind: str, tags: Iterable[str], reason: str = "") -> None:
        """Note elements of a kind of plugin or part that have no effect here."""
        for tag in tags:
            entries = self._unused.setdefault((kind, reason), [])
            if f"<{tag}>" not in entries:
                entries.append(f"<{tag}>")

    def sentences(self) -> list[str]:
        """All remarks: sentences in the order of their making, then a line of unused elements for
        each kind and reason.
        """
        lines = [
            text.replace("{}", ", ".join(repr(name) for name in names), 1) if names else text
            for text, names in self._sentences.items()
        ]
        for (kind, reason), tags in self._unused.items():
            verb = "is" if len(tags) == 1 else "are"
            text = f"{kind}: {', '.join(tags)} {verb} not used"
            lines.append(f"{text} ({reason})" if reason else text)
        return lines


class Parameters:
    """Children of a plugin's element by name.

    As in gz-sim, the first of several of one name counts. What is never asked for can be listed,
    so that nothing is dropped in silence.
    """

    def __init__(
        self, element: Element, kind: str, remarks: Remarks, repeated: Iterable[str] = ()
    ) -> None:
        """Take the element of a plugin of this kind, of which some children may be repeated."""
        self.kind = kind
        self._remarks = remarks
        self._children: dict[str, Element] = {}
        self._used_names: set[str] = set()
        counts = Counter(child.tag for child in element)
        for child in element:
            if child.tag in self._children:
                continue
            self._children[child.tag] = child
            if counts[child.tag] > 1 and child.tag not in repeated:
                remarks.add(
                    f"{kind}: <{child.tag}> stands {counts[child.tag]} times; as in Gazebo, the "
                    f"first counts ({shortened((child.text or '').strip(), 40)})"
                )

    def __contains__(self, name: str) -> bool:
        return name in self._children

    def __iter__(self) -> Iterator[str]:
        return iter(self._children)

    def text(self, name: str) -> str:
        """Text without blanks around it; empty: there is no such element."""
        self._used_names.add(name)
        child = self._children.get(name)
        return "" if child is None else (child.text or "").strip()

    def number(self, name: str, default: float) -> float:
        """One number; LaisnError if it is none."""
        text = self.text(name)
        if name not in self._children:
            return default
        return float(numbers(text, 1, f"{self.kind}: <{name}>")[0])

    def vector(self, name: str, default: tuple[float, float, float]) -> Floats:
        """Three numbers; LaisnError if they are not."""
        text = self.text(name)
        if name not in self._children:
            return np.array(default)
        return numbers(text, 3, f"{self.kind}: <{name}>")

    def flag(self, name: str, default: bool = False) -> bool:
        """A truth value."""
        text = self.text(name)
        return is_true(text) if name in self._children else default

    def set_aside(self, names: Iterable[str], reason: str) -> None:
        """Remark on elements that are known to have no effect here, with the reason."""
        present = [name for name in names if name in self._children]
        self._used_names.update(present)
        self._remarks.add_unused(self.kind, present, reason)

    def remark_unused(self) -> None:
        """Remark on each element that was not asked for."""
        left = [name for name in self._children if name not in self._used_names]
        self._remarks.add_unused(self.kind, left)


def plugins_of(model: Element, kind: str) -> list[Element]:
    """Plugins of a model itself, of gz-sim's kind, by the last part of their name."""
    return [plugin for plugin in model.findall("plugin") if plugin_kind(plugin) == kind]


def plugin_kind(plugin: Element) -> str:
    """The kind of a plugin of gz-sim, such as Thruster; of another, its whole name."""
    name = plugin.get("name", "")
    scope, _, kind = name.rpartition("::")
    return kind if not scope or scope in GZ_NAMESPACES else name
