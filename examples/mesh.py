"""Saves a mesh of a picture, with nothing but Python's own library.

The mesh is in mesh.model, or in a file of the format asked for.
"""

import json
import os
import sys
import time
import urllib.error
import urllib.parse
import urllib.request

URL = os.environ.get("PIXMESH_URL", "http://127.0.0.1:8080")
ATTEMPTS = 5


class Refused(Exception):
    """A problem document (RFC 9457), as a dictionary in `problem`."""

    def __init__(self, problem):
        super().__init__(f"{problem['title']}: {problem['detail']}")
        self.problem = problem


def mesh(picture, **parameters):
    """The mesh of a picture's bytes in the format asked for, and the figures of the mesh."""
    query = urllib.parse.urlencode(parameters)
    request = urllib.request.Request(f"{URL}/v1/meshes?{query}", data=picture, method="POST")
    request.add_header("Content-Type", "application/octet-stream")
    if key := os.environ.get("PIXMESH_KEY"):
        request.add_header("Authorization", f"Bearer {key}")
    for attempt in range(ATTEMPTS):
        try:
            with urllib.request.urlopen(request) as answer:
                return answer.read(), figures(answer.headers)
        except urllib.error.HTTPError as refusal:
            problem = json.load(refusal)
            wait_s = refusal.headers.get("Retry-After")
            if wait_s is None or attempt == ATTEMPTS - 1:
                raise Refused(problem) from None
            time.sleep(int(wait_s))


def figures(headers):
    """Vertices, faces and PSNR in decibels."""
    return {
        "vertices": int(headers["Mesh-Vertices"]),
        "faces": int(headers["Mesh-Faces"]),
        "psnr": float(headers["Mesh-Psnr"]),
    }


def save(name, body):
    """Writes a file; a former one of the name stays until the new one is whole."""
    part = name + ".part"
    with open(part, "wb") as file:
        file.write(body)
    os.replace(part, name)


def main():
    if len(sys.argv) == 1:
        print("usage: examples/mesh.py PICTURE [NAME=VALUE ...]", file=sys.stderr)
        sys.exit(2)
    path, *pairs = sys.argv[1:]
    with open(path, "rb") as file:
        picture = file.read()
    parameters = dict(pair.split("=", 1) for pair in pairs) or {"density": "2"}
    try:
        body, found = mesh(picture, **parameters)
    except Refused as refused:
        print(json.dumps(refused.problem), file=sys.stderr)
        sys.exit(1)
    save(f"mesh.{parameters.get('format', 'model')}", body)
    print(f"{found['vertices']} vertices, {found['faces']} faces, {found['psnr']:.2f} dB, {len(body)} bytes")


if __name__ == "__main__":
    main()
