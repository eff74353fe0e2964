"""Tests of the package: what `render` returns is what the program writes, and errors are the program's."""

import math
import os
import pathlib
import re
import signal
import tempfile
import threading
import time
import unittest

import lightsheaf
import numpy

SCENE = "builtin:cornell_point"
DOCUMENT = pathlib.Path(__file__).parents[2] / "docs" / "python.md"


def reference(scene=SCENE, **options):
    """Renders few samples on the CPU."""
    return lightsheaf.render(scene, **{"method": "reference", "samples": 2, "size": (16, 12), **options})


class Renders(unittest.TestCase):
    """Pictures and their layers."""

    def test_a_picture_is_an_array_that_can_be_written(self):
        picture = reference()
        self.assertEqual((picture.shape, picture.dtype), ((12, 16, 3), numpy.float32))
        self.assertGreater(picture.mean(), 0.0)
        picture *= 2.0

    def test_a_loaded_scene_renders_as_its_file(self):
        scene = lightsheaf.load(SCENE, samples=1, seed=7)
        self.assertTrue((reference(scene) == reference(seed=7)).all(), "options of load are defaults")
        self.assertTrue((reference(scene, env="studio") == reference(env="studio", seed=7)).all(), "it is read again")
        self.assertFalse((reference(scene) == reference(seed=8)).all(), "a canary")
        self.assertTrue(scene.cameras and scene.name)

    def test_layers_are_those_of_the_file(self):
        with tempfile.TemporaryDirectory() as folder:
            files = [os.path.join(folder, "a.exr"), pathlib.Path(folder, "a.png")]
            layers = reference(aov=["albedo", "depth", "direct"], transparent=True, output=files[:1])
            self.assertEqual(layers["picture"].shape, (12, 16, 4))
            self.assertEqual((layers["albedo"].shape, layers["depth"].shape), ((12, 16, 3), (12, 16)))
            stored = lightsheaf.read(files[0])
            self.assertTrue((stored["picture"] == layers["picture"][:, :, :3]).all())
            self.assertTrue((stored["direct"] == layers["direct"]).all())
            reference(output=files)
            self.assertLess(abs(lightsheaf.read(files[1])["picture"].mean() - 0.2), 0.2, "exposed and decoded")

    def test_the_device_renders(self):
        try:
            picture = lightsheaf.render(SCENE, samples=4, size=(32, 32), interleave=1)
        except lightsheaf.Error as error:
            if os.environ.get("REQUIRE_GPU"):
                raise
            self.skipTest(str(error))
        truth = reference(size=(32, 32), samples=64, bounces=2)
        self.assertLess(abs(lightsheaf.compare(picture, truth)["mean_bias"]), 0.2)

    def test_parts_merge_to_the_whole(self):
        with tempfile.TemporaryDirectory() as folder:
            parts = [os.path.join(folder, f"{n}.exr") for n in range(2)]
            for part, samples in zip(parts, ("1..2", "3..4")):
                reference(samples=None, sample_range=samples, output=part)
            out = pathlib.Path(folder, "all.exr")
            lightsheaf.merge(parts, out)
            self.assertLess(lightsheaf.compare(out, reference(samples=4))["rel_mse"], 1e-12)
            with self.assertRaisesRegex(lightsheaf.Error, "both have the samples 1..2; leave one out"):
                lightsheaf.merge([parts[0], parts[0]], out)

    def test_metrics_are_those_of_compare(self):
        image, truth = reference(), reference(samples=16)
        metrics = lightsheaf.compare(image, truth)
        relative = ((image.astype(float) - truth) ** 2 / (truth.astype(float) ** 2 + 0.01)).mean()
        self.assertAlmostEqual(metrics["rel_mse"] / relative, 1.0, places=5)
        image[0, 0, 0] = math.nan
        metrics = lightsheaf.compare(image, truth)
        self.assertTrue(math.isnan(metrics["rel_mse"]) and metrics["non_finite"] == 1)


class Errors(unittest.TestCase):
    """Exceptions, and interrupts."""

    def test_errors_have_the_words_of_the_program(self):
        for options, error, words in [
            ({"no_such_option": 1}, TypeError, "unexpected argument '--no-such-option'"),
            ({"method": "magic"}, TypeError, "invalid value 'magic'"),
            ({"bounces": 65}, lightsheaf.Error, "--bounces 65: has to be 0 to 64"),
            ({"scene": "no-such-file.glb"}, lightsheaf.Error, "no-such-file.glb"),
            ({"samples": None, "frames": "0..2", "fps": 1}, lightsheaf.Error, "--frames: asks for several pictures"),
            ({"checkpoint": 1}, lightsheaf.Error, "give --output"),
        ]:
            with self.subTest(options), self.assertRaisesRegex(error, words) as raised:
                reference(**options)
            self.assertNotIn("Usage", str(raised.exception))
        with self.assertRaisesRegex(lightsheaf.Error, "sizes differ|size"):
            lightsheaf.compare(numpy.zeros((2, 3, 3)), numpy.zeros((3, 3, 3)))
        with self.assertRaisesRegex(TypeError, "three channels"):
            lightsheaf.compare(numpy.zeros((2, 3)), numpy.zeros((2, 3)))

    def test_other_threads_run_and_an_interrupt_stops_the_render(self):
        beats = []
        done = threading.Event()

        def beat():
            while not done.wait(0.01):
                beats.append(time.monotonic())

        # A process in the background of a script is started with interrupts ignored.
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        threads = [threading.Thread(target=beat), threading.Timer(1.0, signal.raise_signal, [signal.SIGINT])]
        began = time.monotonic()
        try:
            for thread in threads:
                thread.start()
            with self.assertRaises(KeyboardInterrupt):
                reference(samples=None, budget=60, size=(128, 128))
        finally:
            done.set()
            for thread in threads:
                thread.join()
            signal.signal(signal.SIGINT, before)
        self.assertLess(time.monotonic() - began, 50.0)
        self.assertGreater(len(beats), 20, "the lock is released while the program renders")


class Document(unittest.TestCase):
    """The examples of docs/python.md."""

    def test_the_examples_run(self):
        text = DOCUMENT.read_text(encoding="utf-8")
        blocks = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
        self.assertGreater(len(blocks), 5)
        before = os.getcwd()
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                names = {}
                for block in blocks:
                    exec(compile(block, str(DOCUMENT), "exec"), names)
            finally:
                os.chdir(before)

    def test_every_option_is_explained(self):
        explained = lightsheaf.options()
        self.assertIn("Number of indirect bounces", explained["bounces"])
        self.assertTrue({"method", "size", "target_error", "aov", "sample_range"} <= set(explained))
        self.assertTrue(all(explained.values()))


if __name__ == "__main__":
    unittest.main()
