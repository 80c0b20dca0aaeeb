#!/usr/bin/env python3
"""Meshes of elevation models within a bound, beside pydelatin and pymartini, as a table in Markdown.

    pip install -r docs/terrain/requirements.txt
    cargo build --release --bin pixmesh --no-default-features --features cli
    docs/terrain/compare.py target/release/pixmesh [MODEL...] [--bounds 5 10 20 50]

The elevation models are one of matplotlib's samples and two generated ones, or those given: arrays of
whole numbers from 0 to 65535 in NumPy files, and pictures, of which the gray levels are the heights. All programs get the middle of each that has 2^k + 1 rows and
columns, because RTIN needs that; --whole takes all of each, without RTIN. An interpolation of its
own, in floating point over each triangle with its border, measures root-mean-square and largest
error of every mesh. The largest error of pixmesh may be over the bound by half a unit, because
max_error bounds the samples of a picture, which are rounded. Seconds are those of the processor, on all
cores, the best of three runs, or of one that takes longer than a second; those of pixmesh are of a whole
process, which reads the model and writes the mesh as well.
"""

import argparse
import json
import math
import pathlib
import resource
import subprocess
import tempfile

import numpy

METHODS = [
    ("fast", ["--method", "preview"]),
    ("default", []),
    ("effort 1", ["--effort", "1"]),
    ("free", ["--connectivity", "free"]),
    ("free, fitted", ["--connectivity", "free", "--values", "fitted"]),
    ("free, effort 1", ["--connectivity", "free", "--effort", "1"]),
]


def jacksboro():
    """The elevation model that comes with matplotlib."""
    from matplotlib import cbook

    with cbook.get_sample_data("jacksboro_fault_dem.npz") as data:
        return data["elevation"]


def ridges(side, seed):
    """Hills with ridges: octaves of interpolated noise, folded."""
    generator = numpy.random.default_rng(seed)
    height = numpy.zeros((side, side))
    for octave in range(2, 8):
        count = 2**octave
        knots = generator.standard_normal((count + 1, count + 1))
        at = numpy.linspace(0, count, side, endpoint=False)
        whole, rest = at.astype(int), at % 1
        rest = rest * rest * (3 - 2 * rest)
        rows = knots[whole] * (1 - rest)[:, None] + knots[whole + 1] * rest[:, None]
        height += (rows[:, whole] * (1 - rest) + rows[:, whole + 1] * rest) / count
    height = numpy.abs(height - height.mean())
    return numpy.round(height / height.max() * 3000)


def fractal(side, seed):
    """A rough surface: noise whose amplitude falls with the frequency to the power of 2.1."""
    generator = numpy.random.default_rng(seed)
    along, across = numpy.fft.fftfreq(side)[:, None], numpy.fft.rfftfreq(side)[None, :]
    frequency = numpy.hypot(along, across)
    frequency[0, 0] = numpy.inf
    noise = numpy.fft.rfft2(generator.standard_normal((side, side)))
    height = numpy.fft.irfft2(noise / frequency**2.1, s=(side, side))
    height -= height.min()
    return numpy.round(height / height.max() * 3000)


def read(path):
    """The array of a NumPy file, or the gray levels of a picture."""
    if path.suffix == ".npy":
        return numpy.load(path)
    from PIL import Image

    return numpy.asarray(Image.open(path).convert("L")).astype(float)


def middle(model):
    """The largest middle part of 2^k + 1 rows and columns."""
    side = 2 ** int(math.log2(min(model.shape) - 1)) + 1
    top, left = ((length - side) // 2 for length in model.shape)
    return model[top : top + side, left : left + side]


def surface(shape, vertices, triangles):
    """The heights of a mesh at all pixels, rows as in the file: triangles of like size at once."""
    heights = numpy.full(shape, numpy.nan)
    corners = vertices[triangles]
    low = corners[:, :, :2].min(axis=1).astype(int)
    extents = (corners[:, :, :2].max(axis=1) - low).max(axis=1) + 1
    sides = 2 ** numpy.ceil(numpy.log2(extents)).astype(int)
    for side in numpy.unique(sides):
        group = numpy.flatnonzero(sides == side)
        rows, columns = numpy.mgrid[:side, :side].reshape(2, -1)
        for part in numpy.array_split(group, len(group) * side * side // 2_000_000 + 1):
            x, y = low[part, :1] + columns, low[part, 1:] + rows
            (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners[part].transpose(1, 2, 0)[..., None]
            area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            b = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
            c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
            inside = (b >= -1e-9) & (c >= -1e-9) & (b + c <= 1 + 1e-9)
            heights[y[inside], x[inside]] = (az + b * (bz - az) + c * (cz - az))[inside]
    return heights


def processor_seconds():
    """Seconds that this process and the ones that it ran took so far."""
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def best(action):
    """The result of an action, and the least of three times that it takes; of one that is long."""
    times = []
    while len(times) < 3 and max(times, default=0) < 1:
        start = processor_seconds()
        result = action()
        times.append(processor_seconds() - start)
    return result, min(times)


def pixmesh(program, folder, model, bound, arguments):
    """Vertices, triangles and seconds of a mesh of this program."""
    source, target = folder / "model.pgm", folder / "model.json"
    rows, columns = model.shape
    source.write_bytes(b"P5 %d %d 65535\n" % (columns, rows) + model.astype(">u2").tobytes())
    command = [program, "mesh", source, "-o", target, "--max-error", str(bound)]
    order = [*command, *arguments]
    _, seconds = best(lambda: subprocess.run(order, check=True, capture_output=True))
    mesh = json.loads(target.read_text())
    vertices = numpy.array(mesh["positions"], dtype=float).reshape(-1, 3)
    vertices[:, 1] = rows - 1 - vertices[:, 1]
    vertices[:, 2] = mesh["samples"]
    return vertices, numpy.array(mesh["triangles"]).reshape(-1, 3), seconds


def delatin(model, bound):
    """The same of greedy insertion by pydelatin."""
    from pydelatin import Delatin

    made, seconds = best(lambda: Delatin(model.astype(numpy.float32), max_error=bound))
    vertices = made.vertices.astype(float)
    vertices[:, 1] = model.shape[0] - 1 - vertices[:, 1]
    return vertices, made.triangles.reshape(-1, 3), seconds


def martini(model, bound):
    """The same of RTIN by pymartini."""
    from pymartini import Martini

    def make():
        tile = Martini(model.shape[0]).create_tile(model.astype(numpy.float32))
        return tile.get_mesh(bound)

    (points, triangles), seconds = best(make)
    points = points.reshape(-1, 2).astype(int)
    heights = model[points[:, 1], points[:, 0]].reshape(-1, 1)
    return numpy.hstack([points, heights]).astype(float), triangles.reshape(-1, 3), seconds


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("models", nargs="*", type=pathlib.Path)
    parser.add_argument("--bounds", nargs="*", type=int, default=[5, 10, 20, 50])
    parser.add_argument("--whole", action="store_true")
    arguments = parser.parse_args()
    models = {path.stem: read(path) for path in arguments.models}
    if not models:
        models = {
            "jacksboro": jacksboro(),
            "ridges": ridges(513, 24),
            "fractal": fractal(513, 24),
        }
    print("| model | bound | mesh | vertices | ÷ delatin | triangles | RMSE | largest error | seconds |")
    print("|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, model in models.items():
            model = model if arguments.whole else middle(model)
            for bound in arguments.bounds:
                meshes = [("delatin", delatin(model, bound))]
                if not arguments.whole:
                    meshes.append(("martini", martini(model, bound)))
                for method, options in METHODS:
                    made = pixmesh(arguments.program, pathlib.Path(folder), model, bound, options)
                    meshes.append((method, made))
                most = len(meshes[0][1][0])
                for label, (vertices, triangles, seconds) in meshes:
                    error = surface(model.shape, vertices, triangles) - model
                    print(
                        f"| {name} {model.shape[1]}x{model.shape[0]} | {bound} | {label} "
                        f"| {len(vertices)} | {len(vertices) / most:.2f} | {len(triangles)} "
                        f"| {numpy.sqrt(numpy.mean(error**2)):.2f} | {numpy.abs(error).max():.2f} "
                        f"| {seconds:.3f} |",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
