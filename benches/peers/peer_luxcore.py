"""LuxCore as a peer of `lightsheaf bench`: `--engine PATHCPU` (default) or `BIDIRCPU`.

LuxCore's metals use another lobe than Mitsuba's, so scenes with conductors are refused. BIDIRCPU limits
the lengths of its two subpaths, not of the whole path, so it supports unlimited bounces only. Its Russian
roulette is biased and is disabled.
"""

import math
import sys
import time

import numpy as np

import mitsuba_scene
import protocol

# Path depth for unlimited bounces. Longer paths contribute nothing.
ENDLESS = 32


def scene_properties(pyluxcore, scene, size):
    """Returns the properties of the scene without its meshes."""
    camera = scene.camera
    told = pyluxcore.Properties()

    def tell(key, *values):
        told.Set(pyluxcore.Property(key, list(values)))

    tell("scene.camera.type", "perspective")
    for key, value in (("orig", camera.origin), ("target", camera.target)):
        tell(f"scene.camera.lookat.{key}", *map(float, value))
    tell("scene.camera.up", *map(float, camera.up))
    tell("scene.camera.fieldofview", 2 * math.degrees(math.atan(min(camera.tan_x, camera.tan_y))))
    tell("scene.camera.autovolume.enable", False)
    # LuxCore's film is shifted by one row, so the screen window is shifted back.
    across, up = (size[0] / min(size), size[1] / min(size))
    row = 2 * up / size[1]
    tell("scene.camera.screenwindow", -across, across, -up - row, up - row)
    tell("scene.camera.cliphither", 1e-4)
    for index, light in enumerate(scene.lights):
        key = f"scene.lights.point{index}"
        tell(f"{key}.type", "point")
        tell(f"{key}.position", *light.position)
        tell(f"{key}.color", *light.intensity)
        # LuxCore's gain is power; Mitsuba's intensity is power per steradian.
        tell(f"{key}.gain", *[4 * math.pi] * 3)
    for index, shape in enumerate(scene.shapes):
        if shape.alpha is not None:
            raise protocol.Refusal("LuxCore's metals use another lobe than Mitsuba's roughconductor")
        tell(f"scene.materials.m{index}.type", "matte")
        tell(f"scene.materials.m{index}.kd", *shape.color)
        if shape.radiance is not None:
            tell(f"scene.materials.m{index}.emission", *shape.radiance)
        tell(f"scene.objects.o{index}.material", f"m{index}")
        tell(f"scene.objects.o{index}.shape", f"s{index}")
    return told




def start(args):
    import pyluxcore

    pyluxcore.Init(lambda message: None)
    if args.engine == "BIDIRCPU" and args.bounces is not None:
        raise protocol.Refusal("BIDIRCPU cannot limit the length of whole paths: give --bounces unlimited")
    scene = mitsuba_scene.load(args)
    told = scene_properties(pyluxcore, scene, args.size)
    made = pyluxcore.Scene()
    for index, shape in enumerate(scene.shapes):
        normals = None if shape.normals is None else [tuple(map(float, n)) for n in shape.normals]
        points = [tuple(map(float, p)) for p in shape.positions]
        triangles = [tuple(map(int, t)) for t in shape.triangles]
        made.DefineMesh(f"s{index}", points, triangles, normals, None, None, None)
    made.Parse(told)
    width, height = args.size
    depth = ENDLESS if args.bounces is None else args.bounces + 2

    def render(samples, seed, path):
        config = pyluxcore.Properties()

        def tell(key, *values):
            config.Set(pyluxcore.Property(key, list(values)))

        tell("renderengine.type", args.engine)
        tell("renderengine.seed", seed + 1)
        tell("native.threads.count", args.threads)
        tell("film.width", width)
        tell("film.height", height)
        tell("film.filter.type", "NONE")
        tell("film.outputs.0.type", "RGB")
        tell("film.outputs.0.filename", "unused.exr")
        tell("film.imagepipelines.0.0.type", "NOP")
        tell("sampler.type", args.sampler)
        tell("batch.haltspp", samples)
        for kind in ("total", "diffuse", "glossy", "specular"):
            tell(f"path.pathdepth.{kind}", depth)
        for side in ("path", "light"):
            tell(f"{side}.maxdepth", depth)
            tell(f"{side}.russianroulette.depth", 1 << 20 if args.engine == "BIDIRCPU" else 5)
        session = pyluxcore.RenderSession(pyluxcore.RenderConfig(config, made))
        began = time.perf_counter()
        session.Start()
        while not session.HasDone():
            time.sleep(0.002)
            session.UpdateStats()
        seconds = time.perf_counter() - began
        taken = session.GetStats().Get("stats.renderengine.pass").GetInt()
        session.Stop()
        buffer = np.zeros(width * height * 3, dtype=np.float32)
        session.GetFilm().GetOutputFloat(pyluxcore.FilmOutputType.RGB, buffer, 0, True)
        # Row 0 of LuxCore's film is at the bottom.
        protocol.write_exr(path, buffer.reshape(height, width, 3)[::-1])
        return max(taken, samples), seconds

    about = f"LuxCore {pyluxcore.Version()}, {args.engine}, {args.sampler} sampler, {args.threads} threads"
    return about, render


if __name__ == "__main__":
    parser = protocol.parser(__doc__)
    parser.add_argument("--engine", choices=("PATHCPU", "BIDIRCPU"), default="PATHCPU")
    parser.add_argument("--sampler", choices=("SOBOL", "RANDOM", "METROPOLIS"), default="SOBOL")
    sys.exit(protocol.serve(parser.parse_args(), start))
