"""Blender Cycles on the CPU as a peer of `lightsheaf bench`. With `--denoise` its denoiser filters every
picture."""

import math
import sys
import time

import numpy as np

import mitsuba_scene
import protocol


def material(bpy, name, shape):
    """Creates the material of a shape. Emitters are one-sided, as in Mitsuba."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    if shape.alpha is None:
        surface = nodes.new("ShaderNodeBsdfDiffuse")
        surface.inputs["Roughness"].default_value = 0
    else:
        surface = nodes.new("ShaderNodeBsdfAnisotropic" if hasattr(bpy.types, "ShaderNodeBsdfAnisotropic") else "ShaderNodeBsdfGlossy")
        surface.distribution = "GGX"
        surface.inputs["Roughness"].default_value = math.sqrt(shape.alpha)
    surface.inputs["Color"].default_value = (*shape.color, 1)
    result = surface.outputs[0]
    if shape.radiance is not None:
        side = nodes.new("ShaderNodeNewGeometry")
        front = nodes.new("ShaderNodeMath")
        front.operation = "SUBTRACT"
        front.inputs[0].default_value = 1
        links.new(side.outputs["Backfacing"], front.inputs[1])
        emission = nodes.new("ShaderNodeEmission")
        emission.inputs["Color"].default_value = (*shape.radiance, 1)
        links.new(front.outputs[0], emission.inputs["Strength"])
        add = nodes.new("ShaderNodeAddShader")
        links.new(result, add.inputs[0])
        links.new(emission.outputs[0], add.inputs[1])
        result = add.outputs[0]
    links.new(result, output.inputs["Surface"])
    return made


def build(bpy, mathutils, scene):
    """Adds the scene to the empty Blender file."""
    collection = bpy.context.scene.collection
    for index, shape in enumerate(scene.shapes):
        mesh = bpy.data.meshes.new(f"s{index}")
        mesh.from_pydata(shape.positions.tolist(), [], shape.triangles.tolist())
        if shape.normals is not None:
            mesh.shade_smooth()
            mesh.normals_split_custom_set_from_vertices(shape.normals.tolist())
        mesh.materials.append(material(bpy, f"m{index}", shape))
        collection.objects.link(bpy.data.objects.new(f"o{index}", mesh))
    for index, light in enumerate(scene.lights):
        lamp = bpy.data.lights.new(f"l{index}", "POINT")
        strength = max(light.intensity)
        lamp.color = [c / strength for c in light.intensity]
        # Blender's energy is power; Mitsuba's intensity is power per steradian.
        lamp.energy = 4 * math.pi * strength
        lamp.shadow_soft_size = 0
        placed = bpy.data.objects.new(f"l{index}", lamp)
        placed.location = light.position
        collection.objects.link(placed)
    camera = scene.camera
    seen = bpy.data.cameras.new("camera")
    seen.sensor_fit = "HORIZONTAL"
    seen.angle = 2 * math.atan(camera.tan_x)
    seen.clip_start = 1e-3
    backward = camera.origin - camera.target
    backward /= np.linalg.norm(backward)
    right = np.cross(camera.up, backward)
    right /= np.linalg.norm(right)
    axes = np.eye(4)
    axes[:3, :4] = np.stack([right, np.cross(backward, right), backward, camera.origin], axis=1)
    placed = bpy.data.objects.new("camera", seen)
    placed.matrix_world = mathutils.Matrix(axes.tolist())
    collection.objects.link(placed)
    bpy.context.scene.camera = placed


def start(args):
    import bpy
    import mathutils

    scene = mitsuba_scene.load(args)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    build(bpy, mathutils, scene)
    settings = bpy.context.scene
    settings.render.engine = "CYCLES"
    render_settings, cycles = settings.render, settings.cycles
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = args.denoise
    if args.denoise:
        cycles.denoiser = "OPENIMAGEDENOISE"
    cycles.pixel_filter_type = "BOX"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.blur_glossy = 0
    cycles.light_sampling_threshold = 0
    cycles.caustics_reflective = True
    bounces = 1024 if args.bounces is None else args.bounces
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = bounces
    cycles.use_auto_tile = False
    render_settings.threads_mode = "FIXED"
    render_settings.threads = args.threads
    render_settings.resolution_x, render_settings.resolution_y = args.size
    render_settings.resolution_percentage = 100
    render_settings.film_transparent = False
    settings.view_settings.view_transform = "Raw"
    image = render_settings.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGB", "32"
    image.exr_codec = "NONE"

    def render(samples, seed, path):
        cycles.samples, cycles.seed = samples, seed
        began = time.perf_counter()
        bpy.ops.render.render()
        seconds = time.perf_counter() - began
        bpy.data.images["Render Result"].save_render(path)
        return samples, seconds

    about = f"Blender {bpy.app.version_string} Cycles, CPU, {args.threads} threads{', denoised' if args.denoise else ''}"
    return about, render


if __name__ == "__main__":
    parser = protocol.parser(__doc__)
    parser.add_argument("--denoise", action="store_true")
    sys.exit(protocol.serve(parser.parse_args(), start))
