#!/usr/bin/env python3
"""Bytes of a pmesh beside PNG, JPEG and WebP of the same PSNR, as tables in Markdown.

    pip install pillow==13.0.0 numpy==2.4.6
    cargo build --release -p pixmesh-cli --bins
    docs/quality/bytes.py target/release/make_model PICTURE... [--gray]

For each density the mesh is made by MGPRFS and by the method optimal at effort 5 (density and
effort are --densities and --effort). Of JPEG and WebP the lowest quality is taken that reaches the
mesh's PSNR, and for JPEG the smaller file of 4:4:4 and 4:2:0; Huffman tables are optimised, WebP
takes its slowest search. PNG knows no loss: its samples are rounded to as few equidistant levels as
reach the PSNR, and the file is the smallest that Pillow makes. PSNR is over all samples. --gray
measures (77 R + 150 G + 29 B + 128) / 256 instead of the colours.
"""

import argparse
import io
import pathlib
import subprocess
import tempfile

import numpy
from PIL import Image


def psnr(original, other):
    """PSNR in decibels of two arrays of 8-bit samples."""
    error = numpy.mean((original.astype(numpy.float64) - other.astype(numpy.float64)) ** 2)
    return 10 * numpy.log10(255**2 / error) if error > 0 else numpy.inf


def encoded(samples, kind, **options):
    """The file of an array of samples, and what is read back from it."""
    file = io.BytesIO()
    Image.fromarray(samples).save(file, kind, **options)
    read = Image.open(io.BytesIO(file.getvalue()))
    return len(file.getvalue()), numpy.asarray(read.convert("L" if samples.ndim == 2 else "RGB"))


def lowest(reaches, least, most):
    """The lowest of whole numbers that reaches, by bisection; None where the highest does not."""
    if not reaches(most):
        return None
    while least < most:
        middle = (least + most) // 2
        least, most = (least, middle) if reaches(middle) else (middle + 1, most)
    return most


def lossy(original, least_db, kind, most, **options):
    """The length of the file of the lowest quality that reaches a PSNR; None when none does."""

    def reaches(quality):
        return psnr(original, encoded(original, kind, quality=quality, **options)[1]) >= least_db

    quality = lowest(reaches, 0, most)
    return None if quality is None else encoded(original, kind, quality=quality, **options)[0]


def jpeg(original, least_db):
    """The smaller file of those with and without the chroma in half the resolution."""
    lengths = [lossy(original, least_db, "JPEG", 95, subsampling=s, optimize=True) for s in (0, 2)]
    return min((length for length in lengths if length is not None), default=None)


def rounded(original, levels):
    """Samples rounded to equidistant levels."""
    steps = numpy.round(original / 255 * (levels - 1))
    return numpy.round(steps * 255 / (levels - 1)).astype(numpy.uint8)


def png(original, least_db):
    """The length of the PNG with the fewest levels that reach a PSNR."""
    levels = lowest(lambda count: psnr(original, rounded(original, count)) >= least_db, 2, 256)
    return encoded(rounded(original, levels), "PNG", optimize=True)[0]


def pmesh(program, picture, options):
    """Vertices, PSNR and bytes of a mesh, and bytes with the order of its vertices."""
    with tempfile.TemporaryDirectory() as folder:
        plain, ordered = pathlib.Path(folder, "mesh.pmesh"), pathlib.Path(folder, "order.pmesh")
        files = ["--pmesh", plain, "--progressive", ordered, "--output", pathlib.Path(folder, "m")]
        command = [program, "--input", picture, "--format", "model", "--stats", *options, *files]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        figures = dict(line.split(maxsplit=1) for line in done.stderr.splitlines())
        sizes = plain.stat().st_size, ordered.stat().st_size
        return int(figures["vertices"]), float(figures["psnr_db"]), *sizes


def rows(program, name, original, picture, arguments):
    """A table's rows for one picture."""
    methods = [("mgprfs", ["--method", "mgprfs"])]
    effort = str(arguments.effort)
    methods.append((f"optimal {effort}", ["--method", "optimal", "--effort", effort]))
    for density in arguments.densities:
        for label, method in methods:
            vertices, reached, bytes_, ordered = pmesh(
                program, picture, [*method, "--density", str(density)]
            )
            # The program prints four decimals.
            least = reached - 1e-4
            others = [
                png(original, least),
                jpeg(original, least),
                lossy(original, least, "WEBP", 100, method=6),
            ]
            cells = [name, label, vertices, f"{reached:.2f}", bytes_, f"{bytes_ / vertices:.2f}"]
            cells += [f"{ordered / vertices:.2f}"]
            cells += ["not reached" if length is None else length for length in others]
            yield "| " + " | ".join(str(cell) for cell in cells) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", help="the program make_model")
    parser.add_argument("pictures", nargs="+", type=pathlib.Path)
    parser.add_argument("--gray", action="store_true")
    parser.add_argument("--effort", type=int, default=5)
    parser.add_argument("--densities", type=float, nargs="+", default=[0.5, 1.0, 2.0, 4.0])
    arguments = parser.parse_args()
    print("| picture | method | vertices | PSNR | pmesh | bytes a vertex | with order | PNG | JPEG | WebP |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for path in arguments.pictures:
        image = Image.open(path)
        gray = image.mode == "L"
        original = numpy.asarray(image if gray else image.convert("RGB"))
        if arguments.gray and not gray:
            weights = numpy.array([77, 150, 29], dtype=numpy.uint32)
            original = ((original @ weights + 128) >> 8).astype(numpy.uint8)
        name = f"{path.stem}-{'gray' if original.ndim == 2 else 'colour'}"
        with tempfile.NamedTemporaryFile(suffix=".png") as picture:
            Image.fromarray(original).save(picture.name)
            for row in rows(arguments.program, name, original, picture.name, arguments):
                print(row, flush=True)


if __name__ == "__main__":
    main()
