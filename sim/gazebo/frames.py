"""Frames of a model: where links, joints, frames and nested models stand and how they are turned.

SDF's rules: a pose is relative to the frame that it names; without a name, that of a link or nested
model to its model, of a joint to its child, of a frame to what it is attached to, of a collision to
its link. All poses are homogeneous 4×4 matrices [m].
"""

from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from laisn.arrays import Floats
from laisn.errors import LaisnError
from sim.gazebo.document import child_text, is_true, numbers

MODEL = "__model__"
DEEPEST_CHAIN = 100  # frames that stand relative to one another


def local_pose(element: Element) -> Floats:
    """Pose of an element in the frame to which it is relative."""
    pose = element.find("pose")
    frame = np.eye(4)
    if pose is None or not (pose.text or "").strip():
        return frame
    label = f"<pose> of {element.get('name', element.tag)!r}"
    rotation_format = pose.get("rotation_format", "euler_rpy")
    if rotation_format == "quat_xyzw":
        values = numbers(pose.text, 7, label)
        if not np.linalg.norm(values[3:]) > 0.0:
            raise LaisnError(f"{label}: the quaternion must not be zero")
        rotation = Rotation.from_quat(values[3:])
    elif rotation_format == "euler_rpy":
        values = numbers(pose.text, 6, label)
        # about fixed axes: roll, then pitch, then yaw
        rotation = Rotation.from_euler("xyz", values[3:], degrees=is_true(pose.get("degrees")))
    else:
        raise LaisnError(
            f"{label}: rotation_format must be euler_rpy or quat_xyzw (given: {rotation_format!r})"
        )
    frame[:3, :3] = rotation.as_matrix()
    frame[:3, 3] = values[:3]
    return frame


def relative_to(element: Element, default: str) -> str:
    """Name of the frame to which the pose of an element is relative."""
    pose = element.find("pose")
    return (pose.get("relative_to", "") if pose is not None else "") or default


@dataclass(eq=False)
class SdfModel:
    """A model with its links, joints, frames and nested models by name."""

    element: Element
    parent: "SdfModel | None" = None
    links: dict[str, Element] = field(default_factory=dict)
    joints: dict[str, Element] = field(default_factory=dict)
    frames: dict[str, Element] = field(default_factory=dict)
    models: dict[str, "SdfModel"] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Gather the parts; LaisnError if two have one name."""
        for child in self.element:
            name = child.get("name", "")
            parts = {"link": self.links, "joint": self.joints, "frame": self.frames}
            if child.tag == "model":
                self._require_new(name)
                self.models[name] = SdfModel(child, self)
            elif child.tag in parts:
                self._require_new(name)
                parts[child.tag][name] = child

    def _require_new(self, name: str) -> None:
        if any(name in names for names in (self.links, self.joints, self.frames, self.models)):
            raise LaisnError(f"model {self.name!r}: two elements have the name {name!r}")

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.element.get("name", "")

    def path(self) -> list[str]:
        """Names of the models that hold this one, and its own, from the outermost on."""
        if self.parent is None:
            return [self.name]
        return [*self.parent.path(), self.name]

    def all_models(self) -> "list[SdfModel]":
        """The model and those nested in it, at any depth."""
        return [self, *(inner for model in self.models.values() for inner in model.all_models())]

    def pose(self) -> Floats:
        """Pose of the model's frame in that of the outermost model."""
        if self.parent is None:
            return np.eye(4)
        return self.parent.pose() @ self.pose_in_parent()

    def pose_of(self, name: str) -> Floats:
        """Pose of a frame of the model in that of the outermost model."""
        return self.pose() @ self.pose_in_model(name)

    def pose_within(self, link: str, part: Element) -> Floats:
        """Pose of a part of a link, as of a collision, in the frame of the outermost model."""
        return self.pose_of(relative_to(part, link)) @ local_pose(part)

    def pose_in_parent(self, chain: tuple[str, ...] = ()) -> Floats:
        """Pose of a nested model in the model that holds it."""
        assert self.parent is not None
        reference = self.parent.pose_in_model(relative_to(self.element, MODEL), chain)
        pose = reference @ local_pose(self.element)
        placement = self.element.get("placement_frame", "")
        return pose @ np.linalg.inv(self.pose_in_model(placement)) if placement else pose

    def pose_in_model(self, name: str, chain: tuple[str, ...] = ()) -> Floats:
        """Pose of a frame in that of the model.

        Args:
            name: of a link, joint, frame or nested model, "__model__", or of one within nested
                models, with "::" between.
            chain: names that wait for this pose.

        Raises:
            LaisnError: there is no such frame, or frames are relative to one another in a circle.
        """
        if name in ("", MODEL):
            return np.eye(4)
        if name in chain or len(chain) > DEEPEST_CHAIN:
            raise LaisnError(
                f"model {self.name!r}: the pose of {name!r} is relative to itself"
                if name in chain
                else f"model {self.name!r}: more than {DEEPEST_CHAIN} poses relative to one another"
            )
        chain = (*chain, name)
        if name in self.links:
            element = self.links[name]
            reference = relative_to(element, MODEL)
        elif name in self.frames:
            element = self.frames[name]
            reference = relative_to(element, element.get("attached_to", "") or MODEL)
        elif name in self.joints:
            element = self.joints[name]
            reference = relative_to(element, child_text(element, "child"))
        elif name in self.models:
            return self.models[name].pose_in_parent(chain)
        else:
            inner, _, rest = name.partition("::")
            if inner not in self.models or not rest:
                raise LaisnError(f"model {self.name!r} has no frame {name!r}")
            model = self.models[inner]
            return model.pose_in_parent(chain) @ model.pose_in_model(rest)
        return self.pose_in_model(reference, chain) @ local_pose(element)

    def find_link(self, name: str) -> "tuple[SdfModel, str] | None":
        """The link of a name, also of a frame that is attached to it or of a nested model's, with
        its model.
        """
        for _ in range(DEEPEST_CHAIN):
            if name in self.links:
                return self, name
            if name in self.models and (links := list(self.models[name].links)):
                return self.models[name], links[0]
            if name not in self.frames:
                break
            name = self.frames[name].get("attached_to", "")
        inner, _, rest = name.partition("::")
        return self.models[inner].find_link(rest) if rest and inner in self.models else None

    def joint_axis(self, name: str) -> Floats:
        """Unit vector of a joint's axis, in the frame of the outermost model."""
        joint = self.joints[name]
        xyz = joint.find("axis/xyz")
        axis = np.array([0.0, 0.0, 1.0])
        expressed_in = ""
        if xyz is not None:
            axis = numbers(xyz.text, 3, f"<axis> of joint {name!r}")
            expressed_in = xyz.get("expressed_in", "")
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise LaisnError(f"<axis> of joint {name!r} must not be zero")
        frame = self.pose_of(expressed_in or name)
        return np.asarray(frame[:3, :3] @ axis / length)
