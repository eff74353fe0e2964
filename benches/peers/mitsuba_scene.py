"""Loader of Mitsuba scenes for renderers that do not read them. It covers a Cornell box and refuses
everything else.

Supported are ply shapes (ASCII) with `to_world`, diffuse and roughconductor BSDFs (GGX, material none),
also within `twosided`, point and area emitters, and a perspective sensor with `lookat`.
"""

import math
import os
from dataclasses import dataclass
from typing import Optional
from xml.etree import ElementTree

import numpy as np

from protocol import Refusal


@dataclass
class Shape:
    """Triangle mesh in world space. `normals` are unit vertex normals, or None."""

    name: str
    positions: np.ndarray
    triangles: np.ndarray
    normals: Optional[np.ndarray]
    color: tuple
    alpha: Optional[float]  # GGX alpha of a conductor; None for a diffuse surface
    radiance: Optional[tuple]


@dataclass
class PointLight:
    """Point light with its intensity in W/sr."""

    position: tuple
    intensity: tuple


@dataclass
class Camera:
    """Perspective camera. tan_x and tan_y are the tangents of half the horizontal and vertical angles of
    view."""

    origin: np.ndarray
    target: np.ndarray
    up: np.ndarray
    tan_x: float
    tan_y: float


@dataclass
class Scene:
    shapes: list
    lights: list
    camera: Camera


def load(args):
    """Loads the scene of the command line with the camera for its picture size."""
    root = ElementTree.parse(args.scene).getroot()
    folder = os.path.dirname(os.path.abspath(args.scene))
    defaults = {e.get("name"): e.get("value") for e in root.findall("default")}
    for element in root.iter():
        for key, value in element.attrib.items():
            for name, text in defaults.items():
                value = value.replace(f"${name}", text)
            element.set(key, value)
    bsdfs = {e.get("id"): e for e in root.findall("bsdf")}
    shapes, lights, camera = [], [], None
    for element in root:
        kind = f"{element.tag} {element.get('type')}"
        if element.tag in ("default", "integrator", "bsdf"):
            continue
        if kind == "shape ply":
            shapes.append(_shape(element, bsdfs, folder))
        elif kind == "emitter point":
            _only(element, {"position", "intensity"})
            lights.append(PointLight(_triple(_child(element, "position"), "position"), _color(_child(element, "intensity"))))
        elif kind == "sensor perspective":
            camera = camera or _camera(element, *args.size)
        else:
            raise Refusal(f"this converter does not know `{kind}` of {args.scene}")
    if camera is None:
        raise Refusal(f"{args.scene} has no perspective sensor")
    return Scene(shapes, lights, camera)


def _only(element, known):
    for child in element:
        if child.get("name") not in known and child.tag not in known:
            what = child.get("name") or child.get("type") or child.tag
            raise Refusal(f"this converter does not know `{what}` of a {element.tag} {element.get('type')}")


def _child(element, name):
    for child in element:
        if child.get("name") == name:
            return child
    raise Refusal(f"a {element.tag} {element.get('type')} has no `{name}`")


def _numbers(text):
    return tuple(float(n) for n in text.replace(",", " ").split())


def _triple(element, what):
    if element.get("value"):
        numbers = _numbers(element.get("value"))
        return numbers * 3 if len(numbers) == 1 else numbers
    if element.get("x"):
        return tuple(float(element.get(axis)) for axis in "xyz")
    raise Refusal(f"`{what}` has no numbers")


def _color(element):
    if element.tag not in ("rgb", "float"):
        raise Refusal(f"this converter does not know a {element.tag} as `{element.get('name')}`")
    return _triple(element, element.get("name"))


def _shape(element, bsdfs, folder):
    _only(element, {"filename", "to_world", "ref", "bsdf", "emitter"})
    bsdf = element.find("bsdf")
    if bsdf is None:
        reference = element.find("ref")
        bsdf = bsdfs.get(reference.get("id")) if reference is not None else None
    color, alpha = _bsdf(bsdf)
    emitter = element.find("emitter")
    radiance = None
    if emitter is not None:
        _only(emitter, {"radiance"})
        radiance = _color(_child(emitter, "radiance"))
    positions, normals, triangles = _ply(os.path.join(folder, _child(element, "filename").get("value")))
    matrix = _to_world(element.find("transform"))
    positions = positions @ matrix[:3, :3].T + matrix[:3, 3]
    if normals is not None:
        normals = normals @ np.linalg.inv(matrix[:3, :3])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Shape(element.get("id") or "shape", positions, triangles, normals, color, alpha, radiance)


def _bsdf(element):
    if element is None:
        return (0.5, 0.5, 0.5), None
    kind = element.get("type")
    if kind == "twosided":
        return _bsdf(element.find("bsdf"))
    if kind == "diffuse":
        _only(element, {"reflectance"})
        return _color(_child(element, "reflectance")), None
    if kind == "roughconductor":
        _only(element, {"material", "distribution", "alpha", "specular_reflectance"})
        if _child(element, "material").get("value") != "none" or _child(element, "distribution").get("value") != "ggx":
            raise Refusal("this converter knows a roughconductor of material none and distribution ggx only")
        return _color(_child(element, "specular_reflectance")), float(_child(element, "alpha").get("value"))
    raise Refusal(f"this converter does not know the bsdf {kind}")


def _to_world(element):
    matrix = np.eye(4)
    for step in element if element is not None else ():
        here = np.eye(4)
        if step.tag == "matrix":
            here = np.array(_numbers(step.get("value"))).reshape(4, 4)
        elif step.tag == "translate":
            here[:3, 3] = [float(step.get(axis, 0)) for axis in "xyz"]
        elif step.tag == "scale":
            same = step.get("value", "1")
            here[:3, :3] = np.diag([float(step.get(axis, same)) for axis in "xyz"])
        else:
            raise Refusal(f"this converter does not know the transform {step.tag}")
        matrix = here @ matrix
    return matrix


def _camera(element, width, height):
    look = element.find("transform/lookat")
    if look is None:
        raise Refusal("this converter knows a sensor with `lookat` only")
    tangent = math.tan(math.radians(float(_child(element, "fov").get("value"))) / 2)
    axis = next((c.get("value") for c in element if c.get("name") == "fov_axis"), "x")
    axis = {"smaller": "x" if width <= height else "y", "larger": "y" if width <= height else "x"}.get(axis, axis)
    if axis not in ("x", "y"):
        raise Refusal(f"this converter does not know the fov_axis {axis}")
    tan_x = tangent if axis == "x" else tangent * width / height
    at = {name: np.array(_numbers(look.get(name))) for name in ("origin", "target", "up")}
    return Camera(at["origin"], at["target"], at["up"], tan_x, tan_x * height / width)


def _ply(path):
    """Returns positions, normals (or None) and triangles of an ASCII PLY file."""
    with open(path, encoding="latin-1") as file:
        lines = iter(file.read().split("\n"))
    columns, counts, element = [], {}, None
    for line in lines:
        words = line.split()
        if words[:1] == ["format"] and words[1] != "ascii":
            raise Refusal(f"{path}: this converter reads ASCII PLY only")
        if words[:1] == ["element"]:
            element = words[1]
            counts[element] = int(words[2])
        if words[:1] == ["property"] and element == "vertex":
            columns.append(words[-1])
        if words == ["end_header"]:
            break
    if list(counts) != ["vertex", "face"]:
        raise Refusal(f"{path}: this converter reads vertices and faces only")
    vertices = np.array([[float(n) for n in next(lines).split()] for _ in range(counts["vertex"])])
    pick = lambda names: vertices[:, [columns.index(name) for name in names]]
    normals = pick(("nx", "ny", "nz")) if "nx" in columns else None
    triangles = []
    for _ in range(counts["face"]):
        corners = [int(n) for n in next(lines).split()][1:]
        triangles += [(corners[0], corners[i], corners[i + 1]) for i in range(1, len(corners) - 1)]
    return pick(("x", "y", "z")), normals, np.array(triangles)
