"""Fits a tool to an arm of pybullet's data package.

The fitting file says what and where. Its `joint_limits` take the place of the description's, joint
by joint, for descriptions that have placeholders instead of the data sheet's values. The package
stays where it is installed: meshes are named by their absolute paths in what is written.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

from sim_bridge import settings
from sim_bridge.errors import BridgeError
from sim_bridge.files import make_folder, write

SCHEMA = "tprmp-fitting/1"
LIMITS = ("velocity_rad_s", "effort_n_m")


def _are_limits(value: object) -> bool:
    return (
        isinstance(value, dict)
        and set(value) == set(LIMITS)
        and all(settings.is_number(limit) and limit > 0 for limit in value.values())
    )


def _numbers() -> object:
    return settings.key("three numbers", lambda value: settings.are_numbers(value, 3), list)


def _names() -> object:
    def accepts(value: object) -> bool:
        return isinstance(value, list) and all(isinstance(item, str) for item in value)

    return settings.key("a list of names", accepts, list)


@dataclass(frozen=True)
class Fitting:
    """A fitting file, checked."""

    schema: str = settings.key(f'"{SCHEMA}"', lambda value: value == SCHEMA, str)
    package_urdf: str = settings.text()
    without_links: list[str] = _names()
    flange_link: str = settings.text()
    tool_urdf: Path = settings.path()
    tool_links: list[str] = _names()
    tool_position_m: list[float] = _numbers()
    tool_rpy_rad: list[float] = _numbers()
    joint_limits: dict[str, dict] = settings.key(
        f"of each joint named the positive numbers {' and '.join(LIMITS)}",
        lambda value: isinstance(value, dict) and all(map(_are_limits, value.values())),
        dict,
    )


def fit(file: Path, out: Path) -> None:
    """Writes the fitted description; raises `BridgeError` naming file, key and expectation."""
    fitting = settings.section(Fitting, file, "", settings.read_json(file))
    import pybullet_data

    data = Path(pybullet_data.getDataPath()).resolve()
    package = (data / fitting.package_urdf).resolve()
    if data not in package.parents:
        raise settings.refused(
            file, "package_urdf", "a path inside pybullet's data package", fitting.package_urdf
        )
    robot = _tree(package, file, "package_urdf")
    tool = _tree(fitting.tool_urdf, file, "tool_urdf")
    _take_off(robot, file, fitting.without_links)
    if fitting.flange_link not in _link_names(robot):
        raise BridgeError(
            f"{file}: `flange_link`: expected a link that is left of {package.name}, found "
            f'"{fitting.flange_link}"'
        )
    for mesh in robot.iter("mesh"):
        path = mesh.get("filename", "").replace("package://", "")
        mesh.set("filename", str((package.parent / path).resolve()))
    _set_limits(robot, file, fitting.joint_limits)
    _put_on(robot, tool, file, fitting)
    make_folder(out.parent)
    text = ElementTree.tostring(robot, encoding="utf-8", xml_declaration=True)
    # The one file that was named is written anew.
    write(out, text, force=True)


def _tree(urdf: Path, file: Path, key: str) -> ElementTree.Element:
    try:
        return ElementTree.parse(urdf).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise BridgeError(f"{file}: `{key}`: {urdf} cannot be read: {error}") from error


def _link_names(robot: ElementTree.Element) -> set[str]:
    return {link.get("name", "") for link in robot.findall("link")}


def _child(joint: ElementTree.Element) -> str:
    return joint.find("child").get("link", "")


def _take_off(robot: ElementTree.Element, file: Path, links: list[str]) -> None:
    for name in links:
        if name not in _link_names(robot):
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
    robot: ElementTree.Element, tool: ElementTree.Element, file: Path, fitting: Fitting
) -> None:
    links = fitting.tool_links
    for name in links:
        if name not in _link_names(tool):
            expected = f"links of {fitting.tool_urdf.name}"
            raise BridgeError(f"{file}: `tool_links`: expected {expected}, found {name}")
        robot.append(next(link for link in tool.findall("link") if link.get("name") == name))
    for joint in tool.findall("joint"):
        if _child(joint) in links:
            fitted = copy.deepcopy(joint)
            if fitted.find("parent").get("link") not in links:
                fitted.find("parent").set("link", fitting.flange_link)
                origin = fitted.find("origin")
                for attribute, numbers in (
                    ("xyz", fitting.tool_position_m),
                    ("rpy", fitting.tool_rpy_rad),
                ):
                    origin.set(attribute, " ".join(map(str, numbers)))
            robot.append(fitted)
    for name in {material.get("name") for link in links for material in _materials(robot, link)}:
        if all(material.get("name") != name for material in robot.findall("material")):
            robot.extend(m for m in tool.findall("material") if m.get("name") == name)


def _materials(robot: ElementTree.Element, link: str) -> list[ElementTree.Element]:
    found = next(element for element in robot.findall("link") if element.get("name") == link)
    return list(found.iter("material"))
