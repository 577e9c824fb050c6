"""Fits a tool to an arm of pybullet's data package.

The fitting file says what and where. Its `joint_limits` take the place of the description's, joint
by joint, for descriptions that have placeholders instead of the data sheet's values. The package
stays where it is installed: meshes are named by their absolute paths in what is written.
"""

from __future__ import annotations

import copy
import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from sim_bridge.errors import BridgeError

SCHEMA = "tprmp-fitting/1"
KEYS = (
    "schema",
    "package_urdf",
    "without_links",
    "flange_link",
    "tool_urdf",
    "tool_links",
    "tool_position_m",
    "tool_rpy_rad",
    "joint_limits",
)
NAMES = ("without_links", "tool_links")
NUMBERS = ("tool_position_m", "tool_rpy_rad")
LIMITS = ("velocity_rad_s", "effort_n_m")


def fit(file: Path, out: Path) -> None:
    """Writes the fitted description; raises `BridgeError` naming file, key and expectation."""
    values = _values(file)
    import pybullet_data

    package = Path(pybullet_data.getDataPath()) / values["package_urdf"]
    robot = _tree(package, file, "package_urdf")
    tool = _tree(file.parent / values["tool_urdf"], file, "tool_urdf")
    _take_off(robot, file, values["without_links"])
    if values["flange_link"] not in _names(robot):
        raise BridgeError(
            f"{file}: `flange_link`: expected a link that is left of {package.name}, found "
            f'"{values["flange_link"]}"'
        )
    for mesh in robot.iter("mesh"):
        path = mesh.get("filename", "").replace("package://", "")
        mesh.set("filename", str((package.parent / path).resolve()))
    _set_limits(robot, file, values["joint_limits"])
    _put_on(robot, tool, file, values)
    out.parent.mkdir(parents=True, exist_ok=True)
    ElementTree.ElementTree(robot).write(out, encoding="utf-8", xml_declaration=True)


def _values(file: Path) -> dict:
    try:
        values = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise BridgeError(f"{file}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise BridgeError(f"{file}: is not JSON: {error}") from error
    if not isinstance(values, dict) or set(values) != set(KEYS) or values["schema"] != SCHEMA:
        found = sorted(values) if isinstance(values, dict) else type(values).__name__
        raise BridgeError(
            f'{file}: expected schema "{SCHEMA}" and the keys {", ".join(KEYS)}; found {found}'
        )
    for key in KEYS:
        value = values[key]
        items = value if isinstance(value, list) else [value]
        if key == "joint_limits":
            right = isinstance(value, dict) and all(map(_are_limits, value.values()))
            expected = f"of each joint named the positive numbers {' and '.join(LIMITS)}"
        elif key in NUMBERS:
            right = len(items) == 3 and all(isinstance(item, (int, float)) for item in items)
            expected = "three numbers"
        else:
            lists = key in NAMES
            right = lists == isinstance(value, list) and all(isinstance(i, str) for i in items)
            expected = "a list of names" if lists else "a text"
        if not right:
            raise BridgeError(f"{file}: `{key}`: expected {expected}, found {json.dumps(value)}")
    return values


def _are_limits(value: object) -> bool:
    return (
        isinstance(value, dict)
        and set(value) == set(LIMITS)
        and all(isinstance(limit, (int, float)) and limit > 0 for limit in value.values())
    )


def _tree(urdf: Path, file: Path, key: str) -> ElementTree.Element:
    try:
        return ElementTree.parse(urdf).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise BridgeError(f"{file}: `{key}`: {urdf} cannot be read: {error}") from error


def _names(robot: ElementTree.Element) -> set[str]:
    return {link.get("name", "") for link in robot.findall("link")}


def _child(joint: ElementTree.Element) -> str:
    return joint.find("child").get("link", "")


def _take_off(robot: ElementTree.Element, file: Path, links: list[str]) -> None:
    for name in links:
        if name not in _names(robot):
            raise BridgeError(
                f"{file}: `without_links`: expected links of the package, found {name}"
            )
    for element in [*robot.findall("link"), *robot.findall("joint")]:
        name = element.get("name", "") if element.tag == "link" else _child(element)
        if name in links:
            robot.remove(element)


def _set_limits(robot: ElementTree.Element, file: Path, limits: dict[str, dict]) -> None:
    joints = {joint.get("name"): joint for joint in robot.findall("joint")}
    for name, values in limits.items():
        limit = joints[name].find("limit") if name in joints else None
        if limit is None:
            raise BridgeError(
                f"{file}: `joint_limits`: expected joints of the package with <limit>, found {name}"
            )
        for attribute, key in zip(("velocity", "effort"), LIMITS):
            limit.set(attribute, str(values[key]))


def _put_on(
    robot: ElementTree.Element, tool: ElementTree.Element, file: Path, values: dict
) -> None:
    links = values["tool_links"]
    for name in links:
        if name not in _names(tool):
            expected = f"links of {values['tool_urdf']}"
            raise BridgeError(f"{file}: `tool_links`: expected {expected}, found {name}")
        robot.append(next(link for link in tool.findall("link") if link.get("name") == name))
    for joint in tool.findall("joint"):
        if _child(joint) in links:
            fitted = copy.deepcopy(joint)
            if fitted.find("parent").get("link") not in links:
                fitted.find("parent").set("link", values["flange_link"])
                origin = fitted.find("origin")
                for attribute, key in (("xyz", "tool_position_m"), ("rpy", "tool_rpy_rad")):
                    origin.set(attribute, " ".join(map(str, values[key])))
            robot.append(fitted)
    for name in {material.get("name") for link in links for material in _materials(robot, link)}:
        if all(material.get("name") != name for material in robot.findall("material")):
            robot.extend(m for m in tool.findall("material") if m.get("name") == name)


def _materials(robot: ElementTree.Element, link: str) -> list[ElementTree.Element]:
    found = next(element for element in robot.findall("link") if element.get("name") == link)
    return list(found.iter("material"))
