"""Included models put in the place of their <include>, as far as they are found on this machine."""

import os
from copy import deepcopy
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from laisn.errors import LaisnError
from sim.gazebo.document import Remarks, child_text, is_true, parse, read_document
from sim.gazebo.frames import MODEL, local_pose
from sim.system import read_text

LARGEST_FILE = 10_000_000  # [bytes]
DEEPEST_INCLUDE = 10
_PATHS = ("GZ_SIM_RESOURCE_PATH", "SDF_PATH")


def put_in_place(root: Element, folder: Path | None, remarks: Remarks) -> None:
    """Replace each <include> of a model that can be read; the others stay.

    Args:
        root: of the document.
        folder: of the file; models are looked for there, above it, and in the folders of
            GZ_SIM_RESOURCE_PATH. None: nothing is looked for.
        remarks: what is left out.
    """
    _modernise(root)
    for holder in [element for element in root.iter() if element.tag in ("sdf", "world", "model")]:
        _expand(holder, folder, remarks, 0)


def _expand(holder: Element, folder: Path | None, remarks: Remarks, depth: int) -> None:
    for include in holder.findall("include"):
        uri = child_text(include, "uri")
        path = None if folder is None else _find(uri, folder)
        if path is None:
            continue
        if depth >= DEEPEST_INCLUDE:
            raise LaisnError(f"<include> of {uri!r}: nested more than {DEEPEST_INCLUDE} deep")
        try:
            document = read_document(read_text(path, LARGEST_FILE))
        except LaisnError as error:
            raise LaisnError(f"<include> of {uri!r}: {path}: {error}") from None
        model = document.find("model")
        if model is None:
            continue
        _modernise(document)
        _expand(model, path.parent, remarks, depth + 1)
        _replace(holder, include, deepcopy(model), remarks)


def _find(uri: str, folder: Path) -> Path | None:
    """The SDF file of a URI; None: it is not on this machine."""
    scheme, separator, rest = uri.partition("://")
    if separator and scheme not in ("model", "file", "package"):
        return None
    name = rest if separator else uri
    if not name:
        return None
    searched = [folder, *list(folder.resolve().parents)[:3]]
    for variable in _PATHS:
        searched += [
            Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry
        ]
    for directory in searched:
        path = directory / name
        if path.is_file() and path.suffix == ".sdf":
            return path
        if path.is_dir() and (file := _file_of_model(path)) is not None:
            return file
    return None


def _file_of_model(folder: Path) -> Path | None:
    """The SDF file of a model's folder: the last that model.config names, or model.sdf."""
    config = folder / "model.config"
    names = ["model.sdf"]
    if config.is_file():
        files = parse(read_text(config, LARGEST_FILE)).findall("sdf")
        names += [(file.text or "").strip() for file in files]
    paths = [folder / name for name in reversed(names) if name]
    return next((path for path in paths if path.is_file()), None)


def _modernise(root: Element) -> None:
    """Write axes in the model's frame, of SDF before 1.7, as today's SDF does."""
    version = root.get("version", "1.7").strip().split(".")
    minor = int(version[1]) if len(version) > 1 and version[1].isdigit() else 7
    for axis in root.iter("axis"):
        flag = axis.find("use_parent_model_frame")
        xyz = axis.find("xyz")
        in_model = is_true(flag.text) if flag is not None else minor <= 4
        if in_model and xyz is not None:
            xyz.set("expressed_in", MODEL)
        if flag is not None:
            axis.remove(flag)


def _replace(holder: Element, include: Element, model: Element, remarks: Remarks) -> None:
    """Put a model in the place of its <include>, with the name, pose and plugins given there."""
    if name := child_text(include, "name"):
        model.set("name", name)
    if placement := child_text(include, "placement_frame"):
        model.set("placement_frame", placement)
    pose = include.find("pose")
    if pose is not None:
        for former in model.findall("pose"):
            model.remove(former)
        model.append(pose)
    model.extend(include.findall("plugin"))
    changed = [
        child.tag
        for parameters in include.findall("experimental:params")
        for child in parameters
        if child.tag != "sensor"
    ]
    if changed:
        remarks.add(
            f"<include> of {model.get('name')!r}: <experimental:params> changes "
            f"{', '.join(f'<{tag}>' for tag in dict.fromkeys(changed))}, which is not read"
        )
    position = list(holder).index(include)
    holder.remove(include)
    if is_true(include.get("merge")):
        for number, element in enumerate(_merged_parts(model)):
            holder.insert(position + number, element)
    else:
        holder.insert(position, model)


def _merged_parts(model: Element) -> list[Element]:
    """The parts of a model that is merged into another, standing relative to a frame of its own."""
    name = f"_merged__{model.get('name', '')}__model__"
    anchor = Element("frame", {"name": name})
    pose = model.find("pose")
    if pose is not None:
        anchor.append(pose)
    placement = model.get("placement_frame", "")
    if placement and pose is not None and local_pose(model).any():
        raise LaisnError(
            f"model {model.get('name')!r}: placement_frame is not read where the model is merged"
        )
    parts = [child for child in model if child.tag not in ("pose", "static", "enable_wind")]
    for child in parts:
        if child.tag in ("link", "frame", "model"):
            _anchor(child, name)
        if child.tag != "model":
            _refer_to(child, name)
    return [anchor, *parts]


def _refer_to(part: Element, name: str) -> None:
    """Let poses and axes within a part of a model name a frame where they name the model. The part
    is no nested model, within which they would name that one.
    """
    for tag, attribute in (("pose", "relative_to"), ("xyz", "expressed_in")):
        for element in part.iter(tag):
            if element.get(attribute) == MODEL:
                element.set(attribute, name)


def _anchor(element: Element, name: str) -> None:
    """Let a part stand relative to a frame where it stood relative to its model."""
    attached = element.get("attached_to", "")
    if attached == MODEL:
        element.set("attached_to", name)
    pose = element.find("pose")
    if pose is None:
        pose = SubElement(element, "pose")
        pose.text = "0 0 0 0 0 0"
    if pose.get("relative_to", "") in ("", MODEL) and (not attached or attached == MODEL):
        pose.set("relative_to", name)
