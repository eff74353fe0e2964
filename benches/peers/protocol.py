"""Common parts of all peers: command line, text protocol of `lightsheaf bench` (src/bench/peer.rs), EXR
files."""

import argparse
import os
import struct
import sys
import tempfile
import traceback


class Refusal(Exception):
    """Raised if a peer does not support a scene, a setting or the machine. The report shows the text."""


class _Answers:
    """Original standard output. The output of libraries is redirected to standard error."""

    def __init__(self):
        self.file = os.fdopen(os.dup(1), "w")
        os.dup2(2, 1)

    def say(self, word, text):
        self.file.write(f"{word} {' '.join(str(text).split())}\n")
        self.file.flush()


def parser(about):
    """Returns a parser of the common arguments: scene, size, bounces (None if unlimited) and threads."""

    def size(text):
        width, height = text.split("x")
        return int(width), int(height)

    def bounces(text):
        return None if text == "unlimited" else int(text)

    made = argparse.ArgumentParser(description=about)
    made.add_argument("--scene", required=True)
    made.add_argument("--size", required=True, type=size)
    made.add_argument("--bounces", required=True, type=bounces)
    made.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count())
    return made


def serve(args, start):
    """Serves requests until the end of the input. `start(args)` returns a description of the program and a
    function `render(samples, seed, path)`, which writes the picture as EXR to `path` and returns the
    number of samples taken and the seconds of rendering."""
    answers = _Answers()
    try:
        about, render = start(args)
        with tempfile.TemporaryDirectory() as folder:
            render(1, 0, os.path.join(folder, "warm-up.exr"))
        answers.say("ready", about)
        for line in sys.stdin:
            words = line.rstrip("\n").split(" ", 3)
            if len(words) != 4 or words[0] != "render":
                raise Refusal(f"`{line.strip()}` is not `render SAMPLES SEED FILE`")
            samples, seconds = render(int(words[1]), int(words[2]), words[3])
            answers.say("done", f"{samples} {seconds:.9f}")
    except Refusal as refusal:
        answers.say("error", refusal)
        return 1
    except Exception as error:  # The report shows any error of a library.
        traceback.print_exc()
        answers.say("error", f"{type(error).__name__}: {error}")
        return 1
    return 0


def write_exr(path, picture):
    """Writes a picture as OpenEXR: scan lines, no compression, channels B, G, R of 32-bit floats.
    `picture` is a numpy array of linear RGB of shape (height, width, 3), row 0 at the top."""
    import numpy as np

    height, width, _ = picture.shape
    rows = np.ascontiguousarray(picture[:, :, 2::-1].transpose(0, 2, 1), dtype="<f4")

    def attribute(name, kind, value):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value

    channel = b"".join(name + b"\0" + struct.pack("<iiii", 2, 0, 1, 1) for name in (b"B", b"G", b"R")) + b"\0"
    box = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    header = b"".join(
        (
            struct.pack("<ii", 20000630, 2),
            attribute("channels", "chlist", channel),
            attribute("compression", "compression", b"\0"),
            attribute("dataWindow", "box2i", box),
            attribute("displayWindow", "box2i", box),
            attribute("lineOrder", "lineOrder", b"\0"),
            attribute("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
            attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0.0, 0.0)),
            attribute("screenWindowWidth", "float", struct.pack("<f", 1.0)),
            b"\0",
        )
    )
    line = 8 + width * 12
    first = len(header) + 8 * height
    part = f"{path}.part"
    with open(part, "wb") as file:
        file.write(header)
        file.write(b"".join(struct.pack("<Q", first + y * line) for y in range(height)))
        for y in range(height):
            file.write(struct.pack("<ii", y, width * 12))
            file.write(rows[y].tobytes())
    os.replace(part, path)
