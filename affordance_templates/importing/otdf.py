"""MIT's object template description format: URDF with parameters, ${expressions} and patterns."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from affordance_templates.authoring import written
from affordance_templates.importing.imported import SIZES, Imported, Meshes, identifier
from affordance_templates.placement import rotation_of
from handrail.config import ConfigError

_POSE = ("x", "y", "z", "roll", "pitch", "yaw")


class Reader:
    """Reads one file."""

    def __init__(self, file: Path, root: ET.Element):
        self._file, self._root = file, root
        self._left: list[str] = []
        self._meshes = Meshes(file)

    def imported(self) -> Imported:
        root = self._root
        data: dict[str, Any] = {"title": root.get("name", self._file.stem)}
        parameters = dict(self._parameters())
        self._names = {each.get("name", ""): identifier(each.get("name", "")) for each in root.iter("param")}
        self._index = next(name for name in ("i", "j", "k", "copy") if name not in self._names.values())
        joints = {identifier(each.get("name", "")): each for each in root if each.tag in ("joint", "joint_pattern")}
        on_joint = {self._end(each, "child"): name for name, each in joints.items()}
        links = [each for each in root if each.tag in ("link", "link_pattern")]
        data["parameters"] = parameters
        data["objects"] = {identifier(link.get("name", "")): self._object(link, on_joint, joints) for link in links}
        data["joints"] = {name: self._joint(name, each) for name, each in joints.items() if each.get("type") != "fixed"}
        for each in root:
            if each.tag not in ("param", "link", "link_pattern", "joint", "joint_pattern"):
                self._left.append(f"<{each.tag} name={each.get('name', '')!r}>: no counterpart")
        if not data["joints"]:
            del data["joints"]
        return Imported(written(data), self._left, self._meshes.found)

    def _parameters(self) -> list[tuple[str, dict[str, Any]]]:
        found = []
        for each in self._root.findall("param"):
            name = each.get("name", "")
            if name in _POSE:
                self._left.append(f"<param name={name!r}>: where the object is; an instance has a pose")
                continue
            row: dict[str, Any] = {"default": self._float(each, "default_value")}
            for ours, theirs in (("min", "min"), ("max", "max"), ("step", "inc")):
                if each.get(theirs) is not None:
                    row[ours] = self._float(each, theirs)
            found.append((identifier(name), row))
        return found

    def _float(self, each: ET.Element, attribute: str) -> float:
        text = each.get(attribute, "")
        try:
            return float(text)
        except ValueError:
            where = f"param {each.get('name', '')}, {attribute}"
            raise ConfigError(self._file, None, where, f"got {text!r}; expected a number") from None

    def _end(self, joint: ET.Element, tag: str) -> str:
        found = joint.find(tag)
        return identifier(found.get("link", "")) if found is not None else ""

    def _object(
        self, link: ET.Element, on_joint: Mapping[str, str], joints: Mapping[str, ET.Element]
    ) -> dict[str, Any]:
        name, thing = identifier(link.get("name", "")), dict[str, Any]()
        joint = on_joint.get(name)
        if repeat := self._repeat(link):
            thing["repeat"] = repeat
        if joint is not None:
            if bool(repeat) != bool(self._repeat(joints[joint])):
                problem = "several of one and one of the other; expected a <joint_pattern> with each <link_pattern>"
                raise ConfigError(self._file, None, f"{link.tag} {name}, {joints[joint].tag} {joint}", problem)
            if joints[joint].get("type") == "fixed":
                thing["parent"] = self._end(joints[joint], "parent")
            else:
                thing["joint"] = f"{joint}[{self._index}]" if repeat else joint
            # Our joints don't move frames at position 0: the joint's origin is its object's.
            thing |= self._origin(joints[joint])
        # What has nothing to be seen is drawn as what is kept clear of.
        drawn = "visual" if link.find("visual") is not None else "collision"
        if shapes := [shape for each in link.findall(drawn) if (shape := self._shape(each, name)) is not None]:
            thing["shapes"] = shapes
        for each in link:
            if each.tag != drawn:
                why = "planners keep clear of what is drawn" if each.tag == "collision" else "no counterpart"
                self._left.append(f"link {name}, <{each.tag}>: {why}")
        return thing

    def _repeat(self, pattern: ET.Element) -> dict[str, float | str]:
        """How many there are of a pattern; empty: it is none."""
        if not pattern.tag.endswith("_pattern"):
            return {}
        return {self._index: self._numbers(pattern.get("noofrepetitions", ""), 1)[0]}

    def _shape(self, visual: ET.Element, link: str) -> dict[str, Any] | None:
        geometry = visual.find("geometry")
        kinds = list(geometry) if geometry is not None else []
        kind = kinds[0].tag if kinds else "nothing"
        if kind == "mesh":
            file, why = self._meshes.take(kinds[0].get("filename", ""))
            if why:
                self._left.append(f"link {link}, geometry <mesh>: {why}")
                return None
            factors = self._numbers(kinds[0].get("scale", "1 1 1"), 3)
            mesh = {"kind": "mesh", "file": file, **({"size": factors} if factors != [1, 1, 1] else {})}
            return {**mesh, **self._origin(visual), **self._color(visual, link)}
        if kind not in SIZES or not kinds:
            self._left.append(f"link {link}, geometry <{kind}>: expected mesh, {', '.join(SIZES)}")
            return None
        size = [part for key in SIZES[kind] for part in self._numbers(kinds[0].get(key, ""), 3 if kind == "box" else 1)]
        return {"kind": kind, "size": size, **self._origin(visual), **self._color(visual, link)}

    def _color(self, visual: ET.Element, link: str) -> dict[str, Any]:
        material = visual.find("material")
        for each in visual:
            if each.tag not in ("origin", "geometry", "material"):
                self._left.append(f"link {link}, visual's <{each.tag}>: no counterpart")
        if material is None:
            return {}
        if (color := material.find("color")) is None:
            self._left.append(f"link {link}, material {material.get('name', '')!r}: without a color of its own")
            return {}
        return {"color": self._numbers(color.get("rgba", ""), 4)}

    def _origin(self, each: ET.Element) -> dict[str, Any]:
        """Of a pattern, each copy's: `pattern_offset` further along the parent's axes, and turned by it, than the one before."""
        found = {}
        origin, offset = each.find("origin"), each.find("pattern_offset")
        for ours, theirs in (("position", "xyz"), ("rpy", "rpy")):
            first, further = (
                self._numbers(one.get(theirs, "0 0 0") if one is not None else "0 0 0", 3) for one in (origin, offset)
            )
            if (
                ours == "rpy"
                and sum(a != 0 or b != 0 for a, b in zip(first, further, strict=True)) > 1
                and any(further)
            ):
                name = each.get("name", "")
                self._left.append(
                    f"{each.tag} {name}, pattern_offset rpy: turns about several axes don't add up: look at it"
                )
                further = [0, 0, 0]
            if any(value := [self._along(a, b) for a, b in zip(first, further, strict=True)]):
                found[ours] = value
        return found

    def _along(self, first: float | str, further: float | str) -> float | str:
        """Of copy i: first + i · further."""
        if further == 0:
            return first
        steps = f"{self._index} * ({_plain(further)})"
        return steps if first == 0 else f"{_plain(first)} + {steps}"

    def _numbers(self, text: str, count: int) -> list[float | str]:
        """Numbers and ${expressions} apart by blanks."""
        parts = re.findall(r"-?\$\{[^}]*\}|\S+", text)
        if len(parts) != count:
            raise ConfigError(self._file, None, "", f"got {text!r}; expected {count} numbers or ${{expressions}}")
        return [_number(part, self._names) for part in parts]

    def _joint(self, name: str, joint: ET.Element) -> dict[str, Any]:
        kind = joint.get("type", "")
        if kind not in ("revolute", "continuous", "prismatic"):
            self._left.append(f"joint {name}, type {kind}: taken for continuous")
            kind = "continuous"
        axis, limit = joint.find("axis"), joint.find("limit")
        row: dict[str, Any] = {
            "kind": kind,
            "axis": self._numbers(axis.get("xyz", "") if axis is not None else "1 0 0", 3),
        }
        if repeat := self._repeat(joint):
            row["repeat"] = repeat
        origin = self._origin(joint)
        if "position" in origin:
            row["origin"] = origin["position"]
        if "rpy" in origin:
            if all(isinstance(part, float | int) for part in (*origin["rpy"], *row["axis"])):
                turned = rotation_of(np.array(origin["rpy"], float)) @ np.array(row["axis"], float)
                row["axis"] = [round(float(part), 9) + 0.0 for part in turned]
            else:
                self._left.append(
                    f"joint {name}: its axis was said in a turned frame, and now is in its parent's: look at it"
                )
        if parent := self._end(joint, "parent"):
            row["parent"] = parent
        if kind != "continuous":
            for side in ("lower", "upper"):
                text = limit.get(side, "") if limit is not None else ""
                if not text:
                    raise ConfigError(self._file, None, f"joint {name}, limit {side}", "got none; expected a number")
                row[side] = self._numbers(text, 1)[0]
        for key in limit.attrib if limit is not None else ():
            if key not in ("lower", "upper"):
                self._left.append(f"joint {name}, limit {key}: no counterpart")
        for each in joint:
            if each.tag not in ("origin", "pattern_offset", "parent", "child", "axis", "limit"):
                self._left.append(f"joint {name}, <{each.tag}>: no counterpart")
        return row


def _plain(value: float | str) -> str:
    """As part of an expression."""
    return f"({value[2:-1]})" if isinstance(value, str) and value.startswith("${") else str(value)


def _number(text: str, names: Mapping[str, str]) -> float | str:
    """A number, or an expression with the names that ours may have."""
    try:
        return float(text) if float(text) != int(float(text)) else int(float(text))
    except (ValueError, OverflowError):
        pass
    text = text.replace("^", "**")
    for theirs, ours in names.items():
        text = re.sub(rf"\b{re.escape(theirs)}\b", ours, text)
    return f"-({text[3:-1]})" if text.startswith("-${") else text
