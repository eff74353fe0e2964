"""Mitsuba 3 as a peer of `lightsheaf bench`: `--integrator path` (default) or `ptracer`, `--sampler
multijitter` (default, and its best).

A shared library of LLVM 16 or later is needed (LLVM 15 crashes on some processors): the one in
DRJIT_LIBLLVM_PATH, the system's libLLVM, or that of a Rust toolchain.
"""

import glob
import os
import re
import subprocess
import sys
import time
from xml.etree import ElementTree

import protocol


def llvm():
    """Returns the path of the newest installed LLVM library of version 16 or later, or None."""
    places = ["/usr/lib/*/libLLVM*.so*", "/usr/lib/llvm-*/lib/libLLVM*.so*", "/usr/lib64/libLLVM*.so*", "/opt/homebrew/opt/llvm/lib/libLLVM*.dylib"]
    try:
        sysroot = subprocess.run(["rustc", "--print", "sysroot"], capture_output=True, text=True, check=True).stdout.strip()
        places.append(os.path.join(sysroot, "lib", "libLLVM*.so*"))
    except (OSError, subprocess.CalledProcessError):
        pass  # Without Rust only the system's libraries are searched.
    found = []
    for path in (path for place in places for path in glob.glob(place)):
        version = re.search(r"libLLVM(?:-|\.so\.|\.)?(\d+)", os.path.basename(path))
        # Small files of that name are linker scripts.
        if version and int(version.group(1)) >= 16 and os.path.getsize(path) > 1 << 20:
            found.append((int(version.group(1)), path))
    return max(found, default=(0, None))[1]


def start(args):
    if not args.scene.endswith(".xml"):
        raise protocol.Refusal(f"{args.scene} is no Mitsuba scene")
    if "DRJIT_LIBLLVM_PATH" not in os.environ:
        library = llvm()
        if library is None:
            raise protocol.Refusal("no LLVM 16 or later: install one (on Debian: apt-get install libllvm19), or name its library in DRJIT_LIBLLVM_PATH")
        os.environ["DRJIT_LIBLLVM_PATH"] = library
    import drjit
    import mitsuba
    import numpy

    drjit.set_thread_count(args.threads)
    mitsuba.set_variant("llvm_ad_rgb")
    mitsuba.file_resolver().append(os.path.dirname(os.path.abspath(args.scene)))
    scene = mitsuba.load_string(with_our_film(args))
    sensor, integrator = scene.sensors()[0], scene.integrator()

    def render(samples, seed, path):
        began = time.perf_counter()
        image = mitsuba.render(scene, sensor=sensor, integrator=integrator, spp=samples, seed=seed)
        picture = numpy.array(image)
        seconds = time.perf_counter() - began
        protocol.write_exr(path, picture[:, :, :3])
        # Some samplers round the number of samples up.
        return sensor.sampler().sample_count(), seconds

    library = os.path.basename(os.environ["DRJIT_LIBLLVM_PATH"])
    about = f"Mitsuba {mitsuba.__version__}, llvm_ad_rgb, {library}, {args.threads} threads, {args.integrator}, {args.sampler} sampler"
    return about, render


def with_our_film(args):
    """Returns the scene's XML with our integrator, and with our film and sampler in its first sensor."""
    root = ElementTree.parse(args.scene).getroot()
    sensor = root.find("sensor")
    if sensor is None:
        raise protocol.Refusal(f"{args.scene} has no sensor of its own")
    for parent, tag in ((root, "integrator"), (sensor, "film"), (sensor, "sampler")):
        for old in parent.findall(tag):
            parent.remove(old)
    depth = -1 if args.bounces is None else args.bounces + 2
    width, height = args.size
    integrator = ElementTree.SubElement(root, "integrator", type=args.integrator)
    ElementTree.SubElement(integrator, "integer", name="max_depth", value=str(depth))
    ElementTree.SubElement(integrator, "integer", name="rr_depth", value=str(args.rr_depth))
    ElementTree.SubElement(sensor, "sampler", type=args.sampler)
    film = ElementTree.SubElement(sensor, "film", type="hdrfilm")
    ElementTree.SubElement(film, "integer", name="width", value=str(width))
    ElementTree.SubElement(film, "integer", name="height", value=str(height))
    ElementTree.SubElement(film, "string", name="pixel_format", value="rgb")
    ElementTree.SubElement(film, "string", name="component_format", value="float32")
    ElementTree.SubElement(film, "rfilter", type="box")
    return ElementTree.tostring(root, encoding="unicode")


if __name__ == "__main__":
    parser = protocol.parser(__doc__)
    parser.add_argument("--integrator", choices=("path", "ptracer"), default="path")
    parser.add_argument("--sampler", choices=("independent", "stratified", "multijitter", "orthogonal", "ldsampler"), default="multijitter")
    parser.add_argument("--rr-depth", type=int, default=5, help="depth from which paths play Russian roulette")
    sys.exit(protocol.serve(parser.parse_args(), start))
