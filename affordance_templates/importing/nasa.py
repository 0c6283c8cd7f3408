"""NASA's affordance templates: objects, and a trajectory for each hand of each of theirs."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from affordance_templates.authoring import written
from affordance_templates.importing.imported import SIZES, Imported, Meshes, identifier
from handrail.config import ConfigError


def as_json(root: ET.Element) -> dict[str, Any]:
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


def imported(file: Path, data: Any) -> Imported:
    """NASA's template: objects, and a trajectory for each hand of each of its trajectories."""
    left, meshes = list[str](), Meshes(file)
    if not isinstance(data, dict) or not isinstance(data.get("display_objects"), list):
        raise ConfigError(file, None, "display_objects", "not there; expected NASA's affordance template")
    if data.get("image"):
        left.append("image: no counterpart (handrail template render draws one)")
    out: dict[str, Any] = {"title": data.get("name") or file.stem, "objects": {}, "trajectories": {}}
    for k, thing in enumerate(data["display_objects"]):
        where = f"display_objects[{k}]"
        name = identifier(str(_mapping(file, where, thing).get("name", f"object{k}")))
        row: dict[str, Any] = {"parent": identifier(str(thing["parent"]))} if thing.get("parent") else {}
        row |= _placed(file, where, thing.get("origin"))
        if (shape := _nasa_shape(file, where, thing, name, left, meshes)) is not None:
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
            name = identifier(title) + (f"_{hand}" if len(groups) > 1 else "")
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
            sync[identifier(title)] = {"trajectories": [name for name, _ in names], "points": points}
    if not out["trajectories"]:
        del out["trajectories"]
    else:
        left.append("hands: taken to point along −z with fingers closing along y; one that does not needs a `palm`")
    if sync:
        out["sync"] = sync
    return Imported(written(out), left, meshes.found)


def _nasa_shape(
    file: Path, where: str, thing: Mapping[str, Any], name: str, left: list[str], meshes: Meshes
) -> dict[str, Any] | None:
    given, size = thing.get("shape", ""), thing.get("size")
    geometry = _mapping(file, where, thing.get("geometry", {}))
    kind = str(given.get("type", "") if isinstance(given, dict) else given)
    if isinstance(given, dict):
        geometry = given
    color = {"color": _floats(file, f"{where}.color", thing["color"], 4)} if thing.get("color") else {}
    if kind == "mesh":
        mesh, why = meshes.take(
            str(next((geometry[key] for key in ("filename", "mesh", "file") if geometry.get(key)), ""))
        )
        if why:
            left.append(f"{name}, shape mesh: {why}")
            return None
        scale = geometry.get("scale", "1 1 1")
        factors = _floats(file, f"{where}.scale", scale.split() if isinstance(scale, str) else scale, 3)
        return {"kind": "mesh", "file": mesh, **({"size": factors} if factors != [1, 1, 1] else {}), **color}
    if kind not in ("box", "cylinder", "sphere"):
        left.append(f"{name}, shape {kind or 'none'}: expected box, cylinder, sphere or mesh")
        return None
    if size is None:
        words = [str(geometry.get(key, "")).split() for key in SIZES[kind]]
        size = [word for row in words for word in row]
    row: dict[str, Any] = {
        "kind": kind,
        "size": _floats(file, f"{where}.size", size, 3 if kind == "box" else len(SIZES[kind])),
    }
    return {**row, **color}


def _nasa_waypoint(file: Path, where: str, each: Any, number: int, left: list[str]) -> dict[str, Any]:
    each = _mapping(file, where, each)
    row: dict[str, Any] = {"name": f"waypoint{number}", "approach": "free" if number == 0 else "straight"}
    if each.get("display_object"):
        row["frame"] = identifier(str(each["display_object"]))
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
