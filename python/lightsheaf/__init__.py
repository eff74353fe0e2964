"""Global illumination by rasterization alone: raster bidirectional path tracing with a known error.

`load` reads a scene, `render` makes a NumPy array of it, `compare` measures the error of one image against another,
`merge` joins parts of a render, `read` reads an image file and `options` lists what `render` takes. Options are those
of the command line, by the same names with underscores. docs/python.md explains them with examples.
"""

import json
import os

import numpy

from . import _lightsheaf
from ._lightsheaf import Error

__all__ = ["Error", "Scene", "compare", "load", "merge", "options", "read", "render"]

# Name, help, and whether it may be given several times, of each option of `render`.
_OPTIONS = {name.replace("-", "_"): (about, repeats) for name, about, repeats in _lightsheaf.options("render")}


class Scene:
    """The file of a scene in memory, with the options that it was loaded with, which are the defaults of `render`."""

    def __init__(self, path, **given):
        self.path = os.fspath(path)
        self.options = given
        self._loaded = _lightsheaf.load(_words(self.path, given))

    @property
    def name(self):
        """Name of the scene."""
        return self._loaded.name

    @property
    def cameras(self):
        """Names of the cameras of the file."""
        return self._loaded.cameras

    @property
    def warnings(self):
        """Sentences about what the file has and the renderer does not."""
        return self._loaded.warnings

    def __repr__(self):
        return f"lightsheaf.Scene({self.path!r})"


def load(path, **options):
    """Loads a scene file, or `builtin:NAME`. Options are those of `render`, and become its defaults."""
    return Scene(path, **options)


def render(scene, *, quiet=True, **options):
    """Renders a scene, a `Scene` or the name of a file, and returns an array of float32 of shape (rows, columns, 3) in
    linear Rec. 709, row 0 on top; with `transparent=True` (rows, columns, 4), the last channel being coverage.

    Options are those of `lightsheaf render`, with underscores: `method="path"`, `samples=64`, `size=(640, 360)`. With
    `aov` and `denoise` the result is a dict of arrays: `picture` and each layer by its name. Files are written only
    with `output`. Ctrl-C raises KeyboardInterrupt after the current batch.
    """
    loaded = None
    if isinstance(scene, Scene):
        scene, options, loaded = scene.path, {**scene.options, **options}, scene._loaded
    layers = _arrays(_lightsheaf.render(_words(os.fspath(scene), {**options, "quiet": quiet}), loaded))
    if options.get("transparent"):
        layers["picture"] = numpy.dstack([layers["picture"], layers.pop("A")])
    return layers if options.get("aov") or options.get("denoise") else layers["picture"]


def read(path):
    """Reads an .exr, .hdr or .png as linear float32; returns a dict of arrays, `picture` and each layer by its name."""
    return _arrays(_lightsheaf.read(os.fspath(path)))


def compare(image, reference):
    """Returns the metrics of an image against a reference, as `lightsheaf compare`. Both are arrays or files."""
    metrics = json.loads(_lightsheaf.compare(_image(image), _image(reference)))
    return {name: float("nan") if value is None else value for name, value in metrics.items()}


def merge(parts, out, *, allow_gaps=False):
    """Joins .exr files of parts of the samples to the picture of all of them, as `lightsheaf merge`."""
    words = ["merge", "--quiet", "--output", os.fspath(out)] + (["--allow-gaps"] if allow_gaps else [])
    _lightsheaf.command([*words, "--", *map(os.fspath, parts)])


def options():
    """Returns the options of `render` with their help, by their names in Python."""
    return {name: about for name, (about, _) in _OPTIONS.items() if name not in ("scene", "help")}


def _words(scene, options):
    """Makes the words of the command line of options by their names in Python."""
    words = ["render"]
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        repeats = _OPTIONS.get(name, ("", False))[1]
        if isinstance(value, (bool, numpy.bool_)):
            words += [option] if value else []
        elif repeats and isinstance(value, (list, tuple)):
            words += [f"{option}={_text(name, part)}" for part in value]
        elif value is not None:
            words.append(f"{option}={_text(name, value)}")
    return [*words, "--", scene]


def _text(name, value):
    """Writes a value as the command line does: sizes as 640x360, other lists with commas."""
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    if hasattr(value, "__iter__"):
        return ("x" if name == "size" else ",").join(_text(name, part) for part in value)
    return repr(value.item() if isinstance(value, numpy.generic) else value)


def _arrays(pixels):
    """Makes arrays of the bytes of a picture: one for the colours, and one for each layer."""
    (rows, columns), colours, channels = pixels
    layers = {}
    # Files have their channels in alphabetical order.
    for name, values in sorted(channels, key=lambda channel: "RGBAXYZ".find(channel[0][-1:])):
        layer = name.rpartition(".")[0] or name
        layers.setdefault(layer, []).append(numpy.frombuffer(values, numpy.float32).reshape(rows, columns))
    arrays = {name: numpy.dstack(parts) if len(parts) > 1 else parts[0] for name, parts in layers.items()}
    return {"picture": numpy.frombuffer(colours, numpy.float32).reshape(rows, columns, 3), **arrays}


def _image(image):
    """Returns shape and bytes of the colours of an image, an array or a file."""
    if isinstance(image, (str, os.PathLike)):
        image = read(image)["picture"]
    array = numpy.asarray(image, numpy.float32)
    if array.ndim != 3 or array.shape[2] < 3:
        raise TypeError(f"an image has rows, columns and three channels or more, not the shape {array.shape}")
    return array.shape[:2], numpy.ascontiguousarray(array[:, :, :3]).tobytes()
