"""Templates of others: MIT's OTDF (Fallon et al. 2015, §5) and NASA's affordance templates (.atdf's XML, the older JSON).

What has a counterpart becomes a template of ours; the rest is listed, nothing is dropped in silence.
"""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from affordance_templates.authoring import written
from affordance_templates.placement import rotation_of
from handrail.config import ConfigError

_POSE = ("x", "y", "z", "roll", "pitch", "yaw")
_LARGEST = 2_000_000  # characters
_SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "torus": ("radius", "tube_radius")}


@dataclass
class Imported:
    """A template's text, and what of the source is not in it."""

    text: str
    left_out: list[str] = field(default_factory=list)


def read(file: Path) -> Imported:
    """Read an OTDF, .atdf or JSON file; which one, its content says. Raises ConfigError, with the line where there is one."""
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise ConfigError(file, None, "", f"can't be read: {problem}") from problem
    if len(text) > _LARGEST:
        raise ConfigError(file, None, "", f"{len(text)} characters; expected at most {_LARGEST}")
    if text.lstrip().startswith("{"):
        try:
            data = json.loads(text)
        except (ValueError, RecursionError) as problem:
            raise ConfigError(file, getattr(problem, "lineno", None), "", f"not JSON: {problem}") from problem
        return _nasa(file, data)
    if "<!ENTITY" in text:
        raise ConfigError(file, None, "", "defines XML entities; expected none")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, RecursionError) as problem:
        line = problem.position[0] if isinstance(problem, ET.ParseError) else None
        raise ConfigError(file, line, "", f"not XML: {problem}") from problem
    if root.tag == "object":
        return _Otdf(file, root).imported()
    if root.tag == "affordance_template":
        return _nasa(file, _as_json(root))
    raise ConfigError(file, 1, "", f"got <{root.tag}>; expected <object> (OTDF) or <affordance_template>")


# ------------------------------------------------------------------------------------------------------------------ OTDF


class _Otdf:
    """MIT's object template description format: URDF with parameters and ${expressions}."""

    def __init__(self, file: Path, root: ET.Element):
        self._file, self._root = file, root
        self._left: list[str] = []

    def imported(self) -> Imported:
        root = self._root
        data: dict[str, Any] = {"title": root.get("name", self._file.stem)}
        parameters = dict(self._parameters())
        self._names = {each.get("name", ""): _identifier(each.get("name", "")) for each in root.iter("param")}
        joints = {_identifier(each.get("name", "")): each for each in root.findall("joint")}
        on_joint = {self._end(each, "child"): name for name, each in joints.items()}
        data["parameters"] = parameters
        data["objects"] = {
            _identifier(link.get("name", "")): self._object(link, on_joint, joints) for link in root.findall("link")
        }
        data["joints"] = {name: self._joint(name, each) for name, each in joints.items() if each.get("type") != "fixed"}
        for each in root:
            if each.tag not in ("param", "link", "joint"):
                self._left.append(f"<{each.tag} name={each.get('name', '')!r}>: no counterpart")
        if not data["joints"]:
            del data["joints"]
        return Imported(written(data), self._left)

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
            found.append((_identifier(name), row))
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
        return _identifier(found.get("link", "")) if found is not None else ""

    def _object(
        self, link: ET.Element, on_joint: Mapping[str, str], joints: Mapping[str, ET.Element]
    ) -> dict[str, Any]:
        name, thing = _identifier(link.get("name", "")), dict[str, Any]()
        joint = on_joint.get(name)
        if joint is not None:
            fixed = joints[joint].get("type") == "fixed"
            thing["parent" if fixed else "joint"] = self._end(joints[joint], "parent") if fixed else joint
            # Our joints don't move frames at position 0: the joint's origin is its object's.
            thing |= self._origin(joints[joint])
        shapes = []
        for visual in link.findall("visual"):
            if (shape := self._shape(visual, name)) is not None:
                shapes.append(shape)
        if shapes:
            thing["shapes"] = shapes
        for each in link:
            if each.tag != "visual":
                why = "planners keep clear of what is drawn" if each.tag == "collision" else "no counterpart"
                self._left.append(f"link {name}, <{each.tag}>: {why}")
        return thing

    def _shape(self, visual: ET.Element, link: str) -> dict[str, Any] | None:
        geometry = visual.find("geometry")
        kinds = list(geometry) if geometry is not None else []
        kind = kinds[0].tag if kinds else "nothing"
        if kind not in _SIZES or not kinds:
            self._left.append(
                f"link {link}, geometry <{kind}>: expected {', '.join(_SIZES)} (meshes are not brought along)"
            )
            return None
        size = [
            part for key in _SIZES[kind] for part in self._numbers(kinds[0].get(key, ""), 3 if kind == "box" else 1)
        ]
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
        origin = each.find("origin")
        if origin is None:
            return {}
        found = {
            "position": self._numbers(origin.get("xyz", "0 0 0"), 3),
            "rpy": self._numbers(origin.get("rpy", "0 0 0"), 3),
        }
        return {key: value for key, value in found.items() if value != [0, 0, 0]}

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
            if each.tag not in ("origin", "parent", "child", "axis", "limit"):
                self._left.append(f"joint {name}, <{each.tag}>: no counterpart")
        return row


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


# ------------------------------------------------------------------------------------------------------------------ NASA


def _as_json(root: ET.Element) -> dict[str, Any]:
    """An .atdf's XML as the JSON format says the same."""
    objects = [
        {
            "name": each.get("name", ""),
            "parent": each.get("parent")
            or (each.find("parent").get("name", "") if each.find("parent") is not None else ""),  # type: ignore[union-attr]
            "origin": _attributes(each.find("origin")),
            "controls": _attributes(each.find("controls")),
            "shape": next((part.tag for part in each.findall("geometry/*")), ""),
            "geometry": next((dict(part.attrib) for part in each.findall("geometry/*")), {}),
            "color": next((part.get("rgba", "").split() for part in each.findall("material/color")), []),
        }
        for each in root.findall("display_objects/display_object")
    ]

    def waypoint(each: ET.Element) -> dict[str, Any]:
        return {**each.attrib, **{part.tag: _attributes(part) for part in each}}

    trajectories = [
        {
            "name": each.get("name", ""),
            "end_effector_group": [
                {
                    "id": group.get("id", "0"),
                    "end_effector_waypoint": [waypoint(w) for w in group.findall("end_effector_waypoint")],
                }
                for group in each.findall("end_effector_group")
            ],
        }
        for each in root.iter("end_effector_trajectory")
    ]
    older: dict[str, list[dict[str, Any]]] = {}
    for each in root.findall("end_effector_waypoints/end_effector_waypoint"):
        older.setdefault(each.get("end_effector", "0"), []).append(waypoint(each))
    if older:
        groups = [{"id": hand, "end_effector_waypoint": rows} for hand, rows in older.items()]
        trajectories.append({"name": "waypoints", "end_effector_group": groups})
    return {
        "name": root.get("name", ""),
        "image": root.get("image", ""),
        "display_objects": objects,
        "end_effector_trajectory": trajectories,
    }


def _attributes(each: ET.Element | None) -> dict[str, Any]:
    return (
        {}
        if each is None
        else {key: text.split() if key in ("xyz", "rpy") else text for key, text in each.attrib.items()}
    )


def _nasa(file: Path, data: Any) -> Imported:
    """NASA's template: objects, and a trajectory for each hand of each of its trajectories."""
    left: list[str] = []
    if not isinstance(data, dict) or not isinstance(data.get("display_objects"), list):
        raise ConfigError(file, None, "display_objects", "not there; expected NASA's affordance template")
    if data.get("image"):
        left.append("image: no counterpart (handrail template render draws one)")
    out: dict[str, Any] = {"title": data.get("name") or file.stem, "objects": {}, "trajectories": {}}
    for k, thing in enumerate(data["display_objects"]):
        where = f"display_objects[{k}]"
        name = _identifier(str(_mapping(file, where, thing).get("name", f"object{k}")))
        row: dict[str, Any] = {"parent": _identifier(str(thing["parent"]))} if thing.get("parent") else {}
        row |= _placed(file, where, thing.get("origin"))
        if (shape := _nasa_shape(file, where, thing, name, left)) is not None:
            row["shapes"] = [shape]
        if thing.get("controls"):
            left.append(f"{name}, controls: `editable` names the parameter that a drag changes; there is none")
        out["objects"][name] = row
    sync: dict[str, Any] = {}
    for k, trajectory in enumerate(_list(file, "end_effector_trajectory", data.get("end_effector_trajectory"))):
        where = f"end_effector_trajectory[{k}]"
        title = str(_mapping(file, where, trajectory).get("name", f"trajectory{k}"))
        groups = _list(file, f"{where}.end_effector_group", trajectory.get("end_effector_group"))
        names = []
        for group in groups:
            hand = f"hand{_mapping(file, where, group).get('id', 0)}"
            name = _identifier(title) + (f"_{hand}" if len(groups) > 1 else "")
            waypoints = _list(file, f"{where}, {hand}, end_effector_waypoint", group.get("end_effector_waypoint"))
            rows = [
                _nasa_waypoint(file, f"{where}, {hand}, waypoint {n}", each, n, left)
                for n, each in enumerate(waypoints)
            ]
            if rows:
                out["trajectories"][name] = {"title": title, "hand": hand, "waypoints": rows}
                names.append((name, len(rows)))
        if len(names) > 1:
            shared = min(count for _, count in names)
            points = [[f"{name}.waypoint{n}" for name, _ in names] for n in range(shared)]
            sync[_identifier(title)] = {"trajectories": [name for name, _ in names], "points": points}
    if not out["trajectories"]:
        del out["trajectories"]
    else:
        left.append("hands: taken to point along −z with fingers closing along y; one that does not needs a `palm`")
    if sync:
        out["sync"] = sync
    return Imported(written(out), left)


def _nasa_shape(file: Path, where: str, thing: Mapping[str, Any], name: str, left: list[str]) -> dict[str, Any] | None:
    given, size = thing.get("shape", ""), thing.get("size")
    geometry = _mapping(file, where, thing.get("geometry", {}))
    kind = str(given.get("type", "") if isinstance(given, dict) else given)
    if isinstance(given, dict):
        geometry = given
    if kind not in ("box", "cylinder", "sphere"):
        left.append(f"{name}, shape {kind or 'none'}: expected box, cylinder or sphere (meshes are not brought along)")
        return None
    if size is None:
        words = [str(geometry.get(key, "")).split() for key in _SIZES[kind]]
        size = [word for row in words for word in row]
    row: dict[str, Any] = {
        "kind": kind,
        "size": _floats(file, f"{where}.size", size, 3 if kind == "box" else len(_SIZES[kind])),
    }
    if thing.get("color"):
        row["color"] = _floats(file, f"{where}.color", thing["color"], 4)
    return row


def _nasa_waypoint(file: Path, where: str, each: Any, number: int, left: list[str]) -> dict[str, Any]:
    each = _mapping(file, where, each)
    row: dict[str, Any] = {"name": f"waypoint{number}", "approach": "free" if number == 0 else "straight"}
    if each.get("display_object"):
        row["frame"] = _identifier(str(each["display_object"]))
    row |= _placed(file, where, each.get("origin"))
    if each.get("ee_pose") is not None:
        row["hand_pose"] = f"pose{each['ee_pose']}"
    for key, value in each.items():
        if key not in ("display_object", "origin", "ee_pose", "id", "end_effector") and value:
            left.append(f"{where}, {key}: no counterpart")
    return row


def _placed(file: Path, where: str, origin: Any) -> dict[str, Any]:
    origin = _mapping(file, f"{where}.origin", origin or {})
    found = {
        "position": _floats(file, f"{where}.origin.xyz", origin.get("xyz", [0, 0, 0]), 3),
        "rpy": _floats(file, f"{where}.origin.rpy", origin.get("rpy", [0, 0, 0]), 3),
    }
    return {key: value for key, value in found.items() if any(value)}


def _mapping(file: Path, where: str, given: Any) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise ConfigError(file, None, where, f"got {given!r:.40}; expected a mapping")
    return given


def _list(file: Path, where: str, given: Any) -> list[Any]:
    if given is None:
        return []
    if not isinstance(given, list):
        raise ConfigError(file, None, where, f"got {given!r:.40}; expected a list")
    return given


def _floats(file: Path, where: str, given: Any, count: int) -> list[float]:
    try:
        found = [float(each) for each in given]
    except (TypeError, ValueError):
        found = []
    if len(found) != count:
        raise ConfigError(file, None, where, f"got {given!r:.60}; expected {count} numbers")
    return found


def _identifier(name: str) -> str:
    """A name that ours may have."""
    word = re.sub(r"\W+", "_", name.strip()).strip("_").lower() or "unnamed"
    return f"_{word}" if word[0].isdigit() else word
